"""Posterior probability that each point at an end of an arc lies on the arc's ellipse.

From the middle part outwards, a Kalman filter of the ellipse predicts each point from the inliers
closer to the middle. The density of its residual is compared with that for an outlier, for a point
of another smooth line, and for a gradual departure from the ellipse (foot of a weld bead).

The functions take a stack of ends, as arrays with one or more leading axes, and up to k points of
each end. A shorter end is extended outwards by points that are not visible: they change nothing.
"""

import math
from typing import NamedTuple

import numpy as np

from lsvision.geometry import BoolArray, FloatArray
from lsvision.geometry.arrays import TINY, select_rows
from lsvision.statistics.compiled_routines import dposv, dpotrf

OUTLIER_FRACTION = 0.05
"""Prior probability that a point is an outlier, from stray light or a jump."""
END_LOG_MARGIN = -math.log(OUTLIER_FRACTION)
"""Largest decrease of the cumulated log likelihood ratio from its maximum to the last inlier of an
arc: the decrease by one outlier. 5 would include more of a weld's foot, 0 would cut off valid
ends."""
POINTS_BEYOND = 8
"""Largest number of connected points beyond the last inlier that are used to detect a departure."""
WINDOW = 2 * POINTS_BEYOND
"""Number of outermost inliers at which a departure may begin, and of points beyond each end of an
arc that are screened, too: growing stops early where the initial ellipse deviates from a tilted
section."""
TURN_STD = 0.5
"""Prior standard deviation of the angle at which a line departs. Units: rad."""
BEND_STD_RADII = 2.0
"""Prior standard deviation of the departing line's curvature over that of the ellipse."""
NO_DEPARTURE_PRIOR = 0.5
"""Prior probability that no departure begins inside the end."""
MAX_STEP_RATIO = 5.0
"""Largest ratio of two successive steps with which another line is extrapolated."""
EXCLUDED = 1 / math.sqrt(np.finfo(float).eps)
"""Factor on the variance of points that the filter must not use; its square is the precision of a
float, so that the factorisation keeps half the digits."""
PREDECESSORS = 2
"""Number of points of the middle part, before an end, from which another line is extrapolated."""
DECISIVE_LEVERAGE = 10.0
"""Leverage above which a point determines the prediction of the points beyond it; it may be a jump.
5 to 10 % of the ends of simulated arcs have such a point. Without this test, the radius of one
simulated arc of 1200, where it was a jump, was wrong by 11 sigma."""
LOG_INLIER = math.log(1 - OUTLIER_FRACTION) - 0.5 * math.log(2 * math.pi)
"""Log of the prior probability of an inlier times the constant factor of the normal density."""


class EndPoints(NamedTuple):
    """Last two points of the middle part of an arc, and k points outwards from it.

    Parameters
    ----------
    residuals : (..., k + 2) ndarray
        Signed distances from the ellipse, positive outside. Units: mm.
    variances : (..., k + 2) ndarray
        Variances of the residuals. Units: mm^2.
    jacobian : (..., 5, k + 2) ndarray
        Displacement of the ellipse along its normals by each parameter.
    visible : (..., k + 2) bool ndarray
        Whether the sensor can see a surface of that normal; False for padding.
    positions : (..., k + 2) ndarray
        Arc length, increasing outwards. Units: mm.
    """

    residuals: FloatArray
    variances: FloatArray
    jacobian: FloatArray
    visible: BoolArray
    positions: FloatArray


class Prediction(NamedTuple):
    """Ellipse predicted from the middle part and the other end.

    Parameters
    ----------
    offset : (..., 5) ndarray
        Its parameters less those of the ellipse of the residuals. Units: mm.
    covariance : (..., 5, 5) ndarray
        Covariance of its parameters. Units: mm^2.
    autocorrelation_time : (...) ndarray
        Number of points per effective point, or an array that is broadcast to this shape.
    radius : (...) ndarray
        Mean semi-axis, or an array that is broadcast to this shape. Units: mm.
    """

    offset: FloatArray
    covariance: FloatArray
    autocorrelation_time: FloatArray
    radius: FloatArray

    def innovations(self, residuals: FloatArray, jacobian: FloatArray) -> FloatArray:
        """Return residuals (..., k) from the predicted ellipse; `jacobian` is (..., 5, k)."""
        predicted: FloatArray = (self.offset[..., None, :] @ jacobian)[..., 0, :]
        return residuals - predicted

    def covariances(self, jacobian: FloatArray) -> FloatArray:
        """Return the covariance (..., k, k) of the predicted ellipse at k points."""
        covariances: FloatArray = jacobian.swapaxes(-1, -2) @ self.covariance @ jacobian
        return covariances


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
    """Return the points of ends that lie on the ellipse, up to where the line leaves it.

    A single point that determines the prediction of the points beyond it, after a gap, may be a
    jump: it is an inlier if the end's likelihood is higher with it than without it.
    """
    inliers, likelihood = _filter_ends(ends, prediction)
    decisive = inliers.members & (inliers.leverages > DECISIVE_LEVERAGE)
    if not np.count_nonzero(decisive):
        return inliers
    doubtful: BoolArray = np.logical_or.reduce(decisive, axis=-1)
    first_decisive = decisive & (decisive.cumsum(axis=-1) == 1)
    visible = ends.visible.copy()
    visible[..., PREDECESSORS:] &= ~first_decisive
    without, without_likelihood = _filter_ends(
        *select_rows((ends._replace(visible=visible), prediction), doubtful)
    )
    better = doubtful.copy()
    better[doubtful] = without_likelihood > likelihood[doubtful]
    for field, replacement in zip(inliers, without, strict=True):
        field[better] = replacement[better[doubtful]]
    return inliers


