"""Posterior probability that each point at an end of an arc lies on the arc's ellipse.

From the middle part outwards, a Kalman filter of the ellipse predicts each point from the inliers
closer to the middle. The density of its residual is compared with that for an outlier, for a point
of another smooth line, and for a gradual departure from the ellipse (foot of a weld bead).
"""

import math
from typing import NamedTuple

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.geometry.arrays import TINY
from lsvision.statistics.compiled_routines import dpotrf, dtrtrs

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
5 to 10 % of the ends of simulated arcs have one; where it was a jump, one radius of 1200 was wrong
by 11 sigma."""
LOG_INLIER = math.log(1 - OUTLIER_FRACTION) - 0.5 * math.log(2 * math.pi)


class EndPoints(NamedTuple):
    """Last two points of the middle part of an arc, and k points outwards from it.

    Signed distances (k + 2,) from the ellipse in mm, and their variances; displacement of the
    ellipse along its normals by each parameter, (5, k + 2); whether the sensor can see a surface
    of that normal; arc length in mm, increasing outwards.
    """

    residuals: FloatArray
    variances: FloatArray
    jacobian: FloatArray
    visible: BoolArray
    positions: FloatArray


class Prediction(NamedTuple):
    """Ellipse predicted from the middle part and the other end.

    Its five parameters less those of the ellipse of the residuals, in mm, and their covariance;
    autocorrelation time of the points' errors, in points; mean semi-axis, in mm.
    """

    offset: FloatArray
    covariance: FloatArray
    autocorrelation_time: float
    radius: float


class EndInliers(NamedTuple):
    """Positions (m,) of the inliers of an end among its k points.

    `log_odds` are those of inlier against outlier; `leverages` the variance of the predicted
    residual over that of the point itself, at least 1.
    """

    members: IntArray
    log_odds: FloatArray
    leverages: FloatArray


def find_end_inliers(end: EndPoints, prediction: Prediction) -> EndInliers:
    """Return the points of an end that lie on the ellipse, up to where the line leaves it.

    A single point that determines the prediction of the points beyond it, after a gap, may be a
    jump: it is an inlier if the end's likelihood is higher with it than without it.
    """
    inliers, likelihood = _filter_end(end, prediction)
    decisive = (inliers.leverages > DECISIVE_LEVERAGE).nonzero()[0]
    if len(decisive) == 0:
        return inliers
    visible = end.visible.copy()
    visible[inliers.members[decisive[0]] + PREDECESSORS] = False
    other, likelihood_without = _filter_end(end._replace(visible=visible), prediction)
    return other if likelihood_without > likelihood else inliers


def _filter_end(end: EndPoints, prediction: Prediction) -> tuple[EndInliers, float]:
    """Return the inliers of an end by a Kalman filter, and the log likelihood ratio of the end."""
    rows, correlation_time = end.jacobian[:, PREDECESSORS:], prediction.autocorrelation_time
    residuals = end.residuals[PREDECESSORS:] - prediction.offset @ rows
    point_variances, visible = end.variances[PREDECESSORS:], end.visible[PREDECESSORS:]
    log_outlier = math.log(OUTLIER_FRACTION / (2 * prediction.radius))
    covariance = rows.T @ prediction.covariance @ rows
    # The filter uses only points that are possible inliers of the ellipse predicted without them.
    possible = _log_inlier(residuals, point_variances + covariance.diagonal()) > log_outlier
    used = np.where(visible & possible, correlation_time, EXCLUDED) * point_variances
    factor = _cholesky(covariance, used)
    stds = factor.diagonal()
    residuals = dtrtrs(factor, residuals, lower=1)[0] * stds
    variances = np.maximum(stds * stds - used, 0.0) + point_variances
    log_inlier = _log_inlier(residuals, variances)
    log_inlier[~visible] = -np.inf
    log_ratio = np.logaddexp(log_inlier, log_outlier)
    log_ratio -= _log_other_line(end, prediction.radius, log_outlier)
    cumulated = log_ratio.cumsum() / correlation_time
    likely = log_inlier > log_outlier
    within = cumulated >= max([0.0, *cumulated.tolist()]) - END_LOG_MARGIN
    last = (within & likely).nonzero()[0]
    members = likely[: last[-1] + 1 if len(last) else 0].nonzero()[0]
    leverages = variances[members] / point_variances[members]
    inliers = EndInliers(members, log_inlier[members] - log_outlier, leverages)
    return inliers, max([0.0, *cumulated.tolist()])


def departure_free_probability(
    end: EndPoints, prediction: Prediction, members: IntArray, following: IntArray
) -> FloatArray:
    """Return the probability (m,), for each inlier, that the line leaves the ellipse only beyond.

    For each inlier the marginal likelihood of a departure that begins there, with normal priors on
    its angle and curvature, is compared with that of no departure. `members` are the positions of
    at least one inlier, `following` those of the connected points beyond the last of them.
    """
    chosen = np.concatenate([members, following[:POINTS_BEYOND]]) + PREDECESSORS
    before = max(0, len(members) - WINDOW)
    count = len(chosen) - before
    jacobian = end.jacobian[:, chosen]
    positions = end.positions[np.append(PREDECESSORS - 1, chosen)]
    # A departure that begins at a point starts from the ellipse at the point before.
    beyond = np.maximum(positions[1:, None] - positions[before:-1], 0.0)
    residuals = end.residuals[chosen] - prediction.offset @ jacobian
    bends = (BEND_STD_RADII / (2 * prediction.radius)) * beyond * beyond
    factor = _cholesky(
        jacobian.T @ prediction.covariance @ jacobian,
        prediction.autocorrelation_time * end.variances[chosen],
    )
    rhs = np.column_stack([residuals, TURN_STD * beyond, bends])
    whitened = dtrtrs(factor, rhs, lower=1)[0]
    log_ratio = _log_marginal_ratio(whitened[:, 0], whitened[:, 1:-count], whitened[:, -count:])
    log_ratio += math.log((1 - NO_DEPARTURE_PRIOR) / NO_DEPARTURE_PRIOR / count)
    log_weights = np.append(log_ratio, 0.0)
    # Cumulated weights of no departure and of the departures that begin at each point or beyond.
    free = np.exp(log_weights - log_weights.max())[::-1].cumsum()[::-1]
    probability = np.ones(len(members))
    probability[before:] = free[1 : 1 + len(members) - before] / free[0]
    return probability


def _log_marginal_ratio(u: FloatArray, turn: FloatArray, bend: FloatArray) -> FloatArray:
    """Return the log likelihood ratio of each departure (unit normal priors) to no departure."""
    m11, m12, m22 = 1 + (turn * turn).sum(0), (turn * bend).sum(0), 1 + (bend * bend).sum(0)
    g1, g2 = u @ turn, u @ bend
    determinant = m11 * m22 - m12 * m12
    quadratic = (m22 * g1 * g1 - 2 * m12 * g1 * g2 + m11 * g2 * g2) / determinant
    ratio: FloatArray = 0.5 * (quadratic - np.log(determinant))
    return ratio


def _log_inlier(residuals: FloatArray, variances: FloatArray) -> FloatArray:
    """Return the log of the density of residuals times the prior probability of an inlier."""
    return LOG_INLIER - 0.5 * (residuals * residuals / variances + np.log(variances))


def _log_other_line(end: EndPoints, radius: float, log_outlier: float) -> FloatArray:
    """Return the log density of each point on another line, extrapolated from the two before."""
    e, v = end.residuals, end.variances
    # Points may share a position on the ellipse.
    steps = np.maximum(end.positions[1:] - end.positions[:-1], TINY)
    ratio = steps[1:] / np.maximum(steps[:-1], steps[1:] / MAX_STEP_RATIO)
    rise, pairs = e[1:] - e[:-1], v[1:] + v[:-1]
    deviation = rise[1:] - ratio * rise[:-1]
    bend = steps[1:] * (steps[1:] + steps[:-1]) / (2 * radius)
    # v2 + (1 + ratio)^2 v1 + ratio^2 v0 + bend^2.
    variances = pairs[1:] + ratio * (2 * v[1:-1] + ratio * pairs[:-1]) + bend * bend
    return np.logaddexp(_log_inlier(deviation, variances), log_outlier)


def _cholesky(covariance: FloatArray, variances: FloatArray) -> FloatArray:
    """Return the Cholesky factor of a covariance plus variances, or the stds if there is none."""
    total = np.array(covariance, order="F")
    total.flat[:: len(total) + 1] += variances
    stds = np.sqrt(total.diagonal())
    factor, failed = dpotrf(total, lower=1, clean=1, overwrite_a=1)
    return np.diag(stds) if failed else factor
