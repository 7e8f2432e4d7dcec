"""Robust ellipse fit for detection: fast, and stable on short arcs, with a small bias.

An arc of 40 deg hardly determines the tilt: without a constraint the fit may degenerate to a
straight line. A weak prior (few pipes are tilted by more than 60 deg) limits the difference of the
semi-axes; on a long arc it has no effect.

The functions take one arc, or a stack of k arcs as arrays with a leading axis: parameters (5,) or
(k, 5), points (n,) or (k, n).
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.parameters import (
    PARAMETERS,
    is_ellipse,
    parameter_jacobian,
    split_parameters,
)
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.geometry.arrays import TINY, as_column
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.statistics.compiled_routines import dposv
from lsvision.statistics.robust import MAD_TO_STD, SIGNIFICANT_SIGMAS, upper_median

FLATTENING_PRIOR_STD = 0.3
"""Prior standard deviation of (a - b) / (a + b): a tilt of 57 deg."""
IDENTITY = np.eye(PARAMETERS)
"""Identity matrix of the size of an information matrix."""
FLATTENING_INFORMATION = np.diag([0, 0, 0, 1, 1, 0])[:PARAMETERS] / FLATTENING_PRIOR_STD**2
"""Normal equations (5, 6) of the prior on the flattening, at a circle with m = 1 mm."""
FLATTENING_DIAGONAL = FLATTENING_INFORMATION.sum(axis=1, keepdims=True)
"""Information of the prior on the flattening about each parameter, (5, 1), for m = 1 mm."""
DAMPING_STEP_FRACTION = 0.1
"""Step, as a fraction of m, whose damping costs as much as a residual of one sigma. Of 1920
simulated arcs, many of them short or sparse, 1508 become cylinders; with 0.07 1504, with 0.14 1516,
with 0.01 1472, and with 10, nearly without damping, 1470."""
DAMPING_AND_PRIOR_INFORMATION = (
    IDENTITY / DAMPING_STEP_FRACTION**2 + FLATTENING_INFORMATION[:, :PARAMETERS]
)
"""Information of the damping and of the prior on the flattening, for m = 1 mm. Units: 1/mm^2."""
VARIANCE_FLOOR_FRACTION = 0.05
"""Fraction of a point's total variance that is added to the variance along any normal, as for a
normal with an error of 13 deg."""


class EllipseResiduals(NamedTuple):
    """Residuals of points from an ellipse, to first order.

    Parameters
    ----------
    residuals : (..., n) ndarray
        Orthogonal distance, positive outside; its error is of second order near the ellipse.
        Units: mm.
    normals, w : (..., n) complex ndarray
        Outward unit normal, and unit vector w, of the point c + E w where the ray from the centre
        meets the ellipse.
    variances : (..., n) ndarray
        Variance of the points' errors along these normals, n' Sigma n. Units: mm^2.
    inflated_variances : (..., n) ndarray
        These variances plus `VARIANCE_FLOOR_FRACTION` of the total variance. On a steep flank
        n' Sigma n is almost zero, so that without this addition a single point, with an error of
        a few degrees in its normal, would dominate the fit. Units: mm^2.
    """

    residuals: FloatArray
    normals: ComplexArray
    w: ComplexArray
    variances: FloatArray
    inflated_variances: FloatArray

    @property
    def normalised_squares(self) -> FloatArray:
        """Squared residuals divided by the inflated variances, (..., n)."""
        return self.residuals * self.residuals / self.inflated_variances


def ellipse_residuals(points: NoisyPoints, parameters: FloatArray) -> EllipseResiduals:
    """Return the residuals of points (..., n) from ellipses (..., 5), in mm.

    For the parameters and E see `lsvision.ellipse.parameters`. E / m acts on w as w + e conj(w),
    with e = (p + iq) / m; its adjugate adj, the inverse times the determinant 1 - |e|^2, acts as
    w - e conj(w). For a point with the offset o from the centre,

        w = adj o / |adj o|,    n = adj w / |adj w|,

    the ray from the centre meets the ellipse at E w = m (1 - |e|^2) / |adj o| times o, and
    o . n = |adj o| / |adj w|, because adj is symmetric. So the residual is

        (o - E w) . n = (|adj o| - m (1 - |e|^2)) / |adj w|.
    """
    centre, m, d = split_parameters(parameters)
    e = d / m
    offset = points.z - centre
    w = offset - e * offset.conj()
    size = np.maximum(np.abs(w), TINY)  # |adj o|
    w *= (1 / size).astype(complex)
    n = w - e * w.conj()
    scale = 1 / np.maximum(np.abs(n), TINY)  # 1 / |adj w|
    n *= scale.astype(complex)
    signed = (size - (m - m * (e * e.conjugate()).real)) * scale
    variances = points.normal_variances(n)
    inflated = variances + (2 * VARIANCE_FLOOR_FRACTION) * points.mean_variance
    return EllipseResiduals(signed, n, w, variances, inflated)


def compute_arc_lengths(
    z: ComplexArray, residuals: FloatArray, normals: ComplexArray
) -> FloatArray:
    """Return the arc lengths (..., n) from the foot of the first point to those of all. Units: mm.

    `z` are points x + iy, `residuals` and unit `normals` those of their feet on an ellipse.
    """
    feet = z - residuals.astype(complex) * normals
    steps = np.zeros(feet.shape)
    np.abs(feet[..., 1:] - feet[..., :-1], out=steps[..., 1:])
    return steps.cumsum(axis=-1)


def ray_normal_variances(points: NoisyPoints, parameters: FloatArray) -> FloatArray:
    """Return only the variances (..., n) of `ellipse_residuals`. Units: mm^2."""
    centre, m, d = split_parameters(parameters)
    offset = points.z - centre
    # The direction of n of `ellipse_residuals`, m^2 adj adj o, without the unit vector w.
    n = (m * m + (d * d.conjugate()).real) * offset
    n -= (2 * m * d) * offset.conj()
    n *= n  # n' Sigma n needs only the square
    squared_length = np.maximum(np.abs(n), TINY)
    n *= points.deviator
    variances: FloatArray = n.real / squared_length
    variances += points.mean_variance
    return variances


class WeightedSystem(NamedTuple):
    """Linearised least-squares problem of the residuals from an ellipse.

    Parameters
    ----------
    rows : (..., 6, n) ndarray
        Displacements of the ellipse along its normals by each parameter (..., 5, n), which are
        minus the derivatives of the residuals, then the residuals.
    weights : (..., n) ndarray
        Inverse variances. Units: 1/mm^2.
    """

    rows: FloatArray
    weights: FloatArray

    @classmethod
    def of(
        cls, evaluated: EllipseResiduals, variance_factor: float | FloatArray
    ) -> "WeightedSystem":
        """Return the system with Cauchy's weights: at a residual of 3 sigma the weight is halved.

        With full weights, the foot of a weld bead on a flank, where n' Sigma n is small, would
        dominate the fit, and the next step would diverge.

        Parameters
        ----------
        evaluated : EllipseResiduals
            Residuals (..., n).
        variance_factor : float or (k, 1) ndarray
            Ratio of the true variances to the inflated variances of the residuals.
        """
        *stack, count = evaluated.residuals.shape
        rows = np.empty((*stack, PARAMETERS + 1, count))
        parameter_jacobian(evaluated.normals, evaluated.w, out=rows[..., :PARAMETERS, :])
        rows[..., PARAMETERS, :] = evaluated.residuals
        variances = evaluated.residuals * evaluated.residuals
        variances *= 1 / SIGNIFICANT_SIGMAS**2
        variances += variance_factor * evaluated.inflated_variances
        return cls(rows, 1 / variances)

    def build_normal_equations(self, members: BoolArray | None = None) -> FloatArray:
        """Return the normal equations (..., 5, 6): information and, last, the right-hand side.

        `members` is the mask (..., n) of the points that are used, all of them by default.
        """
        weights = self.weights if members is None else self.weights * members
        weighted = self.rows[..., :PARAMETERS, :] * weights[..., None, :]
        return weighted @ self.rows.swapaxes(-1, -2)


def add_flattening_prior(equations: FloatArray, parameters: FloatArray) -> None:
    """Add the weak prior on the flattening to normal equations (..., 5, 6), in place."""
    m = parameters[..., 2:3, None]
    equations += FLATTENING_INFORMATION / (m * m)
    equations[..., PARAMETERS:] -= FLATTENING_DIAGONAL / (m * m) * parameters[..., None]


def solve_damped_step(equations: FloatArray, parameters: FloatArray) -> FloatArray:
    """Return the damped step (..., 5) to the minimum with the weak prior; NaN if singular.

    `equations` (..., 5, 6) are those without the prior, `parameters` (..., 5) the present ones.
    """
    m = parameters[..., 2:3, None]
    information = equations[..., :PARAMETERS] + DAMPING_AND_PRIOR_INFORMATION / (m * m)
    rhs = equations[..., PARAMETERS:] - FLATTENING_DIAGONAL / (m * m) * parameters[..., None]
    return solve_positive_definite(information, rhs)[..., 0]


def invert_information_or_nan(equations: FloatArray) -> FloatArray:
    """Return the inverse (..., 5, 5) of the information in normal equations (..., 5, 6).

    It is the covariance of the parameters; NaN where it is singular. Units: mm^2.
    """
    information = equations[..., :PARAMETERS]
    matrices = information.reshape(-1, PARAMETERS, PARAMETERS)
    inverses = [solve_positive_definite(matrix, IDENTITY) for matrix in matrices]
    return np.array(inverses).reshape(information.shape)


def take_gauss_newton_step(
    evaluated: EllipseResiduals, parameters: FloatArray, members: BoolArray | None = None
) -> FloatArray:
    """Return the parameters (..., 5) after one robust, weighted step; NaN if not an ellipse.

    Parameters
    ----------
    evaluated : EllipseResiduals
        Residuals (..., n) from the ellipses of these parameters.
    parameters : (..., 5) ndarray
        Present parameters. Units: mm.
    members : (..., n) bool ndarray, optional
        Points that are used, at least one of each arc; all of them by default.
    """
    # The robust variance factor, at least 1: the noise is not taken to be smaller than stated.
    medians = row_medians(evaluated.normalised_squares, members)
    factor = as_column([max(median * MAD_TO_STD**2, 1.0) for median in medians])
    equations = WeightedSystem.of(evaluated, factor).build_normal_equations(members)
    refined = parameters + solve_damped_step(equations, parameters)
    for row in refined.reshape(-1, PARAMETERS):
        if not is_ellipse(row):
            row.fill(np.nan)
    return refined


def row_medians(
    values: FloatArray, members: BoolArray | Sequence[IntArray] | None = None
) -> list[float]:
    """Return the upper median of each row of (k, n) values, or of (n,) values.

    `members` are the values that are used, as a mask of the same shape or as positions in each row,
    at least one in each; all of them by default.
    """
    rows: Iterable[FloatArray] = values.reshape(-1, values.shape[-1])
    if members is not None:
        if isinstance(members, np.ndarray):
            members = members.reshape(-1, values.shape[-1])
        rows = (row[selected] for row, selected in zip(rows, members, strict=True))
    return [upper_median(row) for row in rows]


def solve_positive_definite(matrix: FloatArray, rhs: FloatArray) -> FloatArray:
    """Solve symmetric positive definite systems; NaN where a matrix is not positive definite.

    `matrix` is (k, k) or (n, k, k), `rhs` (k,), (k, j), or a stack of these.
    """
    if matrix.ndim > 2:
        return np.array([solve_positive_definite(*pair) for pair in zip(matrix, rhs, strict=True)])
    _, solution, failed = dposv(matrix, rhs)
    return np.full_like(solution, np.nan) if failed else solution


def invert_information_or_huge(information: FloatArray) -> FloatArray:
    """Return the inverse of an information matrix (5, 5), with huge variances if it is singular."""
    inverse = solve_positive_definite(information, IDENTITY)
    if math.isnan(inverse[0, 0]):
        scale = 1 / np.sqrt(np.maximum(information.diagonal(), TINY))
        scales = scale[:, None] * scale
        values, vectors = np.linalg.eigh(information * scales)
        with np.errstate(over="ignore"):  # all points at one position: infinite variances
            inverse = (vectors / np.maximum(values, np.finfo(float).eps)) @ vectors.T * scales
    return inverse
