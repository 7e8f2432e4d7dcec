"""Detection and fit of the straight line in which a profile cuts a plane."""

from dataclasses import dataclass

import numpy as np

from lsvision.errors import TooFewPoints
from lsvision.geometry import BoolArray, FloatArray
from lsvision.profile import Profile
from lsvision.statistics.correlation import debiased_autocorrelation_time
from lsvision.statistics.robust import MAD_TO_STD, mad_std

OUTLIER_SIGMAS = 3.5
"""Distance in robust standard deviations beyond which a point is an outlier: about one in 2000
with normally distributed errors."""
MIN_POINTS = 20
"""Smallest number of points on a line; the same as for the arc of a sphere."""
_REMEDY = "check that the plane is in view"
"""Remedy for a profile without the line."""
_MAX_REJECTION_ITERATIONS = 20
"""Maximum number of selections of the inliers: at most six are needed in 1500 simulated profiles
with outliers, until a selection is repeated."""
_TRIAL_LINES = 200
"""Number of random pairs of points, through which lines are tried."""
_MIN_OUTLIER_DISTANCE_MM = 1e-6
"""Distance below which a point is never an outlier: exact data have deviations by rounding only."""
_VARIANCE_FLOOR_MM2 = 1e-12
"""Variance added to that of the residuals, so that exact data have an invertible covariance."""


@dataclass(frozen=True, eq=False)
class PlaneLine:
    """Straight line in which a profile cuts a plane.

    Parameters
    ----------
    midpoint, direction : (3,) ndarray
        Midpoint (mm) and unit vector along the line, section frame (z = 0).
    rms_length : float
        Root mean square distance of the points from the midpoint, which converts a slope to a
        distance; 0.58 of half the line's length for evenly spaced points. Units: mm.
    covariance : (2, 2) ndarray
        Covariance of the line's offset along its normal at the midpoint (mm) and of its slope
        (rad), if the errors of the points are uncorrelated.
    autocorrelation_time : float
        Number of points per effective point, from the correlation of the residuals. That of a
        single line is inaccurate: take the mean of many, and multiply `covariance` by it.
    """

    midpoint: FloatArray
    direction: FloatArray
    rms_length: float
    covariance: FloatArray
    autocorrelation_time: float


def find_plane_line(profile: Profile) -> PlaneLine:
    """Return the straight line on which most points of a profile lie.

    The initial guess is a line of least median distance; the line of orthogonal least squares is
    then fitted to the inliers, which are selected again until they do not change (see
    `select_inliers`). Fewer than half of the points may be outliers.

    Raises
    ------
    TooFewPoints
        If fewer than `MIN_POINTS` points are valid, or lie on the line, or all are equal.
    """
    points = profile.points[np.isfinite(profile.points[:, 0])]
    if len(points) < MIN_POINTS:
        raise TooFewPoints("profile of the plane", len(points), MIN_POINTS, _REMEDY)
    inliers = select_inliers(points, _find_least_median_inliers(points))
    midpoint, direction, normal = _fit_line(points[inliers])
    relative_points = points[inliers] - midpoint
    along, distance = relative_points @ direction, relative_points @ normal
    rms_length = float(np.sqrt((along**2).mean()))
    if rms_length < _MIN_OUTLIER_DISTANCE_MM:
        raise TooFewPoints("line of the plane", 1, MIN_POINTS, "all points are equal")
    # A line has two parameters: offset and slope.
    variance = float((distance**2).sum()) / (len(along) - 2) + _VARIANCE_FLOOR_MM2
    covariance = variance * np.diag([1 / len(along), 1 / float((along**2).sum())])
    autocorrelation_time = debiased_autocorrelation_time(distance, 2)
    return PlaneLine(
        np.append(midpoint, 0.0),
        np.append(direction, 0.0),
        rms_length,
        covariance,
        autocorrelation_time,
    )


def _find_least_median_inliers(points: FloatArray) -> BoolArray:
    """Return the mask of the inliers of the trial line with the least median distance to points.

    Each trial line is that through two random points.
    """
    rng = np.random.default_rng(0)  # the same profile gives the same line
    first = rng.integers(0, len(points), _TRIAL_LINES)
    # At least a quarter of the profile apart, so that noise changes the direction little.
    steps = rng.integers(len(points) // 4, 3 * len(points) // 4 + 1, _TRIAL_LINES)
    second = (first + steps) % len(points)
    directions = points[second] - points[first]
    directions = directions / np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-12)
    normals = np.column_stack([-directions[:, 1], directions[:, 0]])
    distance = np.abs(np.einsum("kij,kj->ki", points[None] - points[first][:, None], normals))
    median = np.median(distance, axis=1)
    best = int(median.argmin())
    limit = max(OUTLIER_SIGMAS * MAD_TO_STD * median[best], _MIN_OUTLIER_DISTANCE_MM)
    inliers: BoolArray = distance[best] <= limit
    return inliers


def select_inliers(points: FloatArray, inliers: BoolArray) -> BoolArray:
    """Return the mask (n,) of the points on the line that is fitted to them.

    Starting from `inliers` (n,), those of `points` (n, 2) near the line fitted to the previous
    ones are selected until a selection is repeated. In about one of 250 profiles with outliers two
    selections alternate, which differ in one point at the limit: then the one whose line has the
    lower truncated cost is returned, whichever came first.

    Raises
    ------
    TooFewPoints
        If fewer than `MIN_POINTS` points lie on the line.
    """
    selections = [inliers]
    for _ in range(_MAX_REJECTION_ITERATIONS):
        inliers = np.abs(_distances(points, inliers)) <= _outlier_distance(points, inliers)
        if inliers.sum() < MIN_POINTS:
            raise TooFewPoints("line of the plane", int(inliers.sum()), MIN_POINTS, _REMEDY)
        repeated = [np.array_equal(inliers, selection) for selection in selections]
        if any(repeated):
            selections = selections[repeated.index(True) :]
            break
        selections.append(inliers)
    limit = max(_outlier_distance(points, selection) for selection in selections)
    return min(
        selections,
        key=lambda selection: np.minimum(_distances(points, selection) ** 2, limit**2).sum(),
    )


def _distances(points: FloatArray, inliers: BoolArray) -> FloatArray:
    """Return the signed distances (n,) of points from the line fitted to the inliers."""
    midpoint, _, normal = _fit_line(points[inliers])
    distances: FloatArray = (points - midpoint) @ normal
    return distances


def _outlier_distance(points: FloatArray, inliers: BoolArray) -> float:
    """Return the distance in mm from the line fitted to the inliers beyond which outliers lie."""
    std = mad_std(_distances(points, inliers)[inliers])
    return max(OUTLIER_SIGMAS * std, _MIN_OUTLIER_DISTANCE_MM)


def _fit_line(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return midpoint, direction (x >= 0) and normal of the orthogonal least-squares line."""
    midpoint = points.mean(axis=0)
    _, axes = np.linalg.eigh((points - midpoint).T @ (points - midpoint))
    direction = axes[:, 1] * (np.sign(axes[0, 1]) or 1.0)  # column 1: the larger eigenvalue
    return midpoint, direction, np.array([-direction[1], direction[0]])
