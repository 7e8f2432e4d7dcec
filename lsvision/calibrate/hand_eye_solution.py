"""From sightings of any target to a `HandEye`: solve, doubt, check, tell."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lsvision.calibrate.flange_poses import Mounting, require_turning
from lsvision.calibrate.hand_eye_checks import (
    ambiguity_ratio,
    misplaced_poses,
    moved_target,
    residual_lengths,
    weakest_direction,
)
from lsvision.calibrate.hand_eye_result import HandEye, RejectedPose, Sensor, Sphere
from lsvision.calibrate.noisy_poses import ROBOT_SHAPE
from lsvision.calibrate.pose_outliers import Doubted, OutlierSettings, believe_poses
from lsvision.calibrate.sightings import Sightings
from lsvision.calibrate.sphere_arc import SphereArcSettings
from lsvision.errors import CalibrationFailed, DegenerateGeometry, FitFailed
from lsvision.shapes import FloatArray, Plane, Pose


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
    max_residual : float
        Largest root mean square residual of the believed poses; beyond it poses and profiles
        do not belong together. Units: mm.
    max_weakness : float
        Largest one sigma in the weakest direction at the nominal or stated robot. Units: mm.
    min_ambiguity : float
        Least ratio of the second-best minimum's cost to the best's.
    """

    robot_std: tuple[float, float] | None = None
    arc: SphereArcSettings = field(default_factory=SphereArcSettings)
    outliers: OutlierSettings = field(default_factory=OutlierSettings)
    max_residual: float = 3.0
    max_weakness: float = 10.0
    min_ambiguity: float = 1.2


@dataclass(frozen=True, eq=False)
class Story:
    """What the result must say beside the solution.

    Parameters
    ----------
    seen : list of int
        Poses with a sighting.
    lost : list of RejectedPose
        Poses without.
    working_point : (3,) ndarray
        Sensor frame. Units: mm.
    mounting, sensor, settings
        As in `HandEye`.
    """

    seen: list[int]
    lost: list[RejectedPose]
    working_point: FloatArray
    mounting: Mounting
    sensor: Sensor
    settings: HandEyeSettings


def solve(
    sightings: Sightings, poses: Sequence[Pose], need: int, settings: HandEyeSettings
) -> Doubted:
    """Solution on the poses that are believed, or a refusal that says why there is none.

    Parameters
    ----------
    sightings : Sightings
        What was seen.
    poses : sequence of Pose
        ``base_from_flange``, one a sighting.
    need : int
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
    require_turning(poses)
    estimate = settings.robot_std is None
    try:
        doubted = believe_poses(sightings, settings.outliers, need=need, estimate=estimate)
    except FitFailed as error:
        raise DegenerateGeometry(str(error)) from error
    refined = doubted.refined
    count = len(poses)
    believed = int(refined.mask.sum())
    lengths = residual_lengths(sightings, sightings.linearised(refined.states).residuals[0])
    rms = float(np.sqrt((lengths**2 * refined.mask).sum() / max(believed, 1)))
    too_few = believed < max(need, count * (1 - settings.outliers.max_share))
    if too_few or rms > settings.max_residual:
        raise CalibrationFailed(_why(sightings, lengths, rms, believed))
    weakness = weakest_direction(sightings, refined)
    if weakness.std > settings.max_weakness:
        raise DegenerateGeometry(
            f"the poses leave the sensor free by {weakness.std:.3g} mm in {weakness.words}: add "
            "poses tilted 20 to 35 deg about two axes, with the target in other places of the view"
        )
    moved = moved_target(sightings, refined.mask, refined) if believed >= 8 else None
    if moved:
        raise CalibrationFailed(moved)
    return doubted


def _why(sightings: Sightings, lengths: FloatArray, rms: float, believed: int) -> str:
    """What the residuals say of data that do not fit."""
    count = len(lengths)
    everyone = float(np.sqrt(np.mean(lengths**2)))
    finding = (moved_target(sightings, np.ones(count)) if count >= 8 else None) or misplaced_poses(
        sightings, everyone
    )
    if finding:
        return finding
    return (
        f"the best answer leaves {rms:.3g} mm at {believed} of {count} poses: are pairs "
        "shuffled, is the poses' convention or unit another one than said, or the mounting "
        "(eye_in_hand, eye_to_hand)?"
    )


def result_of(
    sightings: Sightings, doubted: Doubted, target: Sphere | Plane | Pose, story: Story
) -> HandEye:
    """The solution as the caller gets it, once no other answer fits nearly as well.

    Raises
    ------
    DegenerateGeometry
        If another minimum costs hardly more.
    """
    refined, settings = doubted.refined, story.settings
    raw = sightings.linearised(refined.states).residuals[0]
    lengths = residual_lengths(sightings, raw)
    held_out = residual_lengths(sightings, refined.left_out())
    ambiguity = ambiguity_ratio(sightings, refined)
    if ambiguity < settings.min_ambiguity:
        raise DegenerateGeometry(
            f"another answer fits nearly as well (cost ratio {ambiguity:.2g}): add poses tilted "
            "about other axes and with the target in other places of the view"
        )
    rejected = [
        RejectedPose(
            story.seen[index],
            f"{held_out[index]:.3g} mm off what the other poses expect "
            f"(chance {doubted.chances[index]:.1g})",
        )
        for index in np.flatnonzero(refined.mask == 0)
    ]
    weakness = weakest_direction(sightings, refined)
    shape = np.array(settings.robot_std or ROBOT_SHAPE)
    factor = refined.scale if settings.robot_std is None else float(np.sqrt(refined.widening))
    position, rotation = shape * factor
    return HandEye(
        mount_from_sensor=Pose(refined.states.rotations[0], refined.states.translations[0]),
        covariance=refined.covariance[:6, :6],
        residuals=_placed(lengths, story),
        held_out=_placed(held_out, story),
        rejected=tuple(sorted([*rejected, *story.lost], key=lambda pose: pose.index)),
        target=target,
        working_point=story.working_point,
        robot_std=(float(position), float(rotation)),
        ambiguity=ambiguity,
        weakness=weakness.std,
        weakest=weakness.words,
        mounting=story.mounting,
        sensor=story.sensor,
    )


def _placed(lengths: FloatArray, story: Story) -> FloatArray:
    placed = np.full(len(story.seen) + len(story.lost), np.nan)
    placed[story.seen] = lengths
    return placed
