"""Accurate screening: which points at the ends of an arc lie on its ellipse (section 3.2.2).

As in the paper, an ellipse is fitted to the middle part of the arc and the points at both ends are
compared with it. Here the comparison is a posterior probability (`lsvision.detection.end_points`),
and it is repeated with the inliers of the other end in the fit, so that both ends count alike and
the order of the points does not matter.
"""

import math
from dataclasses import dataclass, replace

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
from lsvision.profile import PreparedProfile
from lsvision.shapes import Ellipse, FloatArray, IntArray
from lsvision.shapes.noisy_points import NoisyPoints

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

    def rows(self) -> IntArray:
        """Positions in `indices` of the middle part."""
        return np.arange(self.middle.start, self.middle.stop)

    def inlier_rows(self, side: int, inliers: EndInliers) -> IntArray:
        """Positions in `indices` of the inliers of an end."""
        return self.ends[side][inliers.members + PREDECESSORS]


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
    if fitted is None:
        return None
    line, parameters, compared, noise = fitted
    inliers = [_grown_inliers(line, arc, side) for side in (0, 1)]
    for _ in range(MAX_ITERATIONS):
        before = inliers
        system = WeightedSystem.of(compared, noise.variance_factor)
        middle = system.normal_equations(line.middle).with_flattening_prior(parameters)
        known = [system.normal_equations(line.inlier_rows(i, before[i])) for i in (0, 1)]
        predictions = [_predict(middle + known[1 - i], noise, parameters) for i in (0, 1)]
        if not all(math.isfinite(p.covariance[0, 0]) for p in predictions):
            return None
        ends = _end_points(line, compared, system.jacobian, noise)
        inliers = [find_end_inliers(*pair) for pair in zip(ends, predictions, strict=True)]
        found = [system.normal_equations(line.inlier_rows(i, inliers[i])) for i in (0, 1)]
        parameters = parameters + (middle + found[0] + found[1]).damped_step(parameters)
        if not is_ellipse(parameters):
            return None
        if all(map(np.array_equal, _members(inliers), _members(before))):
            break
        compared = ellipse_residuals(line.points, parameters)
    rows = [line.inlier_rows(0, inliers[0])[::-1], line.rows(), line.inlier_rows(1, inliers[1])]
    wider = IdentifiedArc.of(
        line.indices[np.concatenate(rows)], ellipse_from_parameters(parameters)
    )
    if _reaches_limit(profile, arc, wider, line):
        return screen_arc(profile, wider)
    kept = [_keep(line, i, ends[i], predictions[i], inliers[i], noise) for i in (0, 1)]
    chosen = np.concatenate([kept[0][::-1], line.rows(), kept[1]])
    return ScreenedArc(
        line.indices[chosen],
        line.points[chosen],
        ellipse_from_parameters(parameters),
        noise.variance_factor,
    )


def _members(inliers: list[EndInliers]) -> tuple[IntArray, IntArray]:
    return inliers[0].members, inliers[1].members


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


def _grown_inliers(line: _Line, arc: IdentifiedArc, side: int) -> EndInliers:
    """Points of an end that growth found: what the other end knows of it at first."""
    grown = np.isin(line.indices[line.ends[side][PREDECESSORS:]], arc.indices)
    return EndInliers(grown.nonzero()[0], np.empty(0), np.empty(0))


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
) -> tuple[_Line, FloatArray, EllipseResiduals, ArcNoise] | None:
    """Ellipse of the middle part and the noise that it shows; the points with that noise."""
    parameters, _ = refine_ellipse(line.points[line.middle], initial_guess, steps=1)
    if not is_ellipse(parameters):
        return None
    compared = ellipse_residuals(line.points, parameters)
    noise = estimate_arc_noise(compared[line.middle], profile.min_variance_factor)
    if not noise.smoothed or line.smoothed:
        return line, parameters, compared, noise
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


def _keep(
    line: _Line, side: int, end: EndPoints, prediction: Prediction, found: EndInliers,
    noise: ArcNoise,
) -> IntArray:  # fmt: skip
    """Rows of the inliers of an end that are kept, outwards."""
    rows = line.ends[side]
    z = line.points.z[rows]
    if len(found.members) == 0:
        return rows[:0]
    last = PREDECESSORS + int(found.members[-1])
    inside = z[np.append(np.arange(PREDECESSORS), found.members + PREDECESSORS)]
    following = found.members[-1] + 1 + connected_beyond(inside, z[last + 1 :], WINDOW_BEYOND)
    probability = found.odds / (1 + found.odds)
    if len(following):
        probability *= departure_free_probability(end, prediction, found.members, following)
    # A wrong inlier may shift the ellipse by the square root of its leverage, in its own sigmas.
    kept = found.members[probability > np.sqrt(found.leverages) * (1 - probability)]
    dropped = round(EDGE_POINTS_PER_CORRELATION * (noise.autocorrelation_time - 1))
    # Connected points beyond the last inlier, or from the last one kept on, make it a contact.
    if len(following) >= MIN_CONTACT_POINTS or len(found.members) - len(kept) >= MIN_CONTACT_POINTS:
        dropped += GUARD_POINTS
    return rows[kept[: max(0, len(kept) - dropped)] + PREDECESSORS]
