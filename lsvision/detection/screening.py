"""Accurate screening: which points at the ends of an arc lie on its ellipse (section 3.2.2).

As in the paper, an ellipse is fitted to the middle part of the arc and the points at both ends are
compared with it. Here the comparison is a posterior probability (`lsvision.detection.end_points`).
It is repeated with the inliers of the other end in the fit, so that both ends are treated in the
same way and reversing the order of the points does not change the result. The arcs of one or more
profiles are screened together as a stack: k arcs with up to n points each. A closed section has no
ends, and keeps all its points (`lsvision.detection.closed_section`).
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from lsvision.detection.arc_stack import ArcStack, SplitArc, split_arc
from lsvision.detection.arcs import IdentifiedArc, ScreenedArc
from lsvision.detection.closed_section import complete_closed_section
from lsvision.detection.end_condition import find_connected_beyond
from lsvision.detection.end_points import (
    FOOT_POINTS,
    PREDECESSORS,
    EndInliers,
    EndPoints,
    Prediction,
    compute_departure_free_probability,
    find_end_inliers,
)
from lsvision.ellipse.arc_noise import apply_smoothing_sensor_noise, estimate_arc_noise
from lsvision.ellipse.parameters import PARAMETERS, are_ellipses, ellipse_from_parameters
from lsvision.ellipse.robust_gauss_newton import (
    EllipseResiduals,
    WeightedSystem,
    add_flattening_prior,
    compute_arc_lengths,
    ellipse_residuals,
    invert_information_or_nan,
    solve_damped_step,
    take_gauss_newton_step,
)
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.geometry.arrays import select_rows
from lsvision.geometry.noisy_points import NoisyPoints
from lsvision.profile import PreparedProfile

MAX_ITERATIONS = 3
"""Largest number of fits and comparisons; more iterations change hardly any inlier."""
GUARD_POINTS = 1
"""Number of inliers dropped at a contact: the outermost inlier is selected by its own residual, and
with a noise model 4 % of the radius intervals would miss the radius because of it. To drop two has
no benefit and reduces accuracy."""
MIN_DEPARTURE_FREE = 0.9
"""Smallest probability that the line has not departed from the ellipse before a point or at it. The
points of the foot of a weld bead all deviate to the same side: of pipes with smooth beads on both
sides, 93 % of the 95 % intervals hold the radius, with 0.5 only 90 %."""
MIN_CONTACT_POINTS = 3
"""Smallest number of connected points beyond an end that count as a contact with another object,
such as a bead, a pipe or a plate."""
EDGE_POINTS_PER_CORRELATION = 2
"""Number of points dropped at each end per unit of autocorrelation time above 1: near an edge, the
points of a sensor that smooths along the line contain the surface beyond the edge."""


class _Noises(NamedTuple):
    """Noise of k arcs: the fields of `ArcNoise` as arrays (k,), in the same order."""

    variance_factor: FloatArray
    autocorrelation_time: FloatArray
    low_frequency_time: FloatArray
    sensor_smooths: BoolArray

    @property
    def mixed_points(self) -> IntArray:
        """Numbers of points near an edge that may contain the surface beyond it, (k,).

        0 unless the errors of neighbours are correlated.
        """
        return np.rint(EDGE_POINTS_PER_CORRELATION * (self.autocorrelation_time - 1)).astype(int)


class _ArcFits(NamedTuple):
    """Stack of k arcs with their ellipses, the residuals of all points (k, n), and the noise."""

    stack: ArcStack
    evaluated: EllipseResiduals
    noise: _Noises


class _EndComparison(NamedTuple):
    """Points of both ends of k arcs (k, 2), the predicted ellipses, and the inliers."""

    points: EndPoints
    prediction: Prediction
    inliers: EndInliers


def screen_arcs(
    profiles: Sequence[PreparedProfile], arcs: Sequence[IdentifiedArc]
) -> list[ScreenedArc | None]:
    """Select the inliers at both ends of each arc.

    Parameters
    ----------
    profiles : sequence of PreparedProfile
        Profile of each arc.
    arcs : sequence of IdentifiedArc
        The arcs.

    Returns
    -------
    list of ScreenedArc or None
        None where no ellipse fits the middle part, alone or with inliers of the ends. An arc with
        too few points for screening keeps the inliers of its identification; a closed section has
        all points around its ellipse.
    """
    screened: list[ScreenedArc | None] = [None] * len(arcs)
    remaining = dict(enumerate(arcs))
    while remaining:
        splits = []
        for number, arc in remaining.items():
            closed = complete_closed_section(profiles[number], arc)
            split = split_arc(number, profiles[number], arc)
            if closed is not None:
                screened[number] = closed
            elif split is None:
                points = profiles[number].noisy_points[arc.indices]
                screened[number] = ScreenedArc(arc.indices, points, arc.ellipse, 1.0)
            else:
                splits.append(split)
        # An arc whose inliers include the outermost point that was compared may continue beyond it:
        # it is screened again. Each time it has more inliers than before, so that this ends.
        remaining = {}
        for fits in _fit_middles(splits):
            for number, result in _compare_ends(fits):
                if isinstance(result, IdentifiedArc):
                    remaining[number] = result
                else:
                    screened[number] = result
    return screened


def _fit_middles(arcs: list[SplitArc]) -> Iterator[_ArcFits]:
    """Yield up to two stacks of arcs with the ellipses and the noise of their middle parts.

    The second stack has the arcs with correlated errors, and the noise of a sensor that smooths
    along the line.
    """
    fits = _fit_middle(ArcStack.of(arcs)) if arcs else None
    if fits is None:
        return
    sensor_smooths = fits.noise.sensor_smooths
    if not sensor_smooths.any():
        yield fits
        return
    yield select_rows(fits, ~sensor_smooths)
    stack, evaluated, _ = select_rows(fits, sensor_smooths)
    stds = np.array([[arc.profile.noise_std] for arc in stack.arcs])
    points = apply_smoothing_sensor_noise(stack.points, evaluated.normals, stds)
    fits = _fit_middle(stack._replace(points=points))
    if fits is not None:
        yield fits


def _fit_middle(stack: ArcStack) -> _ArcFits | None:
    """Fit the ellipses of middle parts and estimate the noise.

    Arcs without an ellipse are left out; None if no arc has one.
    """
    middle = stack.middle
    evaluated = ellipse_residuals(stack.points[..., middle], stack.parameters)
    parameters = take_gauss_newton_step(evaluated, stack.parameters, stack.middle_valid)
    stack, fitted = stack._replace(parameters=parameters), ~np.isnan(parameters[:, 0])
    if not fitted.any():
        return None
    if not fitted.all():
        stack = select_rows(stack, fitted)
    evaluated = ellipse_residuals(stack.points, stack.parameters)
    normalised = evaluated.residuals[:, middle] / np.sqrt(evaluated.variances[:, middle])
    noises = [
        estimate_arc_noise(row[: len(arc.middle)], arc.profile.min_variance_factor)
        for row, arc in zip(normalised, stack.arcs, strict=True)
    ]
    return _ArcFits(stack, evaluated, _Noises(*map(np.array, zip(*noises, strict=True))))


def _compare_ends(fits: _ArcFits) -> Iterator[tuple[int, ScreenedArc | IdentifiedArc]]:
    """Compare each end with the ellipse of all other inliers, until no inlier changes.

    Yields the number of each arc with its result, which is an identified arc if the inliers include
    the outermost point that was compared. Arcs whose fit fails are left out.
    """
    for remaining in reversed(range(MAX_ITERATIONS)):
        if not fits.stack.arcs:
            return
        fits, ends, converged = _compare_once(fits)
        finished = converged | (remaining == 0)
        if finished.all():
            yield from _finish_arcs(fits, ends)
            return
        yield from _finish_arcs(*select_rows((fits, ends), finished))
        fits = select_rows(fits, ~finished)
        evaluated = ellipse_residuals(fits.stack.points, fits.stack.parameters)
        fits = fits._replace(evaluated=evaluated)


def _compare_once(fits: _ArcFits) -> tuple[_ArcFits, _EndComparison, BoolArray]:
    """Return the arcs with the ellipses of their new inliers, their ends, and which have converged.

    An arc has converged if none of its inliers has changed. Arcs whose fit fails are left out.
    """
    stack = fits.stack
    system = WeightedSystem.of(fits.evaluated, fits.noise.variance_factor[:, None])
    middle = WeightedSystem(system.rows[..., stack.middle], system.weights[:, stack.middle])
    equations = middle.build_normal_equations(stack.middle_valid)
    # For the predictions; `solve_damped_step` below adds the prior itself.
    with_prior = equations.copy()
    add_flattening_prior(with_prior, stack.parameters)
    rows, weights = stack.take_ends(system.rows), stack.take_ends(system.weights)
    ends = WeightedSystem(rows[..., PREDECESSORS:], weights[..., PREDECESSORS:])
    # Each end is predicted from the middle part and the other end.
    others = with_prior[:, None] + ends.build_normal_equations(stack.members)[:, ::-1]
    prediction, singular = _predict(others, fits)
    points = _build_end_points(fits, rows[..., :PARAMETERS, :])
    inliers = find_end_inliers(points, prediction)
    changed = np.logical_or.reduce(inliers.members != stack.members, axis=(1, 2))
    equations += ends.build_normal_equations(inliers.members).sum(axis=1)
    parameters = stack.parameters + solve_damped_step(equations, stack.parameters)
    valid = are_ellipses(parameters) & ~singular
    fits = fits._replace(stack=stack._replace(members=inliers.members, parameters=parameters))
    result = fits, _EndComparison(points, prediction, inliers), ~changed
    return result if valid.all() else select_rows(result, valid)


def _predict(equations: FloatArray, fits: _ArcFits) -> tuple[Prediction, BoolArray]:
    """Return the predictions of both ends (k, 2), and which arcs have singular equations (k,)."""
    covariance = invert_information_or_nan(equations)
    singular = np.isnan(covariance[..., 0, 0])
    covariance[singular] = 0.0
    offset = (covariance @ equations[..., PARAMETERS:])[..., 0]
    prediction = Prediction(
        offset,
        covariance * fits.noise.low_frequency_time[:, None, None, None],
        # The same for both ends of an arc.
        np.repeat(fits.noise.autocorrelation_time, 2).reshape(-1, 2),
        np.repeat(fits.stack.parameters[:, 2], 2).reshape(-1, 2),
    )
    return prediction, singular[:, 0] | singular[:, 1]


def _build_end_points(fits: _ArcFits, jacobian: FloatArray) -> EndPoints:
    """Return the points of both ends of k arcs, (k, 2, m + 2), with their `jacobian`."""
    evaluated, all_points, take_ends = fits.evaluated, fits.stack.points, fits.stack.take_ends
    mean_variance, deviator = take_ends(all_points.mean_variance), take_ends(all_points.deviator)
    points = NoisyPoints(take_ends(all_points.z), mean_variance, deviator)
    residuals, normals = take_ends(evaluated.residuals), take_ends(evaluated.normals)
    variance_factor = fits.noise.variance_factor[:, None, None]
    variances = take_ends(evaluated.inflated_variances) * variance_factor
    cosines = np.where(fits.stack.ends_valid, points.compute_incidence_cosines(normals), -1.0)
    positions = compute_arc_lengths(points.z, residuals, normals)
    return EndPoints(residuals, variances, jacobian, cosines, positions)


def _finish_arcs(
    fits: _ArcFits, ends: _EndComparison
) -> Iterator[tuple[int, ScreenedArc | IdentifiedArc]]:
    """Yield the number of each arc with its result, as `_compare_ends` does."""
    stack = fits.stack
    selected, mixed_points = _select_probable(fits, ends), fits.noise.mixed_points.tolist()
    for row, arc in enumerate(stack.arcs):
        ellipse = ellipse_from_parameters(stack.parameters[row])
        if arc.may_continue(stack.members[row]):
            indices, _ = stack.select_inliers(row, stack.members[row])
            yield arc.number, IdentifiedArc(indices, ellipse)
        else:
            variance_factor = float(fits.noise.variance_factor[row])
            points = stack.select_inliers(row, selected[row])
            yield arc.number, ScreenedArc(*points, ellipse, variance_factor, mixed_points[row])


def _select_probable(fits: _ArcFits, ends: _EndComparison) -> BoolArray:
    """Return the mask (k, 2, m) of the inliers that are probable enough for their leverage.

    The outermost of them are dropped at a contact (`GUARD_POINTS`), and near the edges in a profile
    of a sensor that smooths along the line (`EDGE_POINTS_PER_CORRELATION`).
    """
    members, log_odds, leverages = ends.inliers
    following = _mark_connected_beyond(fits.stack)
    # Including an outlier costs its leverage (the square of the shift of the ellipse there, over
    # the variance of a point), leaving out an inlier costs 1: a point is included where
    # probability(inlier) * 1 > probability(outlier) * leverage.
    selected = members & (log_odds > np.log(leverages))
    continues: BoolArray = np.logical_or.reduce(following, axis=-1)
    if continues.any():
        continued = select_rows((ends.points, ends.prediction, members, following), continues)
        selected[continues] &= compute_departure_free_probability(*continued) > MIN_DEPARTURE_FREE
    # A contact has enough connected points beyond the last inlier, or enough rejected inliers.
    rejected = (members & ~selected).sum(axis=-1)
    contact = np.maximum(following.sum(axis=-1), rejected) >= MIN_CONTACT_POINTS
    dropped = fits.noise.mixed_points[:, None] + GUARD_POINTS * contact
    rank_from_outside = selected[..., ::-1].cumsum(axis=-1)[..., ::-1]
    remaining: BoolArray = selected & (rank_from_outside > dropped[..., None])
    return remaining


def _mark_connected_beyond(stack: ArcStack) -> BoolArray:
    """Return the mask (k, 2, m) of the points connected beyond the last inlier of each end."""
    following = np.zeros(stack.members.shape, dtype=bool)
    points = stack.take_ends(stack.points.z)
    for row, arc in enumerate(stack.arcs):
        for side, end in enumerate(arc.ends):
            inliers = stack.members[row, side].nonzero()[0].tolist()
            if inliers:
                z, beyond = points[row, side, : len(end)].tolist(), inliers[-1] + 1
                inside = z[:PREDECESSORS] + [z[PREDECESSORS + i] for i in inliers]
                chain = find_connected_beyond(inside, z[PREDECESSORS + beyond :], FOOT_POINTS)
                following[row, side, [beyond + i for i in chain]] = True
    return following
