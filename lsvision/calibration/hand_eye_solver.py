"""From sightings of any target to a `HandEye`: solve, doubt, check, tell."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lsvision.calibration.errors_in_variables import NOMINAL_ROBOT_STD, ErrorsInVariablesFit
from lsvision.calibration.flange_poses import Mounting, require_rotation
from lsvision.calibration.hand_eye_diagnostics import (
    ambiguity_ratio,
    detect_mispaired_poses,
    detect_moved_target,
    least_determined_direction,
    residual_norms,
)
from lsvision.calibration.hand_eye_result import HandEye, RejectedPose, Sensor, Sphere
from lsvision.calibration.observations import Observations
from lsvision.calibration.pose_outliers import (
    OutlierSettings,
    RobustHandEyeFit,
    fit_with_outlier_rejection,
)
from lsvision.calibration.sphere_arc import SphereArcSettings
from lsvision.errors import CalibrationFailed, DegenerateGeometry, FitFailed
from lsvision.geometry import FloatArray, Plane, Pose


@dataclass(frozen=True, kw_only=True, slots=True)
class HandEyeSettings:
    """What is known of the robot, and when a calibration is refused.

    Parameters
    ----------
    robot_std : tuple of float, optional
        One sigma of the robot's pose in each axis of position (mm) and orientation (rad).
        None finds its size from the residuals, with the proportions 0.05 mm to 0.01 deg. A
        data sheet's "repeatability" is the best case; absolute accuracy is several times worse.
    arc : SphereArcSettings
        How the sphere is found in a profile.
    outliers : OutlierSettings
        How poses are doubted.
    max_residual_rms : float
        Largest root mean square residual of the believed poses; beyond it poses and profiles
        do not belong together. Units: mm.
    max_least_determined_std : float
        Largest one sigma in the weakest direction at the nominal or stated robot. Units: mm.
    min_ambiguity_ratio : float
        Least ratio of the second-best minimum's cost to the best's.
    """

    robot_std: tuple[float, float] | None = None
    arc: SphereArcSettings = field(default_factory=SphereArcSettings)
    outliers: OutlierSettings = field(default_factory=OutlierSettings)
    max_residual_rms: float = 3.0
    max_least_determined_std: float = 10.0
    min_ambiguity_ratio: float = 1.2


@dataclass(frozen=True, eq=False)
class ResultContext:
    """What the result must say beside the solution.

    Parameters
    ----------
    observed_poses : list of int
        Poses with a sighting.
    unobserved_poses : list of RejectedPose
        Poses without.
    working_point : (3,) ndarray
        Sensor frame. Units: mm.
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
    sightings: Observations, poses: Sequence[Pose], min_poses: int, settings: HandEyeSettings
) -> RobustHandEyeFit:
    """Solution on the poses that are believed, or a refusal that says why there is none.

    Parameters
    ----------
    sightings : Observations
        What was seen.
    poses : sequence of Pose
        ``base_from_flange``, one a sighting.
    min_poses : int
        Fewest poses that determine the problem.
    settings : HandEyeSettings
        See there.

    Raises
    ------
    CalibrationFailed
        Sightings and poses that do not belong together, or a target that moved.
    DegenerateGeometry
        Poses that leave a direction free.
    """
    require_rotation(poses)
    estimate = settings.robot_std is None
    try:
        doubted = fit_with_outlier_rejection(
            sightings, settings.outliers, min_poses=min_poses, estimate_robot_std=estimate
        )
    except FitFailed as error:
        raise DegenerateGeometry(str(error)) from error
    refined = doubted.fit
    count = len(poses)
    believed = int(refined.mask.sum())
    lengths = residual_norms(sightings, sightings.linearise(refined.states).residuals[0])
    rms = float(np.sqrt((lengths**2 * refined.mask).sum() / max(believed, 1)))
    too_few = believed < max(min_poses, count * (1 - settings.outliers.max_outlier_fraction))
    if too_few or rms > settings.max_residual_rms:
        raise CalibrationFailed(_diagnose(sightings, lengths, rms, believed))
    weakness = least_determined_direction(sightings, refined)
    if weakness.std > settings.max_least_determined_std:
        raise DegenerateGeometry(
            f"the poses leave the sensor free by {weakness.std:.3g} mm in "
            f"{weakness.description}: add poses tilted 20 to 35 deg about two axes, with the "
            "target in other places of the view"
        )
    moved = detect_moved_target(sightings, refined.mask, refined) if believed >= 8 else None
    if moved:
        raise CalibrationFailed(moved)
    return doubted


