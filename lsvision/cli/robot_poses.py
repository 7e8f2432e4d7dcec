"""The poses of a robot's flange, and the pose of the sensor on it, as files state them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lsvision.errors import LsvisionError, UnreadableFile

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.geometry import Pose


@dataclass(frozen=True)
class PoseFile:
    """File (or folder or pattern of files) of robot poses, and the name of its convention.

    The convention is that of units, axes and rotation angles.
    """

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
            span = f" ({' to '.join(dict.fromkeys((names[0], names[-1])))})" if names else ""
            article = "an" if item[0] in "aeiou" else "a"
            raise UnreadableFile(
                f"{self.path}: expected {counted(count, 'pose')}, one for each {item}{span}, got "
                f"{len(flange_poses)}: leave out each pose without {article} {item}, and each "
                f"{item} without a pose"
            )
        return flange_poses


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
