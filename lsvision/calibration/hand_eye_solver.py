"""Hand-eye solver for observations of any target: fit, outlier rejection, diagnostics, result."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lsvision.calibration.batched_least_squares import (
    search_whitening,
    solve_least_squares,
)
from lsvision.calibration.board_observations import BoardObservations
from lsvision.calibration.errors_in_variables import (
    NOMINAL_ROBOT_STD,
    ErrorsInVariablesFit,
    degrees_of_freedom,
    find_least_determined_direction,
    robot_covariances,
    robot_whitening,
)
from lsvision.calibration.hand_eye_parts import RejectedPose, Sensor, Sphere
from lsvision.calibration.hand_eye_result import HandEye, HandEyeSettings
from lsvision.calibration.observations import (
    Mounting,
    Observations,
    States,
    require_rotation,
)
from lsvision.calibration.pose_outliers import (
    RobustHandEyeFit,
    ambiguity_ratio,
    fit_with_outlier_rejection,
    solve_from_all_guesses,
)
from lsvision.errors import CalibrationFailed, DegenerateGeometry, FitFailed
from lsvision.geometry import FloatArray, Plane, Pose
from lsvision.geometry.arrays import rms

MAX_NOISE_RATIO = 4.0
"""Largest accepted ratio of the rms residual to the one that the stated noise explains."""
MAX_ROBOT_STD_SCALE = 40.0
"""Largest standard deviation of a robot that is accepted, in units of `NOMINAL_ROBOT_STD`: 2 mm and
0.4 deg. Wrong conventions and shuffled pairs give 300 and more."""
MIN_LIMIT_MM = 3.0
"""Rms residual up to which a calibration is accepted at any noise; its covariance grows with the
residuals. Units: mm."""
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


@dataclass(frozen=True, eq=False)
class ResultContext:
    """Data of the result that are not in the solution.

    Parameters
    ----------
    observed_poses : list of int
        Indices, among the poses of the caller, of those with an observation.
    unobserved_poses : list of RejectedPose
        The others, with the reason.
    working_point : (3,) ndarray
        Mean position of the target in the sensor frame. Units: mm.
    mounting, sensor, settings
        As in `HandEye`.
    """

    observed_poses: list[int]
    unobserved_poses: list[RejectedPose]
    working_point: FloatArray
    mounting: Mounting
    sensor: Sensor
    settings: HandEyeSettings


def solve_hand_eye(
    observations: Observations, poses: Sequence[Pose], min_poses: int, settings: HandEyeSettings
) -> RobustHandEyeFit:
    """Return the solution on the inlier poses, or raise an error with the most likely cause.

    `poses` are ``base_from_flange`` of each observation, `min_poses` is the smallest number of
    inlier poses.

    Raises
    ------
    CalibrationFailed
        If observations and poses do not belong together, or the target moved.
    DegenerateGeometry
        If the poses leave a direction undetermined.
    """
    require_rotation(poses)
    estimate_robot_std = settings.robot_std is None
    try:
        solution = fit_with_outlier_rejection(
            observations,
            settings.outliers,
            min_poses=min_poses,
            estimate_robot_std=estimate_robot_std,
        )
    except FitFailed as error:
        raise DegenerateGeometry(str(error)) from error
    fit = solution.fit
    _require_consistent_poses(observations, fit, min_poses, settings)
    least_determined = find_least_determined_direction(observations, fit)
    if least_determined.std > settings.max_least_determined_std:
        raise DegenerateGeometry(
            f"the sensor is determined to {least_determined.std:.3g} mm only in "
            f"{least_determined.description}: add poses tilted 20 to 35 deg about two axes, with "
            "the target at other positions in the view"
        )
    if fit.mask.sum() >= MIN_MOVED_TARGET_POSES:
        motion = detect_moved_target(observations, fit.mask, fit)
        if motion:
            raise CalibrationFailed(motion)
    return solution


def _require_consistent_poses(
    observations: Observations,
    fit: ErrorsInVariablesFit,
    min_poses: int,
    settings: HandEyeSettings,
) -> None:
    """Require enough inlier poses, with residuals that the noise explains.

    Raises
    ------
    CalibrationFailed
        With the most likely cause.
    """
    inliers = int(fit.mask.sum())
    norms = residual_norms(observations, observations.linearise(fit.states).residuals[0])
    inlier_rms = float(np.sqrt((norms**2 * fit.mask).sum() / max(inliers, 1)))
    min_inlier_fraction = 1 - settings.outliers.max_outlier_fraction
    too_few = inliers < max(min_poses, len(norms) * min_inlier_fraction)
    limit = settings.max_residual_rms or _explained_residual_rms(observations, fit, settings)
    if too_few or inlier_rms > limit:
        raise CalibrationFailed(
            _explain_large_residuals(
                observations, norms, inliers=inliers, inlier_rms=inlier_rms, limit=limit
            )
        )


def _explained_residual_rms(
    observations: Observations, fit: ErrorsInVariablesFit, settings: HandEyeSettings
) -> float:
    """Return the largest rms residual that robot and observations explain. Units: mm."""
    squares = np.square(observations.mm_per_residual)
    robot, sensor = (
        float(np.einsum("nii,i->n", covariances, squares)[fit.mask > 0].mean())
        for covariances in (
            robot_covariances(observations, fit.states, (1.0, 1.0))[0],
            observations.covariances,
        )
    )
    factor = MAX_ROBOT_STD_SCALE if settings.robot_std is None else MAX_NOISE_RATIO
    return max(float(np.hypot(factor * robot**0.5, MAX_NOISE_RATIO * sensor**0.5)), MIN_LIMIT_MM)


def _explain_large_residuals(
    observations: Observations,
    norms: FloatArray,
    *,
    inliers: int,
    inlier_rms: float,
    limit: float,
) -> str:
    """Return the message with the most likely cause of large residuals.

    `norms` are the residuals of all poses, `inlier_rms` is that of the `inliers` poses. Units: mm.
    """
    count = len(norms)
    finding = None
    if count >= MIN_MOVED_TARGET_POSES:
        finding = detect_moved_target(observations, np.ones(count))
    finding = finding or detect_mispaired_poses(observations, rms(norms))
    if finding:
        return finding
    return (
        f"the best solution leaves {inlier_rms:.3g} mm at {inliers} of {count} poses, more than "
        f"the {limit:.2g} mm that noise explains: check the order of the pairs, the convention and "
        "unit of the poses, the mounting (eye in hand, eye to hand), and the size of the target; "
        "for a less accurate robot increase the limit --max-residual (in Python max_residual_rms)"
    )


def build_hand_eye(
    observations: Observations,
    solution: RobustHandEyeFit,
    target: Sphere | Plane | Pose,
    context: ResultContext,
) -> HandEye:
    """Return the result, unless another solution fits nearly as well.

    Raises
    ------
    DegenerateGeometry
        If another minimum has nearly the same cost.
    """
    fit, settings = solution.fit, context.settings
    residuals = observations.linearise(fit.states).residuals[0]
    norms = residual_norms(observations, residuals)
    leave_one_out = residual_norms(observations, fit.leave_one_out_residuals())
    ratio = ambiguity_ratio(observations, fit)
    if ratio < settings.min_ambiguity_ratio:
        raise DegenerateGeometry(
            f"another solution fits nearly as well (cost ratio {ratio:.2g}): add poses tilted "
            "about other axes and with the target at other positions in the view"
        )
    rejected = [
        RejectedPose(
            context.observed_poses[index],
            f"{leave_one_out[index]:.3g} mm off the prediction of the other poses "
            f"(p-value {solution.outlier_p_values[index]:.1g})",
        )
        for index in np.flatnonzero(fit.mask == 0)
    ]
    least_determined = find_least_determined_direction(observations, fit)
    return HandEye(
        mount_from_sensor=Pose(fit.states.rotations[0], fit.states.translations[0]),
        covariance=fit.covariance[:6, :6],
        residuals=_expand_to_all_poses(norms, context),
        leave_one_out_residuals=_expand_to_all_poses(leave_one_out, context),
        rejected=tuple(sorted([*rejected, *context.unobserved_poses], key=lambda pose: pose.index)),
        target=target,
        working_point=context.working_point,
        robot_std=_estimate_robot_std(fit, settings),
        ambiguity_ratio=ratio,
        least_determined_std=least_determined.std,
        least_determined_direction=least_determined.description,
        mounting=context.mounting,
        sensor=context.sensor,
    )


def _estimate_robot_std(
    fit: ErrorsInVariablesFit, settings: HandEyeSettings
) -> tuple[float, float]:
    """Return the std of the robot's position (mm) and rotation (rad) in each axis."""
    robot_std = np.array(settings.robot_std or NOMINAL_ROBOT_STD)
    factors = fit.robot_std_scales if settings.robot_std is None else np.sqrt(fit.variance_factor)
    position, rotation = robot_std * factors
    return float(position), float(rotation)


