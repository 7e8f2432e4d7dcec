"""Hand-eye solver for observations of any target: fit, outlier rejection, diagnostics, result."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.errors_in_variables import (
    ErrorsInVariablesFit,
    find_least_determined_direction,
)
from lsvision.calibration.hand_eye_checks import LARGE_RESIDUAL_MM
from lsvision.calibration.hand_eye_mistakes import (
    MIN_MOVED_TARGET_POSES,
    detect_mispaired_poses,
    detect_moved_target,
)
from lsvision.calibration.hand_eye_result import HandEye, HandEyeSettings
from lsvision.calibration.observations import (
    Mounting,
    Observations,
    RejectedPose,
    Sensor,
    Sphere,
    compute_residual_norms,
    require_rotation,
)
from lsvision.calibration.pose_outliers import (
    ambiguity_ratio,
    fit_with_outlier_rejection,
    outlier_p_values,
)
from lsvision.calibration.robot_std import NOMINAL_ROBOT_STD, robot_covariances
from lsvision.errors import CalibrationFailed, DegenerateGeometry, FitFailed
from lsvision.geometry import FloatArray, Plane, Pose
from lsvision.geometry.arrays import rms

MAX_NOISE_RATIO = 4.0
"""Largest accepted ratio of the rms residual to the one that the stated noise explains: a robot may
be four times worse than stated. In 18 simulated sets with heavy tails the ratio is 0.6 to 1.0 for
the stated noise, and 46 and more for poses in another convention or order. A limit of 2 rejects
robots that are three times worse, although the covariance grows with the residuals. Boards whose
stated size is 5 % wrong have ratios of 3.2 to 4.6: where the robot's motion does not determine the
size, a limit of 8 accepts all of them, 4 some."""
MAX_ROBOT_STD_SCALE = 40.0
"""Largest standard deviation of a robot that is accepted, in units of `NOMINAL_ROBOT_STD`: 2 mm and
0.4 deg. Wrong conventions and shuffled pairs give 300 and more."""
MISMATCH_REMEDY = (
    "check the order of the pairs, the convention and unit of the poses, the mounting (eye in "
    "hand, eye to hand), and the size of the target"
)
"""Remedy for poses and observations that do not belong together."""


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
    observations: Observations,
    poses: Sequence[Pose],
    pose_indices: Sequence[int],
    min_poses: int,
    settings: HandEyeSettings,
) -> ErrorsInVariablesFit:
    """Return the solution on the inlier poses, or raise an error with the most likely cause.

    `poses` are ``base_from_flange`` of each observation, `pose_indices` their indices among those
    of the caller, for messages. `min_poses` is the smallest number of inlier poses.

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
        fit = fit_with_outlier_rejection(
            observations,
            settings.outliers,
            min_poses=min_poses,
            estimate_robot_std=estimate_robot_std,
        )
    except FitFailed as error:
        raise DegenerateGeometry(str(error)) from error
    _require_consistent_poses(observations, fit, pose_indices, min_poses, settings)
    std, motion = find_least_determined_direction(observations, fit)
    if std > settings.max_least_determined_std:
        raise DegenerateGeometry(
            f"the sensor is determined to {std:.3g} mm only in {motion}: add poses tilted 20 to 35 "
            "deg about two axes, with the target at other positions in the view"
        )
    # A target that moved by a few mm leaves residuals that the limit accepts.
    if fit.mask.sum() >= MIN_MOVED_TARGET_POSES:
        mistake = detect_moved_target(observations, fit.mask, pose_indices, fit)
        if mistake:
            raise CalibrationFailed(mistake)
    return fit


def _require_consistent_poses(
    observations: Observations,
    fit: ErrorsInVariablesFit,
    pose_indices: Sequence[int],
    min_poses: int,
    settings: HandEyeSettings,
) -> None:
    """Require enough inlier poses, with residuals that the noise explains.

    CalibrationFailed states the most likely cause.
    """
    inliers = int(fit.mask.sum())
    norms = compute_residual_norms(observations, observations.linearise(fit.states).residuals[0])
    inlier_rms = float(np.sqrt((norms**2 * fit.mask).sum() / max(inliers, 1)))
    min_inliers = settings.outliers.compute_min_inliers(len(norms), min_poses)
    limit, limit_name = settings.max_residual_rms, "the limit of {:.2g} mm"
    if limit is None:
        limit = _explained_residual_rms(observations, fit, settings)
        limit_name = "the {:.2g} mm that noise explains"
    if inliers >= min_inliers and inlier_rms <= limit:
        return
    mistake = _find_mistake(observations, norms, pose_indices)
    if mistake:
        raise CalibrationFailed(mistake)
    finding = f"the best solution leaves {inlier_rms:.3g} mm at {inliers} of {len(norms)} poses"
    if inlier_rms <= limit:
        rejected = np.flatnonzero(fit.mask == 0).tolist()
        outliers = ", ".join(str(pose_indices[index]) for index in rejected)
        raise CalibrationFailed(
            f"{finding}, and {min_inliers} poses that agree are needed: add poses, or repeat those "
            f"that disagree ({outliers}, counted from 0), with the robot standing still; if they "
            f"disagree again, {MISMATCH_REMEDY}"
        )
    raise CalibrationFailed(
        f"{finding}, more than {limit_name.format(limit)}: {MISMATCH_REMEDY}; for a less accurate "
        "robot increase the limit --max-residual (in Python max_residual_rms)"
    )


