"""Posterior probability that each point at an end of an arc lies on the arc's ellipse.

From the middle part outwards, a Kalman filter of the ellipse predicts each point from the inliers
closer to the middle. The probability density of its residual is compared with those of an outlier,
of a point on another smooth line, and of a gradual departure from the ellipse, such as the foot of
a weld bead.

The prior probabilities and scales are round numbers, because the results hardly depend on them:
with each of `TURN_STD`, `BEND_STD_RADII`, `NO_DEPARTURE_PRIOR`, `MAX_STEP_RATIO` and
`POINTS_BEYOND` times 0.7 or 1.4 the same pipes of 1345 are found, but for one, and the median error
of their radii, over its standard uncertainty, changes by 2 % at most.

The functions take a stack of ends, as arrays with one or more leading axes, and up to k points of
each end. A shorter end is padded with points that are not visible; they have no influence.
"""

import math
from typing import NamedTuple

import numpy as np

from lsvision.geometry import BoolArray, FloatArray
from lsvision.geometry.arrays import TINY
from lsvision.statistics.compiled_routines import dposv, dpotrf

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
FOOT_POINTS = 8
"""Number of the outermost inliers at which a departure may begin, and largest number of connected
points beyond them that are used to detect it. The foot of a weld bead has fewer points within the
noise."""
TURN_STD = 0.5
"""Prior standard deviation of the angle at which a line departs. Units: rad."""
BEND_STD_RADII = 2.0
"""Prior standard deviation of the departing line's curvature, in curvatures of the ellipse."""
NO_DEPARTURE_PRIOR = 0.5
"""Prior probability that no departure begins at any point of an end."""
MAX_STEP_RATIO = 5.0
"""Largest ratio of two successive steps with which another line is extrapolated."""
MIN_INCIDENCE_COSINE = 0.05
"""Smallest cosine of the angle of incidence (87 deg) at which a sensor can see a surface."""
EXCLUDED_VARIANCE_FACTOR = 1 / math.sqrt(np.finfo(float).eps)
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

    def compute_innovations(self, residuals: FloatArray, jacobian: FloatArray) -> FloatArray:
        """Return residuals (..., k) from the predicted ellipse; `jacobian` is (..., 5, k)."""
        predicted: FloatArray = (self.offset[..., None, :] @ jacobian)[..., 0, :]
        return residuals - predicted

    def covariances(self, jacobian: FloatArray) -> FloatArray:
        """Return the covariance (..., k, k) of the predicted ellipse at k points."""
        return jacobian.swapaxes(-1, -2) @ self.covariance @ jacobian


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
    residuals = prediction.compute_innovations(ends.residuals[..., PREDECESSORS:], jacobian)
    covariance = prediction.covariances(jacobian)
    correlation_time = prediction.autocorrelation_time[..., None]
    cosines = ends.incidence_cosines[..., PREDECESSORS:]
    visible = cosines > MIN_INCIDENCE_COSINE
    # Errors of outliers are uniform in +/- one radius along the ray; their width along the normal.
    widths = 2 * prediction.radius[..., None] * np.maximum(cosines, MIN_INCIDENCE_COSINE)
    log_outlier = np.log(OUTLIER_FRACTION / widths)
    # The filter uses only points that are possible inliers of the ellipse predicted without them,
    # with larger variances where errors are correlated: n points then count as fewer.
    variances = point_variances + covariance.diagonal(axis1=-2, axis2=-1)
    possible = visible & (_compute_log_inlier_density(residuals, variances) > log_outlier)
    filter_variances = (
        np.where(possible, correlation_time, EXCLUDED_VARIANCE_FACTOR) * point_variances
    )
    residuals, variances = _predict_sequentially(covariance, filter_variances, residuals)
    # The point's own part is its true variance again, not that with which the filter weights it.
    variances = np.maximum(variances - filter_variances, 0.0) + point_variances
    log_inlier = np.where(visible, _compute_log_inlier_density(residuals, variances), -np.inf)
    log_ratio = np.logaddexp(log_inlier, log_outlier)
    log_ratio -= _compute_log_other_line_density(ends, prediction.radius[..., None], log_outlier)
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
    # The transpose has Fortran's order, so that LAPACK overwrites the matrix by the factor.
    indefinite = [
        dpotrf(matrix.T, lower=0, clean=0, overwrite_a=1)[1] > 0
        for matrix in total.reshape(-1, count + 1, count + 1)
    ]
    stds = total.diagonal(axis1=-2, axis2=-1)[..., :-1]
    predicted, predicted_variances = total[..., -1, :-1] * stds, stds * stds
    if any(indefinite):  # by rounding errors: there the residuals remain without prediction
        failed = np.array(indefinite).reshape(residuals.shape[:-1])
        predicted[failed] = residuals[failed]
        single_variances = covariance.diagonal(axis1=-2, axis2=-1) + variances
        predicted_variances[failed] = single_variances[failed]
    return predicted, predicted_variances


