"""Whether the data support a sensor-to-robot calibration, and what is wrong where they do not."""

from dataclasses import dataclass

import numpy as np

from lsvision.calibration.batched_least_squares import (
    search_whitening,
    solve_least_squares,
    whitened_jacobian_and_residuals,
)
from lsvision.calibration.errors_in_variables import (
    ErrorsInVariablesFit,
    degrees_of_freedom,
    robot_whitening,
)
from lsvision.calibration.observations import Observations, States
from lsvision.calibration.pose_outliers import SEARCH_ROBOT_STD_MM, multi_start
from lsvision.calibration.rotations import rotation_vectors
from lsvision.geometry import FloatArray

MM_PER_RADIAN = 100.0
"""Millimetres that a radian of the sensor's rotation counts for."""
DISTINCT_ROTATION, DISTINCT_TRANSLATION_MM = np.radians(2.0), 5.0
"""Minima further apart than this (rad, mm) are different answers."""
MAX_RMS_RATIO = 0.35
"""Share of the residual that an explanation must not exceed to be named."""
SIGNIFICANCE = 1e-4
"""Chance, over all splits, at which a second target of a calibration that is fine is named."""
MAX_EXPLAINED_RMS_MM = 1.5
"""Residual that an explanation must not exceed to be named. Units: mm."""


@dataclass(frozen=True, slots=True)
class LeastDeterminedDirection:
    """The direction of the sensor's pose that the poses determine least.

    Parameters
    ----------
    std : float
        One sigma at the nominal robot; a radian counts 100 mm. Units: mm.
    description : str
        The direction.
    """

    std: float
    description: str


def least_determined_direction(
    sightings: Observations, refined: ErrorsInVariablesFit
) -> LeastDeterminedDirection:
    """Predicted one sigma of the worst-determined motion of the sensor.

    Parameters
    ----------
    sightings : Observations
        What was seen.
    refined : ErrorsInVariablesFit
        The solution; its believed poses count.

    Returns
    -------
    LeastDeterminedDirection
        Infinite where the normal matrix is singular.
    """
    whitening = refined.mask[:, None, None] * robot_whitening(sightings, refined.states, 1.0)
    jacobian, _ = whitened_jacobian_and_residuals(sightings, refined.states, whitening)
    rows = jacobian.reshape(-1, jacobian.shape[-1])
    mount, target = (
        rows[:, :6] / np.array([1, 1, 1, MM_PER_RADIAN, MM_PER_RADIAN, MM_PER_RADIAN]),
        rows[:, 6:],
    )
    prior = np.diag(1 / np.tile(sightings.target_prior[1], refined.states.targets.shape[1]))
    target = np.concatenate([target, prior])
    mount = np.concatenate([mount, np.zeros((len(prior), 6))])
    # The target's part is projected out: what of the mount's columns it cannot imitate.
    basis, strengths, _ = np.linalg.svd(target, full_matrices=False)
    basis = basis[:, strengths > 1e-12 * strengths[0]]
    free = mount - basis @ (basis.T @ mount)
    _, strengths, directions = np.linalg.svd(free, full_matrices=False)
    std = float("inf") if strengths[-1] < 1e-12 else float(1 / strengths[-1])
    return LeastDeterminedDirection(
        std, _describe_direction(directions[-1], refined.states.rotations[0])
    )


def _describe_direction(direction: FloatArray, rotation: FloatArray) -> str:
    shift, turn = rotation.T @ direction[:3], rotation.T @ direction[3:]
    axis = turn if np.linalg.norm(turn) > np.linalg.norm(shift) else shift
    verb = "turning about" if axis is turn else "moving along"
    return f"{verb} the sensor's own {'XYZ'[int(np.abs(axis).argmax())]}"


def ambiguity_ratio(sightings: Observations, refined: ErrorsInVariablesFit) -> float:
    """Cost of the best minimum that is another answer, over the cost of the best.

    Infinite where every start leads to the one minimum.
    """
    states, costs = multi_start(sightings, refined.mask)
    nearest = refined.states
    turn = rotation_vectors(states.rotations @ nearest.rotations[0].T)
    shift = states.translations - nearest.translations[0]
    other = (np.linalg.norm(turn, axis=1) > DISTINCT_ROTATION) | (
        np.linalg.norm(shift, axis=1) > DISTINCT_TRANSLATION_MM
    )
    if not other.any():
        return float("inf")
    own = solve_least_squares(
        sightings, nearest, search_whitening(sightings, refined.mask[None], SEARCH_ROBOT_STD_MM)
    ).costs[0]
    return float(costs[other].min() / max(own, 1e-9))


