"""Mistakes that explain large residuals of a hand-eye calibration: target moved, pairs shifted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lsvision.calibration.batched_least_squares import search_whitening, solve_least_squares
from lsvision.calibration.board_observations import BoardObservations
from lsvision.calibration.errors_in_variables import ErrorsInVariablesFit, count_degrees_of_freedom
from lsvision.calibration.observations import Observations, States, compute_residual_norms
from lsvision.calibration.pose_outliers import solve_from_all_guesses
from lsvision.calibration.robot_std import compute_robot_whitening
from lsvision.geometry import FloatArray

MAX_RMS_RATIO = 0.35
"""Largest ratio of the rms residual under a reported hypothesis (moved target, mispaired poses) to
that without it."""
MAX_EXPLAINED_RMS_MM = 1.5
"""Largest rms residual under a reported hypothesis. Units: mm."""
SIGNIFICANCE = 1e-4
"""Probability, over all splits of the poses, of reporting a moved target that did not move."""
MIN_MOVED_TARGET_POSES, MIN_POSES_PER_TARGET = 8, 3
"""Smallest number of poses with which a moved target is looked for, and smallest number of them
before and after the move."""


def detect_moved_target(
    observations: Observations,
    mask: FloatArray,
    pose_indices: Sequence[int],
    fit: ErrorsInVariablesFit | None = None,
) -> str | None:
    """Return the message that the target moved between two poses; None if it did not move.

    It moved if two targets, one before and one after some pose, fit far better than one. `mask`
    (n,) excludes outlying poses, which must not be mistaken for a moved target; `pose_indices` (n,)
    are the indices of the poses in the message. Without `fit` all initial guesses are tried,
    weighted by `search_whitening`.
    """
    initial_guess = fit.states if fit else _find_best_state(observations, mask)
    one_target = _fit_hypothesis(observations, initial_guess, mask, fit)
    two_targets = {
        first_moved: _fit_two_targets(observations, first_moved, mask, fit)
        for first_moved in range(1, len(mask))
        if min(mask[:first_moved].sum(), mask[first_moved:].sum()) >= MIN_POSES_PER_TARGET
    }
    if not two_targets:
        return None
    first_moved, best = min(two_targets.items(), key=lambda item: item[1].chi2)
    if best.rms > min(MAX_RMS_RATIO * one_target.rms, MAX_EXPLAINED_RMS_MM):
        return None
    if fit and _f_test_p_value(one_target, best) * len(two_targets) > SIGNIFICANCE:
        return None
    before, after = pose_indices[first_moved - 1], pose_indices[first_moved]
    return (
        f"the target moved between pose {before} and pose {after} (counted from 0): "
        f"one target leaves {one_target.rms:.2g} mm, two leave {best.rms:.2g} mm and are "
        f"{best.target_distance:.2g} mm apart; repeat one of the halves"
    )


@dataclass(frozen=True, slots=True)
class _TargetHypothesis:
    """Fit of all poses with one target, or with two.

    Parameters
    ----------
    rms : float
        Root mean square residual. Units: mm.
    chi2 : float
        Sum of squared whitened residuals.
    dof : float
        Degrees of freedom.
    target_distance : float
        Distance between the two targets; 0 for one. Units: mm.
    """

    rms: float
    chi2: float
    dof: float
    target_distance: float


def _find_best_state(observations: Observations, mask: FloatArray) -> States:
    """Return the state of lowest cost from all initial guesses."""
    return solve_from_all_guesses(observations, mask)[0].select(np.array([0]))


def _fit_two_targets(
    observations: Observations,
    first_moved: int,
    mask: FloatArray,
    fit: ErrorsInVariablesFit | None,
) -> _TargetHypothesis:
    """Return the fit with one target before pose `first_moved` and another from it on."""
    groups = (np.arange(len(mask)) >= first_moved).astype(np.int64)
    observations = replace(observations, groups=groups)
    if fit is None:
        guess = _find_best_state(observations, mask)
    else:
        guess = replace(fit.states, targets=np.repeat(fit.states.targets[:, :1], 2, axis=1))
    return _fit_hypothesis(observations, guess, mask, fit)


def _fit_hypothesis(
    observations: Observations,
    initial_guess: States,
    mask: FloatArray,
    fit: ErrorsInVariablesFit | None,
) -> _TargetHypothesis:
    """Return a fit with one target for each group, with the weights of `fit` if it is given."""
    if fit is None:
        whitening = search_whitening(observations, mask[None])
    else:
        whitening = mask[:, None, None] * compute_robot_whitening(
            observations, initial_guess, fit.robot_std_scales
        )
    solution = solve_least_squares(observations, initial_guess, whitening)
    targets = solution.states.targets[0]
    return _TargetHypothesis(
        _residual_rms(observations, solution.states, mask),
        float(solution.costs[0]),
        count_degrees_of_freedom(observations, solution.states, mask, whitening),
        observations.target_distance(targets[0], targets[-1]),
    )


def _f_test_p_value(one_target: _TargetHypothesis, two_targets: _TargetHypothesis) -> float:
    """Return the p-value of the improvement by a second target (F test)."""
    from scipy.special import fdtrc

    extra_dof = one_target.dof - two_targets.dof
    ratio = (
        (one_target.chi2 - two_targets.chi2)
        / extra_dof
        / max(two_targets.chi2 / max(two_targets.dof, 1), 1e-12)
    )
    return float(fdtrc(extra_dof, max(two_targets.dof, 1), max(ratio, 0.0)))


def detect_mispaired_poses(observations: Observations, rms: float) -> str | None:
    """Return the message that poses and profiles are shifted or reversed; None if not.

    `rms` is the root mean square residual of the pairs as they are. Units: mm.
    """
    observation = "board" if isinstance(observations, BoardObservations) else "profile"
    count = len(observations.flanges)
    order, shifted = np.arange(count), "pairs shifted against each other"
    # A shift by one pairs the first pose with the last: that pair is left out.
    for explanation, permutation, left_out in (
        (
            f"each {observation} belongs to the next pose: {shifted}",
            np.roll(order, -1),
            [count - 1],
        ),
        (f"each {observation} belongs to the pose before: {shifted}", np.roll(order, 1), [0]),
        (f"the poses are in reverse order of the {observation}s: reverse one", order[::-1], []),
    ):
        trial = replace(observations, flanges=observations.flanges.select(permutation))
        mask = np.ones(count)
        mask[left_out] = 0.0
        states, _ = solve_from_all_guesses(trial, mask)
        if _residual_rms(trial, states, mask) < min(MAX_RMS_RATIO * rms, MAX_EXPLAINED_RMS_MM):
            return explanation
    return None


def _residual_rms(observations: Observations, states: States, mask: FloatArray) -> float:
    """Return the root mean square residual of the masked poses. Units: mm."""
    norms = compute_residual_norms(observations, observations.linearise(states).residuals[0])
    return float(np.sqrt((norms**2 * mask).sum() / mask.sum()))
