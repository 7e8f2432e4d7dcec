"""Rough identification: region growing from each candidate to an arc (paper section 3.2.1).

The paper slides a window of 10 % of the points over the whole profile and tests whether all r_j
lie below the sensor error. Here the window starts at a candidate and grows outwards, with a refit
of the ellipse after each step, until consecutive points exceed the sensor error; single lost
columns and jumps inside do not end an arc. The arcs of many profiles grow together as a stack.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
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
from lsvision.geometry.arrays import as_column, select_rows
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.profile import PreparedProfile
from lsvision.statistics.robust import MAD_TO_STD

SENSOR_ERROR_SIGMAS = 4.0
"""The paper's sensor error, in standard deviations of a point along the normal."""
MAX_OUTLIER_RUN = 3
"""Number of consecutive points beyond the sensor error that interrupts an arc."""
MAX_GAP_FRACTION = 0.5
"""Longest interruption between two runs of inliers that is bridged, as a fraction of the arc's
central run; the run beyond it must also be longer than the interruption. Without both conditions
short runs of points that lie on the ellipse by chance would be joined."""
MIN_NORMAL_Y = -0.5
"""Smallest y of an outward normal that a sensor with a fan of +/- 30 deg can still see."""
MAX_ITERATIONS = 20
"""Largest number of growing steps; a wide pipe needs over ten from a seed of ten points."""


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
    """Arc that grows from a seed.

    Parameters
    ----------
    number : int
        Index of the seed among those that grow together.
    seed : Seed
        Candidate from which the arc grows.
    points : NoisyPoints
        Free points (f,) of the seed, which the arc may contain.
    max_scatter : float
        Largest accepted ratio of the scatter to the noise.
    inside : (n,) int ndarray
        Ascending positions of the arc's inliers among the free points.
    start : int
        Position of the first point of the last window among the free points.
    normals : (w,) complex ndarray
        Outward unit normals of the ellipse at the points of that window.
    spans : set of (int, int)
        First and last inlier after each step.
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
        """Take the inliers of a window, and return whether the arc had the same span before.

        If so, it has converged, or alternates between two spans.

        Parameters
        ----------
        run : (n,) int ndarray
            Positions of the inliers in the window.
        normals : (w,) complex ndarray
            Outward unit normals of the ellipse at the points of the window.
        """
        self.inside, self.normals = self.start + run, normals
        span = int(self.inside[0]), int(self.inside[-1])
        is_repeated = span in self.spans
        self.spans.add(span)
        return is_repeated

    def result(self, parameters: FloatArray) -> GrownArc:
        """Return the arc with the ellipse of parameters (5,)."""
        arc = IdentifiedArc(self.seed.free[self.inside], ellipse_from_parameters(parameters))
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
            explained = np.count_nonzero(self._explained[candidate.indices])
            if explained <= MAX_OVERLAP * len(candidate.indices):
                return Seed(self._profile, candidate, self._free)
        return None

    def add(self, arc: IdentifiedArc, reason: str | None) -> None:
        """Add an arc, or its rejection if there is a reason for it; its points are explained."""
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
    """Return the arcs that grow from the candidates of each profile, and the rejected ones.

    Each point belongs to one arc at most. The candidates of a profile grow one after the other, in
    their order; those of different profiles grow together.

    Parameters
    ----------
    profiles : sequence of PreparedProfile
        The profiles.
    candidates : sequence of sequence of Candidate
        Candidates of each profile, the most promising first.
    radius_ranges : sequence of (float, float)
        Smallest and largest radius of each profile. Units: mm.
    settings : AcceptanceSettings
        Limits on the shape of the ellipse of an arc.

    Returns
    -------
    list of (list of IdentifiedArc, list of Rejection)
        For each profile its arcs, and the rejections of arcs with another shape.
    """
    searches = [_SearchedProfile(*pair) for pair in zip(profiles, candidates, strict=True)]
    limits = dict(zip(searches, radius_ranges, strict=True))
    growing = searches
    while growing:
        seeds = {search: search.next_seed() for search in growing}
        growing = [search for search in growing if seeds[search] is not None]
        grown = grow_arcs([seed for seed in seeds.values() if seed is not None])
        for search, grown_arc in zip(growing, grown, strict=True):
            if grown_arc is not None:
                arc, normals = grown_arc
                reason = shape_rejection_reason(arc.ellipse, normals, limits[search], settings)
                search.add(arc, reason)
    return [(search.arcs, search.rejections) for search in searches]


def grow_arcs(seeds: Sequence[Seed]) -> list[GrownArc | None]:
    """Return the whole arc around each candidate; None where no ellipse fits the points."""
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
            run = find_connected_inliers(within[row], growth.inside - growth.start)
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
            stacks = growths, compared, parameters, members
            growths, compared, parameters, members = select_rows(stacks, rows)
        stepped = gauss_newton_step(compared, parameters, members)
        growths, parameters = _drop_failed(growths, stepped)
    for growth, row in zip(growths, parameters, strict=True):
        grown[growth.number] = growth.result(row)
    return grown


def _fit_seeds(growths: list[_Growth]) -> tuple[list[_Growth], FloatArray]:
    """Return the arcs, and the parameters (k, 5) of their seed ellipses after one refinement."""
    if not growths:
        return growths, np.empty((0, PARAMETERS))
    ellipses = [seed_ellipse(growth.seed.profile, growth.seed.candidate) for growth in growths]
    parameters = np.array([parameters_from_ellipse(ellipse) for ellipse in ellipses])
    points, valid = NoisyPoints.stack([growth.points[growth.inside] for growth in growths])
    compared = ellipse_residuals(points, parameters)
    return _drop_failed(growths, gauss_newton_step(compared, parameters, valid))


def _drop_failed(
    growths: list[_Growth], parameters: FloatArray
) -> tuple[list[_Growth], FloatArray]:
    """Return the arcs, and their parameters (k, 5), without those whose fit has failed (NaN)."""
    fitted = ~np.isnan(parameters[:, 0])
    stacks = growths, parameters
    return stacks if fitted.all() else select_rows(stacks, fitted)


def _compare(growths: list[_Growth], parameters: FloatArray) -> tuple[EllipseResiduals, BoolArray]:
    """Compare the points in the next windows of k arcs with ellipses of parameters (k, 5).

    Returns
    -------
    compared : EllipseResiduals
        Residuals (k, n) of the points of all windows.
    within : (k, n) bool ndarray
        Points that face the sensor and lie within the sensor error.
    """
    points, valid = NoisyPoints.stack([growth.next_window() for growth in growths])
    compared = ellipse_residuals(points, parameters)
    squares = compared.normalised_squares
    medians = row_medians(squares, [growth.inside - growth.start for growth in growths])
    limits = [
        SENSOR_ERROR_SIGMAS * min(max(MAD_TO_STD * math.sqrt(median), 1.0), growth.max_scatter)
        for median, growth in zip(medians, growths, strict=True)
    ]
    within: BoolArray = squares < as_column([limit * limit for limit in limits])
    within &= compared.normals.imag > MIN_NORMAL_Y
    if valid is not None:
        within &= valid
    return compared, within


def find_connected_inliers(inliers: BoolArray, inside: IntArray) -> IntArray:
    """Return the inliers that are connected to the middle of an arc, across short interruptions.

    Parameters
    ----------
    inliers : (w,) bool ndarray
        Mask of the inliers of a window.
    inside : (n,) int ndarray
        Positions of the arc so far in that window, ascending.

    Returns
    -------
    (n,) int ndarray
        Ascending positions of the connected inliers.
    """
    members = inliers.nonzero()[0]
    cuts = (members[1:] - members[:-1] > MAX_OUTLIER_RUN).nonzero()[0] + 1
    if len(cuts) == 0:
        return members
    firsts = members[np.append(0, cuts)]
    stops = members[np.append(cuts, len(members)) - 1] + 1
    middle = (int(inside[0]) + int(inside[-1])) / 2
    gaps, lengths = firsts[1:] - stops[:-1], stops - firsts
    central = int(np.maximum(firsts - middle, middle - stops + 1).argmin())
    max_gap = MAX_GAP_FRACTION * lengths[central]
    first = last = central
    while first > 0 and gaps[first - 1] <= min(max_gap, lengths[first - 1] - 1):
        first -= 1
    while last < len(gaps) and gaps[last] <= min(max_gap, lengths[last + 1] - 1):
        last += 1
    bridged: IntArray = members[(members >= firsts[first]) & (members < stops[last])]
    return bridged
