"""Seeds of arcs: local spans of a component that an ellipse fits.

Where the paper fits an ellipse to every window of 10 % of the profile, and so finds huge
ellipses on flat bars, here spans of many lengths are first judged together by the circle
through their moments; the few that curve like a pipe get an ellipse (``cv2.fitEllipse*``).
The spans are a fixed lattice instead of random draws: same profile, same seeds.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from lsvision.detection.windows import WindowCircles, fit_window_circles, multiscale_windows
from lsvision.profile import Arc, PreparedProfile
from lsvision.shapes import BoolArray, Ellipse, FloatArray, IntArray, Points

SPIKE_SIGMAS, SPIKE_PITCHES = 5.0, 0.5
"""A point further from the median of five is a jump: noise, and the bend of a narrow crest."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CandidateSettings:
    """What a seed must look like.

    Parameters
    ----------
    min_window_points : int
        Points of the shortest span that is tried.
    window_growth : float
        Ratio of successive lengths of spans.
    min_coverage_deg : float
        Smallest angle of a seed's arc around its centre. Units: deg.
    max_tilt_deg : float
        Largest phi that counts as a pipe. Units: deg.
    full_coverage_points : int
        Spans of fewer points must cover more, in proportion: a few points curve by chance.
    max_circle_deviation : float
        Share of the radius by which an elliptic span may leave its circle.
    sigmas : float
        Multiple of the noise by which a span may leave its circle.
    sagitta_sigmas : float
        Multiple of the noise that the height of a span over its chord must reach.
    max_overlap : float
        Of two spans that share more than this of their union, the better one is tried.
    bridged_gap : int
        Lost or jumped columns that part two components which are tried as one span.
    """

    min_window_points: int = 10
    window_growth: float = 1.5
    min_coverage_deg: float = 25.0
    full_coverage_points: int = 36
    max_tilt_deg: float = 60.0
    max_circle_deviation: float = 0.012
    sigmas: float = 2.5
    sagitta_sigmas: float = 5.0
    max_overlap: float = 0.5
    bridged_gap: int = 10


