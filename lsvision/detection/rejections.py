"""Rejections of all segments of a profile that have no cylinder, with reasons."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from lsvision.detection import candidates, windows
from lsvision.detection.arcs import MAX_OVERLAP, Rejection, arc_from_indices
from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import BoolArray, IntArray
from lsvision.profile import Arc, PreparedProfile

MAX_FLAT_SIGMAS = 2.0
"""Largest ratio of the rms distance of a flat segment from its line to the noise; the ratio is
about 1 for a straight line. It decides only on the words of a reason."""


def complete_rejections(
    profile: PreparedProfile,
    components: list[IntArray],
    cylinders: Sequence[CylinderSection],
    rejections: list[Rejection],
    radius_range: tuple[float, float],
    min_span_points: int = candidates.CandidateSettings().min_span_points,
) -> list[Rejection]:
    """Return the rejections of a profile, and one more for each segment without explanation.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    components : list of (n,) int ndarray
        Indices of the points of its connected components.
    cylinders : sequence of CylinderSection
        Accepted sections, with the indices of the prepared profile.
    rejections : list of Rejection
        Rejected arcs. One that overlaps a cylinder or an earlier one is left out; a flat one gets
        that reason instead of its own.
    radius_range : (float, float)
        Smallest and largest radius of the search. Units: mm.
    min_span_points : int
        Smallest number of points of a segment for which a rejection is added.

    Returns
    -------
    list of Rejection
        In the order of the profile; empty only if there are cylinders, or the profile is empty. If
        all segments are too short, one rejection of the whole profile states that.
    """
    explained = np.zeros(len(profile.points), dtype=bool)
    for cylinder in cylinders:
        explained[cylinder.indices[0] : cylinder.indices[-1] + 1] = True
    complete: list[Rejection] = []
    for rejection in rejections:
        span = slice(rejection.arc.start, rejection.arc.stop)
        if np.count_nonzero(explained[span]) <= MAX_OVERLAP * len(rejection.arc):
            complete.append(rejection)
            explained[span] = True
    complete += _find_unexplained(components, explained, min_span_points)
    if complete and components:
        complete = _add_reasons(profile, np.concatenate(components), complete, radius_range)
    if not complete and not cylinders and len(explained):
        valid, reason = len(profile.valid_indices), "all points are lost"
        if valid:
            needed = f"no segment of at least {min_span_points} connected points"
            reason = f"too few points: {valid}, {needed}"
        complete.append(Rejection(Arc(0, len(explained)), reason))
    return sorted(complete, key=lambda rejection: rejection.arc.start)


def _find_unexplained(
    components: list[IntArray], explained: BoolArray, smallest: int
) -> list[Rejection]:
    """Return a rejection, yet without a reason, of each unexplained segment.

    Segments are runs of at least `smallest` points of a component.
    """
    segments = []
    for component in components:
        is_explained = explained[component]
        edges = (is_explained[1:] != is_explained[:-1]).nonzero()[0] + 1
        for i, j in pairwise([0, *edges.tolist(), len(component)]):
            if j - i >= smallest and not is_explained[i]:
                segments.append(Rejection(arc_from_indices(component[i:j]), ""))
    return segments


def _add_reasons(
    profile: PreparedProfile,
    connected: IntArray,
    rejections: list[Rejection],
    radius_range: tuple[float, float],
) -> list[Rejection]:
    """Return each rejection with a reason: `flat`, else its own, else one from its best circle.

    `connected` are the indices of the points of all components.
    """
    spans = np.array([(rejection.arc.start, rejection.arc.stop) for rejection in rejections])
    starts, stops = np.searchsorted(connected, spans).T
    points = profile.noisy_points.z[None, connected]
    rows = np.zeros(len(starts), dtype=int)
    circles = windows.fit_window_circles(points, windows.Windows(rows, starts, stops))
    flat = circles.line_rms < MAX_FLAT_SIGMAS * profile.noise_std
    fits_circle = circles.rms <= candidates.compute_max_circle_rms(
        circles.radius, profile.noise_std
    )
    straight = flat | ~(circles.rms < circles.line_rms)
    low, high = radius_range

    def circle_reason(i: int) -> str:
        radius, rms, line_rms = circles.radius[i], circles.rms[i], circles.line_rms[i]
        if straight[i]:
            return f"{'flat' if flat[i] else 'no arc'}: {line_rms:.2f} mm rms from a straight line"
        if not circles.convex[i]:
            return "concave towards the sensor"
        if fits_circle[i] and not low <= radius <= high:
            return f"radius {radius:.3g} mm outside {low:.3g} to {high:.3g} mm"
        noise = f"{profile.noise_std:.2f} mm noise"
        return f"no ellipse: {rms:.2f} mm rms from the best circle, with {noise}"

    explained = []
    for i, rejection in enumerate(rejections):
        reason = "" if flat[i] else rejection.reason
        convex = bool(circles.convex[i] and not straight[i])
        explained.append(Rejection(rejection.arc, reason or circle_reason(i), convex=convex))
    return explained
