"""Bundle adjustment: joint refinement of camera, laser plane, board poses and board bow.

All unknowns are refined together, because most of the error of the laser plane comes from the
boards' poses and the camera: refining the plane alone does not improve on its linear estimate.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lsvision.calibration.board_shape import SHAPE_TERMS
from lsvision.calibration.bundle_adjustment_problem import (
    BundleAdjustmentProblem,
    BundleAdjustmentState,
    LaserView,
    Refinement,
    build_tilt_axes,
)
from lsvision.calibration.laser_plane_initial_guess import (
    fit_plane,
    intersect_laser_rays_with_boards,
)
from lsvision.geometry import FloatArray, Points
from lsvision.statistics.correlation import debiased_autocorrelation_time
from lsvision.statistics.robust import mad_std

HUBER_THRESHOLD = 3.0
"""Normalised residual above which the Huber loss is linear, which limits the influence of a bad
view."""

MAX_GROUPS, MIN_GROUP_SIZE = 4, 40
"""Largest number of groups of line points by predicted std, and smallest size of one."""

LINE_DOWNWEIGHTING = 1e4
"""Factor on the line's std with which the corners alone determine camera and boards."""

MAX_CORNER_STD_RATIO = 1.15
"""Largest ratio of the corner residual std with and without the laser line, for many corners; above
it line and corners are inconsistent. Of 381 simulated sets of lines in one plane the largest is
1.07; a limit of 0.88 rejects more than half of them. With 1.5, sets of shifted or bent lines give
1.6 times as many planes with an error of more than 4 standard deviations."""

MAX_LINE_STD_RATIO = 1.3
"""Largest ratio of the line residual std to the noise of the line; above it line and corners are
inconsistent. Of 274 simulated sets of lines in one plane, of 18 points and more, the largest is
1.21; a limit of 1.0 rejects 74 of them. Of 258 sets with shifted or bent lines 15 planes have an
error of more than 4 standard deviations, 21 with 1.5 and 34 with 2.5."""

MAX_STEPS = 40
"""Maximum number of iterations; about five are needed."""

RELATIVE_TOLERANCE, CORNER_TOLERANCE = 1e-9, 1e-6
"""Relative decrease of the loss at which the iteration stops: of the result, and of the fit to the
corners, from which it starts."""

INITIAL_DAMPING, MAX_DAMPING, DAMPING_FACTOR = 1e-4, 1e8, 10.0
"""Damping, relative to the diagonal of the normal matrix: in the first step, where the iteration
stops because no step decreases the loss, and the factor by which it changes from step to step."""


@dataclass(frozen=True, eq=False)
class BundleAdjustmentResult:
    """Refined state with residuals and covariance.

    Parameters
    ----------
    state : BundleAdjustmentState
        Unknowns at the minimum.
    corner_residuals, line_residuals : tuple of ndarray
        Residuals of each view, (n, 2) and (m,). Units: px.
    plane_covariance : (3, 3) ndarray
        Covariance of the tilt about the section's X and Y (rad) and the distance (mm).
    bow_std : (3,) ndarray
        Standard deviation of the bow; zero where it was fixed. Units: mm.
    line_inconsistent : bool
        Whether line and corners are inconsistent, so that camera and boards were determined by the
        corners alone.
    """

    state: BundleAdjustmentState
    corner_residuals: tuple[FloatArray, ...]
    line_residuals: tuple[FloatArray, ...]
    plane_covariance: FloatArray
    bow_std: FloatArray
    line_inconsistent: bool


