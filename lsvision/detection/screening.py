"""Accurate screening: which points at the ends of an arc lie on its ellipse (section 3.2.2).

As in the paper, an ellipse is fitted to the middle part of the arc and the points at both ends are
compared with it. Here the comparison is a posterior probability (`lsvision.detection.end_points`),
and it is repeated with the inliers of the other end in the fit, so that both ends count alike and
the order of the points does not matter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lsvision.detection.arcs import IdentifiedArc
from lsvision.detection.end_condition import connected_beyond
from lsvision.detection.end_points import (
    PREDECESSORS,
    WINDOW_BEYOND,
    EndInliers,
    EndPoints,
    Prediction,
    departure_free_probability,
    find_end_inliers,
)
from lsvision.ellipse.arc_noise import ArcNoise, estimate_arc_noise, smoothed_noise
from lsvision.ellipse.parameters import (
    ellipse_from_parameters,
    is_ellipse,
    parameters_from_ellipse,
)
from lsvision.ellipse.robust_gauss_newton import (
    IDENTITY,
    EllipseResiduals,
    NormalEquations,
    WeightedSystem,
    ellipse_residuals,
    refine_ellipse,
    solve_positive_definite,
)
from lsvision.geometry import Ellipse, FloatArray, IntArray
from lsvision.geometry.noisy_points import NoisyPoints
from lsvision.profile import PreparedProfile

MIDDLE_FRACTION = 0.7
"""Share of the arc's points in its middle part."""
MIN_MIDDLE_POINTS = 8
"""In the middle part; with fewer an arc is not screened."""
POINTS_BEYOND, FRACTION_BEYOND = 14, 0.33
"""Points beyond the ends among which more of the arc is looked for: so many, or this share of the
arc's points. Growth stops early where the seed's ellipse bends away from a tilted section. An arc
that turns out to go on as far as was looked is screened once more."""
MAX_END_POINTS = 100
"""Of either of these: the filter of an end takes time with the cube of its points."""
MAX_ITERATIONS = 3
"""Of fit and comparison: more change no inlier that matters."""
MIN_INCIDENCE_COSINE = 0.05
"""Cosine of the incidence, 87 deg, from which on no sensor sees a surface."""
GUARD_POINTS = 1
"""Inliers dropped at a contact: the last one was chosen by its own residual, and with a model of
the sensor 4 % of the intervals would miss the radius for it. Two cost accuracy and gain nothing."""
MIN_CONTACT_POINTS = 3
"""Connected points beyond an end that make it a contact: a bead, a neighbour, a plate."""
EDGE_POINTS_PER_CORRELATION = 1.7
"""Points dropped at each end for each unit of the autocorrelation time over 1: before an edge, a
sensor that smooths along the line mixes in what lies beyond."""
TINY_MM = 1e-9
"""Points may share a foot; arc length must rise all the same."""


@dataclass(frozen=True, eq=False, slots=True)
class ScreenedArc:
    """An arc with its inliers and the noise that they show.

    Parameters
    ----------
    indices : (n,) int ndarray
        The inliers, rising.
    points : NoisyPoints
        The same points, with the noise model of a smoothing sensor where they show one.
    ellipse : Ellipse
        Units: mm, rad.
    variance_factor : float
        Of their residuals over the noise model of the profile.
    """

    indices: IntArray
    points: NoisyPoints
    ellipse: Ellipse
    variance_factor: float


@dataclass(frozen=True, eq=False, slots=True)
class _Line:
    """The middle part of an arc, and what lies before and beyond it.

    `ends` holds the positions in `indices` of the points outwards from the middle part, after two
    of the middle part itself.
    """

    indices: IntArray
    points: NoisyPoints
    middle: slice
    ends: tuple[IntArray, IntArray]
    smoothed: bool = False

    def end_rows(self, side: int, members: IntArray) -> IntArray:
        """Positions in `indices` of members of an end, outwards."""
        return self.ends[side][members + PREDECESSORS]

    def rows_with(self, members: Sequence[IntArray]) -> IntArray:
        """Positions in `indices` of the middle part and the members of both ends, rising."""
        middle = np.arange(self.middle.start, self.middle.stop)
        return np.concatenate(
            [self.end_rows(0, members[0])[::-1], middle, self.end_rows(1, members[1])]
        )

    def members_of(self, side: int, arc: IdentifiedArc) -> IntArray:
        """Positions among the points of an end that are an arc's."""
        indices = self.indices[self.ends[side][PREDECESSORS:]]
        members: IntArray = np.isin(indices, arc.indices).nonzero()[0]
        return members


