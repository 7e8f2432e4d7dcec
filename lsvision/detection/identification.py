"""Rough identification: region growing from each candidate to an arc (paper section 3.2.1).

The paper slides a window of 10 % of the points over the whole profile and tests whether all radial
residuals r_j (Eq. 4) lie below the sensor error. Here the window starts at a candidate and grows
outwards, with a refit of the ellipse after each step, up to runs of outliers (`INTERRUPTING_RUN`)
that are too long to be bridged (`MAX_GAP_FRACTION`); single lost columns and jumps (isolated points
away from the line) do not end an arc. The arcs of many profiles grow together as a stack.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lsvision.detection.acceptance import AcceptanceSettings, find_shape_rejection_reason
from lsvision.detection.arcs import (
    INTERRUPTING_RUN,
    MAX_OVERLAP,
    MIN_NORMAL_Y,
    MIN_POINTS,
    IdentifiedArc,
    Rejection,
)
from lsvision.detection.candidates import Candidate, fit_seed_ellipse
from lsvision.detection.divided_arcs import join_divided_arcs
from lsvision.ellipse.parameters import (
    ellipse_from_parameters,
    parameters_from_ellipse,
)
from lsvision.ellipse.robust_gauss_newton import (
    EllipseResiduals,
    ellipse_residuals,
    row_medians,
    take_gauss_newton_step,
)
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.geometry.arrays import as_column, select_rows
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.profile import Arc, PreparedProfile
from lsvision.statistics.robust import MAD_TO_STD

SENSOR_ERROR_SIGMAS = 4.0
"""Counterpart of the paper's sensor error of 0.9 mm: largest distance of an inlier from the
ellipse, in standard deviations of a point along the normal, times the ratio of the arc's robust
scatter to the noise, limited to 1 to `PreparedProfile.max_noise_factor`. Screening follows, so that
the limit matters little: with 2.8 one pipe more of 1350 (750 simulated scenes) is found, with 5.6
the same."""
MAX_GAP_FRACTION = 0.5
"""Longest interruption between two runs of inliers that is bridged, as a fraction of the arc's
central run; the run beyond it must also be longer than the interruption. Without both conditions,
short runs of points that are on the ellipse by chance would be added to the arc."""
MAX_ITERATIONS = 20
"""Largest number of growing steps; a wide pipe needs over ten from a seed of ten points."""


class Seed(NamedTuple):
    """Candidate from which an arc grows.

    Parameters
    ----------
    profile : PreparedProfile
        Profile of the candidate.
    candidate : Candidate
        First points of the arc.
    free : (f,) int ndarray
        Ascending indices of the points that the arc may contain: those outside of the spans of
        accepted arcs.
    """

    profile: PreparedProfile
    candidate: Candidate
    free: IntArray


class GrownArc(NamedTuple):
    """Identified arc with the outward unit normals (n,) of its ellipse at the inliers."""

    arc: IdentifiedArc
    normals: ComplexArray


class _GrowingArc:
    """Arc that grows from a seed; at first it consists of the free points of the candidate.

    Attributes
    ----------
    seed : Seed
        Candidate from which the arc grows.
    points : NoisyPoints
        Free points (f,) of the seed, which the arc may contain.
    max_noise_factor : float
        Largest accepted ratio of the scatter about the ellipse to the noise.
    inliers : (n,) int ndarray
        Ascending positions of the arc's inliers among the free points.
    start : int
        Position of the first point of the present window among the free points.
    normals : (w,) complex ndarray
        Outward unit normals of the ellipse at the points of that window.
    ends : (int, int)
        Positions of the first and the last inlier in the present window among the free points.
    grown : GrownArc or None
        Result; None as long as the arc has not finished.
    """

    def __init__(self, seed: Seed) -> None:
        profile, candidate, free = seed
        in_candidate = np.zeros(len(profile.points), dtype=bool)
        in_candidate[candidate.indices] = True
        self.seed, self.points = seed, profile.noisy_points[free]
        self.max_noise_factor = profile.max_noise_factor(candidate.radius)
        self.inliers: IntArray = in_candidate[free].nonzero()[0]
        self.start, self.normals = 0, self.points.z[:0]  # before the first window
        self.ends = -1, -1
        self.grown: GrownArc | None = None

    def move_window(self) -> NoisyPoints:
        """Set `start` to the next window, and return its points.

        It contains the inliers, extended by half their span at either end.
        """
        first, stop = int(self.inliers[0]), int(self.inliers[-1]) + 1
        step = (stop - first + 1) // 2
        self.start = max(0, first - step)
        return self.points[self.start : stop + step]

    def update(self, inliers: IntArray, normals: ComplexArray) -> bool:
        """Set the inliers in the present window, and return whether their span is as it was before.

        Parameters
        ----------
        inliers : (n,) int ndarray
            Ascending positions of the inliers in the window.
        normals : (w,) complex ndarray
            Outward unit normals of the ellipse at the points of the window.
        """
        self.inliers, self.normals = self.start + inliers, normals
        previous, self.ends = self.ends, (int(self.inliers[0]), int(self.inliers[-1]))
        return self.ends == previous

    def finish(self, parameters: FloatArray) -> None:
        """Set the result: the arc with the ellipse of (centre x, y, m, p, q), in mm.

        For these parameters see `lsvision.ellipse.parameters`.
        """
        arc = IdentifiedArc(self.seed.free[self.inliers], ellipse_from_parameters(parameters))
        self.grown = GrownArc(arc, self.normals[self.inliers - self.start])


class _SearchedProfile:
    """Profile with its remaining candidates, and its arcs and rejections so far.

    `_rejected` are the arcs with another shape, `_spans` those of all arcs.
    """

    def __init__(
        self,
        profile: PreparedProfile,
        candidates: Sequence[Candidate],
        radius_range: tuple[float, float],
    ) -> None:
        self._arcs: list[IdentifiedArc] = []
        self._rejected: list[IdentifiedArc] = []
        self.rejections: list[Rejection] = []
        self._profile, self._candidates = profile, list(candidates)
        self._radius_range = radius_range
        self._spans: list[Arc] = []
        self._free = np.ones(len(profile.points), dtype=bool)

    def select_next_seeds(self) -> list[Seed]:
        """Return the unexplained candidates that share no point with a better one in the result.

        They are ordered, the better ones first; `_is_explained` states which arcs explain one.
        """
        free, taken = self._free.nonzero()[0], np.zeros(len(self._free), dtype=bool)
        self._candidates = [c for c in self._candidates if not self._is_explained(c)]
        seeds = list[Seed]()
        for candidate in self._candidates:
            if not taken[candidate.indices].any():
                taken[candidate.indices] = True
                seeds.append(Seed(self._profile, candidate, free))
        return seeds

    def add(self, seed: Seed, grown: GrownArc | None, settings: AcceptanceSettings) -> None:
        """Add an arc, or its rejection if its shape is not that of a cylinder.

        An added arc takes all points of its span; a rejected one only explains candidates.

        An arc that has points in common with a better one, which has grown at the same time, is
        not added; its candidate grows again.
        """
        if grown is not None and not self._is_explained(seed.candidate):
            arc, normals = grown
            if not self._free[arc.indices].all():
                return
            self._spans.append(arc.arc)
            reason = find_shape_rejection_reason(arc.ellipse, normals, self._radius_range, settings)
            if reason is None:
                self._arcs.append(arc)
                self._free[arc.arc.start : arc.arc.stop] = False
            else:
                self._rejected.append(arc)
                self.rejections.append(Rejection(arc.arc, reason))
        self._candidates = [c for c in self._candidates if c is not seed.candidate]

    def join_parts(self, settings: AcceptanceSettings) -> list[IdentifiedArc]:
        """Return the arcs, with those that are parts of one pipe joined."""
        arcs = self._arcs, self._rejected
        return join_divided_arcs(self._profile, *arcs, self._radius_range, settings)

    def _is_explained(self, candidate: Candidate) -> bool:
        """Return whether an earlier arc spans more than `MAX_OVERLAP` of a candidate's points.

        The largest overlap with one arc counts, not the sum: where the noise is larger than the
        pitch, short rejected arcs may cover a good candidate together.
        """
        if not self._spans:
            return False
        bounds = candidate.indices.searchsorted([(arc.start, arc.stop) for arc in self._spans])
        overlaps = bounds[:, 1] - bounds[:, 0]
        return bool(overlaps.max() > MAX_OVERLAP * len(candidate.indices))


def identify_arcs(
    profiles: Sequence[PreparedProfile],
    candidates: Sequence[Sequence[Candidate]],
    radius_ranges: Sequence[tuple[float, float]],
    settings: AcceptanceSettings = AcceptanceSettings(),
) -> list[tuple[list[IdentifiedArc], list[Rejection]]]:
    """Return the arcs that grow from the candidates of each profile, and the rejected ones.

    Each point belongs to one arc at most; parts of a pipe on both sides of a gap are one arc.
    Candidates that do not overlap grow together.

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
    searches = list(map(_SearchedProfile, profiles, candidates, radius_ranges))
    while seeds := [(search, seed) for search in searches for seed in search.select_next_seeds()]:
        grown_arcs = grow_arcs([seed for _, seed in seeds])
        for (search, seed), grown in zip(seeds, grown_arcs, strict=True):
            search.add(seed, grown, settings)
    return [(search.join_parts(settings), search.rejections) for search in searches]


