"""Robust hand-eye solution: reject outlying robot poses.

A wrong pose (paired with another profile, or read while the arm still moved) biases least squares
over all poses. Least trimmed squares over random selections of a few poses finds gross errors; the
F test of the leave-one-out residual finds those of a few standard deviations. Poses that the
estimated errors of the robot explain are then restored, several at once: the search has equal
weights for all poses, although errors of orientation grow with the distance from the flange.
Poses are rejected as a whole, because an error of a pose affects all its points.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.batched_least_squares import (
    MAX_STEPS,
    prior_jacobian_and_residuals,
    search_whitening,
    solve_least_squares,
    whitened_jacobian_and_residuals,
)
from lsvision.calibration.errors_in_variables import ErrorsInVariablesFit, fit_errors_in_variables
from lsvision.calibration.observations import Observations, States
from lsvision.calibration.robot_std import robot_covariances
from lsvision.calibration.rotations import vectors_from_rotations
from lsvision.geometry import FloatArray, IntArray

GROSS_OUTLIER_FACTOR = 5.0
"""Multiple of the median pose residual beyond which a pose is a gross outlier."""

MIN_MEDIAN_RESIDUAL = 0.4
"""Smallest value of that median, in standard deviations of the search: poses within 2 of these
(5 times 0.4) are no gross outliers, however small the other residuals are."""

SEARCH_STEPS, CANDIDATES, CONCENTRATION_STEPS = 12, 8, 4
"""Least trimmed squares: iterations from each initial guess of several selections, solutions that
are then refined, and refits to the poses of smallest residual."""

DISTINCT_ROTATION, DISTINCT_TRANSLATION_MM = np.radians(2.0), 5.0
"""Minima further apart than this (rad, mm) are different solutions."""


@dataclass(frozen=True, kw_only=True, slots=True)
class OutlierSettings:
    """Settings of the rejection of outlying poses.

    Parameters
    ----------
    max_outlier_fraction : float
        Largest fraction of outlying poses.
    significance : float
        Probability of rejecting a correct pose, over all poses of a calibration.
    sample_size : int
        Number of poses in a random selection.
    trials : int
        Number of random selections; with 40 of 7 poses, one without outliers is among them in
        99.9 % of cases where 2 of 12 poses are wrong.
    seed : int
        Seed of the random selections.
    """

    max_outlier_fraction: float = 0.3
    significance: float = 0.01
    sample_size: int = 7
    trials: int = 40
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("max_outlier_fraction", "significance"):
            if not 0 <= getattr(self, name) < 1:
                raise ValueError(f"expected {name} from 0 to 1, got {getattr(self, name)}")

    def compute_min_inliers(self, count: int, min_poses: int) -> int:
        """Return the smallest number of inliers among `count` poses, `min_poses` at least."""
        return max(min_poses, count - int(self.max_outlier_fraction * count))


def fit_with_outlier_rejection(
    observations: Observations,
    settings: OutlierSettings,
    *,
    min_poses: int,
    estimate_robot_std: bool,
) -> ErrorsInVariablesFit:
    """Return the fit to the inlier poses, found without initial guess; its mask marks them.

    Least trimmed squares, then leave-one-out F tests; `min_poses` is the smallest number of inlier
    poses; for `estimate_robot_std` see `fit_errors_in_variables`.
    """
    state = _estimate_by_least_trimmed_squares(observations, settings, min_poses)
    mask = _reject_gross_outliers(observations, state)
    fit = fit_errors_in_variables(observations, state, mask, estimate_robot_std=estimate_robot_std)
    fit = _restore_inliers(observations, fit, settings)
    fit = _reject_outliers(observations, fit, settings, min_poses)
    return _restore_inliers(observations, fit, settings)


def solve_from_all_guesses(
    observations: Observations, mask: FloatArray
) -> tuple[States, FloatArray]:
    """Return the minima from all initial guesses and their costs, lowest first."""
    masks = mask[None]
    states = observations.estimate_initial_guesses(masks)
    solutions = solve_least_squares(observations, states, search_whitening(observations, masks))
    order = np.argsort(solutions.costs, kind="stable")
    return solutions.states.select(order), solutions.costs[order]


def _estimate_by_least_trimmed_squares(
    observations: Observations, settings: OutlierSettings, min_poses: int
) -> States:
    """Return the state with the smallest trimmed sum of squared residuals."""
    count = len(observations.flanges)
    trimmed_count = settings.compute_min_inliers(count, min_poses)
    masks = _draw_selections(count, settings, min_poses)
    states = observations.estimate_initial_guesses(masks)
    masks_of_states = np.repeat(masks, len(states) // len(masks), axis=0)
    whitening = search_whitening(observations, masks_of_states)
    steps = SEARCH_STEPS if len(masks) > 1 else MAX_STEPS
    states = solve_least_squares(observations, states, whitening, steps).states
    states = _select_least_trimmed(observations, states, trimmed_count, CANDIDATES)
    for _ in range(CONCENTRATION_STEPS):
        order = np.argsort(_pose_residuals(observations, states), axis=1, kind="stable")
        masks = np.zeros((len(states), count))
        np.put_along_axis(masks, order[:, :trimmed_count], 1.0, axis=1)
        whitening = search_whitening(observations, masks)
        states = solve_least_squares(observations, states, whitening).states
    return _select_least_trimmed(observations, states, trimmed_count, 1)


def _draw_selections(count: int, settings: OutlierSettings, min_poses: int) -> FloatArray:
    """Return selections (q, n) of 0 and 1: all poses, and random samples of them."""
    rng = np.random.default_rng(settings.seed)
    sample_size = min(max(settings.sample_size, min_poses), max(count - 1, min_poses))
    masks = [np.ones(count)]
    for _ in range(settings.trials if count > min_poses else 0):
        mask = np.zeros(count)
        mask[rng.permutation(count)[:sample_size]] = 1.0
        masks.append(mask)
    return np.array(masks)


def _pose_residuals(observations: Observations, states: States) -> FloatArray:
    """Return the norm (s, n) of each pose's residual, whitened as in the search."""
    whitening = search_whitening(observations, np.ones((1, len(observations.flanges))))
    whitened = (whitening @ observations.linearise(states).residuals[..., None])[..., 0]
    norms: FloatArray = np.linalg.norm(whitened, axis=-1)
    return norms


