"""Robust ellipse fit for detection: fast and stable on short arcs, with a small bias.

An arc of 40 deg hardly determines the tilt of a free ellipse, whose fit may degenerate to a
straight line. Here a weak prior (few pipes are tilted by more than 60 deg) limits the difference
of the semi-axes; on a long arc it has no effect.

The functions take one arc, or a stack of k arcs as arrays with a leading axis: parameters (5,) or
(k, 5), points (n,) or (k, n).
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

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
FLATTENING_INFORMATION = np.diag([0, 0, 0, 1, 1, 0])[:PARAMETERS] / FLATTENING_PRIOR_STD**2
"""Normal equations (5, 6) of the prior on the flattening of a circle, for m = 1 mm."""
FLATTENING_DIAGONAL = FLATTENING_INFORMATION.sum(axis=1, keepdims=True)
"""Its information about each parameter, (5, 1)."""
MAX_RELATIVE_STEP = 0.1
"""Damping: a step of this fraction of m costs as much as a residual of one sigma."""
DAMPING = IDENTITY / MAX_RELATIVE_STEP**2
"""Information that damps a step, for m = 1 mm. Units: 1/mm^2."""
DAMPED_PRIOR = DAMPING + FLATTENING_INFORMATION[:, :PARAMETERS]
"""Information of the damping and of the prior on the flattening, for m = 1 mm. Units: 1/mm^2."""
VARIANCE_FLOOR_FRACTION = 0.05
"""Fraction of the total variance added along any normal: as for a normal that is 13 deg wrong."""


class EllipseResiduals(NamedTuple):
    """Residuals of points from an ellipse, to first order.

    Parameters
    ----------
    residuals : (..., n) ndarray
        Orthogonal distance, positive outside; its error is of second order near the ellipse.
        Units: mm.
    normals, w : (..., n) complex ndarray
        Outward unit normal, and unit vector of c + E w, where the ray from the centre meets the
        ellipse.
    variances : (..., n) ndarray
        Variance of the points' errors along these normals, n' Sigma n. Units: mm^2.
    inflated_variances : (..., n) ndarray
        These variances plus `VARIANCE_FLOOR_FRACTION` of the total variance: on a steep flank
        n' Sigma n almost vanishes, and with a normal a few degrees wrong a single point would
        dominate the fit. Units: mm^2.
    """

    residuals: FloatArray
    normals: ComplexArray
    w: ComplexArray
    variances: FloatArray
    inflated_variances: FloatArray

    @property
    def normalised_squares(self) -> FloatArray:
        """Squared residuals over the inflated variances."""
        return self.residuals * self.residuals / self.inflated_variances


def ellipse_residuals(points: NoisyPoints, parameters: FloatArray) -> EllipseResiduals:
    """Return the residuals of points from an ellipse (see `lsvision.ellipse.parameters`).

    The symmetric matrix E / m acts on w as w + d conj(w), with d = (p + iq) / m, and its adjugate,
    from which the inverse and the normals follow, as w - d conj(w).
    """
    centre, m, d = split_parameters(parameters)
    d = d / m
    offset = points.z - centre
    w = offset - d * offset.conj()
    size = np.maximum(np.abs(w), TINY)
    w *= (1 / size).astype(complex)
    n = w - d * w.conj()
    cosine = 1 / np.maximum(np.abs(n), TINY)
    n *= cosine.astype(complex)
    # The ray meets the ellipse at m det(E / m) / size of the offset from the centre; the distance
    # from there is multiplied by the cosine of the ray with n.
    signed = (size - (m - m * (d * d.conjugate()).real)) * cosine
    variances = points.normal_variances(n)
    inflated = variances + (2 * VARIANCE_FLOOR_FRACTION) * points.mean_variance
    return EllipseResiduals(signed, n, w, variances, inflated)


def ray_normal_variances(points: NoisyPoints, parameters: FloatArray) -> FloatArray:
    """Return `EllipseResiduals.variances` (..., n) of points alone. Units: mm^2."""
    centre, m, d = split_parameters(parameters)
    offset = points.z - centre
    # n of `ellipse_residuals` times m^2, without its unit vector w in between.
    n = (m * m + (d * d.conjugate()).real) * offset
    n -= (2 * m * d) * offset.conj()
    n *= n
    size = np.maximum(np.abs(n), TINY)
    n *= points.deviator
    variances: FloatArray = n.real / size
    variances += points.mean_variance
    return variances


class WeightedSystem(NamedTuple):
    """Linearised least-squares problem of the residuals from an ellipse.

    Parameters
    ----------
    rows : (..., 6, n) ndarray
        Jacobian (..., 5, n), then the residuals.
    weights : (..., n) ndarray
        Inverse variances. Units: 1/mm^2.
    """

    rows: FloatArray
    weights: FloatArray

    @classmethod
    def of(
        cls, evaluated: EllipseResiduals, variance_factor: float | FloatArray
    ) -> "WeightedSystem":
        """Return the system with Cauchy's weights: a residual of 3 sigma halves a point's.

        Otherwise the foot of a weld bead on a flank, where n' Sigma n is small, would dominate the
        fit, and the next step would diverge. `variance_factor` is a number, or (k, 1).
        """
        *stack, count = evaluated.residuals.shape
        rows = np.empty((*stack, PARAMETERS + 1, count))
        parameter_jacobian(evaluated.normals, evaluated.w, out=rows[..., :PARAMETERS, :])
        rows[..., PARAMETERS, :] = evaluated.residuals
        variances = evaluated.residuals * evaluated.residuals
        variances *= 1 / SIGNIFICANT_SIGMAS**2
        variances += variance_factor * evaluated.inflated_variances
        return cls(rows, 1 / variances)

    def normal_equations(self, members: BoolArray | None = None) -> FloatArray:
        """Return the normal equations of all or some points, (..., 5, 6): information, gradient."""
        weights = self.weights if members is None else self.weights * members
        weighted = self.rows[..., :PARAMETERS, :] * weights[..., None, :]
        equations: FloatArray = weighted @ self.rows.swapaxes(-1, -2)
        return equations


def add_flattening_prior(equations: FloatArray, parameters: FloatArray) -> None:
    """Add the weak prior that few pipes are tilted by more than 60 deg, in place."""
    m = _mean_semi_axes(parameters)
    equations += FLATTENING_INFORMATION / (m * m)
    equations[..., PARAMETERS:] -= FLATTENING_DIAGONAL / (m * m) * parameters[..., None]


def damped_step(equations: FloatArray, parameters: FloatArray) -> FloatArray:
    """Return the step (..., 5) to the minimum with the weak prior; NaN if singular.

    `equations` are those without the prior. The step is damped in units of m.
    """
    m = _mean_semi_axes(parameters)
    information = equations[..., :PARAMETERS] + DAMPED_PRIOR / (m * m)
    gradient = equations[..., PARAMETERS:] - FLATTENING_DIAGONAL / (m * m) * parameters[..., None]
    return solve_positive_definite(information, gradient)[..., 0]


def _mean_semi_axes(parameters: FloatArray) -> Any:
    """Return m of ellipses (..., 5) as (..., 1, 1); that of a single ellipse is a number."""
    if parameters.size == PARAMETERS:
        return parameters.ravel().tolist()[2]
    return parameters[..., 2:3, None]


def inverse_information(equations: FloatArray) -> FloatArray:
    """Return the covariance (..., 5, 5) of the parameters; NaN if singular. Units: mm^2."""
    information = equations[..., :PARAMETERS]
    matrices = information.reshape(-1, PARAMETERS, PARAMETERS)
    inverses = np.array([_solve(matrix, IDENTITY) for matrix in matrices])
    return inverses.reshape(information.shape)


def gauss_newton_step(
    evaluated: EllipseResiduals, parameters: FloatArray, members: BoolArray | None = None
) -> FloatArray:
    """Return the parameters after one robust, weighted step; NaN if they are not an ellipse.

    `members` is the mask (..., n) of the points that are used, all of them by default; at least one
    of each arc.
    """
    medians = row_medians(evaluated.normalised_squares, members)
    factor = as_column([max(median * MAD_TO_STD**2, 1.0) for median in medians])
    equations = WeightedSystem.of(evaluated, factor).normal_equations(members)
    refined = parameters + damped_step(equations, parameters)
    for row in refined.reshape(-1, PARAMETERS):
        if not is_ellipse(row):
            row.fill(np.nan)
    return refined


def row_medians(
    values: FloatArray, members: BoolArray | Sequence[IntArray] | None = None
) -> list[float]:
    """Return the upper median of each row of (k, n) values, or of the one row of (n,) values.

    `members` is the mask (k, n) of the values that count, or their positions in each row; by
    default all of them.
    """
    rows: Iterable[FloatArray] = values.reshape(-1, values.shape[-1])
    if members is not None:
        rows = (row[selected] for row, selected in zip(rows, members, strict=True))
    return [upper_median(row) for row in rows]


def solve_positive_definite(matrix: FloatArray, rhs: FloatArray) -> FloatArray:
    """Solve symmetric positive definite systems; NaN where a matrix is not positive definite.

    `matrix` is (k, k) or (n, k, k), `rhs` (k,), (k, j), or a stack of these.
    """
    if matrix.ndim == 2:
        return _solve(matrix, rhs)
    if len(matrix) == 1:
        return _solve(matrix[0], rhs[0])[None]
    return np.array([_solve(*pair) for pair in zip(matrix, rhs, strict=True)])


def _solve(matrix: FloatArray, rhs: FloatArray) -> FloatArray:
    """Solve one positive definite system; NaN if the matrix is not positive definite."""
    _, solution, failed = dposv(matrix, rhs)
    return np.full_like(solution, np.nan) if failed else solution


def inverse_or_huge(information: FloatArray) -> FloatArray:
    """Return the inverse of an information (5, 5); huge variances where it is singular."""
    inverse = solve_positive_definite(information, IDENTITY)
    if math.isnan(inverse[0, 0]):
        scale = 1 / np.sqrt(np.maximum(information.diagonal(), TINY))
        scales = scale[:, None] * scale
        values, vectors = np.linalg.eigh(information * scales)
        with np.errstate(over="ignore"):  # all points at one position: infinite variances
            inverse = (vectors / np.maximum(values, np.finfo(float).eps)) @ vectors.T * scales
    return inverse