def adjust_bundle(
    views: Sequence[LaserView],
    initial_guess: BundleAdjustmentState,
    refinement: Refinement,
    corner_std: float = 0.1,
) -> BundleAdjustmentResult:
    """Return all unknowns, refined jointly and weighted by the noise of corners and lines.

    First the corners alone determine camera and boards, which gives the corners' noise; that of the
    line is its deviation from a smooth curve. Then all is refined together. If this increases the
    corner residuals beyond noise, or the line residuals exceed the line's noise, the line does not
    lie in the plane of the corners (a sheet that is not flat beside the pattern, a wide saturated
    line): then the same is tried with flat boards, and if that does not help, camera and boards
    stay as the corners determine them, and the plane is fitted to the lines.

    Parameters
    ----------
    views : sequence of LaserView
        At least two; see `calibrate_laser_plane` for what they must span.
    initial_guess : BundleAdjustmentState
        Accurate to a few px.
    refinement : Refinement
        Parts of the state that are refined beside plane and poses.
    corner_std : float
        Initial guess of the corners' standard deviation. Units: px.

    Returns
    -------
    BundleAdjustmentResult
        Minimum of the Huber loss with its covariance.
    """
    corner_fit = _fit_corners(views, initial_guess, refinement, corner_std)
    problem = BundleAdjustmentProblem(
        _with_line_stds(views, corner_fit.line_noise.effective_stds),
        corner_fit.state,
        refinement,
        corner_fit.view_stds,
    )
    vector, information = _minimise(problem, RELATIVE_TOLERANCE)
    corner_residuals, line_residuals = problem.residuals_in_pixels(vector)
    if not _is_consistent(corner_residuals, line_residuals, corner_fit):
        if refinement.bow:
            # Where the line does not lie on the boards, it does not determine their bow.
            flat_boards = replace(corner_fit.state, bow=np.zeros(SHAPE_TERMS))
            flat = replace(refinement, bow=False)
            return adjust_bundle(views, flat_boards, flat, corner_fit.std)
        return _solve_plane_only(views, corner_fit.state)
    covariance, bow_std = _plane_covariance_and_bow_std(problem, information)
    return BundleAdjustmentResult(
        problem.unpack_state(vector),
        problem.split_corners(corner_residuals),
        problem.split_lines(line_residuals),
        covariance,
        bow_std,
        line_inconsistent=False,
    )


@dataclass(frozen=True, eq=False)
class _CornerFit:
    """Camera and boards from the corners alone, with the noise of corners and line.

    Parameters
    ----------
    state : BundleAdjustmentState
        Unknowns; the plane follows from the lines on these boards.
    std : float
        Standard deviation of a corner coordinate of all views. Units: px.
    view_stds : list of float
        That of each view, valid for heavy tails, too. Units: px.
    line_noise : LineNoise
        Noise of the lines.
    """

    state: BundleAdjustmentState
    std: float
    view_stds: list[float]
    line_noise: "LineNoise"


def _fit_corners(
    views: Sequence[LaserView],
    initial_guess: BundleAdjustmentState,
    refinement: Refinement,
    corner_std: float,
) -> _CornerFit:
    """Return the fit to the corners, to which the lines, with hardly any weight, add the plane."""
    problem = BundleAdjustmentProblem(
        _with_line_stds(views, [LINE_DOWNWEIGHTING * view.line_std for view in views]),
        initial_guess,
        refinement,
        [corner_std] * len(views),
    )
    vector, _ = _minimise(problem, CORNER_TOLERANCE)
    corner_residuals, line_residuals = problem.residuals_in_pixels(vector)
    # Poses, camera and bow absorb a part of the noise, a large one where there are few corners.
    fitted = problem.size - len(problem.find_plane_columns())
    dof_factor = np.sqrt(corner_residuals.size / max(corner_residuals.size - fitted, 1))
    return _CornerFit(
        problem.unpack_state(vector),
        _mad_std(corner_residuals),
        [dof_factor * _huber_std(values) for values in problem.split_corners(corner_residuals)],
        estimate_line_noise(views, problem.split_lines(line_residuals)),
    )


def _with_line_stds(views: Sequence[LaserView], stds: Iterable[FloatArray]) -> list[LaserView]:
    """Return the views with other standard deviations of their line points. Units: px."""
    return [replace(view, line_std=std) for view, std in zip(views, stds, strict=True)]


def _is_consistent(
    corner_residuals: Points, line_residuals: FloatArray, corner_fit: _CornerFit
) -> bool:
    """Return whether joint residuals in px are as small as those of corners and line alone."""
    # The second term is the noise of the ratio for few corners.
    max_std_ratio = MAX_CORNER_STD_RATIO + 2 / np.sqrt(corner_residuals.size)
    if _mad_std(corner_residuals) > corner_fit.std * max_std_ratio:
        return False
    normalised = line_residuals / np.concatenate(corner_fit.line_noise.point_stds)
    return _mad_std(normalised) <= MAX_LINE_STD_RATIO


