"""Posterior probability that each point at an end of an arc lies on the arc's ellipse.

From the middle part outwards, a Kalman filter of the ellipse predicts each point from the inliers
closer to the middle. The probability density of its residual is compared with those of an outlier
and of a point on another smooth line, such as the foot of a weld bead.

The functions take a stack of ends, as arrays with one or more leading axes, and up to k points of
each end. A shorter end is padded with points that are not visible; they have no influence.
"""

import math
from typing import NamedTuple

import numpy as np

from lsvision.geometry import BoolArray, FloatArray
from lsvision.geometry.arrays import TINY
from lsvision.statistics.compiled_routines import dpotrf

OUTLIER_FRACTION = 0.05
"""Prior probability that a point is an outlier, from stray light or a jump."""
END_LOG_MARGIN = -math.log(OUTLIER_FRACTION)
"""Largest decrease of the cumulated log likelihood ratio from its maximum to the last inlier of an
arc: up to there, another line is at most 1 / `OUTLIER_FRACTION` times as likely. With 5, more of
the foot of a weld would be included; with 0, valid points at the ends would be lost."""
POINTS_BEYOND = 16
"""Number of points beyond each end of an arc that are screened. An arc may be longer than rough
identification found: growing stops early where the initial ellipse deviates from a tilted
section."""
MAX_STEP_RATIO = 5.0
"""Largest ratio of two successive steps with which another line is extrapolated."""
MIN_INCIDENCE_COSINE = 0.05
"""Smallest cosine of the angle of incidence (87 deg) at which a sensor can see a surface."""
EXCLUDED = 1 / math.sqrt(np.finfo(float).eps)
"""Factor on the variance of points that the filter must not use: the inverse square root of the
precision of a float, so that the factorisation keeps half of the digits."""
PREDECESSORS = 2
"""Number of points of the middle part, next to an end, that are stored before the points of the
end: another line is extrapolated from two points."""
LOG_INLIER = math.log(1 - OUTLIER_FRACTION) - 0.5 * math.log(2 * math.pi)
"""Logarithm of the prior probability of an inlier times the constant factor of the normal
density."""


class EndPoints(NamedTuple):
    """Last `PREDECESSORS` points of the middle part of an arc, and the k points beyond, outwards.

    Parameters
    ----------
    residuals : (..., k + 2) ndarray
        Signed distances from the ellipse, positive outside. Units: mm.
    variances : (..., k + 2) ndarray
        Variances of the residuals. Units: mm^2.
    jacobian : (..., 5, k + 2) ndarray
        Displacement of the ellipse along its normals by each parameter.
    incidence_cosines : (..., k + 2) ndarray
        Cosine of the angle between the ray and the ellipse's normal; -1 for padding.
    positions : (..., k + 2) ndarray
        Arc length, increasing outwards. Units: mm.
    """

    residuals: FloatArray
    variances: FloatArray
    jacobian: FloatArray
    incidence_cosines: FloatArray
    positions: FloatArray


class Prediction(NamedTuple):
    """Ellipse predicted from the middle part and the other end.

    Parameters
    ----------
    offset : (..., 5) ndarray
        Parameters of the predicted ellipse minus those of the ellipse from which the residuals are
        measured. Units: mm.
    covariance : (..., 5, 5) ndarray
        Covariance of the parameters of the predicted ellipse. Units: mm^2.
    autocorrelation_time : (...) ndarray
        Number of points per effective point, or an array that is broadcast to this shape.
    radius : (...) ndarray
        Mean semi-axis, or an array that is broadcast to this shape. Units: mm.
    """

    offset: FloatArray
    covariance: FloatArray
    autocorrelation_time: FloatArray
    radius: FloatArray


class EndInliers(NamedTuple):
    """Which of the k points of an end are inliers.

    Parameters
    ----------
    members : (..., k) bool ndarray
        Mask of the inliers.
    log_odds : (..., k) ndarray
        Log of the odds of inlier against outlier.
    leverages : (..., k) ndarray
        Variance of the predicted residual over that of the point itself, at least 1.
    """

    members: BoolArray
    log_odds: FloatArray
    leverages: FloatArray


