"""Levenberg-Marquardt for many initial guesses at once; scipy solves one problem at a time."""

from dataclasses import dataclass

import numpy as np

from lsvision.calibration.observations import Observations, States
from lsvision.calibration.rotations import find_nearest_rotations, rotations_from_vectors
from lsvision.geometry import FloatArray, IntArray

MAX_STEPS = 40
"""Maximum number of iterations: one that has not converged by then keeps a high cost."""
INITIAL_DAMPING, MIN_DAMPING, MAX_DAMPING = 1e-3, 1e-12, 1e9
"""Damping added to the diagonal of the normal equations, which is scaled to 1: in the first step,
and its bounds."""
DAMPING_DECREASE, DAMPING_INCREASE = 5.0, 6.0
"""Divisor of the damping after a step that decreased the cost, factor on it after another."""
CONVERGED_DAMPING = 1e8
"""Damping above which no step decreases the cost: the solution has converged."""
RIDGE = 1e-13
"""Part of the diagonal, scaled to 1, that keeps a singular system solvable at any damping."""
MIN_DIAGONAL = 1e-12
"""Smallest diagonal element that is divided by: that of an unknown that no pose determines."""
BLOCK_STATES = 300
"""Number of initial guesses solved at once: the arrays of thousands leave the processor's cache."""
RELATIVE_COST_TOLERANCE = 1e-10
"""Relative decrease of the cost below which a solution has converged."""
PERFECT_COST = 1e-20
"""Cost below which there is nothing to improve: data without noise."""

SEARCH_ROBOT_STD_MM = 0.2
"""Standard deviation of the robot that is assumed in the search, before it can be estimated. Units:
mm. It decides how small an error of a pose can be a gross outlier. In 24 simulated sets of a sphere
and 8 of a plane with one to three poses 0.5 to 4 mm wrong, 18 of these are accepted, and 33 with
1 mm, which doubles the error on planes; 0.1 to 0.28 mm change the errors by less than 1 %."""


@dataclass(frozen=True, eq=False)
class LeastSquaresSolutions:
    """Solutions of the least-squares problem, one for each initial guess.

    Parameters
    ----------
    states : States
        s solutions.
    costs : (s,) ndarray
        Sum of squared whitened residuals over the selected poses and the prior.
    """

    states: States
    costs: FloatArray


def solve_least_squares(
    observations: Observations, states: States, whitening: FloatArray, max_steps: int = MAX_STEPS
) -> LeastSquaresSolutions:
    """Return the minima of the whitened residuals from s initial guesses (Levenberg-Marquardt).

    `whitening` (s or 1, n, m, m) are the whitening matrices of each pose's residual; zero excludes
    a pose. The solutions are in the order of the guesses; one that did not converge keeps a high
    cost.
    """
    boundaries = range(BLOCK_STATES, len(states), BLOCK_STATES)
    blocks = [
        _solve_block(observations, states.select(block), _select_rows(whitening, block), max_steps)
        for block in np.split(np.arange(len(states)), boundaries)
    ]
    rotations, translations, targets, costs = (
        np.concatenate(arrays) for arrays in zip(*blocks, strict=True)
    )
    return LeastSquaresSolutions(States(rotations, translations, targets), costs)


