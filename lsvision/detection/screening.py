"""Accurate screening: which points at the ends of an arc lie on its ellipse (section 3.2.2).

As in the paper, an ellipse is fitted to the middle part of the arc and the points at both ends are
compared with it. Here the comparison is a posterior probability (`lsvision.detection.end_points`),
and it is repeated with the inliers of the other end in the fit, so that both ends are treated
alike and reversing the order of the points does not change the result.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lsvision.detection.arcs import MIN_POINTS, IdentifiedArc
from lsvision.detection.end_condition import connected_beyond
from lsvision.detection.end_points import (
    POINTS_BEYOND,
    PREDECESSORS,
    WINDOW,
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
from lsvision.geometry import Ellipse, FloatArray, IntArray
from lsvision.geometry.noisy_points import NoisyPoints
from lsvision.profile import PreparedProfile

MIDDLE_FRACTION = 0.7
"""Fraction of the arc's points in its middle part."""
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
EDGE_POINTS_PER_CORRELATION = 2
"""Points dropped at each end per unit of autocorrelation time above 1: near an edge, a sensor that
smooths along the line mixes in the surface beyond the edge."""


class ScreenedArc(NamedTuple):
    """Ascending indices (n,) of the inliers of an arc, with the noise of their residuals.

    `points` have the noise of a smoothing sensor if neighbouring errors are correlated; the
    `ellipse` (mm, rad) is that of all inliers; `variance_factor` is the variance of the residuals
    over that of the noise model.
    """

    indices: IntArray
    points: NoisyPoints
    ellipse: Ellipse
    variance_factor: float


class _Line(NamedTuple):
    """The middle part of an arc, and the points on both sides of it.

    For each side, `ends` holds positions in `indices`: two points of the middle part, then those
    outwards from it; `members` holds positions among the latter, those of the identified arc.
    """

    indices: IntArray
    points: NoisyPoints
    middle: slice
    ends: tuple[IntArray, IntArray]
    members: tuple[IntArray, ...]

    def end_rows(self, side: int, members: IntArray) -> IntArray:
        """Return the positions in `indices` of members of an end, outwards."""
        return self.ends[side][members + PREDECESSORS]

    def indices_with(self, members: Sequence[IntArray]) -> tuple[IntArray, NoisyPoints]:
        """Return the middle part and the ends' members, ascending, and their points."""
        middle = np.arange(self.middle.start, self.middle.stop)
        first, last = (self.end_rows(side, members[side]) for side in (0, 1))
        rows = np.concatenate([first[::-1], middle, last])
        return self.indices[rows], self.points[rows]


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


def screen_arc(profile: PreparedProfile, arc: IdentifiedArc) -> ScreenedArc | None:
    """Select the inliers at both ends of an arc; None where no ellipse fits its middle part.

    An arc with too few points to be screened is returned unchanged.
    """
    line = _split_arc(profile, arc)
    if line is None:
        return ScreenedArc(arc.indices, profile.noisy_points[arc.indices], arc.ellipse, 1.0)
    fitted = _fit_middle(profile, line, parameters_from_ellipse(arc.ellipse))
    if fitted is None:
        return None
    line, noise = fitted.line, fitted.noise
    parameters, ends = _compare_ends(fitted)
    if not is_ellipse(parameters):
        return None
    ellipse = ellipse_from_parameters(parameters)
    indices, _ = line.indices_with([end.inliers.members for end in ends])
    # An arc that reaches the last of the points beyond is screened once more.
    first, last = int(line.indices[0]), int(line.indices[-1])
    if first == indices[0] > 0 or last == indices[-1] < len(profile.points) - 1:
        return screen_arc(profile, IdentifiedArc.of(indices, ellipse))
    kept = line.indices_with([_keep(line, side, ends[side], noise) for side in (0, 1)])
    return ScreenedArc(*kept, ellipse, noise.variance_factor)


def _split_arc(profile: PreparedProfile, arc: IdentifiedArc) -> _Line | None:
    """Return the inliers of the middle part, and all points from there to beyond the ends."""
    count = len(arc.indices)
    end_count = min(max(2, round((1 - MIDDLE_FRACTION) / 2 * count)), MAX_END_POINTS)
    inner = arc.indices[end_count : count - end_count]
    if len(inner) < MIN_POINTS:
        return None
    left = np.arange(max(0, arc.arc.start - WINDOW), inner[0])
    right = np.arange(inner[-1] + 1, min(arc.arc.stop + WINDOW, len(profile.points)))
    indices = np.concatenate([left, inner, right])
    begin, end = len(left), len(left) + len(inner)
    rows = np.arange(len(indices))
    identified = np.zeros(len(profile.points), dtype=bool)
    identified[arc.indices] = True
    members = tuple(identified[side].nonzero()[0] for side in (left[::-1], right))
    ends = (rows[: begin + PREDECESSORS][::-1], rows[end - PREDECESSORS :])
    return _Line(indices, profile.noisy_points[indices], slice(begin, end), ends, members)


