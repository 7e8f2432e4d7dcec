"""Robust ellipse fit for detection: fast and stable on short arcs, with a small bias.

An arc of 40 deg hardly determines the tilt of a free ellipse, whose fit may degenerate to a
straight line. Here a weak prior (few pipes are tilted by more than 60 deg) limits the difference
of the semi-axes; on a long arc it has no effect.
"""

import math
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.parameters import PARAMETERS, is_ellipse, parameter_jacobian
from lsvision.geometry import FloatArray, IntArray
from lsvision.geometry.arrays import TINY
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.statistics.compiled_routines import dposv
from lsvision.statistics.robust import MAD_TO_STD, SIGNIFICANT_SIGMAS, upper_median

FLATTENING_PRIOR_STD = 0.3
"""Prior standard deviation of (a - b) / (a + b): a tilt of 57 deg."""
IDENTITY = np.eye(PARAMETERS)
MAX_RELATIVE_STEP = 0.1
"""Damping: a step of this fraction of m costs as much as a residual of one sigma."""
VARIANCE_FLOOR_FRACTION = 0.05
"""Fraction of the total variance added along any normal: as for a normal that is 13 deg wrong."""


class EllipseResiduals(NamedTuple):
    """Residuals of points from an ellipse, to first order.

    Parameters
    ----------
    residuals : (n,) ndarray
        Orthogonal distance, positive outside; its error is of second order near the ellipse.
        Units: mm.
    normals, w : (n,) complex ndarray
        Outward unit normal, and unit vector of c + E w, where the ray from the centre meets the
        ellipse.
    variances : (n,) ndarray
        Variance of the points' errors along these normals, n' Sigma n. Units: mm^2.
    inflated_variances : (n,) ndarray
        These variances plus `VARIANCE_FLOOR_FRACTION` of the total variance: on a steep flank
        n' Sigma n almost vanishes, and with a normal a few degrees wrong a single point would
        dominate the fit. Units: mm^2.
    """

    residuals: FloatArray
    normals: ComplexArray
    w: ComplexArray
    variances: FloatArray
    inflated_variances: FloatArray

    def rows(self, which: IntArray | slice) -> "EllipseResiduals":
        """Return the residuals of some points."""
        residuals, normals, w, variances, inflated = self
        return EllipseResiduals(
            residuals[which], normals[which], w[which], variances[which], inflated[which]
        )


def ellipse_residuals(points: NoisyPoints, parameters: FloatArray) -> EllipseResiduals:
    """Return the residuals of points from an ellipse (see `lsvision.ellipse.parameters`).

    The symmetric matrix E / m acts on w as w + d conj(w), with d = (p + iq) / m, and its adjugate,
    from which the inverse and the normals follow, as w - d conj(w).
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
    inflated = variances + (2 * VARIANCE_FLOOR_FRACTION) * points.mean_variance
    return EllipseResiduals(signed, n, w, variances, inflated)


class WeightedSystem(NamedTuple):
    """Linearised least-squares problem of the residuals from an ellipse.

    Parameters
    ----------
    rows : (6, n) ndarray
        Jacobian (5, n), then the residuals.
    weights : (n,) ndarray
        Inverse variances. Units: 1/mm^2.
    """

    rows: FloatArray
    weights: FloatArray

    @classmethod
    def of(cls, compared: EllipseResiduals, variance_factor: float) -> "WeightedSystem":
        """Return the system with Cauchy's weights: a residual of 3 sigma halves a point's.

        Otherwise the foot of a weld bead on a flank, where n' Sigma n is small, would dominate the
        fit, and the next step would diverge.
        """
        rows = np.empty((PARAMETERS + 1, len(compared.residuals)))
        parameter_jacobian(compared.normals, compared.w, out=rows[:PARAMETERS])
        rows[PARAMETERS] = compared.residuals
        variances = compared.residuals * compared.residuals
        variances *= 1 / SIGNIFICANT_SIGMAS**2
        variances += variance_factor * compared.inflated_variances
        return cls(rows, 1 / variances)

    def normal_equations(self, which: slice | IntArray = slice(None)) -> FloatArray:
        """Return the normal equations of some points, (5, 6): information, then gradient."""
        rows = self.rows[:, which]
        equations: FloatArray = (rows[:PARAMETERS] * self.weights[which]) @ rows.T
        return equations


def add_flattening_prior(equations: FloatArray, parameters: FloatArray) -> None:
    """Add the weak prior that few pipes are tilted by more than 60 deg, in place."""
    weight = 1 / (FLATTENING_PRIOR_STD * float(parameters[2])) ** 2
    for i in range(PARAMETERS)[-2:]:
        equations[i, i] += weight
        equations[i, PARAMETERS] -= weight * float(parameters[i])


def damped_step(equations: FloatArray, parameters: FloatArray) -> FloatArray:
    """Return the step (5,) to the minimum, damped in units of the ellipse's m; NaN if singular."""
    damping = 1 / (MAX_RELATIVE_STEP * float(parameters[2])) ** 2
    damped = equations[:, :PARAMETERS] + damping * IDENTITY
    return solve_positive_definite(damped, equations[:, PARAMETERS])


def inverse_information(equations: FloatArray) -> FloatArray:
    """Return the covariance (5, 5) of the parameters; NaN if singular. Units: mm^2."""
    return solve_positive_definite(equations[:, :PARAMETERS], IDENTITY)


def refine_ellipse(points: NoisyPoints, parameters: FloatArray, steps: int) -> FloatArray:
    """Refine an ellipse by robust, weighted Gauss-Newton steps with a prior on its flattening.

    Parameters
    ----------
    points : NoisyPoints
        Points of the arc.
    parameters : (5,) ndarray
        Initial guess; see `lsvision.ellipse.parameters`. Units: mm.
    steps : int
        Number of Gauss-Newton steps.

    Returns
    -------
    (5,) ndarray
        Refined parameters, NaN where a step gives no ellipse. Units: mm.
    """
    for _ in range(steps):
        if math.isnan(parameters[0]):
            break
        parameters = gauss_newton_step(ellipse_residuals(points, parameters), parameters)
    return parameters


def gauss_newton_step(compared: EllipseResiduals, parameters: FloatArray) -> FloatArray:
    """Return the parameters after one step of `refine_ellipse`; NaN if they are not an ellipse."""
    squares = compared.residuals * compared.residuals / compared.inflated_variances
    factor = max(upper_median(squares) * MAD_TO_STD**2, 1.0)
    equations = WeightedSystem.of(compared, factor).normal_equations()
    add_flattening_prior(equations, parameters)
    refined = parameters + damped_step(equations, parameters)
    return refined if is_ellipse(refined) else np.full(PARAMETERS, np.nan)


def solve_positive_definite(matrix: FloatArray, rhs: FloatArray) -> FloatArray:
    """Solve a symmetric positive definite system; NaN if the matrix is not positive definite."""
    _, solution, failed = dposv(matrix, rhs)
    return np.full_like(solution, np.nan) if failed else solution