def find_end_inliers(ends: EndPoints, prediction: Prediction) -> EndInliers:
    """Find the points of ends that are on the ellipse, up to where the line leaves it.

    Parameters
    ----------
    ends : EndPoints
        Points of the ends.
    prediction : Prediction
        Ellipses predicted without the points of the ends.

    Returns
    -------
    EndInliers
        Inliers of each end.
    """
    jacobian = ends.jacobian[..., PREDECESSORS:]
    point_variances = ends.variances[..., PREDECESSORS:]
    # Residuals from the predicted ellipse, and its covariance (..., k, k) at the points.
    shifts = (prediction.offset[..., None, :] @ jacobian)[..., 0, :]
    residuals = ends.residuals[..., PREDECESSORS:] - shifts
    covariance = jacobian.swapaxes(-1, -2) @ prediction.covariance @ jacobian
    correlation_time = prediction.autocorrelation_time[..., None]
    cosines = ends.incidence_cosines[..., PREDECESSORS:]
    visible = cosines > MIN_INCIDENCE_COSINE
    # An outlier has an error of up to a radius along the ray, of which this part is along n.
    ranges = 2 * prediction.radius[..., None] * np.maximum(cosines, MIN_INCIDENCE_COSINE)
    log_outlier = np.log(OUTLIER_FRACTION / ranges)
    # The filter uses only points that are possible inliers of the ellipse predicted without them,
    # with larger variances where errors are correlated: n points then count as fewer.
    variances = point_variances + covariance.diagonal(axis1=-2, axis2=-1)
    possible = visible & (_log_inlier_density(residuals, variances) > log_outlier)
    used = np.where(possible, correlation_time, EXCLUDED) * point_variances
    residuals, variances = _predict_sequentially(covariance, used, residuals)
    # From the variance with which the filter weights a point to that of its error.
    variances = np.maximum(variances - used, 0.0) + point_variances
    log_inlier = np.where(visible, _log_inlier_density(residuals, variances), -np.inf)
    log_ratio = np.logaddexp(log_inlier, log_outlier)
    log_ratio -= _log_other_line_density(ends, prediction.radius[..., None], log_outlier)
    cumulated = log_ratio.cumsum(axis=-1) / correlation_time
    highest = cumulated.max(axis=-1, initial=0.0)
    likely = log_inlier > log_outlier
    inside = likely & (cumulated >= highest[..., None] - END_LOG_MARGIN)
    before_last = np.logical_or.accumulate(inside[..., ::-1], axis=-1)[..., ::-1]
    return EndInliers(likely & before_last, log_inlier - log_outlier, variances / point_variances)


def _predict_sequentially(
    covariance: FloatArray, variances: FloatArray, residuals: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return residuals (..., k) minus their predictions from those before, and their variances.

    `covariance` (..., k, k) is that of the ellipse at the points, `variances` (..., k) are those
    of the points.
    """
    count = residuals.shape[-1]
    total = np.empty((*residuals.shape[:-1], count + 1, count + 1))
    total[..., :-1, :-1] = covariance
    diagonal = total.reshape(*residuals.shape[:-1], -1)[..., :: count + 2]
    diagonal[..., :-1] += variances
    # The residuals are the last row of the matrix: the last row of its Cholesky factor then
    # contains the normalised innovations. The last diagonal element must exceed their sum of
    # squares.
    total[..., -1, :-1], total[..., -1, -1] = residuals, 1e300
    indefinite = []
    for matrix in total.reshape(-1, count + 1, count + 1):
        # The transpose has Fortran's order, so that LAPACK overwrites the matrix by the factor.
        _, singular = dpotrf(matrix.T, lower=0, clean=0, overwrite_a=1)
        indefinite.append(singular > 0)
    stds = total.diagonal(axis1=-2, axis2=-1)[..., :-1]
    predicted, predicted_variances = total[..., -1, :-1] * stds, stds * stds
    if any(indefinite):  # by rounding errors: there the residuals remain without prediction
        failed = np.array(indefinite).reshape(residuals.shape[:-1])
        predicted[failed] = residuals[failed]
        single_variances = covariance.diagonal(axis1=-2, axis2=-1) + variances
        predicted_variances[failed] = single_variances[failed]
    return predicted, predicted_variances


def _log_inlier_density(residuals: FloatArray, variances: FloatArray) -> FloatArray:
    """Return the log of the density of residuals times the prior probability of an inlier."""
    return LOG_INLIER - 0.5 * (residuals * residuals / variances + np.log(variances))


def _log_other_line_density(
    ends: EndPoints, radius: FloatArray, log_outlier: FloatArray
) -> FloatArray:
    """Return the log density (..., k) of each point as a point of another line, or as an outlier.

    The other line is extrapolated from the residuals e0 and e1, with variances v0 and v1, of the
    two points before. The residual e2 deviates from it by e2 - e1 - ratio (e1 - e0), where the
    ratio is that of the distances between the points.
    """
    e, v = ends.residuals, ends.variances
    # Two points may have the same position on the ellipse.
    steps = np.maximum(ends.positions[..., 1:] - ends.positions[..., :-1], TINY)
    before, step = steps[..., :-1], steps[..., 1:]
    ratio = step / np.maximum(before, step / MAX_STEP_RATIO)
    rise, pairs = e[..., 1:] - e[..., :-1], v[..., 1:] + v[..., :-1]
    deviation = rise[..., 1:] - ratio * rise[..., :-1]
    # The deviation of a line that is as curved as the ellipse.
    bend = step * (step + before) / (2 * radius)
    # v2 + (1 + ratio)^2 v1 + ratio^2 v0 + bend^2.
    variances = pairs[..., 1:] + ratio * (2 * v[..., 1:-1] + ratio * pairs[..., :-1]) + bend * bend
    return np.logaddexp(_log_inlier_density(deviation, variances), log_outlier)