def _fit_middle(
    profile: PreparedProfile, line: _Line, parameters: FloatArray, *, smoothed: bool = False
) -> _MiddleFit | None:
    """Fit the ellipse of the middle part and estimate the noise from its residuals."""
    parameters = refine_ellipse(line.points[line.middle], parameters, steps=1)
    if not is_ellipse(parameters):
        return None
    compared = ellipse_residuals(line.points, parameters)
    noise = estimate_arc_noise(compared.rows(line.middle), profile.min_variance_factor)
    if smoothed or not noise.smoothed:
        return _MiddleFit(line, parameters, compared, noise)
    points = smoothed_noise(line.points, compared.normals, profile.noise_std)
    return _fit_middle(profile, line._replace(points=points), parameters, smoothed=True)


def _compare_ends(fitted: _MiddleFit) -> tuple[FloatArray, list[_ComparedEnd]]:
    """Compare each end with the ellipse of all other inliers, until no inlier changes.

    The parameters of the ellipse of all inliers are NaN, or no ellipse, where the fit breaks down.
    """
    line, parameters, compared, noise = fitted
    members: Sequence[IntArray] = line.members
    for _ in range(MAX_ITERATIONS):
        system = WeightedSystem.of(compared, noise.variance_factor)
        middle = system.normal_equations(line.middle)
        add_flattening_prior(middle, parameters)
        equations = [system.normal_equations(line.end_rows(i, members[i])) for i in (0, 1)]
        predictions = [_predict(middle + equations[1 - i], noise, parameters) for i in (0, 1)]
        if any(math.isnan(prediction.covariance[0, 0]) for prediction in predictions):
            return np.full(PARAMETERS, np.nan), []
        points = _end_points(line, compared, system.rows, noise)
        ends = [
            _ComparedEnd(*pair, find_end_inliers(*pair))
            for pair in zip(points, predictions, strict=True)
        ]
        previous, members = members, [end.inliers.members for end in ends]
        same = (a.tobytes() == b.tobytes() for a, b in zip(members, previous, strict=True))
        converged = all(same)
        if not converged:
            equations = [system.normal_equations(line.end_rows(i, members[i])) for i in (0, 1)]
        parameters = parameters + damped_step(middle + equations[0] + equations[1], parameters)
        if converged or not is_ellipse(parameters):
            break
        compared = ellipse_residuals(line.points, parameters)
    return parameters, ends


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
    rows = np.concatenate(line.ends)  # both ends at once
    points, compared, jacobian = line.points[rows], compared.rows(rows), system_rows.take(rows, 1)
    feet = points.z - compared.residuals * compared.normals
    positions = np.zeros(len(feet))
    np.abs(feet[1:] - feet[:-1]).cumsum(out=positions[1:])
    visible = points.incidence_cosines(compared.normals) > MIN_INCIDENCE_COSINE
    variances = compared.inflated_variances * noise.variance_factor
    first = len(line.ends[0])
    return [
        EndPoints(
            compared.residuals[end],
            variances[end],
            jacobian[:PARAMETERS, end],
            visible[end],
            positions[end] - positions[end.start],
        )
        for end in (slice(0, first), slice(first, len(rows)))
    ]


def _keep(line: _Line, side: int, end: _ComparedEnd, noise: ArcNoise) -> IntArray:
    """Return the inliers of an end that are probable enough for their leverage."""
    members, log_odds, leverages = end.inliers
    if len(members) == 0:
        return members
    z = line.points.z[line.ends[side]]
    inside = np.concatenate([range(PREDECESSORS), members + PREDECESSORS])
    following = connected_beyond(z[inside], z[inside[-1] + 1 :], POINTS_BEYOND) + members[-1] + 1
    probability = 1 / (1 + np.exp(-log_odds))
    if len(following):
        probability *= departure_free_probability(end.points, end.prediction, members, following)
    # A wrong inlier may shift the ellipse by sqrt(leverage) of the ellipse's standard deviations.
    kept = members[probability > np.sqrt(leverages) * (1 - probability)]
    dropped = round(EDGE_POINTS_PER_CORRELATION * (noise.autocorrelation_time - 1))
    # A contact: enough connected points beyond the last inlier, or enough rejected inliers.
    if max(len(following), len(members) - len(kept)) >= MIN_CONTACT_POINTS:
        dropped += GUARD_POINTS
    return kept[: max(0, len(kept) - dropped)]