def _solve_plane_only(
    views: Sequence[LaserView], state: BundleAdjustmentState
) -> BundleAdjustmentResult:
    """Return the plane fitted to the lines, with camera and boards from the corners alone."""
    laser_points = intersect_laser_rays_with_boards(state.camera, state.camera_from_boards, views)
    state = replace(state, plane=fit_plane(np.concatenate(laser_points)), bow=np.zeros(SHAPE_TERMS))
    # Only for its residuals, in px: the standard deviation of the corners is not used.
    fixed = Refinement(camera=False, bow=False)
    problem = BundleAdjustmentProblem(views, state, fixed, [1.0] * len(views))
    corner_residuals, line_residuals = problem.residuals_in_pixels(np.zeros(problem.size))
    return BundleAdjustmentResult(
        state,
        problem.split_corners(corner_residuals),
        problem.split_lines(line_residuals),
        _cluster_robust_covariance(state, laser_points),
        np.zeros(SHAPE_TERMS),
        line_inconsistent=True,
    )


def _cluster_robust_covariance(
    state: BundleAdjustmentState, laser_points: Sequence[Points]
) -> FloatArray:
    """Return the covariance (3, 3) of a plane whose errors are correlated within a view (sandwich).

    Each view has an error of offset and slope, of one variance for all views: three views are too
    few to estimate one for each. Order and units are those of
    `BundleAdjustmentResult.plane_covariance`.
    """
    design = [
        np.column_stack([points @ build_tilt_axes(state).T, -np.ones(len(points))])
        for points in laser_points
    ]
    mean_squares = [
        float(np.mean(state.plane.signed_distances(points) ** 2)) for points in laser_points
    ]
    # Three parameters, of two numbers for each view.
    variance = sum(mean_squares) / max(2 * len(laser_points) - 3, 1)
    inverse: FloatArray = np.linalg.inv(sum(rows.T @ rows for rows in design))
    gradient_covariance = variance * sum(len(rows) * rows.T @ rows for rows in design)
    return np.asarray(inverse @ gradient_covariance @ inverse, dtype=np.float64)


