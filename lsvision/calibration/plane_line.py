"""Detection and fit of the straight line in which a profile cuts a plane."""

from dataclasses import dataclass

import numpy as np

from lsvision.errors import TooFewPoints
from lsvision.geometry import BoolArray, FloatArray
from lsvision.profile import Profile
from lsvision.statistics.correlation import debiased_autocorrelation_time
from lsvision.statistics.robust import MAD_TO_STD, mad_std

OUTLIER_SIGMAS = 3.5
"""Distance in robust standard deviations beyond which a point is an outlier."""
MIN_POINTS = 20
"""Smallest number of points on a line."""


@dataclass(frozen=True, eq=False)
class PlaneLine:
    """Straight line in which a profile cuts a plane.

    Parameters
    ----------
    midpoint, direction : (3,) ndarray
        Midpoint (mm) and unit vector along the line, section frame (z = 0).
    half_length : float
        Root mean square distance of the points from the midpoint. Units: mm.
    covariance : (2, 2) ndarray
        Covariance of offset (mm) and slope (rad) for uncorrelated points.
    autocorrelation_time : float
        Autocorrelation time of the residuals, as in `SphereArc`.
    """

    midpoint: FloatArray
    direction: FloatArray
    half_length: float
    covariance: FloatArray
    autocorrelation_time: float


def find_plane_line(profile: Profile) -> PlaneLine:
    """Return the straight line of most points in a profile (least median, then trimmed squares).

    Returns
    -------
    PlaneLine
        Line by orthogonal least squares, with covariance.

    Raises
    ------
    TooFewPoints
        If fewer than 20 points lie on a line.
    """
    points = profile.points[np.isfinite(profile.points[:, 0])]
    if len(points) < MIN_POINTS:
        raise TooFewPoints(
            "profile of the plane", len(points), MIN_POINTS, "check that it is in view"
        )
    inliers = _least_median_inliers(points)
    for _ in range(20):
        midpoint, direction, normal = _fit_line(points[inliers])
        distance = (points - midpoint) @ normal
        std = mad_std(distance[inliers])
        previous, inliers = inliers, np.abs(distance) <= max(OUTLIER_SIGMAS * std, 1e-6)
        if inliers.sum() < MIN_POINTS:
            raise TooFewPoints(
                "line of the plane", int(inliers.sum()), MIN_POINTS, "check that it is in view"
            )
        if np.array_equal(previous, inliers):
            break
    midpoint, direction, normal = _fit_line(points[inliers])
    s, distance = (points[inliers] - midpoint) @ direction, (points[inliers] - midpoint) @ normal
    variance = float((distance**2).sum()) / (len(s) - 2) + 1e-12
    covariance = variance * np.diag([1 / len(s), 1 / float((s**2).sum())])
    half_length = float(np.sqrt((s**2).mean()))
    autocorrelation_time = debiased_autocorrelation_time(distance, 2)
    return PlaneLine(
        np.append(midpoint, 0.0),
        np.append(direction, 0.0),
        half_length,
        covariance,
        autocorrelation_time,
    )


def _least_median_inliers(points: FloatArray) -> BoolArray:
    """Return the mask of points near the line through two of them with least median distance."""
    rng = np.random.default_rng(0)
    first = rng.integers(0, len(points), 200)
    second = (first + rng.integers(len(points) // 4, 3 * len(points) // 4 + 1, 200)) % len(points)
    directions = points[second] - points[first]
    directions = directions / np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-12)
    normals = np.column_stack([-directions[:, 1], directions[:, 0]])
    distance = np.abs(np.einsum("kij,kj->ki", points[None] - points[first][:, None], normals))
    median = np.median(distance, axis=1)
    best = int(median.argmin())
    inliers: BoolArray = distance[best] <= max(OUTLIER_SIGMAS * MAD_TO_STD * median[best], 1e-6)
    return inliers


def _fit_line(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return midpoint, direction and normal of the orthogonal least-squares line."""
    midpoint = points.mean(axis=0)
    _, axes = np.linalg.eigh((points - midpoint).T @ (points - midpoint))
    direction = axes[:, 1] * (np.sign(axes[0, 1]) or 1.0)
    return midpoint, direction, np.array([-direction[1], direction[0]])