def _select_least_trimmed(
    observations: Observations, states: States, trimmed_count: int, count: int
) -> States:
    """Return the `count` states of least trimmed cost, lowest first.

    The cost is the sum of the `trimmed_count` smallest squared residuals.
    """
    squares = np.sort(_pose_residuals(observations, states) ** 2, axis=1)
    costs = squares[:, :trimmed_count].sum(axis=1)
    return states.select(np.argsort(costs, kind="stable")[:count])


def _reject_gross_outliers(observations: Observations, state: States) -> FloatArray:
    """Return the mask of poses without a gross error."""
    norms = _pose_residuals(observations, state)[0]
    limit = GROSS_OUTLIER_FACTOR * max(float(np.median(norms)), MIN_MEDIAN_RESIDUAL)
    mask: FloatArray = (norms <= limit).astype(np.float64)
    return mask


def _reject_outliers(
    observations: Observations,
    fit: ErrorsInVariablesFit,
    settings: OutlierSettings,
    min_poses: int,
) -> ErrorsInVariablesFit:
    """Return the fit without the poses of smallest p-value, until all are above significance.

    No more are rejected, with the gross outliers, than the settings allow, and `min_poses` remain.
    """
    min_inliers = settings.compute_min_inliers(len(fit.mask), min_poses)
    while fit.mask.sum() > min_inliers:
        p_values = np.where(fit.mask > 0, outlier_p_values(fit), 1.0)
        rejected = int(p_values.argmin())
        if p_values[rejected] * fit.mask.sum() > settings.significance:
            break
        mask = fit.mask.copy()
        mask[rejected] = 0.0
        fit = _refit(observations, fit, mask)
    return fit


def _restore_inliers(
    observations: Observations, fit: ErrorsInVariablesFit, settings: OutlierSettings
) -> ErrorsInVariablesFit:
    """Return the fit with as many poses restored as are no outliers, taken together.

    Together, because each may look wrong beside poses that were selected by their small residuals.
    The p-value is multiplied by the number of selections of as many poses.
    """
    rejected = np.flatnonzero(fit.mask == 0)
    rejected = rejected[np.argsort(-outlier_p_values(fit)[rejected], kind="stable")]
    for count in range(len(rejected), 0, -1):
        restored = rejected[:count]
        selections = math.comb(int(fit.mask.sum()) + count, count)
        if joint_p_value(observations, fit, restored) * selections > settings.significance:
            mask = fit.mask.copy()
            mask[restored] = 1.0
            return _refit(observations, fit, mask)
    return fit


def _refit(
    observations: Observations, fit: ErrorsInVariablesFit, mask: FloatArray
) -> ErrorsInVariablesFit:
    """Return the fit of other poses, from the solution of a fit."""
    estimated = fit.robot_std_is_estimated
    return fit_errors_in_variables(observations, fit.states, mask, estimate_robot_std=estimated)


