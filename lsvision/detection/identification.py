"""Rough identification: the arc that belongs to each candidate (paper section 3.2.1).

The paper slides a window of 10 % of the points over the whole profile and asks whether all r_j
lie below the sensor error. Here the window starts at a candidate and grows outwards from it, the
ellipse fitted anew after each step, until points beyond the sensor error follow one another;
single lost columns and jumps inside do not end an arc.
"""

import math

import numpy as np

from lsvision.detection.acceptance import AcceptanceSettings, shape_rejection_reason
from lsvision.detection.arcs import IdentifiedArc, Rejection
from lsvision.detection.candidates import Candidate, seed_ellipse
from lsvision.ellipse.parameters import ellipse_from_parameters, parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import (
    EllipseResiduals,
    ellipse_residuals,
    gauss_newton_step,
    refine_ellipse,
)
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.profile import PreparedProfile
from lsvision.statistics.robust import MAD_TO_STD, upper_median

SENSOR_ERROR_SIGMAS = 4.0
"""The paper's sensor error, in standard deviations of a point along the normal."""
GROWTH_FRACTION = 0.5
"""Share of the arc by which it may grow at each end in one step."""
MIN_GROWTH_POINTS = 4
"""Points by which it may grow in any case."""
MAX_OUTLIER_RUN = 3
"""So many points in a row beyond the sensor error interrupt an arc."""
MAX_GAP_FRACTION = 0.25
"""An interruption shorter than this share of the arc is bridged where more inliers follow."""
MAX_ITERATIONS = 20
"""A seed of ten points needs more than ten steps to the ends of a wide pipe."""
MIN_POINTS = 8
"""Inliers below which the growth has failed."""
MAX_SIZE_RATIO = 3.0
"""Of the ellipse to the candidate's circle, or its inverse."""
MAX_FLATTENING = 0.45
"""Of (a - b) / (a + b), a tilt of 68 deg: beyond, an ellipse winds itself round a corner."""
MIN_NORMAL_Y = -0.5
"""Smallest y of an outward normal that a sensor with a fan of +/- 30 deg can still see."""
MAX_ASSIGNED_FRACTION = 0.3
"""A candidate with a larger share of points in an arc already found is that arc's."""
MAX_FAILURES = 2
"""Points that so many failed arcs held seed no other."""


def identify_arcs(
    profile: PreparedProfile,
    candidates: list[Candidate],
    radius_range: tuple[float, float],
    settings: AcceptanceSettings = AcceptanceSettings(),
) -> tuple[list[IdentifiedArc], list[Rejection]]:
    """Grow candidates to arcs, the best first; each point belongs to one arc.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    candidates : list of Candidate
        In the order of trying.
    radius_range : tuple of float
        Units: mm.
    settings : AcceptanceSettings
        What the shape of an arc must be.

    Returns
    -------
    arcs : list of IdentifiedArc
        Unscreened.
    rejections : list of Rejection
        Arcs that grew, and have not the shape of a cylinder's.
    """
    taken = np.zeros(len(profile.points), dtype=bool)
    failures: FloatArray = np.zeros(len(profile.points))
    arcs: list[IdentifiedArc] = []
    rejections: list[Rejection] = []
    free = profile.valid_indices
    for candidate in candidates:
        span = candidate.indices
        most_taken, most_failures = MAX_ASSIGNED_FRACTION * len(span), MAX_FAILURES * len(span)
        if taken[span].sum() > most_taken or failures[span].sum() >= most_failures:
            continue
        grown = grow_arc(profile, candidate, free)
        if grown is None:
            failures[span] += 1
            continue
        arc, compared = grown
        reason = shape_rejection_reason(arc.ellipse, compared.normals, radius_range, settings)
        if reason is not None:
            rejections.append(Rejection(arc.arc, reason))
            failures[span] += 1
            failures[arc.indices] += 1
            continue
        arcs.append(arc)
        taken[arc.arc.start : arc.arc.stop] = True
        free = free[~taken[free]]
    return arcs, rejections


