"""Options for a sensor on a robot: the file of flange poses, and the hand-eye file."""

from collections.abc import Sequence
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
    """Options for the poses of a robot's flange, and for the pose of the sensor on the flange.

    Without the latter the poses are those of the section frame.
    """

    poses: Annotated[
        Path | None,
        typer.Option(
            metavar="F", help="File of the flange's poses in the base frame, one per profile."
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
        """Paths given by the options, for the check that no output overwrites an input."""
        return [file for file in (self.poses, self.flange_from_section) if file is not None]


@dataclass(frozen=True)
class PoseFile:
    """File of robot poses, and the name of its convention of units, axes and rotation angles."""

    path: Path
    convention: str

    def read(self, count: int, item: str = "profile", names: Sequence[str] = ()) -> "list[Pose]":
        """Read the poses, and check their number.

        Parameters
        ----------
        count : int
            Expected number of poses.
        item : str
            What each pose belongs to, in the singular, for the error message.
        names : sequence of str
            Names of these items, of which the error message has the first and the last.

        Returns
        -------
        list of Pose
            ``base_from_flange`` of each item, in the order of the file; ``base_from_section`` if
            there is no hand-eye file. Units: mm.

        Raises
        ------
        UnreadableFile
            If the file cannot be read, or does not hold `count` poses.
        """
        from lsvision.io.robot_poses import read_robot_poses
        from lsvision.results.summaries import counted

        flange_poses = read_robot_poses(self.path, self.convention)
        if len(flange_poses) != count:
            span = f" ({names[0]} to {names[-1]})" if names else ""
            article = "an" if item[0] in "aeiou" else "a"
            raise UnreadableFile(
                f"{self.path}: expected {counted(count, 'pose')}, one for each {item}{span}, got "
                f"{len(flange_poses)}: leave out each pose without {article} {item}, and each "
                f"{item} without a pose"
            )
        return flange_poses


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


def read_calibration(path: Path) -> "HandEye":
    """Return the hand-eye calibration of a profile sensor on the flange, read from a file.

    Raises
    ------
    LsvisionError
        If the file is invalid or has another schema, or if it is the calibration of a camera, or of
        a sensor that is not on the flange.
    """
    from lsvision.calibration.hand_eye_result import HandEye

    calibration = HandEye.load(path)
    try:
        # Read only for its check: it raises an error for a camera, and for a sensor off the flange.
        _ = calibration.flange_from_section
    except ValueError as error:
        raise LsvisionError(
            f"{path}: {error}: calibrate the sensor on the flange, with lsvision calibrate "
            "hand-eye sphere or plane"
        ) from error
    return calibration


def format_uncertainty_caption(*, calibrated: bool, in_base: bool) -> str:
    """Return the caption that states which errors the standard deviations of a table include.

    Parameters
    ----------
    calibrated : bool
        Whether the sensor's pose on the robot comes from a calibration with known errors.
    in_base : bool
        Whether the results are in the base frame, so that errors of the robot's poses count.
    """
    if not calibrated:
        return "one sigma, with the sensor's pose on the robot taken as exact"
    sources = "calibration's and the robot's" if in_base else "calibration's"
    return f"one sigma, with the {sources} error"
