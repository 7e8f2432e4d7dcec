"""Rough identification: region growing from each candidate to an arc (paper section 3.2.1).

The paper slides a window of 10 % of the points over the whole profile and tests whether all r_j
lie below the sensor error. Here the window starts at a candidate and grows outwards, with a refit
of the ellipse after each step, until consecutive points exceed the sensor error; single lost
columns and jumps inside do not end an arc. The arcs of many profiles grow together as a stack.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress
from typing import NamedTuple, Self

import numpy as np

from lsvision.detection.acceptance import AcceptanceSettings, shape_rejection_reason
from lsvision.detection.arcs import MAX_OVERLAP, MIN_POINTS, IdentifiedArc, Rejection
from lsvision.detection.candidates import Candidate, seed_ellipse
from lsvision.ellipse.parameters import (
    PARAMETERS,
    ellipse_from_parameters,
    parameters_from_ellipse,
)
from lsvision.ellipse.robust_gauss_newton import (
    EllipseResiduals,
    ellipse_residuals,
    gauss_newton_step,
    row_medians,
)
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.geometry.arrays import as_column
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.profile import PreparedProfile
from lsvision.statistics.robust import MAD_TO_STD

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


class Seed(NamedTuple):
    """Candidate of a profile, and the ascending indices of the points that its arc may contain."""

    profile: PreparedProfile
    candidate: Candidate
    free: IntArray


class GrownArc(NamedTuple):
    """Identified arc with the outward unit normals (n,) of its ellipse at the inliers."""

    arc: IdentifiedArc
    normals: ComplexArray


@dataclass(eq=False, slots=True)
class _Growth:
    """Arc that grows from the seed of a `number`, whose free points are `points`.

    `inside` are the positions of its inliers among them; `normals` are those of the ellipse at the
    points from `start` on; `spans` are the first and last inliers so far. `max_scatter` is the
    largest accepted ratio of the scatter to the noise.
    """

    number: int
    seed: Seed
    points: NoisyPoints
    max_scatter: float
    inside: IntArray
    start: int
    normals: ComplexArray
    spans: set[tuple[int, int]]

    @classmethod
    def of(cls, number: int, seed: Seed) -> Self:
        """Return the arc that consists of the free points of a candidate."""
        profile, candidate, free = seed
        seeded = np.zeros(len(profile.points), dtype=bool)
        seeded[candidate.indices] = True
        inside, points = seeded[free].nonzero()[0], profile.noisy_points[free]
        scatter = profile.max_noise_factor(candidate.radius)
        return cls(number, seed, points, scatter, inside, 0, points.z, set())

    def next_window(self) -> NoisyPoints:
        """Return the points around the inliers, extended by half their span at either end."""
        first, stop = int(self.inside[0]), int(self.inside[-1]) + 1
        step = (stop - first + 1) // 2
        self.start = max(0, first - step)
        return self.points[self.start : stop + step]

    def take(self, run: IntArray, normals: ComplexArray) -> bool:
        """Take the inliers of a window, and return whether they had the same span before.

        Then the arc has converged, or alternates between two spans.
        """
        self.inside, self.normals = self.start + run, normals
        span = int(self.inside[0]), int(self.inside[-1])
        known = span in self.spans
        self.spans.add(span)
        return known

    def result(self, parameters: FloatArray) -> GrownArc:
        """Return the arc with its ellipse."""
        arc = IdentifiedArc.of(self.seed.free[self.inside], ellipse_from_parameters(parameters))
        return GrownArc(arc, self.normals[self.inside - self.start])


class _SearchedProfile:
    """Candidates of a profile that are left to grow, and the arcs and rejections so far."""

    def __init__(self, profile: PreparedProfile, candidates: Sequence[Candidate]) -> None:
        self.arcs: list[IdentifiedArc] = []
        self.rejections: list[Rejection] = []
        self._profile, self._candidates = profile, iter(candidates)
        self._free = profile.valid_indices
        self._explained = np.zeros(len(profile.points), dtype=bool)

    def next_seed(self) -> Seed | None:
        """Return the next candidate most of whose points are not explained by arcs so far."""
        for candidate in self._candidates:
            taken = np.count_nonzero(self._explained[candidate.indices])
            if taken <= MAX_OVERLAP * len(candidate.indices):
                return Seed(self._profile, candidate, self._free)
        return None

    def add(self, arc: IdentifiedArc, reason: str | None) -> None:
        """Add an arc, or its rejection with the reason."""
        start, stop = arc.arc.start, arc.arc.stop
        self._explained[start:stop] = True
        if reason is None:
            self.arcs.append(arc)
            self._free = self._free[(self._free < start) | (self._free >= stop)]
        else:
            self.rejections.append(Rejection(arc.arc, reason))


def identify_arcs(
    profiles: Sequence[PreparedProfile],
    candidates: Sequence[Sequence[Candidate]],
    radius_ranges: Sequence[tuple[float, float]],
    settings: AcceptanceSettings = AcceptanceSettings(),
) -> list[tuple[list[IdentifiedArc], list[Rejection]]]:
    """Return, for each profile, the arcs that grow from its candidates, and those of another shape.

    Each point belongs to one arc at most. Of each profile one candidate grows at a time, in their
    order, and those of many profiles together. The `radius_ranges` are in mm.
    """
    searches = [_SearchedProfile(*pair) for pair in zip(profiles, candidates, strict=True)]
    limits = dict(zip(searches, radius_ranges, strict=True))
    growing = searches
    while growing:
        seeds = {search: search.next_seed() for search in growing}
        growing = [search for search in growing if seeds[search] is not None]
        grown = grow_arcs([seed for seed in seeds.values() if seed is not None])
        for search, found in zip(growing, grown, strict=True):
            if found is not None:
                arc, normals = found
                reason = shape_rejection_reason(arc.ellipse, normals, limits[search], settings)
                search.add(arc, reason)
    return [(search.arcs, search.rejections) for search in searches]


def grow_arcs(seeds: Sequence[Seed]) -> list[GrownArc | None]:
    """Return the whole arcs around candidates; None where no ellipse fits the points around one."""
    grown: list[GrownArc | None] = [None] * len(seeds)
    growths = [_Growth.of(number, seed) for number, seed in enumerate(seeds)]
    growths = [growth for growth in growths if len(growth.inside) >= MIN_POINTS]
    growths, parameters = _fit_seeds(growths)
    for _ in range(MAX_ITERATIONS):
        if not growths:
            break
        compared, within = _compare(growths, parameters)
        members, rows = np.zeros(within.shape, dtype=bool), list[int]()
        for row, growth in enumerate(growths):
            run = connected_inliers(within[row], growth.inside - growth.start)
            if len(run) < MIN_POINTS:
                continue
            if growth.take(run, compared.normals[row]):
                grown[growth.number] = growth.result(parameters[row])
                continue
            members[row][run] = True
            rows.append(row)
        if not rows:
            return grown
        if len(rows) < len(growths):
            growths = [growths[row] for row in rows]
            compared, parameters, members = compared.rows(rows), parameters[rows], members[rows]
        stepped = gauss_newton_step(compared, parameters, members)
        growths, parameters = _without_lost(growths, stepped)
    for growth, row in zip(growths, parameters, strict=True):
        grown[growth.number] = growth.result(row)
    return grown


def _fit_seeds(growths: list[_Growth]) -> tuple[list[_Growth], FloatArray]:
    """Return the arcs with the ellipses of their candidates, after one step of refinement."""
    if not growths:
        return growths, np.empty((0, PARAMETERS))
    ellipses = [seed_ellipse(growth.seed.profile, growth.seed.candidate) for growth in growths]
    parameters = np.array([parameters_from_ellipse(ellipse) for ellipse in ellipses])
    points, valid = NoisyPoints.stack([growth.points[growth.inside] for growth in growths])
    compared = ellipse_residuals(points, parameters)
    return _without_lost(growths, gauss_newton_step(compared, parameters, valid))


def _without_lost(
    growths: list[_Growth], parameters: FloatArray
) -> tuple[list[_Growth], FloatArray]:
    """Return the arcs whose parameters are those of an ellipse."""
    fitted = [not math.isnan(x) for x in parameters[:, 0].tolist()]
    if all(fitted):
        return growths, parameters
    return list(compress(growths, fitted)), parameters[fitted]


def _compare(growths: list[_Growth], parameters: FloatArray) -> tuple[EllipseResiduals, BoolArray]:
    """Compare the points in the next windows of k arcs with their ellipses.

    Returns
    -------
    compared : EllipseResiduals
        Residuals (k, n) of the points of all windows.
    within : (k, n) bool ndarray
        Points within the sensor error.
    """
    points, valid = NoisyPoints.stack([growth.next_window() for growth in growths])
    compared = ellipse_residuals(points, parameters)
    return compared, _within_sensor_error(compared, growths) & valid


def _within_sensor_error(compared: EllipseResiduals, growths: list[_Growth]) -> BoolArray:
    """Return which points (k, n) face the sensor and lie within the sensor error of the arc."""
    squares = compared.normalised_squares
    medians = row_medians(squares, [growth.inside - growth.start for growth in growths])
    limits = [
        SENSOR_ERROR_SIGMAS * min(max(MAD_TO_STD * math.sqrt(median), 1.0), growth.max_scatter)
        for median, growth in zip(medians, growths, strict=True)
    ]
    within: BoolArray = squares < as_column([limit * limit for limit in limits])
    within &= compared.normals.imag > MIN_NORMAL_Y
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