def grow_arcs(seeds: Sequence[Seed]) -> list[GrownArc | None]:
    """Grow the arc around each candidate until its span does not change.

    Parameters
    ----------
    seeds : sequence of Seed
        Candidates of one or more profiles.

    Returns
    -------
    list of GrownArc or None
        Arc of each seed; None where no ellipse fits, or fewer than `MIN_POINTS` are inliers.
    """
    all_arcs = list(map(_GrowingArc, seeds))
    arcs = [arc for arc in all_arcs if len(arc.inliers) >= MIN_POINTS]
    ellipses = [fit_seed_ellipse(arc.seed.profile, arc.seed.candidate) for arc in arcs]
    parameters = np.array([parameters_from_ellipse(ellipse) for ellipse in ellipses])
    for _ in range(MAX_ITERATIONS):
        if arcs:
            arcs, parameters = _grow_once(arcs, parameters)
    # Arcs that have not converged: their inliers, and the ellipse fitted to them; the normals are
    # those of the ellipse one step before.
    for arc, row in zip(arcs, parameters, strict=True):
        arc.finish(row)
    return [arc.grown for arc in all_arcs]


def _grow_once(
    arcs: list[_GrowingArc], parameters: FloatArray
) -> tuple[list[_GrowingArc], FloatArray]:
    """Update the inliers of k arcs, and refit the ellipses (k, 5) of those that are still growing.

    Arcs whose span has not changed are finished. Those without an ellipse are left out, too.
    """
    evaluated, within = _compare(arcs, parameters)
    members, rows = np.zeros(within.shape, dtype=bool), list[int]()
    for row, arc in enumerate(arcs):
        inliers = find_connected_inliers(within[row], arc.inliers - arc.start)
        if len(inliers) < MIN_POINTS:
            continue
        if arc.update(inliers, evaluated.normals[row]):
            arc.finish(parameters[row])
        else:
            members[row, inliers] = True
            rows.append(row)
    if not rows:
        return [], parameters[:0]
    if len(rows) < len(arcs):
        stacks = arcs, evaluated, parameters, members
        arcs, evaluated, parameters, members = select_rows(stacks, rows)
    parameters = take_gauss_newton_step(evaluated, parameters, members)
    fitted = ~np.isnan(parameters[:, 0])
    return (arcs, parameters) if fitted.all() else select_rows((arcs, parameters), fitted)