def _explained_residual_rms(
    observations: Observations, fit: ErrorsInVariablesFit, settings: HandEyeSettings
) -> float:
    """Return the largest rms residual that robot and observations explain. Units: mm.

    At least `LARGE_RESIDUAL_MM`: a residual that gives no warning is no reason for a rejection, and
    the covariance grows with it.
    """
    squares = np.square(observations.mm_per_residual)
    robot, sensor = (
        float(np.einsum("nii,i->n", covariances, squares)[fit.mask > 0].mean())
        for covariances in (
            robot_covariances(observations, fit.states, (1.0, 1.0))[0],
            observations.covariances,
        )
    )
    factor = MAX_ROBOT_STD_SCALE if settings.robot_std is None else MAX_NOISE_RATIO
    return max(
        float(np.hypot(factor * robot**0.5, MAX_NOISE_RATIO * sensor**0.5)), LARGE_RESIDUAL_MM
    )


def _find_mistake(
    observations: Observations, norms: FloatArray, pose_indices: Sequence[int]
) -> str | None:
    """Return the message on a mistake that explains the residuals `norms` (mm) of all poses.

    None if no such mistake is found: the target did not move, and the pairs are not shifted. All
    poses count, since the fit may have rejected those after a move as outliers.
    """
    count, moved = len(norms), None
    if count >= MIN_MOVED_TARGET_POSES:
        moved = detect_moved_target(observations, np.ones(count), pose_indices)
    return moved or detect_mispaired_poses(observations, rms(norms))


def build_hand_eye(
    observations: Observations,
    fit: ErrorsInVariablesFit,
    target: Sphere | Plane | Pose,
    context: ResultContext,
) -> HandEye:
    """Return the result; DegenerateGeometry if another solution fits nearly as well."""
    settings, p_values = context.settings, outlier_p_values(fit)
    residuals = observations.linearise(fit.states).residuals[0]
    norms = compute_residual_norms(observations, residuals)
    leave_one_out = compute_residual_norms(observations, fit.leave_one_out_residuals())
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
            f"(p-value {p_values[index]:.1g})",
        )
        for index in np.flatnonzero(fit.mask == 0)
    ]
    least_determined_std, direction = find_least_determined_direction(observations, fit)
    return HandEye(
        mount_from_sensor=Pose(fit.states.rotations[0], fit.states.translations[0]),
        covariance=fit.covariance[:6, :6],
        residuals=_expand_to_all_poses(norms, context),
        leave_one_out_residuals=_expand_to_all_poses(leave_one_out, context),
        rejected=tuple(sorted([*rejected, *context.unobserved_poses], key=lambda pose: pose.index)),
        target=target,
        working_point=context.working_point,
        robot_std=_scale_robot_std(fit, settings),
        ambiguity_ratio=ratio,
        least_determined_std=least_determined_std,
        least_determined_direction=direction,
        mounting=context.mounting,
        sensor=context.sensor,
        degrees_of_freedom=fit.posterior.covariance_dof,
    )


def _scale_robot_std(fit: ErrorsInVariablesFit, settings: HandEyeSettings) -> tuple[float, float]:
    """Return the robot's std of position (mm) and rotation (rad) per axis, scaled by the fit."""
    robot_std = np.array(settings.robot_std or NOMINAL_ROBOT_STD)
    factors = fit.robot_std_scales if settings.robot_std is None else np.sqrt(fit.variance_factor)
    position, rotation = robot_std * factors
    return float(position), float(rotation)


def _expand_to_all_poses(values: FloatArray, context: ResultContext) -> FloatArray:
    """Return values of the observed poses in the order of all poses; NaN for others."""
    expanded = np.full(len(context.observed_poses) + len(context.unobserved_poses), np.nan)
    expanded[context.observed_poses] = values
    return expanded
