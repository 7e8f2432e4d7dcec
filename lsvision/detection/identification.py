"""Rough identification: region growing from each candidate to an arc (paper section 3.2.1).

The paper slides a window of 10 % of the points over the whole profile and tests whether all r_j
lie below the sensor error. Here the window starts at a candidate and grows outwards, with a refit
of the ellipse after each step, until consecutive points exceed the sensor error; single lost
columns and jumps inside do not end an arc.
"""

import math

import numpy as np

from lsvision.detection.acceptance import AcceptanceSettings, shape_rejection_reason
from lsvision.detection.arcs import MAX_OVERLAP, MIN_POINTS, IdentifiedArc, Rejection
from lsvision.detection.candidates import Candidate, seed_ellipse
from lsvision.ellipse.parameters import ellipse_from_parameters, parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import (
    EllipseResiduals,
    ellipse_residuals,
    gauss_newton_step,
    refine_ellipse,
)
from lsvision.geometry import BoolArray, IntArray
from lsvision.profile import PreparedProfile
from lsvision.statistics.robust import MAD_TO_STD, upper_median

SENSOR_ERROR_SIGMAS = 4.0
"""The paper's sensor error, in standard deviations of a point along the normal."""
MAX_OUTLIER_RUN = 3
"""Number of consecutive points beyond the sensor error that interrupts an arc."""
MAX_GAP_FRACTION = 0.5
"""Longest interruption, as a fraction of the arc, that is bridged to a longer run of inliers; short
runs by chance would be joined without it."""
MIN_NORMAL_Y = -0.5
"""Smallest y of an outward normal that a sensor with a fan of +/- 30 deg can still see."""
MAX_ITERATIONS = 20
"""Largest number of growing steps: from ten points to the ends of a wide pipe it takes over ten."""


def identify_arcs(
    profile: PreparedProfile,
    candidates: list[Candidate],
    radius_range: tuple[float, float],
    settings: AcceptanceSettings = AcceptanceSettings(),
) -> tuple[list[IdentifiedArc], list[Rejection]]:
    """Return the arcs that grow from the candidates, in their order, and those of another shape.

    Each point belongs to one arc at most. `radius_range` is in mm.
    """
    explained = np.zeros(len(profile.points), dtype=bool)
    arcs: list[IdentifiedArc] = []
    rejections: list[Rejection] = []
    free = profile.valid_indices
    for candidate in candidates:
        taken = np.count_nonzero(explained[candidate.indices])
        if taken > MAX_OVERLAP * len(candidate.indices):
            continue
        grown = grow_arc(profile, candidate, free)
        if grown is None:
            continue
        arc, compared = grown
        explained[arc.arc.start : arc.arc.stop] = True
        reason = shape_rejection_reason(arc.ellipse, compared.normals, radius_range, settings)
        if reason is not None:
            rejections.append(Rejection(arc.arc, reason))
            continue
        arcs.append(arc)
        free = free[(free < arc.arc.start) | (free >= arc.arc.stop)]
    return arcs, rejections


def grow_arc(
    profile: PreparedProfile, candidate: Candidate, free: IntArray
) -> tuple[IdentifiedArc, EllipseResiduals] | None:
    """Return the whole arc around a candidate with the residuals of its inliers.

    `free` are the ascending indices of the points that may belong to the arc. None if the points
    around the candidate do not lie on an ellipse.
    """
    seeded = np.zeros(len(profile.points), dtype=bool)
    seeded[candidate.indices] = True
    inside = seeded[free].nonzero()[0]
    if len(inside) < MIN_POINTS:
        return None
    points = profile.noisy_points[free]
    max_scatter = profile.max_noise_factor(candidate.radius)
    parameters = parameters_from_ellipse(seed_ellipse(profile, candidate))
    parameters = refine_ellipse(points[inside], parameters, 1)
    seen: set[tuple[int, int]] = set()
    for _ in range(MAX_ITERATIONS):
        if math.isnan(parameters[0]):
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
        parameters = gauss_newton_step(compared.rows(run), parameters)
    if math.isnan(parameters[0]):
        return None
    indices = free[inside]
    return IdentifiedArc.of(indices, ellipse_from_parameters(parameters)), compared.rows(run)


def _expand(inside: IntArray, count: int) -> tuple[int, int]:
    """Return the span of the points inside, extended by half its length at either end."""
    start, stop = int(inside[0]), int(inside[-1]) + 1
    step = (stop - start + 1) // 2
    return max(0, start - step), min(count, stop + step)


def _within_sensor_error(
    compared: EllipseResiduals, inside: IntArray, max_scatter: float
) -> BoolArray:
    """Return which points face the sensor and lie within the sensor error times the scatter."""
    squares = compared.residuals * compared.residuals / compared.inflated_variances
    scatter = MAD_TO_STD * math.sqrt(upper_median(squares[inside]))
    limit = SENSOR_ERROR_SIGMAS * min(max(scatter, 1.0), max_scatter)
    within: BoolArray = (compared.normals.imag > MIN_NORMAL_Y) & (squares < limit * limit)
    return within


def connected_inliers(inliers: BoolArray, inside: IntArray) -> IntArray:
    """Return the positions of the inliers around the middle of an arc, bridging short gaps.

    `inliers` is the (n,) mask of a window, `inside` holds the positions of the arc so far.
    """
    members = inliers.nonzero()[0]
    cuts = (members[1:] - members[:-1] > MAX_OUTLIER_RUN).nonzero()[0] + 1
    if len(cuts) == 0:
        return members
    firsts = members[np.append(0, cuts)]
    stops = members[np.append(cuts, len(members)) - 1] + 1
    middle = (int(inside[0]) + int(inside[-1])) / 2
    gaps, lengths = firsts[1:] - stops[:-1], stops - firsts
    own = int(np.maximum(firsts - middle, middle - stops + 1).argmin())
    bridge = MAX_GAP_FRACTION * lengths[own]
    first = last = own
    while first > 0 and gaps[first - 1] <= min(bridge, lengths[first - 1] - 1):
        first -= 1
    while last < len(gaps) and gaps[last] <= min(bridge, lengths[last + 1] - 1):
        last += 1
    bridged: IntArray = members[(members >= firsts[first]) & (members < stops[last])]
    return bridged