def _expand_to_all_poses(values: FloatArray, context: ResultContext) -> FloatArray:
    """Return values of the observed poses in the order of all poses; NaN for others."""
    expanded = np.full(len(context.observed_poses) + len(context.unobserved_poses), np.nan)
    expanded[context.observed_poses] = values
    return expanded


def residual_norms(observations: Observations, residuals: FloatArray) -> FloatArray:
    """Return the norms (n,) of residuals (n, m) in mm."""
    norms: FloatArray = np.linalg.norm(residuals * observations.mm_per_residual, axis=-1)
    return norms


def detect_moved_target(
    observations: Observations, mask: FloatArray, fit: ErrorsInVariablesFit | None = None
) -> str | None:
    """Return the message that the target moved between two poses; None if it did not move.

    It moved if two targets, one before and one after some pose, fit far better than one. `mask`
    (n,) excludes outlying poses, which must not be mistaken for a moved target. Without `fit` all
    initial guesses are tried, weighted by `search_whitening`.
    """
    initial_guess = fit.states if fit else _best_state(observations, mask)
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
    return (
        f"the target moved between pose {first_moved - 1} and pose {first_moved} (counted from 0): "
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
    dof : int
        Degrees of freedom.
    target_distance : float
        Distance between the two targets; 0 for one. Units: mm.
    """

    rms: float
    chi2: float
    dof: int
    target_distance: float


def _best_state(observations: Observations, mask: FloatArray) -> States:
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
    guess = _duplicate_target(fit.states) if fit else _best_state(observations, mask)
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
        whitening = mask[:, None, None] * robot_whitening(
            observations, initial_guess, fit.robot_std_scales
        )
    solution = solve_least_squares(observations, initial_guess, whitening)
    targets = solution.states.targets[0]
    return _TargetHypothesis(
        _residual_rms(observations, solution.states, mask),
        float(solution.costs[0]),
        degrees_of_freedom(observations, solution.states, mask),
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
    norms = residual_norms(observations, observations.linearise(states).residuals[0])
    return float(np.sqrt((norms**2 * mask).sum() / mask.sum()))


def _duplicate_target(states: States) -> States:
    """Return states with two targets, both equal to the first."""
    targets = np.repeat(states.targets[:, :1], 2, axis=1)
    return States(states.rotations, states.translations, targets)
