"""Candidate arcs: windows of a component that fit a circle, and the initial ellipse of an arc.

The paper fits an ellipse to every window of 10 % of the profile, and therefore finds huge ellipses
on flat bars. Here circles are first fitted to windows of many lengths at once, from their moments;
an ellipse (``cv2.fitEllipseDirect``) is fitted only to the windows from which arcs grow. The
windows are a fixed grid instead of random samples, so that results are repeatable.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from lsvision.detection import windows
from lsvision.detection.arcs import MAX_OVERLAP
from lsvision.geometry import BoolArray, Ellipse, FloatArray, IntArray, Points
from lsvision.geometry.arrays import select_rows, stack_with_mask
from lsvision.geometry.noisy_points import ComplexArray
from lsvision.profile import MAX_RELATIVE_SCATTER, PreparedProfile
from lsvision.statistics.robust import SIGNIFICANT_SIGMAS

MAX_AXIS_RATIO = 2.0
"""Largest ratio of the semi-axes of an initial ellipse, that of a tilt of 60 deg."""
MIN_COVERAGE_POINTS = 15.7
"""Smallest product of the angle that a window covers (rad) and its number of points (for 36 points
the angle is 25 deg): the noise of few points may look like curvature. A whole component may cover
less: between two cables, it is a part of a pipe that does not determine its curvature alone."""


@dataclass(frozen=True, kw_only=True)
class CandidateSettings:
    """Limits for candidates.

    Parameters
    ----------
    min_span_points : int
        Number of points of the shortest window and of the smallest component, at least three.

    Raises
    ------
    ValueError
        If `min_span_points` is less than 3, the number of points that determine a circle.
    """

    min_span_points: int = 10

    def __post_init__(self) -> None:
        if self.min_span_points < 3:
            raise ValueError(f"expected min_span_points >= 3, got {self.min_span_points}")


class Candidate(NamedTuple):
    """Window with the curvature of a pipe.

    Parameters
    ----------
    indices : (n,) int ndarray
        Ascending indices of the points of the window in the prepared profile.
    centre : (float, float)
        Centre of the fitted circle. Units: mm.
    radius : float
        Radius of the fitted circle. Units: mm.
    """

    indices: IntArray
    centre: tuple[float, float]
    radius: float


def find_candidates(
    profiles: Sequence[PreparedProfile],
    components: Sequence[list[IntArray]],
    radius_ranges: Sequence[tuple[float, float]],
    settings: CandidateSettings = CandidateSettings(),
) -> list[list[Candidate]]:
    """Find the windows of each profile that have the curvature of a pipe.

    Reversing the order of the points does not change the result.

    Parameters
    ----------
    profiles : sequence of PreparedProfile
        The profiles.
    components : sequence of list of (n,) int ndarray
        Indices of the points of the connected components of each profile.
    radius_ranges : sequence of (float, float)
        Smallest and largest radius of each profile. Units: mm.
    settings : CandidateSettings
        Limits for candidates.

    Returns
    -------
    list of list of Candidate
        Candidates of each profile, in descending order of the angle covered; none for a profile
        without components.
    """
    candidates: list[list[Candidate]] = [[] for _ in profiles]
    searched = [i for i, segments in enumerate(components) if segments]
    if not searched:
        return candidates
    # A row for each profile: the points of its components, one component after the other.
    sequences = [np.concatenate(components[i]) for i in searched]
    arrays = [profiles[i].noisy_points.z[row] for i, row in zip(searched, sequences, strict=True)]
    points, _ = stack_with_mask(arrays)
    spans = _build_windows([components[i] for i in searched], settings.min_span_points)
    circles = windows.fit_window_circles(points, spans)
    limits = np.array([(*radius_ranges[i], profiles[i].noise_std) for i in searched])
    passed = _passes_limits(circles, *limits.take(spans.rows, axis=0).T).nonzero()[0]
    spans, centres = select_rows((spans, circles.centre), passed)
    sizes, _ = stack_with_mask([_repeat_component_sizes(components[i]) for i in searched])
    is_component = spans.stops - spans.starts == sizes[spans.rows, spans.starts]
    order = _order_by_coverage(points, spans, centres, is_component)
    best = order[_suppress_non_maxima(select_rows(spans, order))]
    columns = [field[best].tolist() for field in (*spans, centres, circles.radius[passed])]
    for row, start, stop, centre, radius in zip(*columns, strict=True):
        candidate = Candidate(sequences[row][start:stop], (centre.real, centre.imag), radius)
        candidates[searched[row]].append(candidate)
    return candidates


def _build_windows(components: Sequence[list[IntArray]], smallest: int) -> windows.Windows:
    """Return the windows, of `smallest` points or more, of the components of each profile."""
    spans = [
        windows.build_multiscale_windows(list(map(len, segments)), smallest)
        for segments in components
    ]
    rows = np.repeat(np.arange(len(spans)), [row_spans.shape[1] for row_spans in spans])
    return windows.Windows(rows, *np.concatenate(spans, axis=1))


def _repeat_component_sizes(components: list[IntArray]) -> IntArray:
    """Return the number of points of the component of each point."""
    counts = list(map(len, components))
    return np.repeat(counts, counts)


def _passes_limits(
    circles: windows.WindowCircles, low: FloatArray, high: FloatArray, noise_std: FloatArray
) -> BoolArray:
    """Return which of w windows pass the limits of curvature, convexity and residuals.

    `low` and `high` (w,) are the radius ranges, `noise_std` (w,) the noise, of their profiles in
    mm.
    """
    passed: BoolArray = circles.convex & (circles.rms < circles.line_rms)
    # The radius of curvature of an ellipse is between b^2 / a and a^2 / b.
    passed &= circles.radius >= low / MAX_AXIS_RATIO
    passed &= circles.radius / MAX_AXIS_RATIO**2 <= high
    passed &= circles.rms <= compute_max_circle_rms(circles.radius, noise_std)
    return passed


def compute_max_circle_rms(radius: FloatArray, noise_std: float | FloatArray) -> FloatArray:
    """Return the largest accepted rms distance of points from circles of these radii. Units: mm."""
    # The rms of a noise-free section tilted by 45 deg is up to 1 % of the radius over 90 deg; of a
    # more tilted section, windows that cover less pass.
    return SIGNIFICANT_SIGMAS * noise_std + MAX_RELATIVE_SCATTER * radius


def _order_by_coverage(
    points: ComplexArray, spans: windows.Windows, centres: ComplexArray, is_component: BoolArray
) -> IntArray:
    """Return the positions of windows that cover enough, by row, in descending order of coverage.

    `points` and `centres` are those of `windows.measure_arc_coverage`; windows that are a whole
    component (w,) need not cover enough.
    """
    coverage = windows.measure_arc_coverage(points, spans, centres)
    # In float32, so that windows whose coverage differs only by rounding are sorted by the x of
    # their centre.
    order = np.lexsort((centres.real, -coverage.astype(np.float32), spans.rows))
    is_enough = is_component | (coverage * (spans.stops - spans.starts) >= MIN_COVERAGE_POINTS)
    return order[is_enough[order]]


def _suppress_non_maxima(ordered: windows.Windows) -> list[int]:
    """Return the positions of the windows that do not overlap a better one of the same row.

    The windows are sorted by row, with the best one of each row first.
    """
    best, spans, last_row = list[int](), list[tuple[int, int]](), -1
    spans_by_row = zip(*(field.tolist() for field in ordered), strict=True)
    for i, (row, start, stop) in enumerate(spans_by_row):
        if row != last_row:
            spans, last_row = [], row
        for better_start, better_stop in spans:
            common = min(stop, better_stop) - max(start, better_start)
            if common > MAX_OVERLAP * (stop - start + better_stop - better_start - common):
                break
        else:
            best.append(i)
            spans.append((start, stop))
    return best


def fit_seed_ellipse(profile: PreparedProfile, candidate: Candidate) -> Ellipse:
    """Return the algebraic ellipse of a candidate, or its circle if that is implausible."""
    indices, centre, radius = candidate
    ellipse = _fit_algebraic_ellipse(profile.points[indices])
    if (
        ellipse is not None
        and ellipse.semi_major <= MAX_AXIS_RATIO * min(radius, ellipse.semi_minor)
        and radius <= MAX_AXIS_RATIO * ellipse.semi_minor
        and math.dist(ellipse.centre, centre) <= radius
    ):
        return ellipse
    return Ellipse(centre, radius, radius, 0.0)


def _fit_algebraic_ellipse(points: Points) -> Ellipse | None:
    """Return the ellipse of Halir and Flusser's fit, whose axes are biased to small values.

    None if the fit fails.
    """
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
