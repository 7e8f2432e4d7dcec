"""Where a robot held the sensor: poses of its flange, and the hand-eye file."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from lsvision.errors import LsvisionError, UnreadableFile

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.geometry import Pose


@dataclass(frozen=True)
class PoseFile:
    """``--poses`` and ``--convention``."""

    path: Path
    convention: str


def parse_pose_file(poses: Path | None, convention: str | None) -> PoseFile | None:
    """What the options say of the robot's poses; None without any.

    Raises
    ------
    typer.BadParameter
        If one of them is missing, or the convention is unknown.
    """
    if poses is None:
        if convention is not None:
            raise typer.BadParameter("want --poses beside --convention, got none")
        return None
    from lsvision.io.robot_conventions import CONVENTIONS

    if convention not in CONVENTIONS:
        raise typer.BadParameter(
            f"want --convention {', '.join(CONVENTIONS)} beside --poses, got {convention}"
        )
    return PoseFile(poses, convention)


def read_poses(rows: PoseFile, count: int) -> "list[Pose]":
    """The poses, one a profile.

    Raises
    ------
    UnreadableFile
        If the file cannot be read, or there are not as many poses as profiles.
    """
    from lsvision.io.robot_poses import read_robot_poses

    flanges = read_robot_poses(rows.path, rows.convention)
    if len(flanges) != count:
        raise UnreadableFile(
            f"{rows.path}: want one pose a profile, got {len(flanges)} poses for {count} "
            f"profile{'' if count == 1 else 's'}: leave out what has no partner"
        )
    return flanges


def read_calibration(path: Path) -> "HandEye":
    """The hand-eye file of a profile sensor on the flange.

    Raises
    ------
    LsvisionError
        If it is none, of another schema, of a camera, or of a sensor that stands still.
    """
    from lsvision.io.hand_eye_file import load_hand_eye

    calibration = load_hand_eye(path)
    try:
        _ = calibration.flange_from_section
    except ValueError as error:
        raise LsvisionError(
            f"{path}: {error}: calibrate with lsvision calibrate hand-eye sphere or plane, the "
            "sensor on the flange"
        ) from error
    return calibration


def uncertainty_caption(*, calibrated: bool, in_base: bool) -> str:
    """What the errors of a table are, of a sensor on a robot."""
    if not calibrated:
        return "one sigma, the sensor's place on the robot taken as exact"
    sources = "calibration's and the robot's" if in_base else "calibration's"
    return f"one sigma, with the {sources} error"
