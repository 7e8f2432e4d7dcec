"""Candidate arcs: windows of a component that fit a circle, with an initial ellipse for each.

The paper fits an ellipse to every window of 10 % of the profile, and so finds huge ellipses on
flat bars. Here circles are first fitted to windows of many lengths at once, from their moments;
only those with the curvature of a pipe get an ellipse (``cv2.fitEllipseDirect``). The windows
are a fixed lattice instead of random draws, so that results are repeatable.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from lsvision.detection import windows
from lsvision.detection.arcs import MAX_OVERLAP
from lsvision.geometry import BoolArray, Ellipse, FloatArray, IntArray, Points
from lsvision.profile import MAX_RELATIVE_SCATTER, Arc, PreparedProfile
from lsvision.statistics.robust import SIGNIFICANT_SIGMAS

MAX_AXIS_RATIO = 2.0
"""Largest ratio of the semi-axes of an initial ellipse: a tilt of 60 deg."""
MIN_COVERAGE_POINTS = 15.7
"""Smallest product of the angle that a window covers (rad) and its number of points, 25 deg at 36
points: few points may curve by chance."""


@dataclass(frozen=True, kw_only=True)
class CandidateSettings:
    """Limits for candidates.

    Parameters
    ----------
    min_span_points : int
        Number of points of the shortest window and of the smallest component.
    """

    min_span_points: int = 10


@dataclass(frozen=True, eq=False, slots=True)
class Candidate:
    """Window with the curvature of a pipe: span, indices of its points, and their circle in mm."""

    arc: Arc
    indices: IntArray
    centre: tuple[float, float]
    radius: float


def find_candidates(
    profile: PreparedProfile,
    components: list[IntArray],
    radius_range: tuple[float, float],
    settings: CandidateSettings = CandidateSettings(),
) -> list[Candidate]:
    """Return the windows with the curvature of a pipe, by descending angle covered.

    Reversing the order of the points does not change the result.
    """
    if not components:
        return []
    sequence = np.concatenate(components)
    points = profile.points[sequence]
    sizes = [len(component) for component in components]
    starts, stops = windows.multiscale_windows(sizes, settings.min_span_points)
    circles = windows.fit_window_circles(points, starts, stops)
    passed = _passes_gates(circles, profile.noise_std, radius_range).nonzero()[0]
    starts, stops, centres = starts[passed], stops[passed], circles.centre[passed]
    coverage = windows.arc_coverage(points, starts, stops, centres)
    # float32: windows whose coverage differs by rounding only are sorted by their centre's x.
    order = np.lexsort((centres[:, 0], -coverage.astype(np.float32)))
    order = order[(coverage * (stops - starts) >= MIN_COVERAGE_POINTS)[order]]
    kept = order[_non_maximum_suppression(starts[order], stops[order])]
    radii, found = circles.radius[passed], []
    for i in kept:
        span, (x, y) = sequence[starts[i] : stops[i]], centres[i].tolist()
        found.append(Candidate(Arc(int(span[0]), int(span[-1]) + 1), span, (x, y), float(radii[i])))
    return found


def _passes_gates(
    circles: windows.WindowCircles, noise_std: float, radius_range: tuple[float, float]
) -> BoolArray:
    """Return which windows pass the limits of curvature, convexity and residuals."""
    low, high = radius_range
    passed: BoolArray = circles.convex & (circles.rms < circles.line_rms)
    # Radius of curvature of an ellipse: from b^2 / a at its sharp ends to a^2 / b.
    passed &= circles.radius >= low / MAX_AXIS_RATIO
    passed &= circles.radius <= high * MAX_AXIS_RATIO**2
    passed &= circles.rms <= max_circle_rms(circles.radius, noise_std)
    return passed


def max_circle_rms(radius: FloatArray, noise_std: float) -> FloatArray:
    """Return the largest accepted rms distance of points from circles of these radii. Units: mm."""
    # 90 deg of a section tilted by 50 deg leave 1.2 % of the radius.
    return SIGNIFICANT_SIGMAS * noise_std + MAX_RELATIVE_SCATTER * radius


def _non_maximum_suppression(starts: IntArray, stops: IntArray) -> list[int]:
    """Return the positions of the windows, sorted best first, that overlap no better one."""
    kept: dict[int, tuple[int, int]] = {}
    for i, (start, stop) in enumerate(zip(starts.tolist(), stops.tolist(), strict=True)):
        for first, last in kept.values():
            common = (stop if stop < last else last) - (start if start > first else first)
            if common > MAX_OVERLAP * (stop - start + last - first - common):
                break
        else:
            kept[i] = (start, stop)
    return list(kept)


def seed_ellipse(profile: PreparedProfile, candidate: Candidate) -> Ellipse:
    """Return the algebraic ellipse of a candidate's points, or its circle instead."""
    circle, radius = candidate.centre, candidate.radius
    ellipse = _algebraic_ellipse(profile.points[candidate.indices])
    if (
        ellipse is not None
        and ellipse.semi_major <= MAX_AXIS_RATIO * min(radius, ellipse.semi_minor)
        and radius <= MAX_AXIS_RATIO * ellipse.semi_minor
        and math.dist(ellipse.centre, circle) <= radius
    ):
        return ellipse
    return Ellipse(circle, radius, radius, 0.0)


def _algebraic_ellipse(points: Points) -> Ellipse | None:
    """Return the ellipse of Halir and Flusser's fit, biased to small axes; None if it fails."""
    centroid = points.sum(axis=0) / len(points)
    # OpenCV uses float32: without subtracting the centroid, 0.1 mm would be lost at 400 mm.
    centred: FloatArray = points - centroid
    try:
        (x, y), (width, height), angle_deg = cv2.fitEllipseDirect(centred.astype(np.float32))
    except cv2.error:
        return None
    if not (math.isfinite(x + y + width + height + angle_deg) and min(width, height) > 0):
        return None
    centre = (float(centroid[0]) + x, float(centroid[1]) + y)
    return Ellipse.from_axes(centre, width / 2, height / 2, math.radians(angle_deg))