def residual_norms(sightings: Observations, residuals: FloatArray) -> FloatArray:
    """(n,) millimetres of residuals (n, m)."""
    lengths: FloatArray = np.linalg.norm(residuals * sightings.mm_per_residual, axis=-1)
    return lengths


def detect_moved_target(
    sightings: Observations, mask: FloatArray, refined: ErrorsInVariablesFit | None = None
) -> str | None:
    """Whether two targets, one before and one after some pose, explain what one cannot.

    Parameters
    ----------
    sightings : Observations
        What was seen, all of it of one target.
    mask : (n,) ndarray
        1 for the poses that count: a wrong pose must not pass for a target that moved.
    refined : ErrorsInVariablesFit, optional
        A solution to start from and to weigh by; without it every start is tried.

    Returns
    -------
    str or None
        The finding in words.
    """
    start = refined.states if refined else multi_start(sightings, mask)[0].select(np.array([0]))
    one = _fit_hypothesis(sightings, start, mask, refined)
    others = {}
    for split in range(1, len(mask)):
        if min(mask[:split].sum(), mask[split:].sum()) < 3:
            continue
        two = sightings.with_groups((np.arange(len(mask)) >= split).astype(np.int64))
        begin = (
            _with_second_target(start)
            if refined
            else multi_start(two, mask)[0].select(np.array([0]))
        )
        others[split] = _fit_hypothesis(two, begin, mask, refined)
    if not others:
        return None
    at, best = min(others.items(), key=lambda item: item[1].chi2)
    if best.rms > min(MAX_RMS_RATIO * one.rms, MAX_EXPLAINED_RMS_MM):
        return None
    if refined and _f_test_p_value(one, best) * len(others) > SIGNIFICANCE:
        return None
    return (
        f"the target moved between pose {at - 1} and pose {at} (counted from 0): as one target "
        f"they leave {one.rms:.2g} mm, as two {best.rms:.2g} mm, "
        f"{best.target_distance:.2g} apart; repeat one of the halves"
    )


@dataclass(frozen=True, slots=True)
class _TargetHypothesis:
    """How well one target, or two, explain what was seen."""

    rms: float
    chi2: float
    dof: int
    target_distance: float


def _fit_hypothesis(
    sightings: Observations, start: States, mask: FloatArray, refined: ErrorsInVariablesFit | None
) -> _TargetHypothesis:
    if refined is None:
        whitening = search_whitening(sightings, mask[None], SEARCH_ROBOT_STD_MM)
    else:
        whitening = mask[:, None, None] * robot_whitening(sightings, start, refined.robot_std_scale)
    found = solve_least_squares(sightings, start, whitening)
    targets = found.states.targets[0]
    return _TargetHypothesis(
        _rms_of(sightings, found.states, mask),
        float(found.costs[0]),
        degrees_of_freedom(sightings, found.states, mask),
        sightings.target_distance(targets[0], targets[-1]),
    )


def _f_test_p_value(one: _TargetHypothesis, two: _TargetHypothesis) -> float:
    """Of so much a better fit by a second target that is none: the F test."""
    from scipy.special import fdtrc

    more = one.dof - two.dof
    ratio = (one.chi2 - two.chi2) / more / max(two.chi2 / max(two.dof, 1), 1e-12)
    return float(fdtrc(more, max(two.dof, 1), max(ratio, 0.0)))


def detect_mispaired_poses(sightings: Observations, rms: float) -> str | None:
    """Whether the poses shifted by one, or in reverse, fit what was seen."""
    everyone = np.ones(len(sightings.flanges))
    order = np.arange(len(everyone))
    for words, other in (
        ("each profile belongs to the next pose", np.roll(order, -1)),
        ("each profile belongs to the pose before", np.roll(order, 1)),
        ("the poses are in reverse order", order[::-1]),
    ):
        trial = sightings.with_flange_poses(sightings.flanges.select(other))
        # The pair that a shift brings from the other end is no pair.
        mask = np.where(np.abs(other - order) > 1, 0.0, 1.0) if "each" in words else everyone
        states, _ = multi_start(trial, mask)
        if _rms_of(trial, states, mask) < min(MAX_RMS_RATIO * rms, MAX_EXPLAINED_RMS_MM):
            return f"{words}: pairs shifted against each other"
    return None


def _rms_of(sightings: Observations, states: States, mask: FloatArray) -> float:
    lengths = residual_norms(sightings, sightings.linearise(states).residuals[0])
    return float(np.sqrt((lengths**2 * mask).sum() / mask.sum()))


def _with_second_target(states: States) -> States:
    targets = np.repeat(states.targets[:, :1], 2, axis=1)
    return States(states.rotations, states.translations, targets)
