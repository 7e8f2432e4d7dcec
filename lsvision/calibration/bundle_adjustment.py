"""Joint refinement of camera, laser plane, board poses and board bow, in pixels.

All unknowns at once, because most of a laser plane's error sits in the boards' poses and the
camera: refining the plane alone is no better than its linear start (camera.md, section 2).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lsvision.calibration.bundle_adjustment_problem import BundleAdjustmentProblem, tilt_axes
from lsvision.calibration.bundle_adjustment_state import BundleAdjustmentState, LaserView
from lsvision.calibration.laser_plane_initial_guess import fit_plane, laser_points_on_boards
from lsvision.calibration.noise_estimation import (
    HUBER_THRESHOLD,
    estimate_line_noise,
    huber_std,
    mad_std,
)
from lsvision.geometry import FloatArray, Points

LINE_DOWNWEIGHTING = 1e4
"""Factor on the line's sigma by which the corners alone place camera and boards."""

MAX_CORNER_STD_RATIO = 1.15
"""Growth of the corners' residual, when the line joins in, that noise alone does not cause."""

MAX_LINE_STD_RATIO = 1.8
"""Residual of the line, over its scatter about its own smooth course, that noise alone does not
cause."""

MAX_STEPS = 40
"""Steps of the minimiser; it needs about five."""


@dataclass(frozen=True, eq=False)
class BundleAdjustmentResult:
    """A refined state with its evidence.

    Parameters
    ----------
    state : BundleAdjustmentState
        The minimum.
    corner_residuals, line_residuals : tuple of ndarray
        For each view (n, 2) and (m,). Units: px.
    plane_covariance : (3, 3) ndarray
        Tilt about the section's X and Y (rad) and distance (mm).
    bow_std : (2,) ndarray
        Zero where the bow was held. Units: mm.
    line_inconsistent : bool
        Whether line and corners contradict each other, so that the line was not allowed to
        move camera and boards.
    """

    state: BundleAdjustmentState
    corner_residuals: tuple[FloatArray, ...]
    line_residuals: tuple[FloatArray, ...]
    plane_covariance: FloatArray
    bow_std: FloatArray
    line_inconsistent: bool


def adjust_bundle(
    views: Sequence[LaserView],
    start: BundleAdjustmentState,
    refine: tuple[bool, bool],
    corner_std: float = 0.1,
) -> BundleAdjustmentResult:
    """Refine everything at once, weighted by the noise that corners and lines show by themselves.

    First the corners alone place camera and boards, which tells their noise; the line's is its
    scatter about its own smooth course. Then all is solved together. If that bends the boards
    beyond noise, or leaves the lines beside them, the line does not lie where the board's plane
    is (a sheet that is not flat beside the pattern, a wide saturated line): then the corners
    have the last word, and the plane is the nearest to the lines.

    Parameters
    ----------
    views : sequence of LaserView
        Two at least; see `calibrate_laser_plane` for what they must span.
    start : BundleAdjustmentState
        Good to a few px.
    refine : tuple of bool
        Whether the camera, and the bow, take part.
    corner_std : float
        First guess. Units: px.

    Returns
    -------
    BundleAdjustmentResult
        The minimum of Huber's loss with its covariance.
    """
    alone = BundleAdjustmentProblem(
        [replace(view, line_std=LINE_DOWNWEIGHTING * view.line_std) for view in views],
        start,
        refine,
        [corner_std] * len(views),
    )
    vector, _ = _minimise(alone, 1e-6)
    start = alone.state(vector)
    corner, line = alone.residuals_in_pixels(vector)
    corner_std, misfits = mad_std(corner), alone.split(line, line=True)
    corner_stds = [huber_std(each) for each in alone.split(corner, line=False)]
    scatter = estimate_line_noise(views, misfits)
    problem = BundleAdjustmentProblem(
        [
            replace(view, line_std=std)
            for view, std in zip(views, scatter.effective_stds, strict=True)
        ],
        start,
        refine,
        corner_stds,
    )
    vector, information = _minimise(problem, 1e-9)
    corner, line = problem.residuals_in_pixels(vector)
    bent = mad_std(corner) > corner_std * (MAX_CORNER_STD_RATIO + 2 / np.sqrt(corner.size))
    if bent or mad_std(line / np.concatenate(scatter.point_stds)) > MAX_LINE_STD_RATIO:
        if refine[1]:
            # Where the line lies off the boards, their bow has no meaning.
            flat = replace(start, bow=np.zeros(2))
            return adjust_bundle(views, flat, (refine[0], False), corner_std)
        return _solve_plane_only(views, start)
    covariance, bow_std = _plane_covariance_and_bow_std(problem, information)
    return BundleAdjustmentResult(
        problem.state(vector),
        problem.split(corner, line=False),
        problem.split(line, line=True),
        covariance,
        bow_std,
        line_inconsistent=False,
    )