def _solve_block(
    observations: Observations, states: States, whitening: FloatArray, max_steps: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return rotations, translations, targets and costs of the solutions; changes `states`."""
    damping = np.full(len(states), INITIAL_DAMPING)
    system = _linearise_and_whiten(observations, states, whitening)
    active = np.arange(len(states))
    for _ in range(max_steps):
        jacobian, residual, costs = (array[active] for array in system)
        steps = _solve_damped_steps(jacobian, residual, damping[active])
        trial = _apply_steps(observations, states.select(active), steps)
        trial_system = _linearise_and_whiten(observations, trial, _select_rows(whitening, active))
        improved = trial_system[2] < costs
        factors = np.where(improved, 1 / DAMPING_DECREASE, DAMPING_INCREASE)
        damping[active] = np.clip(damping[active] * factors, MIN_DAMPING, MAX_DAMPING)
        updated = active[improved]
        _replace(states, updated, trial.select(np.flatnonzero(improved)))
        for array, trial_array in zip(system, trial_system, strict=True):
            array[updated] = trial_array[improved]
        decrease = np.where(improved, costs - trial_system[2], np.inf)
        converged = (
            (decrease <= RELATIVE_COST_TOLERANCE * costs)
            | (damping[active] > CONVERGED_DAMPING)
            | (costs < PERFECT_COST)
        )
        active = active[~converged]
        if not len(active):
            break
    return states.rotations, states.translations, states.targets, system[2]


def whitened_jacobian_and_residuals(
    observations: Observations, states: States, whitening: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return whitened Jacobian (s, n, m, p) and residuals (s, n, m); p = 6 + d per target."""
    linearisation = observations.linearise(states)
    target_jacobian = _expand_target_columns(
        linearisation.target_jacobian, observations.groups, states.targets.shape[1]
    )
    jacobian = whitening @ np.concatenate([linearisation.mount_jacobian, target_jacobian], axis=-1)
    residual = (whitening @ linearisation.residuals[..., None])[..., 0]
    return jacobian, residual


def search_whitening(observations: Observations, masks: FloatArray) -> FloatArray:
    """Return whitening matrices (q, n, m, m) for the search for initial guesses.

    The covariance is that of the observation plus a robot error of `SEARCH_ROBOT_STD_MM` in each
    residual, which needs no state. `masks` (q, n) are 1 for the poses to use, 0 for others.
    """
    robot_std = SEARCH_ROBOT_STD_MM / observations.mm_per_residual
    covariances = observations.covariances + np.diag(robot_std**2)
    return masks[..., None, None] * build_whitening_matrices(covariances)


def build_whitening_matrices(covariances: FloatArray) -> FloatArray:
    """Return matrices W with W C W' = 1 for a stack of covariances C."""
    return np.linalg.inv(np.linalg.cholesky(covariances))


def _linearise_and_whiten(
    observations: Observations, states: States, whitening: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Jacobian (s, r, p), residuals (s, r) and costs (s,), the prior included."""
    data_jacobian, data_residual = whitened_jacobian_and_residuals(observations, states, whitening)
    prior, prior_residual = prior_jacobian_and_residuals(observations, states)
    count, size = len(states), data_jacobian.shape[-1]
    jacobians = np.concatenate([data_jacobian.reshape(count, -1, size), prior], axis=1)
    residuals = np.concatenate([data_residual.reshape(count, -1), prior_residual], axis=1)
    return jacobians, residuals, (residuals**2).sum(axis=1)


def prior_jacobian_and_residuals(
    observations: Observations, states: States
) -> tuple[FloatArray, FloatArray]:
    """Return Jacobian and residuals of the prior on the targets, as rows of the whitened system."""
    mean, std = observations.target_prior
    count, groups = states.targets.shape[:2]
    weights, size = 1 / std, groups * len(std)
    jacobian = np.zeros((count, size, 6 + size))
    jacobian[:, range(size), range(6, 6 + size)] = np.tile(weights, groups)
    if not weights.any():
        return jacobian, np.zeros((count, size))
    # Targets with a prior are those whose numbers are their step coordinates.
    return jacobian, ((states.targets - mean) * weights).reshape(count, size)


def _expand_target_columns(jacobian: FloatArray, groups: IntArray, count: int) -> FloatArray:
    """Return the Jacobian by all targets: zero except by the target that each pose observes."""
    if count == 1:
        return jacobian
    one_hot = (groups[:, None] == np.arange(count)).astype(np.float64)
    expanded = one_hot[None, :, None, :, None] * jacobian[..., None, :]
    flat: FloatArray = expanded.reshape(*jacobian.shape[:-1], -1)
    return flat


def _solve_damped_steps(
    jacobian: FloatArray, residual: FloatArray, damping: FloatArray
) -> FloatArray:
    """Return the Levenberg-Marquardt step of each state."""
    transposed = np.swapaxes(jacobian, -1, -2)
    gram = transposed @ jacobian
    size = gram.shape[-1]
    diagonal = np.maximum(np.einsum("sii->si", gram), MIN_DIAGONAL)
    # Scaled to a unit diagonal: columns in mm and rad would make the matrix ill-conditioned.
    scale = 1 / np.sqrt(diagonal)
    gram = gram * scale[:, :, None] * scale[:, None, :]
    gram[:, range(size), range(size)] += damping[:, None] + RIDGE
    steps = np.linalg.solve(gram, -(transposed @ residual[..., None]) * scale[..., None])
    damped: FloatArray = steps[..., 0] * scale
    return damped


def _apply_steps(observations: Observations, states: States, steps: FloatArray) -> States:
    """Return the states changed by one step each."""
    rotations = find_nearest_rotations(rotations_from_vectors(steps[:, 3:6]) @ states.rotations)
    shape = (*states.targets.shape[:2], -1)
    targets = observations.update_targets(states.targets, steps[:, 6:].reshape(shape))
    return States(rotations, states.translations + steps[:, :3], targets)


def _replace(states: States, indices: IntArray, new_states: States) -> None:
    """Replace the states at some indices, in place."""
    states.rotations[indices] = new_states.rotations
    states.translations[indices] = new_states.translations
    states.targets[indices] = new_states.targets


def _select_rows(whitening: FloatArray, indices: IntArray) -> FloatArray:
    """Return the whitening matrices at some indices; the only ones if all states share them."""
    return whitening if len(whitening) == 1 else whitening[indices]