def grow_arc(
    profile: PreparedProfile, candidate: Candidate, free: IntArray
) -> tuple[IdentifiedArc, EllipseResiduals] | None:
    """Grow a candidate to the whole arc around it.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    candidate : Candidate
        Where to begin.
    free : (k,) int ndarray
        Indices of the points that may belong to it, ordered.

    Returns
    -------
    arc : IdentifiedArc
        Its inliers and their ellipse.
    compared : EllipseResiduals
        Residuals of the inliers. None in place of both where the growth fails: the points around
        the seed are on no ellipse.
    """
    seeded = np.zeros(len(profile.points), dtype=bool)
    seeded[candidate.indices] = True
    inside = seeded[free].nonzero()[0]
    if len(inside) < MIN_POINTS:
        return None
    points = profile.noisy_points[free]
    max_scatter = profile.max_noise_factor(candidate.radius)
    parameters = parameters_from_ellipse(seed_ellipse(profile, candidate))
    parameters, _ = refine_ellipse(points[inside], parameters, 2)
    seen: set[tuple[int, int]] = set()
    for _ in range(MAX_ITERATIONS):
        if not _is_plausible(parameters, candidate.radius):
            return None
        low, high = _expand(inside, len(points))
        compared = ellipse_residuals(points[low:high], parameters)
        inliers = _within_sensor_error(compared, inside - low, max_scatter)
        run = connected_inliers(inliers, inside - low)
        if len(run) < MIN_POINTS:
            return None
        inside = low + run
        ends = (int(inside[0]), int(inside[-1]))
        # This span was seen before: converged, or alternating between two spans.
        if ends in seen:
            break
        seen.add(ends)
        parameters, _ = gauss_newton_step(compared[run], parameters)
    indices = free[inside]
    return IdentifiedArc.of(indices, ellipse_from_parameters(parameters)), compared[run]


def _expand(inside: IntArray, count: int) -> tuple[int, int]:
    """The span of the points inside, wider by a share of itself at either end."""
    start, stop = int(inside[0]), int(inside[-1]) + 1
    step = max(MIN_GROWTH_POINTS, int(GROWTH_FRACTION * (stop - start)))
    return max(0, start - step), min(count, stop + step)


def _is_plausible(parameters: FloatArray, radius: float) -> bool:
    """Whether it is an ellipse, about the size of the circle it began with, and not too flat."""
    _, _, size, p, q = parameters.tolist()
    if not radius / MAX_SIZE_RATIO < size < radius * MAX_SIZE_RATIO:
        return False
    return bool(math.hypot(p, q) < MAX_FLATTENING * size)


def _within_sensor_error(
    compared: EllipseResiduals, inside: IntArray, max_scatter: float
) -> BoolArray:
    """Which points face the sensor and lie within the sensor error, scaled to the arc's scatter."""
    squares = compared.residuals * compared.residuals / compared.inflated_variances
    scatter = MAD_TO_STD * math.sqrt(upper_median(squares[inside]))
    limit = SENSOR_ERROR_SIGMAS * min(max(scatter, 1.0), max_scatter)
    within: BoolArray = (compared.normals.imag > MIN_NORMAL_Y) & (squares < limit * limit)
    return within


def connected_inliers(inliers: BoolArray, inside: IntArray) -> IntArray:
    """Positions of the inliers around the middle of an arc, over short interruptions.

    Parameters
    ----------
    inliers : (n,) bool ndarray
        Of the window.
    inside : (k,) int ndarray
        Positions of the arc so far.
    """
    members = inliers.nonzero()[0]
    cuts = (members[1:] - members[:-1] > MAX_OUTLIER_RUN).nonzero()[0] + 1
    if len(cuts) == 0:
        return members
    runs = np.split(members, cuts)
    middle = (int(inside[0]) + int(inside[-1])) / 2
    away = [max(run[0] - middle, middle - run[-1], 0) for run in runs]
    first = last = away.index(min(away))
    bridge = MAX_GAP_FRACTION * (int(runs[first][-1]) + 1 - int(runs[first][0]))

    def bridged(gap: int, run: IntArray) -> bool:
        return gap <= bridge and int(run[-1]) + 1 - int(run[0]) > max(gap, MIN_GROWTH_POINTS + 1)

    while first > 0 and bridged(runs[first][0] - runs[first - 1][-1] - 1, runs[first - 1]):
        first -= 1
    while last + 1 < len(runs) and bridged(runs[last + 1][0] - runs[last][-1] - 1, runs[last + 1]):
        last += 1
    return np.concatenate(runs[first : last + 1])
