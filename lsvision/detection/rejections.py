"""Every stretch of a profile that holds no cylinder, with one reason: never silence."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from lsvision.detection.arcs import Rejection
from lsvision.detection.candidates import (
    MAX_OVERLAP,
    MAX_RMS_SIGMAS,
    CandidateSettings,
    max_circle_rms,
)
from lsvision.detection.windows import WindowCircles, fit_window_circles
from lsvision.ellipse.section import CylinderSection
from lsvision.profile import Arc, PreparedProfile
from lsvision.shapes import BoolArray, IntArray


def complete_rejections(
    profile: PreparedProfile,
    components: list[IntArray],
    cylinders: Sequence[CylinderSection],
    rejections: list[Rejection],
    radius_range: tuple[float, float],
    min_span_points: int = CandidateSettings().min_span_points,
) -> list[Rejection]:
    """Rejections without repetition, and one for each stretch nothing was said of yet.

    Of `rejections` the most telling comes first. The result is in the order of the profile, and
    empty only where there are cylinders or no columns. Stretches of fewer than `min_span_points`
    are left out; where there is no longer one, that is the reason.
    """
    explained = np.zeros(len(profile.points), dtype=bool)
    for cylinder in cylinders:
        explained[cylinder.indices[0] : cylinder.indices[-1] + 1] = True
    kept: list[Rejection] = []
    for rejection in rejections:
        span = slice(rejection.arc.start, rejection.arc.stop)
        if np.count_nonzero(explained[span]) <= MAX_OVERLAP * len(rejection.arc):
            kept.append(rejection)
            explained[span] = True
    for run in _unexplained_runs(components, ~explained, min_span_points):
        kept.append(Rejection(Arc(int(run[0]), int(run[-1]) + 1), ""))
    if kept and components:
        kept = _explain(profile, np.concatenate(components), kept, radius_range)
    if not kept and not cylinders and len(explained):
        reason = _few_points_reason(len(profile.valid_indices), min_span_points)
        kept.append(Rejection(Arc(0, len(explained)), reason))
    return sorted(kept, key=lambda rejection: rejection.arc.start)


def _unexplained_runs(
    components: list[IntArray], unexplained: BoolArray, smallest: int
) -> list[IntArray]:
    """The stretches of components of which nothing was said."""
    runs = []
    for component in components:
        open_ = unexplained[component]
        edges = (open_[1:] != open_[:-1]).nonzero()[0] + 1
        for start, stop in pairwise([0, *edges.tolist(), len(component)]):
            if open_[start] and stop - start >= smallest:
                runs.append(component[start:stop])
    return runs


def _explain(
    profile: PreparedProfile,
    connected: IntArray,
    rejections: list[Rejection],
    radius_range: tuple[float, float],
) -> list[Rejection]:
    """Rejections with the reason why their connected points lie on a line, or on no circle.

    A reason that was given before stays, except where the points lie on a line.
    """
    spans = np.array([(rejection.arc.start, rejection.arc.stop) for rejection in rejections])
    starts, stops = np.searchsorted(connected, spans).T
    circles = fit_window_circles(profile.points[connected], starts, stops)
    flat = circles.line_rms < MAX_RMS_SIGMAS * profile.noise_std
    return [
        Rejection(
            rejection.arc,
            f"flat: {circles.line_rms[i]:.2f} mm rms from a straight line"
            if flat[i]
            else rejection.reason or _circle_reason(circles, i, profile.noise_std, radius_range),
        )
        for i, rejection in enumerate(rejections)
    ]


def _circle_reason(
    circles: WindowCircles, i: int, noise_std: float, radius_range: tuple[float, float]
) -> str:
    """Why a window that seeded no arc is no cylinder."""
    radius, rms, line_rms = (float(v[i]) for v in (circles.radius, circles.rms, circles.line_rms))
    low, high = radius_range
    if not rms < line_rms:
        return f"no arc: {line_rms:.2f} mm rms from a straight line"
    if not circles.convex[i]:
        return "concave towards the sensor"
    if rms <= max_circle_rms(radius, noise_std) and not low <= radius <= high:
        return f"radius {radius:.3g} mm outside {low:.3g} to {high:.3g} mm"
    return f"no ellipse: best circle leaves {rms:.2f} mm rms at {noise_std:.2f} mm noise"


def _few_points_reason(valid: int, smallest: int) -> str:
    if not valid:
        return "all points are lost"
    return f"too few points: {valid}, of which no {smallest} are connected"