def _solve_plane_only(
    views: Sequence[LaserView], state: BundleAdjustmentState
) -> BundleAdjustmentResult:
    """The plane nearest to the lines, camera and boards left where the corners place them."""
    lit = laser_points_on_boards(state.camera, state.camera_from_boards, views)
    state = replace(state, plane=fit_plane(np.concatenate(lit)), bow=np.zeros(2))
    problem = BundleAdjustmentProblem(views, state, (False, False), [1.0] * len(views))
    corner, line = problem.residuals_in_pixels(np.zeros(problem.size))
    return BundleAdjustmentResult(
        state,
        problem.split(corner, line=False),
        problem.split(line, line=True),
        _cluster_robust_covariance(state, lit),
        np.zeros(2),
        line_inconsistent=True,
    )


def _cluster_robust_covariance(state: BundleAdjustmentState, lit: Sequence[Points]) -> FloatArray:
    """Covariance of a plane whose points err together in each view (cluster sandwich)."""
    design = [
        np.column_stack([points @ tilt_axes(state).T, -np.ones(len(points))]) for points in lit
    ]
    slopes = [
        rows.T @ state.plane.signed_distances(points)
        for rows, points in zip(design, lit, strict=True)
    ]
    inverse: FloatArray = np.linalg.inv(sum(rows.T @ rows for rows in design))
    # Three parameters were fitted to two numbers of each view.
    free = len(lit) / max(len(lit) - 1.5, 0.5)
    meat = np.asarray(slopes).T @ np.asarray(slopes)
    covariance: FloatArray = np.asarray(inverse @ meat @ inverse * free, dtype=np.float64)
    return covariance


def _plane_covariance_and_bow_std(
    problem: BundleAdjustmentProblem, information: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Covariance of the plane, and standard deviations of the bow (0 where held)."""
    covariance: FloatArray = np.asarray(np.linalg.pinv(information, hermitian=True))
    plane, bow = problem.columns_of_plane(), problem.columns_of_bow()
    bow_std = np.zeros(2)
    if len(bow):
        bow_std = np.sqrt(covariance[bow, bow])
    return covariance[np.ix_(plane, plane)], bow_std


def _minimise(
    problem: BundleAdjustmentProblem, relative_tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Levenberg-Marquardt with Huber's weights: the minimum, and J'WJ there.

    Own, because scipy's takes twice the steps here and an SVD for each.
    """
    vector, damping = np.zeros(problem.size), 1e-4
    cost = _huber(problem(vector))
    for _ in range(MAX_STEPS):
        residuals, jacobian = problem(vector), problem.jacobian(vector)
        weights = np.minimum(1.0, HUBER_THRESHOLD / np.maximum(np.abs(residuals), 1e-300))
        information = jacobian.T @ (weights[:, None] * jacobian)
        slope = jacobian.T @ (weights * residuals)
        gained = 0.0
        while damping < 1e8 and not gained > 0:
            scaled = information + damping * np.diag(np.diag(information))
            trial = vector - np.linalg.solve(scaled, slope)
            gained = cost - _huber(problem(trial))
            damping = damping / 10 if gained > 0 else damping * 10
        if not gained > 0:
            break
        vector, cost = trial, cost - gained
        if gained < relative_tolerance * cost:
            break
    return vector, information


def _huber(residuals: FloatArray) -> float:
    size = np.abs(residuals)
    return float(
        np.where(
            size < HUBER_THRESHOLD, size**2, HUBER_THRESHOLD * (2 * size - HUBER_THRESHOLD)
        ).sum()
    )