def _diagnose(sightings: Observations, lengths: FloatArray, rms: float, believed: int) -> str:
    """What the residuals say of data that do not fit."""
    count = len(lengths)
    everyone = float(np.sqrt(np.mean(lengths**2)))
    finding = (
        detect_moved_target(sightings, np.ones(count)) if count >= 8 else None
    ) or detect_mispaired_poses(sightings, everyone)
    if finding:
        return finding
    return (
        f"the best answer leaves {rms:.3g} mm at {believed} of {count} poses: are pairs "
        "shuffled, is the poses' convention or unit another one than said, or the mounting "
        "(eye_in_hand, eye_to_hand)?"
    )


def build_hand_eye(
    sightings: Observations,
    doubted: RobustHandEyeFit,
    target: Sphere | Plane | Pose,
    story: ResultContext,
) -> HandEye:
    """The solution as the caller gets it, once no other answer fits nearly as well.

    Raises
    ------
    DegenerateGeometry
        If another minimum costs hardly more.
    """
    refined, settings = doubted.fit, story.settings
    raw = sightings.linearise(refined.states).residuals[0]
    lengths = residual_norms(sightings, raw)
    held_out = residual_norms(sightings, refined.leave_one_out_residuals())
    ambiguity = ambiguity_ratio(sightings, refined)
    if ambiguity < settings.min_ambiguity_ratio:
        raise DegenerateGeometry(
            f"another answer fits nearly as well (cost ratio {ambiguity:.2g}): add poses tilted "
            "about other axes and with the target in other places of the view"
        )
    rejected = [
        RejectedPose(
            story.observed_poses[index],
            f"{held_out[index]:.3g} mm off what the other poses expect "
            f"(chance {doubted.outlier_p_values[index]:.1g})",
        )
        for index in np.flatnonzero(refined.mask == 0)
    ]
    weakness = least_determined_direction(sightings, refined)
    return HandEye(
        mount_from_sensor=Pose(refined.states.rotations[0], refined.states.translations[0]),
        covariance=refined.covariance[:6, :6],
        residuals=_expand_to_all_poses(lengths, story),
        leave_one_out_residuals=_expand_to_all_poses(held_out, story),
        rejected=tuple(sorted([*rejected, *story.unobserved_poses], key=lambda pose: pose.index)),
        target=target,
        working_point=story.working_point,
        robot_std=_estimate_robot_std(refined, settings),
        ambiguity_ratio=ambiguity,
        least_determined_std=weakness.std,
        least_determined_direction=weakness.description,
        mounting=story.mounting,
        sensor=story.sensor,
    )


def _estimate_robot_std(
    refined: ErrorsInVariablesFit, settings: HandEyeSettings
) -> tuple[float, float]:
    """Standard deviations of the robot's position (mm) and rotation (rad), per axis."""
    shape = np.array(settings.robot_std or NOMINAL_ROBOT_STD)
    factor = (
        refined.robot_std_scale
        if settings.robot_std is None
        else float(np.sqrt(refined.variance_factor))
    )
    position, rotation = shape * factor
    return float(position), float(rotation)


def _expand_to_all_poses(lengths: FloatArray, story: ResultContext) -> FloatArray:
    placed = np.full(len(story.observed_poses) + len(story.unobserved_poses), np.nan)
    placed[story.observed_poses] = lengths
    return placed