class _MiddleFit(NamedTuple):
    """Ellipse of the middle part, all points compared with it, and the noise that they show."""

    line: _Line
    parameters: FloatArray
    compared: EllipseResiduals
    noise: ArcNoise


class _ComparedEnd(NamedTuple):
    """The points of an end, what predicts them, and which are inliers."""

    points: EndPoints
    prediction: Prediction
    found: EndInliers


class _Comparison(NamedTuple):
    """Ellipse of the middle part and the inliers of both ends."""

    ellipse: Ellipse
    ends: tuple[_ComparedEnd, ...]


def screen_arc(profile: PreparedProfile, arc: IdentifiedArc) -> ScreenedArc | None:
    """Find the inliers at both ends of an arc.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    arc : IdentifiedArc
        From rough identification.

    Returns
    -------
    ScreenedArc or None
        None where no ellipse fits the middle part; an arc with too few points to be screened
        comes back as it is.
    """
    line = _split_arc(profile, arc)
    if line is None:
        return ScreenedArc(arc.indices, profile.noisy_points[arc.indices], arc.ellipse, 1.0)
    fitted = _fit_middle(profile, line, parameters_from_ellipse(arc.ellipse))
    compared = None if fitted is None else _compare_ends(fitted, arc)
    if fitted is None or compared is None:
        return None
    line, noise = fitted.line, fitted.noise
    members = [end.found.members for end in compared.ends]
    wider = IdentifiedArc.of(line.indices[line.rows_with(members)], compared.ellipse)
    if _reaches_limit(profile, arc, wider, line):
        return screen_arc(profile, wider)
    rows = line.rows_with([_keep(line, i, compared.ends[i], noise) for i in (0, 1)])
    return ScreenedArc(
        line.indices[rows], line.points[rows], compared.ellipse, noise.variance_factor
    )


def _compare_ends(fitted: _MiddleFit, arc: IdentifiedArc) -> _Comparison | None:
    """Compare the points of both ends with the ellipse of all others, until no inlier changes."""
    line, parameters, compared, noise = fitted
    members = [line.members_of(side, arc) for side in (0, 1)]
    for _ in range(MAX_ITERATIONS):
        before = members
        system = WeightedSystem.of(compared, noise.variance_factor)
        middle = system.normal_equations(line.middle).with_flattening_prior(parameters)
        known = [system.normal_equations(line.end_rows(i, before[i])) for i in (0, 1)]
        predictions = [_predict(middle + known[1 - i], noise, parameters) for i in (0, 1)]
        if not all(math.isfinite(p.covariance[0, 0]) for p in predictions):
            return None
        points = _end_points(line, compared, system.jacobian, noise)
        found = [find_end_inliers(*pair) for pair in zip(points, predictions, strict=True)]
        members = [end.members for end in found]
        updated = [system.normal_equations(line.end_rows(i, members[i])) for i in (0, 1)]
        parameters = parameters + (middle + updated[0] + updated[1]).damped_step(parameters)
        if not is_ellipse(parameters):
            return None
        if all(map(np.array_equal, members, before)):
            break
        compared = ellipse_residuals(line.points, parameters)
    ends = tuple(map(_ComparedEnd, points, predictions, found))
    return _Comparison(ellipse_from_parameters(parameters), ends)


def _reaches_limit(
    profile: PreparedProfile, arc: IdentifiedArc, wider: IdentifiedArc, line: _Line
) -> bool:
    """Whether an arc has grown as far as was looked, and the line goes on beyond."""
    first, last = profile.valid_indices[[0, -1]]
    start, stop = wider.indices[[0, -1]]
    return bool(
        (arc.indices[0] > start == line.indices[0] > first)
        or (arc.indices[-1] < stop == line.indices[-1] < last)
    )


