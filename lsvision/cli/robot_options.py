"""Options for a sensor on a robot: the file of flange poses, and the hand-eye file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from lsvision.cli.robot_frame import RobotFrame
from lsvision.cli.robot_poses import PoseFile, read_calibration


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
    """Return the name of a pose convention, after the check that it is known.

    Parameters
    ----------
    name : str, optional
        Value of the option; None if it was not given.
    option : str
        Name of the command-line option, for the error message.

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