@dataclass(frozen=True, eq=False, slots=True)
class Candidate:
    """An index span that curves like a pipe, unproven.

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
    """Spans of all components that curve like a pipe, the most telling first.

    Parameters
    ----------
    profile : PreparedProfile
        The profile that the components are of.
    components : list of (k,) int ndarray
        Connected points, in order.
    radius_range : tuple of float
        Smallest and largest radius of a cylinder. Units: mm.
    settings : CandidateSettings
        Gates.

    Returns
    -------
    list of Candidate
        By falling angle covered, spans with large residuals later.
    """
    if not components:
        return []
    noise_std = profile.noise_std
    sequence, sizes = _reject_spikes(profile, components, settings.min_window_points)
    starts, stops = multiscale_windows(sizes, settings.min_window_points, settings.window_growth)
    over = _windows_across_gaps(sequence, sizes, settings.bridged_gap)
    starts, stops = np.concatenate([starts, over[0]]), np.concatenate([stops, over[1]])
    circles = fit_window_circles(profile.points[sequence], starts, stops)
    good = _passes_circle_gates(circles, stops - starts, noise_std, radius_range, settings)
    limit = settings.sigmas * noise_std + settings.max_circle_deviation * circles.radius
    with np.errstate(invalid="ignore", over="ignore"):
        merit = circles.coverage * (1 - (circles.rms / limit) ** 2)
    order = good.nonzero()[0]
    order = order[(-merit[order]).argsort(kind="stable")]
    order = order[_non_maximum_suppression(starts[order], stops[order], settings.max_overlap)]
    return [_candidate(sequence[starts[i] : stops[i]], circles, i) for i in order.tolist()]


def _reject_spikes(
    profile: PreparedProfile, components: list[IntArray], smallest: int
) -> tuple[IntArray, IntArray]:
    """All components in a row, and their sizes, without jumps too small to be cut off.

    Such a jump is far from the median of five; of a component that would be left with fewer
    than `smallest` points nothing is dropped.
    """
    sequence = np.concatenate(components)
    sizes = np.array([len(component) for component in components])
    first = sizes.cumsum() - sizes
    points = profile.points[sequence]
    limit = SPIKE_SIGMAS * profile.noise_std + SPIKE_PITCHES * profile.pitch
    # Each component's end points thrice, so that no median reaches into its neighbours.
    times = np.ones(len(sequence), dtype=int)
    times[first] = times[first + sizes - 1] = 3
    padded = np.repeat(points[:, 1] - points[0, 1], times).astype(np.float32)
    middle = cv2.medianBlur(padded[None], 5)[0]
    place = times.cumsum() - times
    place[first] += 2
    near = np.abs(padded[place] - middle[place]) <= limit
    left = np.add.reduceat(near, first)
    spared = left < smallest
    near |= np.repeat(spared, sizes)
    return sequence[near], np.where(spared, sizes, left)


def _windows_across_gaps(
    sequence: IntArray, sizes: IntArray, most_columns: int
) -> tuple[IntArray, IntArray]:
    """Windows over two components in a row that few columns part: jumps may have cut an arc."""
    stops = sizes.cumsum()
    gaps = sequence[stops[:-1]] - sequence[stops[:-1] - 1] - 1
    first = (gaps <= most_columns).nonzero()[0]
    return (stops - sizes)[first], stops[first + 1]


def _non_maximum_suppression(starts: IntArray, stops: IntArray, overlap: float) -> IntArray:
    """Positions of the windows that share less than `overlap` with every better one kept."""
    kept: list[int] = []
    left = np.arange(len(starts))
    while len(left):
        kept.append(int(left[0]))
        common = np.minimum(stops, stops[0]) - np.maximum(starts, starts[0])
        union = (stops - starts) + (stops[0] - starts[0]) - common
        unlike = common < overlap * union
        left, starts, stops = left[unlike], starts[unlike], stops[unlike]
    return np.array(kept, dtype=np.int64)


def _passes_circle_gates(
    circles: WindowCircles,
    points: IntArray,
    noise_std: float,
    radius_range: tuple[float, float],
    settings: CandidateSettings,
) -> BoolArray:
    """Gates: radius range, convexity towards the sensor, arc coverage, residual, sagitta."""
    # The radius of curvature of a tilted section lies between b^2 / a at its sharp ends and
    # a^2 / b; what is seen of it also holds more than a sharp end.
    stretch = 1 / math.cos(math.radians(settings.max_tilt_deg))
    low, high = radius_range[0] / math.sqrt(stretch), radius_range[1] * stretch**2
    # Straight windows have an infinite radius, and neither sagitta nor limit.
    radius = np.where(np.isfinite(circles.radius), circles.radius, 0.0)
    sagitta = radius * (1 - np.cos(circles.coverage / 2))
    passed: BoolArray = (
        (circles.radius >= low)
        & (circles.radius <= high)
        & circles.convex
        # Noise alone bends a straight window: its circle is small by bias, and fits worse.
        & (circles.rms < circles.line_rms)
        & (circles.coverage >= math.radians(settings.min_coverage_deg))
        & (
            circles.coverage * points
            >= math.radians(settings.min_coverage_deg) * settings.full_coverage_points
        )
        & (circles.rms <= settings.sigmas * noise_std + settings.max_circle_deviation * radius)
        & (sagitta >= settings.sagitta_sigmas * noise_std)
    )
    return passed


def _candidate(span: IntArray, circles: WindowCircles, i: int) -> Candidate:
    x, y = circles.centre[i].tolist()
    return Candidate(Arc(int(span[0]), int(span[-1]) + 1), span, (x, y), float(circles.radius[i]))


def seed_ellipse(
    profile: PreparedProfile,
    candidate: Candidate,
    settings: CandidateSettings = CandidateSettings(),
) -> Ellipse:
    """Algebraic ellipse of a candidate's points, or its circle where that is no pipe.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    candidate : Candidate
        A span with its circle.
    settings : CandidateSettings
        Largest tilt.

    Returns
    -------
    Ellipse
        Units: mm, rad.
    """
    circle, radius = candidate.centre, candidate.radius
    ellipse = _algebraic_ellipse(profile.points[candidate.indices])
    if (
        ellipse is not None
        and ellipse.phi <= math.radians(settings.max_tilt_deg)
        and math.dist(ellipse.centre, circle) <= radius
        and radius / 2 <= ellipse.semi_minor <= ellipse.semi_major <= 2 * radius
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
