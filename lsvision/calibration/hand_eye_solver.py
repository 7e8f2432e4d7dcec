"""Hand-eye solver for observations of any target: fit, outlier rejection, diagnostics, result."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.errors_in_variables import (
    NOMINAL_ROBOT_STD,
    ErrorsInVariablesFit,
    find_least_determined_direction,
    robot_covariances,
)
from lsvision.calibration.hand_eye_mistakes import (
    MIN_MOVED_TARGET_POSES,
    detect_mispaired_poses,
    detect_moved_target,
)
from lsvision.calibration.hand_eye_parts import RejectedPose, Sensor, Sphere
from lsvision.calibration.hand_eye_result import HandEye, HandEyeSettings
from lsvision.calibration.observations import (
    Mounting,
    Observations,
    require_rotation,
    residual_norms,
)
from lsvision.calibration.pose_outliers import (
    RobustHandEyeFit,
    ambiguity_ratio,
    fit_with_outlier_rejection,
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