def compute_departure_free_probability(
    ends: EndPoints, prediction: Prediction, members: BoolArray, following: BoolArray
) -> FloatArray:
    """Return the probability (n, k) that the line still follows the ellipse at each inlier.

    The marginal likelihood of a departure that begins at an inlier, with normal priors on its angle
    and curvature, is compared with that of no departure. Departures may begin at the `FOOT_POINTS`
    outermost inliers or beyond; the probability of the inliers before them is 1.

    Parameters
    ----------
    ends : EndPoints
        Points of n ends.
    prediction : Prediction
        Ellipses predicted without the points of the ends.
    members : (n, k) bool ndarray
        Inliers, at least one in each end.
    following : (n, k) bool ndarray
        Connected points beyond the last inlier.
    """
    used = members | following
    begins = used & (members[:, ::-1].cumsum(axis=1)[:, ::-1] <= FOOT_POINTS)
    # Sorted last: all points at which a departure may begin, and some others if these are fewer.
    columns = begins.argsort(axis=1, kind="stable")[:, -2 * FOOT_POINTS :]
    cells = columns + used.shape[1] * np.arange(len(used))[:, None]
    begins = begins.take(cells)
    jacobian = ends.jacobian[..., PREDECESSORS:] * used[:, None]
    positions = ends.positions[:, PREDECESSORS - 1 :]
    # A departure that begins at a point leaves the ellipse at the used point before it.
    before = np.where(used, positions[:, 1:], positions[:, :1])
    before = np.concatenate([positions[:, :1], before[:, :-1]], axis=1)
    origins = np.maximum.accumulate(before, axis=1).take(cells)
    beyond = np.maximum(positions[:, None, 1:] - origins[..., None], 0.0) * used[:, None]
    residuals = prediction.compute_innovations(ends.residuals[:, PREDECESSORS:], jacobian) * used
    covariance = prediction.covariances(jacobian)
    diagonal = covariance.reshape(len(covariance), -1)[:, :: covariance.shape[1] + 1]
    diagonal += prediction.autocorrelation_time[:, None] * ends.variances[:, PREDECESSORS:]
    bends = (BEND_STD_RADII / 2 / prediction.radius)[:, None, None] * beyond * beyond
    log_ratio = _compute_log_marginal_ratio(covariance, residuals, TURN_STD * beyond, bends)
    log_ratio += math.log((1 - NO_DEPARTURE_PRIOR) / NO_DEPARTURE_PRIOR)
    log_ratio -= np.log(begins.sum(axis=1))[:, None]
    log_ratio[~begins] = -np.inf
    # Cumulated weights: no departure, and all departures that begin at each point or beyond it.
    largest = np.maximum(log_ratio.max(axis=1, keepdims=True), 0.0)
    no_departure, weights = np.exp(-largest), np.exp(log_ratio - largest)
    from_here = weights[:, ::-1].cumsum(axis=1)[:, ::-1] + no_departure
    later = np.concatenate([from_here, no_departure], axis=1)
    probability = np.ones(used.shape)
    probability.put(cells, np.where(begins, later[:, 1:] / later[:, :1], 1.0))
    return probability


def _compute_log_marginal_ratio(
    covariance: FloatArray, residuals: FloatArray, turn: FloatArray, bend: FloatArray
) -> FloatArray:
    """Return the log of the likelihood ratio (n, j) of each of j departures to no departure.

    `covariance` (n, k, k) is that of the `residuals` (n, k) without a departure; `turn` and `bend`
    (n, j, k) are displacements of the points, whose factors have standard normal priors.
    """
    count = turn.shape[1]
    displacements = np.concatenate([turn, bend], axis=1)
    pairs = zip(covariance, displacements, strict=True)
    weighted = np.array([dposv(matrix, rows.T)[1].T for matrix, rows in pairs])
    squares = (displacements * weighted).sum(axis=2)
    products = (weighted @ residuals[..., None])[..., 0]
    # Normal equations of the factors of turn and bend: their priors add 1 to the diagonal.
    m11, m22 = 1 + squares[:, :count], 1 + squares[:, count:]
    m12 = (turn * weighted[:, count:]).sum(axis=2)
    g1, g2 = products[:, :count], products[:, count:]
    determinant = m11 * m22 - m12 * m12
    quadratic = (m22 * g1 * g1 - 2 * m12 * g1 * g2 + m11 * g2 * g2) / determinant
    ratio: FloatArray = 0.5 * (quadratic - np.log(determinant))
    return ratio


def _compute_log_inlier_density(residuals: FloatArray, variances: FloatArray) -> FloatArray:
    """Return the log of the density of residuals times the prior probability of an inlier."""
    return LOG_INLIER - 0.5 * (residuals * residuals / variances + np.log(variances))


def _compute_log_other_line_density(
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
    return np.logaddexp(_compute_log_inlier_density(deviation, variances), log_outlier)
