"""The straight line that a plane shows in one profile."""

from dataclasses import dataclass

import numpy as np

from lsvision.calibration.autocorrelation import autocorrelation_time
from lsvision.errors import TooFewPoints
from lsvision.geometry import BoolArray, FloatArray
from lsvision.profile import Profile

OUTLIER_SIGMAS = 3.5
"""Robust standard deviations beyond which a point is none of the plane's."""
MIN_POINTS = 20


@dataclass(frozen=True, eq=False)
class PlaneLine:
    """Straight line in which a profile cuts a plane.

    Parameters
    ----------
    midpoint, direction : (3,) ndarray
        Section frame (z = 0); a unit vector. Units: mm.
    half_length : float
        Root mean square distance of the points from the middle. Units: mm.
    covariance : (2, 2) ndarray
        Of offset (mm) and slope (rad), were each point's error its own.
    autocorrelation_time : float
        As of `SphereArc`.
    """

    midpoint: FloatArray
    direction: FloatArray
    half_length: float
    covariance: FloatArray
    autocorrelation_time: float


def find_plane_line(profile: Profile) -> PlaneLine:
    """Straight line of most points in a profile: best line through two of them, then trimmed.

    Returns
    -------
    PlaneLine
        By orthogonal least squares.

    Raises
    ------
    TooFewPoints
        If fewer than 20 points lie on a line.
    """
    points = profile.points[np.isfinite(profile.points[:, 0])]
    if len(points) < MIN_POINTS:
        raise TooFewPoints("profile of the plane", len(points), MIN_POINTS, "is it in view?")
    keep = _least_median_inliers(points)
    for _ in range(20):
        middle, along, across = _line_through(points[keep])
        distance = (points - middle) @ across
        spread = 1.4826 * float(np.median(np.abs(distance[keep])))
        previous, keep = keep, np.abs(distance) <= max(OUTLIER_SIGMAS * spread, 1e-6)
        if keep.sum() < MIN_POINTS:
            raise TooFewPoints("line of the plane", int(keep.sum()), MIN_POINTS, "is it in view?")
        if np.array_equal(previous, keep):
            break
    middle, along, across = _line_through(points[keep])
    s, distance = (points[keep] - middle) @ along, (points[keep] - middle) @ across
    variance = float((distance**2).sum()) / (len(s) - 2) + 1e-12
    covariance = variance * np.diag([1 / len(s), 1 / float((s**2).sum())])
    half = float(np.sqrt((s**2).mean()))
    likeness = autocorrelation_time(distance, 2)
    return PlaneLine(np.append(middle, 0.0), np.append(along, 0.0), half, covariance, likeness)


def _least_median_inliers(points: FloatArray) -> BoolArray:
    """Points nearest the best of the lines through pairs some way apart (least median)."""
    rng = np.random.default_rng(0)
    first = rng.integers(0, len(points), 200)
    second = (first + rng.integers(len(points) // 4, 3 * len(points) // 4 + 1, 200)) % len(points)
    along = points[second] - points[first]
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    distance = np.abs(np.einsum("kij,kj->ki", points[None] - points[first][:, None], across))
    median = np.median(distance, axis=1)
    best = int(median.argmin())
    keep: BoolArray = distance[best] <= max(OUTLIER_SIGMAS * 1.4826 * median[best], 1e-6)
    return keep


def _line_through(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    middle = points.mean(axis=0)
    _, axes = np.linalg.eigh((points - middle).T @ (points - middle))
    along = axes[:, 1] * (np.sign(axes[0, 1]) or 1.0)
    return middle, along, np.array([-along[1], along[0]])
