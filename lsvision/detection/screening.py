"""Accurate screening: which points at the ends of an arc lie on its ellipse (section 3.2.2).

As in the paper, an ellipse is fitted to the middle part of the arc and the points at both ends are
compared with it. Here the comparison is a posterior probability (`lsvision.detection.end_points`),
and it is repeated with the inliers of the other end in the fit, so that both ends are treated
alike and reversing the order of the points does not change the result.
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
    PARAMETERS,
    ellipse_from_parameters,
    is_ellipse,
    parameters_from_ellipse,
)
from lsvision.ellipse.robust_gauss_newton import (
    EllipseResiduals,
    WeightedSystem,
    add_flattening_prior,
    damped_step,
    ellipse_residuals,
    inverse_information,
    refine_ellipse,
)
from lsvision.geometry import BoolArray, Ellipse, FloatArray, IntArray
from lsvision.geometry.noisy_points import NoisyPoints
from lsvision.profile import PreparedProfile

MIDDLE_FRACTION = 0.7
"""Fraction of the arc's points in its middle part."""
MIN_MIDDLE_POINTS = 8
"""Smallest number of points in the middle part; with fewer an arc is not screened."""
POINTS_BEYOND = 14
"""Points beyond each end that are screened, too: growing stops early where the initial ellipse
deviates from a tilted section. An arc that reaches the last of them is screened once more."""
MAX_END_POINTS = 100
"""Largest number of the arc's points at an end: the filter's time grows with its cube."""
MAX_ITERATIONS = 3
"""Largest number of fits and comparisons; more of them change no relevant inlier."""
MIN_INCIDENCE_COSINE = 0.05
"""Cosine of the largest incidence at which a sensor can see a surface, 87 deg."""
GUARD_POINTS = 1
"""Inliers dropped at a contact: the last inlier is selected by its own residual, and with a noise
model 4 % of the radius intervals would miss because of it. Dropping two only costs accuracy."""
MIN_CONTACT_POINTS = 3
"""Smallest number of connected points beyond an end that are a contact: bead, pipe or plate."""
EDGE_POINTS_PER_CORRELATION = 1.7
"""Points dropped at each end per unit of autocorrelation time above 1: near an edge, a sensor that
smooths along the line mixes in the surface beyond the edge."""


@dataclass(frozen=True, eq=False, slots=True)
class ScreenedArc:
    """Inliers of an arc, with the noise estimated from their residuals.

    Parameters
    ----------
    indices : (n,) int ndarray
        Indices of the inliers, ascending.
    points : NoisyPoints
        The inliers, with the noise of a smoothing sensor if neighbouring errors are correlated.
    ellipse : Ellipse
        Ellipse of the inliers. Units: mm, rad.
    variance_factor : float
        Variance of the residuals over that of the noise model.
    """

    indices: IntArray
    points: NoisyPoints
    ellipse: Ellipse
    variance_factor: float


@dataclass(frozen=True, eq=False, slots=True)
class _Line:
    """The middle part of an arc, and the points on both sides of it.

    For each side, `ends` holds positions in `indices`: two points of the middle part, then those
    outwards from it. `identified` marks the `indices` that belong to the identified arc.
    """

    indices: IntArray
    points: NoisyPoints
    middle: slice
    ends: tuple[IntArray, IntArray]
    identified: BoolArray
    smoothed: bool = False

    def end_rows(self, side: int, members: IntArray) -> IntArray:
        """Return the positions in `indices` of members of an end, outwards."""
        return self.ends[side][members + PREDECESSORS]

    def rows_with(self, members: Sequence[IntArray]) -> IntArray:
        """Return the positions in `indices` of the middle part and the ends' members, ascending."""
        middle = np.arange(self.middle.start, self.middle.stop)
        return np.concatenate(
            [self.end_rows(0, members[0])[::-1], middle, self.end_rows(1, members[1])]
        )

    def identified_members(self, side: int) -> IntArray:
        """Return the positions, within an end, of the points of the identified arc."""
        members: IntArray = self.identified[self.ends[side][PREDECESSORS:]].nonzero()[0]
        return members