def _plane_covariance_and_bow_std(
    problem: BundleAdjustmentProblem, information: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance of the plane, and the std of the bow (0 where fixed)."""
    covariance: FloatArray = np.asarray(np.linalg.pinv(information, hermitian=True))
    plane, bow = problem.find_plane_columns(), problem.find_bow_columns()
    bow_std = np.zeros(SHAPE_TERMS)
    if len(bow):
        bow_std = np.sqrt(covariance[bow, bow])
    return covariance[np.ix_(plane, plane)], bow_std


def _minimise(
    problem: BundleAdjustmentProblem, relative_tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Return the minimum of the Huber loss by Levenberg-Marquardt, and J'WJ before the last step.

    `scipy.optimize.least_squares` needs twice the iterations here, with an SVD in each.
    """
    vector, damping = np.zeros(problem.size), INITIAL_DAMPING
    cost = _sum_huber_losses(problem(vector))
    for _ in range(MAX_STEPS):
        residuals, jacobian = problem(vector), problem.jacobian(vector)
        weights = np.minimum(1.0, HUBER_THRESHOLD / np.maximum(np.abs(residuals), 1e-300))
        information = jacobian.T @ (weights[:, None] * jacobian)
        gradient = jacobian.T @ (weights * residuals)
        decrease = 0.0
        while damping < MAX_DAMPING and not decrease > 0:
            damped = information + damping * np.diag(np.diag(information))
            trial = vector - np.linalg.solve(damped, gradient)
            decrease = cost - _sum_huber_losses(problem(trial))
            damping = damping / DAMPING_FACTOR if decrease > 0 else damping * DAMPING_FACTOR
        if not decrease > 0:
            break
        vector, cost = trial, cost - decrease
        if decrease < relative_tolerance * cost:
            break
    return vector, information


def _sum_huber_losses(residuals: FloatArray) -> float:
    """Return the sum of the Huber loss of normalised residuals; the square of a small one."""
    size = np.abs(residuals)
    return float(
        np.where(
            size < HUBER_THRESHOLD, size**2, HUBER_THRESHOLD * (2 * size - HUBER_THRESHOLD)
        ).sum()
    )


@dataclass(frozen=True, eq=False)
class LineNoise:
    """Standard deviation of each point of each view's line. Units: px.

    Parameters
    ----------
    point_stds : tuple of (m,) ndarray
        Standard deviation of a single point, for each view. Units: px.
    effective_stds : tuple of (m,) ndarray
        `point_stds` times the square root of the autocorrelation time, by which correlated points
        are weighted.
    """

    point_stds: tuple[FloatArray, ...]
    effective_stds: tuple[FloatArray, ...]


def estimate_line_noise(views: Sequence[LaserView], residuals: Sequence[FloatArray]) -> LineNoise:
    """Return the noise of the lines, estimated from their deviations from smooth curves.

    `residuals` are those of each line (m,) with respect to boards and plane, in px. Points are
    grouped by their predicted standard deviation, each group with its own estimate: a line is ten
    times more precise on white than on black.
    """
    deviations = [
        _deviations_from_trend(view, values) for view, values in zip(views, residuals, strict=True)
    ]
    predicted_stds = np.concatenate([view.line_std for view in views])
    ends = np.cumsum([len(deviation) for deviation in deviations])[:-1]
    point_stds = np.split(_stds_by_predicted_std(predicted_stds, np.concatenate(deviations)), ends)
    normalised = [
        np.clip(deviation / std, -HUBER_THRESHOLD, HUBER_THRESHOLD)
        for deviation, std in zip(deviations, point_stds, strict=True)
    ]
    # The estimate from one line is inaccurate. Camera and surface are common: average the lines.
    autocorrelation_time = float(
        np.mean([debiased_autocorrelation_time(values, 3) for values in normalised])
    )
    return LineNoise(
        tuple(point_stds), tuple(std * np.sqrt(autocorrelation_time) for std in point_stds)
    )


def _deviations_from_trend(view: LaserView, residuals: FloatArray) -> FloatArray:
    """Return the residuals without their trend along the line: noise, not board and plane.

    They are enlarged by what the three parameters of the trend absorb of the noise.
    """
    axis, count = np.ptp(view.line_pixels, axis=0).argmax(), len(residuals)
    position = view.line_pixels[:, axis] - view.line_pixels[:, axis].mean()
    trend = np.polynomial.Polynomial.fit(position, residuals, 2)(position)
    deviations: FloatArray = (residuals - trend) * np.sqrt(count / max(count - 3, 1))
    return deviations


def _stds_by_predicted_std(predicted_stds: FloatArray, deviations: FloatArray) -> FloatArray:
    """Return the std of each point: that of the group with similar predicted std."""
    groups = max(1, min(MAX_GROUPS, len(predicted_stds) // MIN_GROUP_SIZE))
    edges = np.quantile(predicted_stds, np.arange(1, groups) / groups)
    group = np.searchsorted(edges, predicted_stds)
    stds = np.empty(len(predicted_stds))
    for index in np.unique(group):
        stds[group == index] = _huber_std(deviations[group == index])
    return stds


def _huber_std(values: FloatArray) -> float:
    """Return the std with which the covariance of a Huber fit is valid for heavy tails, too.

    Definition: sigma sqrt(mean psi^2) / mean psi' (Huber 1981, section 6.4) with sigma from
    `_mad_std`; for a normal distribution it is sigma.
    """
    sigma = _mad_std(values)
    clipped = np.clip(values / sigma, -HUBER_THRESHOLD, HUBER_THRESHOLD)
    inlier_fraction = float(np.mean(np.abs(clipped) < HUBER_THRESHOLD))
    return sigma * float(np.sqrt(np.mean(clipped**2))) / inlier_fraction


def _mad_std(values: FloatArray) -> float:
    """Return the standard deviation about zero by the MAD, at least 1e-4 for perfect data."""
    return max(mad_std(values), 1e-4)
