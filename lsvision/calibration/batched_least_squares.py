"""Levenberg-Marquardt over many starts at once, for any kind of sighting."""

from dataclasses import dataclass

import numpy as np

from lsvision.calibration.observations import Observations, States
from lsvision.calibration.rotations import nearest_rotations, rotations_of
from lsvision.geometry import BoolArray, FloatArray, IntArray

MAX_STEPS = 40
RELATIVE_COST_TOLERANCE = 1e-10
"""Relative fall of the cost below which a start has arrived."""


@dataclass(frozen=True, eq=False)
class LeastSquaresSolutions:
    """Starts that have been led to their minima.

    Parameters
    ----------
    states : States
        s of them.
    costs : (s,) ndarray
        Sum of squared whitened residuals over the poses that counted.
    """

    states: States
    costs: FloatArray


def solve_least_squares(
    sightings: Observations, states: States, whitening: FloatArray, max_steps: int = MAX_STEPS
) -> LeastSquaresSolutions:
    """Levenberg-Marquardt from many starts at once.

    Parameters
    ----------
    sightings : Observations
        What was seen.
    states : States
        Starts.
    whitening : (s or 1, n, m, m) ndarray
        Whitening matrix of each pose's residual; zero leaves a pose out.
    max_steps : int
        Limit of steps.

    Returns
    -------
    LeastSquaresSolutions
        In the order of the starts; a start that leads nowhere keeps a high cost.
    """
    damping = np.full(len(states), 1e-3)
    system = _whitened_system(sightings, states, whitening)
    for _ in range(max_steps):
        jacobian, residual, costs = system
        steps = _damped_steps(jacobian, residual, damping)
        trial = _stepped(sightings, states, steps)
        trial_system = _whitened_system(sightings, trial, whitening)
        better = trial_system[2] < costs
        damping = np.clip(np.where(better, damping / 5, damping * 6), 1e-12, 1e9)
        states = _select_states(better, trial, states)
        system = tuple(  # type: ignore[assignment]
            np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)
            for new, old in zip(trial_system, system, strict=True)
        )
        gain = np.where(better, costs - trial_system[2], np.inf)
        idle = (gain <= RELATIVE_COST_TOLERANCE * costs) | (damping > 1e8) | (costs < 1e-20)
        if idle.all():
            break
    return LeastSquaresSolutions(states, system[2])


def whitened_jacobian_and_residuals(
    sightings: Observations, states: States, whitening: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Whitened Jacobian (s, n, m, p) and residuals (s, n, m); p = 6 and d for each target."""
    lin = sightings.linearise(states)
    by_target = _expand_target_columns(
        lin.target_jacobian, sightings.groups, states.targets.shape[1]
    )
    jacobian = whitening @ np.concatenate([lin.mount_jacobian, by_target], axis=-1)
    residual = (whitening @ lin.residuals[..., None])[..., 0]
    return jacobian, residual


def search_whitening(sightings: Observations, masks: FloatArray, std_mm: float) -> FloatArray:
    """Whitening for the search: what was seen plus a rough robot of `std_mm`, no state needed."""
    levers = sightings.mm_per_residual
    rough = np.diag((std_mm / levers) ** 2)
    return masks[..., None, None] * whitening_matrices(sightings.covariances + rough)


def whitening_matrices(covariances: FloatArray) -> FloatArray:
    """Matrices W with W C W' = 1, for a stack of covariances."""
    inverse: FloatArray = np.linalg.inv(np.linalg.cholesky(covariances))
    return inverse


def _whitened_system(
    sightings: Observations, states: States, whitening: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    jacobian, residual = whitened_jacobian_and_residuals(sightings, states, whitening)
    prior, prior_residual = prior_rows(sightings, states)
    count, size = len(states), jacobian.shape[-1]
    rows = np.concatenate([jacobian.reshape(count, -1, size), prior], axis=1)
    right = np.concatenate([residual.reshape(count, -1), prior_residual], axis=1)
    return rows, right, (right**2).sum(axis=1)


def prior_rows(sightings: Observations, states: States) -> tuple[FloatArray, FloatArray]:
    """What is known of the target beforehand, as rows of the whitened system."""
    weights = 1 / sightings.target_prior[1]
    count, groups = states.targets.shape[:2]
    size = groups * len(weights)
    rows = np.zeros((count, size, 6 + size))
    rows[:, range(size), range(6, 6 + size)] = np.tile(weights, groups)
    residuals = sightings.prior_residuals(states.targets) * weights
    return rows, residuals.reshape(count, size)


def _expand_target_columns(by_target: FloatArray, groups: IntArray, count: int) -> FloatArray:
    if count == 1:
        return by_target
    one_hot = (groups[:, None] == np.arange(count)).astype(np.float64)
    spread = one_hot[None, :, None, :, None] * by_target[..., None, :]
    flat: FloatArray = spread.reshape(*by_target.shape[:-1], -1)
    return flat


def _damped_steps(rows: FloatArray, right: FloatArray, damping: FloatArray) -> FloatArray:
    transposed = np.swapaxes(rows, -1, -2)
    gram = transposed @ rows
    size = gram.shape[-1]
    diagonal = np.maximum(np.einsum("sii->si", gram), 1e-12)
    # Columns in mm, rad and weights of any size would spoil the solution's digits.
    scale = 1 / np.sqrt(diagonal)
    gram = gram * scale[:, :, None] * scale[:, None, :]
    gram[:, range(size), range(size)] += damping[:, None] + 1e-13
    steps = np.linalg.solve(gram, -(transposed @ right[..., None]) * scale[..., None])
    damped: FloatArray = steps[..., 0] * scale
    return damped


def _stepped(sightings: Observations, states: States, steps: FloatArray) -> States:
    rotations = nearest_rotations(rotations_of(steps[:, 3:6]) @ states.rotations)
    shape = (*states.targets.shape[:2], -1)
    targets = sightings.update_targets(states.targets, steps[:, 6:].reshape(shape))
    return States(rotations, states.translations + steps[:, :3], targets)


def _select_states(better: BoolArray, a: States, b: States) -> States:
    pick = better[:, None, None]
    return States(
        np.where(pick, a.rotations, b.rotations),
        np.where(better[:, None], a.translations, b.translations),
        np.where(pick, a.targets, b.targets),
    )
