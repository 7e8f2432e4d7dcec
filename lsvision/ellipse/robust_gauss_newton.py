"""Ellipses good enough to look around with: stable on short arcs, biased a little, fast.

An arc of 40 deg leaves the tilt of a free ellipse almost undetermined, and a fit that runs off
to a needle recognises nothing. Here a weak prior (few pipes are tilted by more than 60 deg)
holds the difference of the semi-axes; on a long arc the data overrule it.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dposv

from lsvision.ellipse.parameters import PARAMETERS, is_ellipse, parameter_jacobian
from lsvision.shapes import FloatArray, IntArray
from lsvision.shapes.noisy_points import ComplexArray, NoisyPoints
from lsvision.statistics.robust import MAD_TO_STD, upper_median

FLATTENING_PRIOR_STD = 0.15
"""One sigma of (a - b) / (a + b) before the data speak: 0.13 is a tilt of 40 deg."""
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

    def __getitem__(self, which: IntArray) -> "EllipseResiduals":
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
    steepness = np.abs(n)
    n /= steepness
    # Along the ray the ellipse is at m det / size; times the ray's cosine with n.
    signed = (size - m * (1 - abs(d) ** 2)) / steepness
    variances = points.normal_variances(n)
    tolerant = variances + (2 * VARIANCE_FLOOR_FRACTION) * points.mean_variance
    return EllipseResiduals(signed, n, w, variances, tolerant)


def cauchy_variances(signed: FloatArray, variances: FloatArray) -> FloatArray:
    """Variances that grow with the square of the residual: Cauchy's weights. Units: mm^2.

    The foot of a weld bead at a flank, where n' Sigma n is small, would else pull the whole
    ellipse to itself, and the next step far beyond. The median tells the scatter of the rest.
    """
    squares = signed * signed
    scatter = max(upper_median(squares / variances) * MAD_TO_STD**2, 1.0)
    return variances + squares / (CAUCHY_SCALE_SIGMAS**2 * scatter)


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
    rows = compared.jacobian()
    weighted = rows / cauchy_variances(compared.residuals, compared.inflated_variances)
    information, right = weighted @ rows.T, weighted @ compared.residuals
    m = float(parameters[2])
    held = 1 / (FLATTENING_PRIOR_STD * 2 * m) ** 2
    information[3, 3] += held
    information[4, 4] += held
    right[3:] -= held * parameters[3:]
    damped = information + IDENTITY / (MAX_RELATIVE_STEP * m) ** 2
    nearer = parameters + solve_positive_definite(damped, right)
    if not is_ellipse(nearer):
        return np.full(PARAMETERS, np.nan), np.full((PARAMETERS, PARAMETERS), np.nan)
    return nearer, solve_positive_definite(information, IDENTITY)


def solve_positive_definite(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solution of a symmetric positive definite system; NaN where the matrix is none."""
    _, solution, failed = dposv(matrix, right)
    return np.full_like(solution, np.nan) if failed else solution