def joint_p_value(
    observations: Observations, fit: ErrorsInVariablesFit, indices: IntArray
) -> float:
    """Return the p-value of the residuals of k unused poses (k,), taken together.

    It is the mean over the robot's standard deviations that the used poses allow: where its errors
    of orientation dominate, a few poses may be explained by those of position alone. For a stated
    robot it is that of the F test.
    """
    from scipy.special import chdtrc, fdtrc

    residuals, covariances = _predicted_residuals(observations, fit, indices)
    solutions = np.linalg.solve(covariances, residuals[..., None])[..., 0]
    chi2, size = (residuals * solutions).sum(axis=-1), residuals.shape[-1]
    if fit.robot_std_is_estimated:
        return float(fit.posterior.weights @ chdtrc(size, chi2))
    if fit.dof <= 0:
        return 1.0
    return float(fdtrc(size, fit.dof, chi2[0] / size / max(fit.chi2 / fit.dof, 1e-6)))


def _predicted_residuals(
    observations: Observations, fit: ErrorsInVariablesFit, indices: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return the residuals (q, km) of k unused poses, and their covariances (q, km, km).

    Each of the q scales of the posterior has a solution of its own (linearised at the fit).
    """
    no_whitening = np.eye(observations.covariances.shape[-1])[None, None]
    jacobian, residuals = (
        array[0]
        for array in whitened_jacobian_and_residuals(observations, fit.states, no_whitening)
    )
    prior, prior_residuals = prior_jacobian_and_residuals(observations, fit.states)
    robot = robot_covariances(observations, fit.states, fit.posterior.scales)[:, 0]
    covariances, used = observations.covariances + robot, fit.mask > 0
    weighted = np.linalg.solve(covariances[:, used], jacobian[used])
    normal = np.einsum("nmp,qnmr->qpr", jacobian[used], weighted) + prior[0].T @ prior[0]
    moment = np.einsum("qnmp,nm->qp", weighted, residuals[used]) + prior_residuals[0] @ prior[0]
    # Scaled to a unit diagonal: columns in mm and rad would make the matrix ill-conditioned.
    scales = 1 / np.sqrt(np.einsum("qpp->qp", normal))
    rows = jacobian[indices].reshape(-1, jacobian.shape[-1]) * scales[:, None]
    normal = normal * scales[:, :, None] * scales[:, None, :]
    solutions = np.linalg.solve(normal, np.swapaxes(rows, -1, -2))
    steps = np.einsum("qpr,qp->qr", solutions, moment * scales)
    blocks = np.eye(len(indices))[:, None, :, None] * covariances[:, indices, :, None, :]
    size = rows.shape[1]
    return (
        residuals[indices].ravel() - steps,
        rows @ solutions + blocks.reshape(-1, size, size),
    )


def outlier_p_values(fit: ErrorsInVariablesFit) -> FloatArray:
    """Return each pose's p-value (n,) by the F test of its leave-one-out residual.

    It is 1 where the other poses leave no degree of freedom for the test.
    """
    from scipy.special import fdtrc

    size = fit.residuals.shape[1]
    residuals, used = fit.residuals[..., None], fit.mask > 0
    leave_one_out = np.linalg.solve(fit.redundancy + 1e-12 * np.eye(size), residuals)
    predicted_error = np.linalg.solve(np.eye(size) + fit.prediction_covariances, residuals)
    chi2_decrease = (residuals * np.where(used[:, None, None], leave_one_out, predicted_error)).sum(
        axis=(1, 2)
    )
    remaining_chi2 = np.where(used, fit.chi2 - chi2_decrease, fit.chi2)
    dof = np.where(used, fit.dof - size, fit.dof)
    positive_dof = np.maximum(dof, 1)
    ratio = (chi2_decrease / size) / np.maximum(remaining_chi2 / positive_dof, 1e-6)
    return np.where(dof > 0, fdtrc(size, positive_dof, np.maximum(ratio, 0.0)), 1.0)


def ambiguity_ratio(observations: Observations, fit: ErrorsInVariablesFit) -> float:
    """Return the cost of the best other minimum over that of the fit; inf if there is none.

    All minima are those of one cost, with the weights of the fit: a minimum of the search's rough
    weights may lie some mm from the fit and is not a separate solution.
    """
    whitening = fit.mask[None, :, None, None] * fit.whitening
    states, _ = solve_from_all_guesses(observations, fit.mask)
    best = solve_least_squares(observations, fit.states, whitening)
    others = solve_least_squares(observations, states, whitening)
    rotation_difference = vectors_from_rotations(
        others.states.rotations @ best.states.rotations[0].T
    )
    translation_difference = others.states.translations - best.states.translations[0]
    distinct = (np.linalg.norm(rotation_difference, axis=1) > DISTINCT_ROTATION) | (
        np.linalg.norm(translation_difference, axis=1) > DISTINCT_TRANSLATION_MM
    )
    if not distinct.any():
        return float("inf")
    return float(others.costs[distinct].min() / max(best.costs[0], 1e-9))
