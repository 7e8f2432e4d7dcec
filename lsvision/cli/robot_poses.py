"""Options of a robot that carries the sensor: poses of its flange, and the hand-eye file."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lsvision.errors import LsvisionError, UnreadableFile

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.geometry import Pose


@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """Poses of a robot that carries the sensor, and the pose of the sensor on it."""

    poses: Annotated[
        Path | None,
        typer.Option(metavar="F", help="Poses of the robot's flange, one per profile."),
    ] = None
    convention: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Convention of the poses, never guessed: ur, kuka, fanuc, abb, ros, matrix, ...",
        ),
    ] = None
    flange_from_section: Annotated[
        Path | None,
        typer.Option(
            metavar="F",
            help="Hand-eye file, its errors propagated; without it, --poses are of the section.",
        ),
    ] = None

    @property
    def files(self) -> list[Path]:
        """Return the files that the options name."""
        return [file for file in (self.poses, self.flange_from_section) if file is not None]


@dataclass(frozen=True)
class PoseFile:
    """File of poses, and their convention."""

    path: Path
    convention: str

    def read(self, count: int, item: str = "profile") -> "list[Pose]":
        """Return the poses of the flange.

        Parameters
        ----------
        count : int
            Expected number of poses.
        item : str
            Noun for an item with a pose, for the message.

        Raises
        ------
        UnreadableFile
            If the file cannot be read, or holds another number of poses.
        """
        from lsvision.io.robot_poses import read_robot_poses
        from lsvision.results.summaries import counted

        flanges = read_robot_poses(self.path, self.convention)
        if len(flanges) != count:
            raise UnreadableFile(
                f"{self.path}: expected {counted(count, 'pose')}, one for each "
                f"{item}, got {len(flanges)}: leave out items without a partner"
            )
        return flanges


def parse_pose_file(robot: RobotOptions) -> PoseFile | None:
    """Return ``--poses`` with ``--convention``; None without both.

    Raises
    ------
    typer.BadParameter
        If one of them is missing, or the convention is unknown.
    """
    if robot.poses is not None:
        return PoseFile(robot.poses, parse_convention(robot.convention))
    if robot.convention is not None:
        raise typer.BadParameter("expected --poses with --convention, got none")
    return None


def parse_convention(name: str | None, option: str = "--convention") -> str:
    """Return the name of a pose convention, checked.

    Raises
    ------
    typer.BadParameter
        If the name is unknown or missing.
    """
    from lsvision.io.robot_conventions import CONVENTIONS

    if name not in CONVENTIONS:
        raise typer.BadParameter(
            f"expected {option} {', '.join(CONVENTIONS)}, got {name or 'none'}: the same "
            "numbers mean another pose in each"
        )
    return name


def read_calibration(path: Path) -> "HandEye":
    """Return the calibration in the hand-eye file of a profile sensor on the flange.

    Raises
    ------
    LsvisionError
        If it is invalid, of another schema, of a camera, or of a fixed sensor.
    """
    from lsvision.calibration.hand_eye_result import HandEye

    calibration = HandEye.load(path)
    try:
        _ = calibration.flange_from_section
    except ValueError as error:
        raise LsvisionError(
            f"{path}: {error}: calibrate with lsvision calibrate hand-eye sphere or plane, the "
            "sensor on the flange"
        ) from error
    return calibration


def uncertainty_caption(*, calibrated: bool, in_base: bool) -> str:
    """Return a caption: which errors the standard deviations of a table include."""
    if not calibrated:
        return "one sigma, the sensor's pose on the robot taken as exact"
    sources = "calibration's and the robot's" if in_base else "calibration's"
    return f"one sigma, with the {sources} error"