def _filter_ends(ends: EndPoints, prediction: Prediction) -> tuple[EndInliers, FloatArray]:
    """Return the inliers of ends by a Kalman filter, and the log likelihood ratio of each end."""
    jacobian = ends.jacobian[..., PREDECESSORS:]
    point_variances = ends.variances[..., PREDECESSORS:]
    residuals = prediction.innovations(ends.residuals[..., PREDECESSORS:], jacobian)
    correlation_time = prediction.autocorrelation_time[..., None]
    log_outlier = np.log(OUTLIER_FRACTION / 2 / prediction.radius)[..., None]
    covariance, visible = prediction.covariances(jacobian), ends.visible[..., PREDECESSORS:]
    # The filter uses only points that are possible inliers of the ellipse predicted without them.
    variances = point_variances + covariance.diagonal(axis1=-2, axis2=-1)
    possible = visible & (_log_inlier_density(residuals, variances) > log_outlier)
    used = np.where(possible, correlation_time, EXCLUDED) * point_variances
    residuals, variances = _predict_sequentially(covariance, used, residuals)
    variances = np.maximum(variances - used, 0.0) + point_variances
    log_inlier = np.where(visible, _log_inlier_density(residuals, variances), -np.inf)
    log_ratio = np.logaddexp(log_inlier, log_outlier)
    log_ratio -= _log_other_line_density(ends, prediction.radius[..., None], log_outlier)
    cumulated = log_ratio.cumsum(axis=-1) / correlation_time
    highest = cumulated.max(axis=-1, initial=0.0)
    likely = log_inlier > log_outlier
    inside = likely & (cumulated >= highest[..., None] - END_LOG_MARGIN)
    before_last = np.logical_or.accumulate(inside[..., ::-1], axis=-1)[..., ::-1]
    inliers = EndInliers(
        likely & before_last, log_inlier - log_outlier, variances / point_variances
    )
    return inliers, highest