def _split_arc(profile: PreparedProfile, arc: IdentifiedArc) -> _Line | None:
    """The inliers of the middle part, and all points from there to beyond the ends."""
    count, valid = len(arc.indices), profile.valid_indices
    part = min(max(2, round((1 - MIDDLE_FRACTION) / 2 * count)), MAX_END_POINTS)
    inner = arc.indices[part : count - part]
    if len(inner) < MIN_MIDDLE_POINTS:
        return None
    beyond = min(max(POINTS_BEYOND, int(FRACTION_BEYOND * count)), MAX_END_POINTS)
    first, last = np.searchsorted(valid, inner[[0, -1]]).tolist()
    start, _ = np.searchsorted(valid, arc.indices[[0, -1]] - beyond).tolist()
    _, stop = np.searchsorted(valid, arc.indices[[0, -1]] + beyond, "right").tolist()
    indices = np.concatenate([valid[start:first], inner, valid[last + 1 : stop]])
    begin, end = first - start, first - start + len(inner)
    rows = np.arange(len(indices))
    ends = (rows[: begin + PREDECESSORS][::-1], rows[end - PREDECESSORS :])
    return _Line(indices, profile.noisy_points[indices], slice(begin, end), ends)


def _fit_middle(
    profile: PreparedProfile, line: _Line, initial_guess: FloatArray
) -> _MiddleFit | None:
    """Ellipse of the middle part and the noise that it shows; the points with that noise."""
    parameters, _ = refine_ellipse(line.points[line.middle], initial_guess, steps=2)
    if not is_ellipse(parameters):
        return None
    compared = ellipse_residuals(line.points, parameters)
    noise = estimate_arc_noise(compared[line.middle], profile.min_variance_factor)
    if not noise.smoothed or line.smoothed:
        return _MiddleFit(line, parameters, compared, noise)
    points = smoothed_noise(line.points, compared.normals, profile.noise_std)
    return _fit_middle(profile, replace(line, points=points, smoothed=True), parameters)


def _predict(known: NormalEquations, noise: ArcNoise, parameters: FloatArray) -> Prediction:
    covariance = solve_positive_definite(known.information, IDENTITY)
    return Prediction(
        covariance @ known.gradient,
        covariance * noise.low_frequency_time,
        noise.autocorrelation_time,
        float(parameters[2]),
    )


def _end_points(
    line: _Line, compared: EllipseResiduals, jacobian: FloatArray, noise: ArcNoise
) -> list[EndPoints]:
    feet = line.points.z - compared.residuals * compared.normals
    steps = np.maximum(np.abs(feet[1:] - feet[:-1]), TINY_MM)
    positions = np.concatenate([[0.0], steps.cumsum()])
    visible = line.points.incidence_cosines(compared.normals) > MIN_INCIDENCE_COSINE
    variances = compared.inflated_variances * noise.variance_factor
    return [
        EndPoints(
            compared.residuals[rows],
            variances[rows],
            jacobian[:, rows],
            visible[rows],
            np.abs(positions[rows] - positions[rows[0]]),
        )
        for rows in line.ends
    ]


def _keep(line: _Line, side: int, end: _ComparedEnd, noise: ArcNoise) -> IntArray:
    """Members of an end that are kept: before a departure, and worth more than they may spoil."""
    found, z = end.found, line.points.z[line.ends[side]]
    if len(found.members) == 0:
        return found.members
    inside = np.append(np.arange(PREDECESSORS), found.members + PREDECESSORS)
    following = connected_beyond(z[inside], z[inside[-1] + 1 :], WINDOW_BEYOND)
    following += found.members[-1] + 1
    probability = found.odds / (1 + found.odds)
    if len(following):
        probability *= departure_free_probability(
            end.points, end.prediction, found.members, following
        )
    # A wrong inlier may shift the ellipse by the square root of its leverage, in its own sigmas.
    kept = found.members[probability > np.sqrt(found.leverages) * (1 - probability)]
    dropped = round(EDGE_POINTS_PER_CORRELATION * (noise.autocorrelation_time - 1))
    # Connected points beyond the last inlier, or from the last one kept on, make it a contact.
    if len(following) >= MIN_CONTACT_POINTS or len(found.members) - len(kept) >= MIN_CONTACT_POINTS:
        dropped += GUARD_POINTS
    return kept[: max(0, len(kept) - dropped)]