def _compare(arcs: list[_GrowingArc], parameters: FloatArray) -> tuple[EllipseResiduals, BoolArray]:
    """Compare the points in the next windows of k arcs with ellipses of parameters (k, 5).

    Returns
    -------
    evaluated : EllipseResiduals
        Residuals (k, n) of the points of all windows.
    within : (k, n) bool ndarray
        Points that face the sensor and lie within the sensor error.
    """
    points, valid = NoisyPoints.stack([arc.move_window() for arc in arcs])
    evaluated = ellipse_residuals(points, parameters)
    squares = evaluated.normalised_squares
    medians = row_medians(squares, [arc.inliers - arc.start for arc in arcs])
    limits = [
        SENSOR_ERROR_SIGMAS * min(max(MAD_TO_STD * math.sqrt(median), 1.0), arc.max_noise_factor)
        for median, arc in zip(medians, arcs, strict=True)
    ]
    within: BoolArray = squares < as_column([limit * limit for limit in limits])
    within &= evaluated.normals.imag > MIN_NORMAL_Y
    if valid is not None:
        within &= valid
    return evaluated, within


def find_connected_inliers(inliers: BoolArray, previous: IntArray) -> IntArray:
    """Return the inliers that are connected to the middle of an arc, across short interruptions.

    Parameters
    ----------
    inliers : (w,) bool ndarray
        Mask of the inliers of a window.
    previous : (n,) int ndarray
        Ascending positions of the arc's previous inliers in that window, at least one.

    Returns
    -------
    (n,) int ndarray
        Ascending positions of the connected inliers; empty if the window has no inlier.
    """
    members = inliers.nonzero()[0]
    cuts = (members[1:] - members[:-1] > INTERRUPTING_RUN).nonzero()[0] + 1
    if len(cuts) == 0:
        return members
    firsts = members[np.append(0, cuts)]
    stops = members[np.append(cuts, len(members)) - 1] + 1
    middle = (int(previous[0]) + int(previous[-1])) / 2
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
