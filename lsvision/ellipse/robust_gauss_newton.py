"""Ellipses good enough to look around with: stable on short arcs, biased a little, fast.

An arc of 40 deg leaves the tilt of a free ellipse almost undetermined, and a fit that runs off
to a needle recognises nothing. Here a weak prior (few pipes are tilted by more than 60 deg)
holds the difference of the semi-axes; on a long arc the data overrule it.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv

from lsvision.ellipse.parameters import PARAMETERS, is_ellipse, parameter_jacobian
from lsvision.geometry import FloatArray, IntArray
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.statistics.robust import MAD_TO_STD, upper_median

FLATTENING_PRIOR_STD = 0.3
"""Standard deviation of (a - b) / (a + b) before the data speak: a tilt of 57 deg."""
TINY = 1e-300
IDENTITY = np.eye(PARAMETERS)
MAX_RELATIVE_STEP = 0.1
"""Damping: a step of this share of the size is as dear as a misfit of one sigma."""
CAUCHY_SCALE_SIGMAS = 3.0
"""A point so far off has half its weight."""
VARIANCE_FLOOR_FRACTION = 0.05
"""Share of the total variance that counts along any normal: one 13 deg off."""


@dataclass(frozen=True, eq=False, slots=True)
class EllipseResiduals:
    """Points compared with an ellipse, to first order.

    Parameters
    ----------
    residuals : (n,) ndarray
        Orthogonal distance, positive outside; exact at the ellipse, right to second order near
        it. Units: mm.
    normals, w : (n,) complex ndarray
        Outward unit normal, and unit vector of c + E w, where the ray from the centre meets the
        ellipse.
    variances : (n,) ndarray
        Of the points' errors along these normals, n' Sigma n. Units: mm^2.
    inflated_variances : (n,) ndarray
        The same where a normal is itself not yet known well: at a grazing flank n' Sigma n
        almost vanishes, and a normal a few degrees off would give that point all the weight;
        `VARIANCE_FLOOR_FRACTION` of the total variance is added. Units: mm^2.
    """

    residuals: FloatArray
    normals: ComplexArray
    w: ComplexArray
    variances: FloatArray
    inflated_variances: FloatArray

    def __getitem__(self, which: IntArray | slice) -> "EllipseResiduals":
        return EllipseResiduals(
            self.residuals[which],
            self.normals[which],
            self.w[which],
            self.variances[which],
            self.inflated_variances[which],
        )

    def jacobian(self) -> FloatArray:
        """How far the ellipse moves along each normal, by each parameter: (5, n)."""
        return parameter_jacobian(self.normals, self.w)

    def prediction_variances(self, covariance: FloatArray) -> FloatArray:
        """What an ellipse of that covariance, (5, 5), does not know along each normal. mm^2."""
        return propagated_variances(self.jacobian(), covariance)


def propagated_variances(rows: FloatArray, covariance: FloatArray) -> FloatArray:
    """Variance of each column of rows, (5, n), times parameters of that covariance."""
    variances: FloatArray = ((covariance @ rows) * rows).sum(axis=0)
    return variances


def ellipse_residuals(points: NoisyPoints, parameters: FloatArray) -> EllipseResiduals:
    """Points compared with an ellipse (see `lsvision.ellipse.parameters`).

    The symmetric matrix E / m acts on w as w + d conj(w), with d = (p + iq) / m, and its adjugate,
    which the inverse and the normals are made of, as w - d conj(w).
    """
    x, y, m, p, q = parameters.tolist()
    d, offset = complex(p, q) / m, points.z - complex(x, y)
    w = offset - d * offset.conj()
    size = np.maximum(np.abs(w), TINY)
    w /= size
    n = w - d * w.conj()
    steepness = np.maximum(np.abs(n), TINY)
    n /= steepness
    # Along the ray the ellipse is at m det / size; times the ray's cosine with n.
    signed = (size - m * (1 - abs(d) ** 2)) / steepness
    variances = points.normal_variances(n)
    tolerant = variances + (2 * VARIANCE_FLOOR_FRACTION) * points.mean_variance
    return EllipseResiduals(signed, n, w, variances, tolerant)


class NormalEquations(NamedTuple):
    """Normal equations of an ellipse: information (5, 5) and gradient (5,)."""

    information: FloatArray
    gradient: FloatArray

    def __add__(self, other: "NormalEquations") -> "NormalEquations":  # type: ignore[override]
        """Of both sets of points."""
        return NormalEquations(self.information + other.information, self.gradient + other.gradient)

    def with_flattening_prior(self, parameters: FloatArray) -> "NormalEquations":
        """With the weak prior that few pipes are tilted by more than 60 deg."""
        information, gradient = self.information.copy(), self.gradient.copy()
        weight = 1 / (FLATTENING_PRIOR_STD * float(parameters[2])) ** 2
        information[3, 3] += weight
        information[4, 4] += weight
        gradient[3:] -= weight * parameters[3:]
        return NormalEquations(information, gradient)

    def damped_step(self, parameters: FloatArray) -> FloatArray:
        """Step (5,) towards the minimum, damped on the scale of the ellipse; NaN if singular."""
        damping = 1 / (MAX_RELATIVE_STEP * float(parameters[2])) ** 2
        return solve_positive_definite(self.information + damping * IDENTITY, self.gradient)


class WeightedSystem(NamedTuple):
    """Jacobian (5, n), weights (n,) and residuals (n,) of points compared with an ellipse."""

    jacobian: FloatArray
    weights: FloatArray
    residuals: FloatArray

    @classmethod
    def of(cls, compared: EllipseResiduals, variance_factor: float) -> "WeightedSystem":
        """Cauchy's weights: scaled variances that grow with the square of the residual.

        The foot of a weld bead at a flank, where n' Sigma n is small, would else pull the whole
        ellipse to itself, and the next step far beyond.
        """
        squares = compared.residuals * compared.residuals
        squares *= 1 / CAUCHY_SCALE_SIGMAS**2
        weights = 1 / (variance_factor * compared.inflated_variances + squares)
        return cls(compared.jacobian(), weights, compared.residuals)

    def normal_equations(self, which: slice | IntArray) -> NormalEquations:
        """Normal equations of some of the points."""
        rows = self.jacobian[:, which]
        weighted = rows * self.weights[which]
        return NormalEquations(weighted @ rows.T, weighted @ self.residuals[which])


def refine_ellipse(
    points: NoisyPoints, parameters: FloatArray, steps: int
) -> tuple[FloatArray, FloatArray]:
    """A few Gauss-Newton steps of the robust weighted fit, the tilt held by its prior.

    Parameters
    ----------
    points : NoisyPoints
        Of the arc.
    parameters : (5,) ndarray
        Start; see `lsvision.ellipse.parameters`. Units: mm.
    steps : int
        Gauss-Newton steps, at least one.

    Returns
    -------
    parameters : (5,) ndarray
        NaN where the iteration breaks down.
    covariance : (5, 5) ndarray
        Of the parameters, before the last step. Units: mm^2.
    """
    parameters, covariance = gauss_newton_step(ellipse_residuals(points, parameters), parameters)
    for _ in range(steps - 1):
        if math.isnan(parameters[0]):
            break
        parameters, covariance = gauss_newton_step(
            ellipse_residuals(points, parameters), parameters
        )
    return parameters, covariance


def gauss_newton_step(
    compared: EllipseResiduals, parameters: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """One Gauss-Newton step of `refine_ellipse`, from points compared with the ellipse."""
    squares = compared.residuals * compared.residuals / compared.inflated_variances
    system = WeightedSystem.of(compared, max(upper_median(squares) * MAD_TO_STD**2, 1.0))
    equations = system.normal_equations(slice(None)).with_flattening_prior(parameters)
    nearer = parameters + equations.damped_step(parameters)
    if not is_ellipse(nearer):
        return np.full(PARAMETERS, np.nan), np.full((PARAMETERS, PARAMETERS), np.nan)
    return nearer, solve_positive_definite(equations.information, IDENTITY)


def solve_positive_definite(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solution of a symmetric positive definite system; NaN where the matrix is none."""
    _, solution, failed = dposv(matrix, right)
    return np.full_like(solution, np.nan) if failed else solution