class _MiddleFit(NamedTuple):
    """Ellipse of the middle part, residuals of all points from it, and the noise of the arc."""

    line: _Line
    parameters: FloatArray
    compared: EllipseResiduals
    noise: ArcNoise


class _ComparedEnd(NamedTuple):
    """Points of an end, the ellipse that predicts them, and their inliers."""

    points: EndPoints
    prediction: Prediction
    inliers: EndInliers


class _Comparison(NamedTuple):
    """Ellipse of the middle part and the inliers of both ends."""

    ellipse: Ellipse
    ends: tuple[_ComparedEnd, ...]


def screen_arc(profile: PreparedProfile, arc: IdentifiedArc) -> ScreenedArc | None:
    """Select the inliers at both ends of an arc.

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
        is returned unchanged.
    """
    line = _split_arc(profile, arc)
    if line is None:
        return ScreenedArc(arc.indices, profile.noisy_points[arc.indices], arc.ellipse, 1.0)
    fitted = _fit_middle(profile, line, parameters_from_ellipse(arc.ellipse))
    compared = None if fitted is None else _compare_ends(fitted)
    if fitted is None or compared is None:
        return None
    line, noise = fitted.line, fitted.noise
    members = [end.inliers.members for end in compared.ends]
    wider = IdentifiedArc.of(line.indices[line.rows_with(members)], compared.ellipse)
    if _reaches_limit(profile, arc, wider, line):
        return screen_arc(profile, wider)
    rows = line.rows_with([_keep(line, i, compared.ends[i], noise) for i in (0, 1)])
    return ScreenedArc(
        line.indices[rows], line.points[rows], compared.ellipse, noise.variance_factor
    )


def _compare_ends(fitted: _MiddleFit) -> _Comparison | None:
    """Compare each end with the ellipse of all other inliers, until no inlier changes."""
    line, parameters, compared, noise = fitted
    members = [line.identified_members(side) for side in (0, 1)]
    for _ in range(MAX_ITERATIONS):
        system = WeightedSystem.of(compared, noise.variance_factor)
        middle = system.normal_equations(line.middle)
        add_flattening_prior(middle, parameters)
        equations = [system.normal_equations(line.end_rows(i, members[i])) for i in (0, 1)]
        predictions = [_predict(middle + equations[1 - i], noise, parameters) for i in (0, 1)]
        if not all(math.isfinite(p.covariance[0, 0]) for p in predictions):
            return None
        points = _end_points(line, compared, system.rows, noise)
        inliers = [find_end_inliers(*pair) for pair in zip(points, predictions, strict=True)]
        previous, members = members, [end.members for end in inliers]
        same = (a.tobytes() == b.tobytes() for a, b in zip(members, previous, strict=True))
        converged = all(same)
        if not converged:
            equations = [system.normal_equations(line.end_rows(i, members[i])) for i in (0, 1)]
        parameters = parameters + damped_step(middle + equations[0] + equations[1], parameters)
        if not is_ellipse(parameters):
            return None
        if converged:
            break
        compared = ellipse_residuals(line.points, parameters)
    ends = tuple(map(_ComparedEnd, points, predictions, inliers))
    return _Comparison(ellipse_from_parameters(parameters), ends)


def _reaches_limit(
    profile: PreparedProfile, arc: IdentifiedArc, wider: IdentifiedArc, line: _Line
) -> bool:
    """Return whether an arc reaches the last screened point, and the profile goes on beyond."""
    first, last = profile.valid_indices[[0, -1]]
    start, stop = wider.indices[[0, -1]]
    return bool(
        (arc.indices[0] > start == line.indices[0] > first)
        or (arc.indices[-1] < stop == line.indices[-1] < last)
    )


