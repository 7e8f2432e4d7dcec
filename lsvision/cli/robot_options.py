"""Options for the motion of a sensor: by a robot (files of poses and hand-eye file), or a feed."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lsvision.cli.robot_frame import (
    PoseFile,
    RobotFrame,
    format_uncertainty_caption,
    read_calibration,
)

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.geometry import Pose

MAX_STEP_MM = 1e5
"""Largest --step: coordinates up to 1e9 mm are accepted, so that 10 000 profiles are possible."""


@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """Options for the poses of a robot's flange, and for the pose of the sensor on the flange.

    Without the latter the poses are those of the section frame.
    """

    poses: Annotated[
        Path | None,
        typer.Option(
            metavar="F",
            help="File of the flange's poses in the base frame, one per profile; or a folder or "
            "pattern of files of one pose each.",
        ),
    ] = None
    convention: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Convention of --poses, never guessed: ur, kuka, fanuc, abb, ros, matrix, ...",
        ),
    ] = None
    flange_from_section: Annotated[
        Path | None,
        typer.Option(
            metavar="F",
            help="Hand-eye file: the sensor's pose on the flange, and its errors, which are "
            "propagated; without it, --poses are the poses of the section frame itself.",
        ),
    ] = None

    @property
    def files(self) -> list[Path]:
        """Files that the options name, for the check that no output overwrites an input."""
        files = list(filter(None, [self.flange_from_section]))
        if self.poses is not None:
            from lsvision.io.robot_poses import find_pose_files

            files += find_pose_files(self.poses)
        return files


def parse_robot_frame(robot: RobotOptions) -> RobotFrame | None:
    """Return the transformation that the options describe; None without any.

    Raises
    ------
    typer.BadParameter
        If only one of poses and convention is given, or the convention is unknown.
    LsvisionError
        If the hand-eye file cannot be used.
    """
    pose_file, hand_eye = parse_pose_file(robot), robot.flange_from_section
    if pose_file is None and hand_eye is None:
        return None
    calibration = None if hand_eye is None else read_calibration(hand_eye)
    return RobotFrame(calibration=calibration, pose_file=pose_file)


def parse_pose_file(robot: RobotOptions) -> PoseFile | None:
    """Return the pose file that ``--poses`` and ``--convention`` state; None if both are missing.

    Raises
    ------
    typer.BadParameter
        If only one of the two is given, or the convention is unknown.
    """
    if robot.poses is not None:
        return PoseFile(robot.poses, parse_convention(robot.convention))
    if robot.convention is not None:
        raise typer.BadParameter(
            "expected --poses with --convention, got none: give the file of poses"
        )
    return None


def parse_convention(name: str | None, option: str = "--convention") -> str:
    """Return the name of a pose convention, after the check that it is known; `option` states it.

    Raises
    ------
    typer.BadParameter
        If the name is unknown or missing.
    """
    from lsvision.io.robot_conventions import CONVENTIONS

    if name not in CONVENTIONS:
        raise typer.BadParameter(
            f"expected {option} {', '.join(CONVENTIONS)}, got {name or 'none'}: the same "
            "numbers denote a different pose in each convention"
        )
    return name


@dataclass(frozen=True)
class EncoderMotion:
    """Motion along an encoder axis: ``--feed`` and ``--step``.

    The direction is a unit vector in the section frame; the step, in mm, from one profile to the
    next is negative for the opposite direction.
    """

    direction: tuple[float, float, float]
    step: float


@dataclass(frozen=True)
class RobotMotion:
    """Motion by a robot: ``--poses`` with ``--convention``, and ``--flange-from-section``.

    Poses are those of the flange, or, without a calibration, of the section frame.
    """

    pose_file: PoseFile
    calibration: "HandEye | None"


def parse_motion(
    feed: str | None, step: float | None, robot: RobotOptions
) -> EncoderMotion | RobotMotion:
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
        return RobotMotion(pose_file, None if hand_eye is None else read_calibration(hand_eye))
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
    return EncoderMotion(_parse_direction(feed), step)


def build_scan_poses(motion: EncoderMotion | RobotMotion, count: int) -> "list[Pose]":
    """Return ``base_from_section`` of each of `count` profiles.

    Raises
    ------
    LsvisionError
        If a file cannot be read, or there are not as many poses as profiles.
    """
    if isinstance(motion, EncoderMotion):
        from lsvision.io.robot_poses import build_encoder_poses

        return build_encoder_poses(count, motion.direction, motion.step)
    flanges = motion.pose_file.read(count)
    if motion.calibration is None:
        return flanges
    return [flange @ motion.calibration.flange_from_section for flange in flanges]


def format_motion_uncertainty_caption(motion: EncoderMotion | RobotMotion) -> str:
    """Return a caption: which errors the standard deviations of the table include."""
    if isinstance(motion, EncoderMotion):
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
