"""Seeds of arcs: windows of a component that a circle fits, and an ellipse through each.

Where the paper fits an ellipse to every window of 10 % of the profile, and so finds huge
ellipses on flat bars, here windows of many lengths are first judged together by the circle
through their moments; the few that curve like a pipe get an ellipse (``cv2.fitEllipse*``).
The windows are a fixed lattice instead of random draws: same profile, same seeds.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from lsvision.detection.windows import WindowCircles, fit_window_circles, multiscale_windows
from lsvision.geometry import BoolArray, Ellipse, FloatArray, IntArray, Points
from lsvision.profile import Arc, PreparedProfile

MAX_AXIS_RATIO = 2.0
"""Semi-major over semi-minor axis of an ellipse that arcs start from: a tilt of 60 deg."""
MAX_RMS_SIGMAS, MAX_RELATIVE_RMS = 2.5, 0.012
"""Rms distance of points from their circle or line, as a multiple of the noise; and over the
radius, for ellipses: 90 deg of any section of a pipe tilted by 50 deg leave 1.2 % at most."""
MIN_LINE_RMS_RATIO = 1.5
"""Rms distance from a line over that from the circle: noise alone bends a straight window, and an
arc as high as 4 sigma of its points has 1.5."""
MIN_COVERAGE_POINTS = 15.7
"""Angle that a window covers (rad) times its points, 25 deg at 36 points: few points curve by
chance."""
MAX_OVERLAP = 0.5
"""Of two windows that share more than this of their union, the one that covers more is tried; what
shares more than this of its points with a cylinder needs no reason of its own."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CandidateSettings:
    """What is tried as a seed.

    Parameters
    ----------
    min_span_points : int
        Points of the shortest window, and of the smallest component: fewer curve by chance.
    """

    min_span_points: int = 10


@dataclass(frozen=True, eq=False, slots=True)
class Candidate:
    """A window that curves like a pipe, unproven.

    Parameters
    ----------
    arc : Arc
        The span.
    indices : (k,) int ndarray
        The connected points in it.
    centre : tuple of float
        Of the circle through them. Units: mm.
    radius : float
        Units: mm.
    """

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
    """Windows of all components that curve like a pipe, by falling angle covered.

    Parameters
    ----------
    profile : PreparedProfile
        The profile that the components are of.
    components : list of (k,) int ndarray
        Connected points, in order.
    radius_range : tuple of float
        Smallest and largest radius of a cylinder. Units: mm.
    settings : CandidateSettings
        Length of the shortest window.

    Returns
    -------
    list of Candidate
        The same whichever end the points are listed from.
    """
    if not components:
        return []
    sequence, sizes = np.concatenate(components), np.array([len(own) for own in components])
    starts, stops = multiscale_windows(sizes, settings.min_span_points)
    circles = fit_window_circles(profile.points[sequence], starts, stops)
    good = _passes_gates(circles, stops - starts, profile.noise_std, radius_range).nonzero()[0]
    # Among equals, whose order rounding would choose, the leftmost first.
    order = good[np.lexsort((circles.centre[good, 0], -circles.coverage[good].round(9)))]
    kept = order[_non_maximum_suppression(starts[order], stops[order])]
    return [
        Candidate(Arc(int(span[0]), int(span[-1]) + 1), span, (x, y), radius)
        for span, (x, y), radius in zip(
            [sequence[starts[i] : stops[i]] for i in kept],
            circles.centre[kept].tolist(),
            circles.radius[kept].tolist(),
            strict=True,
        )
    ]


def _passes_gates(
    circles: WindowCircles, counts: IntArray, noise_std: float, radius_range: tuple[float, float]
) -> BoolArray:
    """Gates: radius range, convexity towards the sensor, arc coverage, residual."""
    passed: BoolArray = (
        # Radius of curvature of an ellipse: from b^2 / a at its sharp ends to a^2 / b.
        (circles.radius >= radius_range[0] / MAX_AXIS_RATIO)
        & (circles.radius <= radius_range[1] * MAX_AXIS_RATIO**2)
        & circles.convex
        & (circles.coverage * counts >= MIN_COVERAGE_POINTS)
        & (MIN_LINE_RMS_RATIO * circles.rms <= circles.line_rms)
        & (circles.rms <= max_circle_rms(circles.radius, noise_std))
    )
    return passed


def max_circle_rms(radius: FloatArray, noise_std: float) -> FloatArray:
    """Largest rms distance of a section's points from their circle. Units: mm.

    Parameters
    ----------
    radius : (w,) ndarray
        Of the circles. Units: mm.
    noise_std : float
        Units: mm.
    """
    return MAX_RMS_SIGMAS * noise_std + MAX_RELATIVE_RMS * radius


def _non_maximum_suppression(starts: IntArray, stops: IntArray) -> list[int]:
    """Positions of the windows that no better one kept before overlaps."""
    kept: list[int] = []
    spans: list[tuple[int, int]] = []
    for i, (start, stop) in enumerate(zip(starts.tolist(), stops.tolist(), strict=True)):
        for first, last in spans:
            common = min(stop, last) - max(start, first)
            if common > MAX_OVERLAP * (stop - start + last - first - common):
                break
        else:
            kept.append(i)
            spans.append((start, stop))
    return kept


def seed_ellipse(profile: PreparedProfile, candidate: Candidate) -> Ellipse:
    """Algebraic ellipse of a candidate's points, or its circle where that is no pipe.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    candidate : Candidate
        A span with its circle.

    Returns
    -------
    Ellipse
        Units: mm, rad.
    """
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
    """Halir and Flusser's fit: small by bias, but never a hyperbola. None where it fails."""
    centroid = points.mean(axis=0)
    # float32: subtract the centroid first, or 0.1 mm is lost at 400 mm.
    centred: FloatArray = points - centroid
    try:
        (x, y), (width, height), angle_deg = cv2.fitEllipseDirect(centred.astype(np.float32))
    except cv2.error:
        return None
    if not (math.isfinite(x + y + width + height + angle_deg) and min(width, height) > 0):
        return None
    centre = (float(centroid[0]) + x, float(centroid[1]) + y)
    return Ellipse.from_axes(centre, width / 2, height / 2, math.radians(angle_deg))