def _split_arc(profile: PreparedProfile, arc: IdentifiedArc) -> _Line | None:
    """Return the inliers of the middle part, and all points from there to beyond the ends."""
    count, valid = len(arc.indices), profile.valid_indices
    end_count = min(max(2, round((1 - MIDDLE_FRACTION) / 2 * count)), MAX_END_POINTS)
    inner = arc.indices[end_count : count - end_count]
    if len(inner) < MIN_MIDDLE_POINTS:
        return None
    first, last = np.searchsorted(valid, inner[[0, -1]]).tolist()
    start, _ = np.searchsorted(valid, arc.indices[[0, -1]] - POINTS_BEYOND).tolist()
    _, stop = np.searchsorted(valid, arc.indices[[0, -1]] + POINTS_BEYOND, "right").tolist()
    indices = np.concatenate([valid[start:first], inner, valid[last + 1 : stop]])
    begin, end = first - start, first - start + len(inner)
    rows = np.arange(len(indices))
    ends = (rows[: begin + PREDECESSORS][::-1], rows[end - PREDECESSORS :])
    identified = np.zeros(len(profile.points), dtype=bool)
    identified[arc.indices] = True
    points = profile.noisy_points[indices]
    return _Line(indices, points, slice(begin, end), ends, identified[indices])


def _fit_middle(
    profile: PreparedProfile, line: _Line, initial_guess: FloatArray
) -> _MiddleFit | None:
    """Fit the ellipse of the middle part and estimate the noise from its residuals."""
    parameters = refine_ellipse(line.points[line.middle], initial_guess, steps=1)
    if not is_ellipse(parameters):
        return None
    compared = ellipse_residuals(line.points, parameters)
    noise = estimate_arc_noise(compared[line.middle], profile.min_variance_factor)
    if not noise.smoothed or line.smoothed:
        return _MiddleFit(line, parameters, compared, noise)
    points = smoothed_noise(line.points, compared.normals, profile.noise_std)
    return _fit_middle(profile, replace(line, points=points, smoothed=True), parameters)


def _predict(equations: FloatArray, noise: ArcNoise, parameters: FloatArray) -> Prediction:
    covariance = inverse_information(equations)
    return Prediction(
        covariance @ equations[:, -1],
        covariance * noise.low_frequency_time,
        noise.autocorrelation_time,
        float(parameters[2]),
    )


def _end_points(
    line: _Line, compared: EllipseResiduals, system_rows: FloatArray, noise: ArcNoise
) -> list[EndPoints]:
    feet = line.points.z - compared.residuals * compared.normals
    positions = np.concatenate([[0.0], np.abs(feet[1:] - feet[:-1]).cumsum()])
    visible = line.points.incidence_cosines(compared.normals) > MIN_INCIDENCE_COSINE
    variances = compared.inflated_variances * noise.variance_factor
    return [
        EndPoints(
            compared.residuals[rows],
            variances[rows],
            system_rows[:PARAMETERS, rows],
            visible[rows],
            np.abs(positions[rows] - positions[rows[0]]),
        )
        for rows in line.ends
    ]


def _keep(line: _Line, side: int, end: _ComparedEnd, noise: ArcNoise) -> IntArray:
    """Return the inliers of an end that are probable enough for their leverage."""
    inliers, z = end.inliers, line.points.z[line.ends[side]]
    if len(inliers.members) == 0:
        return inliers.members
    inside = np.append(np.arange(PREDECESSORS), inliers.members + PREDECESSORS)
    following = connected_beyond(z[inside], z[inside[-1] + 1 :], WINDOW_BEYOND)
    following += inliers.members[-1] + 1
    probability = inliers.odds / (1 + inliers.odds)
    if len(following):
        probability *= departure_free_probability(
            end.points, end.prediction, inliers.members, following
        )
    # A wrong inlier may shift the ellipse by sqrt(leverage) of the ellipse's standard deviations.
    kept = inliers.members[probability > np.sqrt(inliers.leverages) * (1 - probability)]
    dropped = round(EDGE_POINTS_PER_CORRELATION * (noise.autocorrelation_time - 1))
    # A contact: enough connected points beyond the last inlier, or enough rejected inliers.
    rejected = len(inliers.members) - len(kept)
    if max(len(following), rejected) >= MIN_CONTACT_POINTS:
        dropped += GUARD_POINTS
    return kept[: max(0, len(kept) - dropped)]
