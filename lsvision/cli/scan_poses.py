"""Poses of the sections of a scan: from an encoder axis, or from a robot."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import typer

from lsvision.cli.robot_options import RobotOptions, parse_pose_file
from lsvision.cli.robot_poses import PoseFile, format_uncertainty_caption, read_calibration

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.geometry import Pose

MAX_STEP_MM = 1e5
"""Largest --step: coordinates up to 1e9 mm are accepted, so that 10 000 profiles are possible."""


@dataclass(frozen=True)
class Encoder:
    """Motion along an encoder axis: ``--feed`` and ``--step``.

    Parameters
    ----------
    direction : (float, float, float)
        Direction of the section's motion in the section frame, a unit vector.
    step : float
        Feed from one profile to the next; negative for the opposite direction. Units: mm.
    """

    direction: tuple[float, float, float]
    step: float


@dataclass(frozen=True)
class Robot:
    """Motion by a robot: ``--poses`` with ``--convention``, and ``--flange-from-section``.

    Parameters
    ----------
    pose_file : PoseFile
        Poses of the flange, or, without a calibration, of the section frame.
    calibration : HandEye, optional
        Pose of the sensor on the flange.
    """

    pose_file: PoseFile
    calibration: "HandEye | None"


def parse_motion(feed: str | None, step: float | None, robot: RobotOptions) -> Encoder | Robot:
    """Return the motion that the options describe.

    Raises
    ------
    typer.BadParameter
        If an option is missing or invalid, or both motions are given.
    LsvisionError
        If the hand-eye file cannot be used.
    """
    if robot.poses is not None and (feed is not None or step is not None):
        raise typer.BadParameter("expected --feed with --step, or --poses, got both")
    pose_file, hand_eye = parse_pose_file(robot), robot.flange_from_section
    if pose_file is not None:
        return Robot(pose_file, None if hand_eye is None else read_calibration(hand_eye))
    if hand_eye is not None:
        raise typer.BadParameter("expected --poses with --flange-from-section, got none")
    if feed is None or step is None:
        raise typer.BadParameter(
            "expected --feed X,Y,Z and --step MM, or --poses F and --convention NAME: without "
            "poses the sections cannot be combined"
        )
    if not 0 < abs(step) <= MAX_STEP_MM:
        raise typer.BadParameter(
            f"expected --step in mm other than 0, at most {MAX_STEP_MM:g}, got {step:g}"
        )
    return Encoder(_parse_direction(feed), step)


def scan_poses(motion: Encoder | Robot, count: int) -> "list[Pose]":
    """Return ``base_from_section`` of each profile.

    Parameters
    ----------
    motion : Encoder or Robot
        Motion from `parse_motion`.
    count : int
        Number of profiles.

    Raises
    ------
    LsvisionError
        If a file cannot be read, or there are not as many poses as profiles.
    """
    if isinstance(motion, Encoder):
        from lsvision.io.robot_poses import encoder_poses

        return encoder_poses(count, motion.direction, motion.step)
    flanges = motion.pose_file.read(count)
    if motion.calibration is None:
        return flanges
    return [flange @ motion.calibration.flange_from_section for flange in flanges]


def motion_uncertainty_caption(motion: Encoder | Robot) -> str:
    """Return a caption: which errors the standard deviations of the table include."""
    if isinstance(motion, Encoder):
        return "one sigma"
    return format_uncertainty_caption(calibrated=motion.calibration is not None, in_base=True)


def _parse_direction(text: str) -> tuple[float, float, float]:
    """Return the unit vector of ``--feed``, from ``X,Y,Z`` of any length above 0."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"expected --feed X,Y,Z such as 0,0,1, got {text!r}") from None
    length = math.hypot(x, y, z)
    if not 0 < length < math.inf:
        raise typer.BadParameter(f"expected --feed of a finite length above 0, got {text!r}")
    return x / length, y / length, z / length