def _predict_sequentially(
    covariance: FloatArray, variances: FloatArray, residuals: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return residuals (..., k), each predicted from those before it, and their variances.

    `covariance` (..., k, k) is that of the ellipse at the points, `variances` (..., k) are those
    of the points.
    """
    count = residuals.shape[-1]
    total = np.empty((*residuals.shape[:-1], count + 1, count + 1))
    total[..., :-1, :-1] = covariance
    diagonal = total.reshape(*residuals.shape[:-1], -1)[..., :: count + 2]
    diagonal[..., :-1] += variances
    # With the residuals as one more row, that of the factor has the normalised innovations. Its
    # last element must exceed their sum of squares.
    total[..., -1, :-1], total[..., -1, -1] = residuals, 1e300
    failed = []
    for matrix in total.reshape(-1, count + 1, count + 1):
        # LAPACK takes the transpose, in Fortran's order, and writes the factor into its place.
        _, singular = dpotrf(matrix.T, lower=0, clean=0, overwrite_a=1)
        failed.append(singular > 0)
    stds = total.diagonal(axis1=-2, axis2=-1)[..., :-1]
    predicted, predicted_variances = total[..., -1, :-1] * stds, stds * stds
    if any(failed):  # not predicted where rounding has made a matrix indefinite
        lost = np.array(failed).reshape(residuals.shape[:-1])
        predicted[lost] = residuals[lost]
        single_variances = covariance.diagonal(axis1=-2, axis2=-1) + variances
        predicted_variances[lost] = single_variances[lost]
    return predicted, predicted_variances


def departure_free_probability(
    ends: EndPoints, prediction: Prediction, members: BoolArray, following: BoolArray
) -> FloatArray:
    """Return the probability (n, k), for each inlier, that the line leaves the ellipse beyond it.

    For each inlier the marginal likelihood of a departure that begins there, with normal priors on
    its angle and curvature, is compared with that of no departure. `members` (n, k) are the inliers
    of n ends, at least one each, `following` the connected points beyond the last of them.
    Departures begin at the `WINDOW` outermost inliers or beyond; the probability of inliers before
    is 1.
    """
    chosen = members | following
    begins = chosen & (members[:, ::-1].cumsum(axis=1)[:, ::-1] <= WINDOW)
    # The columns of the last points at which a departure may begin, and possibly some before.
    columns = begins.argsort(axis=1, kind="stable")[:, -(WINDOW + POINTS_BEYOND) :]
    cells = columns + chosen.shape[1] * np.arange(len(chosen))[:, None]
    begins = begins.take(cells)
    jacobian = ends.jacobian[..., PREDECESSORS:] * chosen[:, None]
    positions = ends.positions[:, PREDECESSORS - 1 :]
    # A departure that begins at a point starts from the ellipse at the chosen point before.
    before = np.where(chosen, positions[:, 1:], positions[:, :1])
    before = np.concatenate([positions[:, :1], before[:, :-1]], axis=1)
    origins = np.maximum.accumulate(before, axis=1).take(cells)
    beyond = np.maximum(positions[:, None, 1:] - origins[..., None], 0.0) * chosen[:, None]
    residuals = prediction.innovations(ends.residuals[:, PREDECESSORS:], jacobian) * chosen
    covariance = prediction.covariances(jacobian)
    diagonal = covariance.reshape(len(covariance), -1)[:, :: covariance.shape[1] + 1]
    diagonal += prediction.autocorrelation_time[:, None] * ends.variances[:, PREDECESSORS:]
    bends = (BEND_STD_RADII / 2 / prediction.radius)[:, None, None] * beyond * beyond
    log_ratio = _log_marginal_ratio(covariance, residuals, TURN_STD * beyond, bends)
    log_ratio += math.log((1 - NO_DEPARTURE_PRIOR) / NO_DEPARTURE_PRIOR)
    log_ratio -= np.log(begins.sum(axis=1))[:, None]
    log_ratio[~begins] = -np.inf
    # Cumulated weights of no departure and of the departures that begin beyond each point.
    largest = np.maximum(log_ratio.max(axis=1, keepdims=True), 0.0)
    none, weights = np.exp(-largest), np.exp(log_ratio - largest)
    later = np.concatenate([weights[:, ::-1].cumsum(axis=1)[:, ::-1] + none, none], axis=1)
    probability = np.ones(chosen.shape)
    probability.put(cells, np.where(begins, later[:, 1:] / later[:, :1], 1.0))
    return probability


def _log_marginal_ratio(
    covariance: FloatArray, residuals: FloatArray, turn: FloatArray, bend: FloatArray
) -> FloatArray:
    """Return the log likelihood ratio (n, j) of each of j departures to no departure.

    `covariance` (n, k, k) is that of the `residuals` (n, k) without a departure; `turn` and `bend`
    (n, j, k) are displacements of the points with unit normal priors on their factors.
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


def _log_inlier_density(residuals: FloatArray, variances: FloatArray) -> FloatArray:
    """Return the log of the density of residuals times the prior probability of an inlier."""
    return LOG_INLIER - 0.5 * (residuals * residuals / variances + np.log(variances))


def _log_other_line_density(
    ends: EndPoints, radius: FloatArray, log_outlier: FloatArray
) -> FloatArray:
    """Return the log density (..., k) of each point on another line, or as an outlier.

    The other line is extrapolated from the residuals e0, e1, with variances v0, v1, of the two
    points before; e2 deviates from it by e2 - e1 - ratio (e1 - e0), with the ratio of the steps.
    """
    e, v = ends.residuals, ends.variances
    # Points may share a position on the ellipse.
    steps = np.maximum(ends.positions[..., 1:] - ends.positions[..., :-1], TINY)
    step, before = steps[..., 1:], steps[..., :-1]
    ratio = step / np.maximum(before, step / MAX_STEP_RATIO)
    rise, pairs = e[..., 1:] - e[..., :-1], v[..., 1:] + v[..., :-1]
    deviation = rise[..., 1:] - ratio * rise[..., :-1]
    bend = step * (step + before) / (2 * radius)
    # v2 + (1 + ratio)^2 v1 + ratio^2 v0 + bend^2.
    variances = pairs[..., 1:] + ratio * (2 * v[..., 1:-1] + ratio * pairs[..., :-1]) + bend * bend
    return np.logaddexp(_log_inlier_density(deviation, variances), log_outlier)
