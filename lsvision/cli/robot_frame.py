"""Cylinders in the robot's frame, from sections of a sensor on the robot and files of poses."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lsvision.errors import LsvisionError, UnreadableFile

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.cylinder.robot_frame import PlacedCylinder
    from lsvision.ellipse.section import CylinderSection
    from lsvision.geometry import Pose


@dataclass(frozen=True)
class PoseFile:
    """File (or folder or pattern of files) of robot poses, and the name of its convention.

    The convention is that of units, axes and rotation angles.
    """

    path: Path
    convention: str

    def read(self, count: int, item: str = "profile", names: Sequence[str] = ()) -> "list[Pose]":
        """Read the poses, ``base_from_flange`` in mm in the order of the file; check their number.

        Without a hand-eye file they are ``base_from_section``. The message of an error says what
        each pose belongs to, `item`, and has the first and the last of the `names` of these.

        Raises
        ------
        UnreadableFile
            If the file cannot be read, or does not hold `count` poses.
        """
        from lsvision.io.robot_poses import read_robot_poses
        from lsvision.results.summaries import format_count

        flange_poses = read_robot_poses(self.path, self.convention)
        if len(flange_poses) != count:
            span = f" ({' to '.join(dict.fromkeys((names[0], names[-1])))})" if names else ""
            article = "an" if item[0] in "aeiou" else "a"
            raise UnreadableFile(
                f"{self.path}: expected {format_count(count, 'pose')}, one for each {item}{span}, "
                f"got {len(flange_poses)}: leave out each pose without {article} {item}, and each "
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

    Those of the sensor's pose on the robot if it is `calibrated`, and those of the robot's poses if
    the results are in the base frame.
    """
    if not calibrated:
        return "one sigma, with the sensor's pose on the robot taken as exact"
    sources = "calibration's and the robot's" if in_base else "calibration's"
    return f"one sigma, with the {sources} error"


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotFrame:
    """Transformation of sections to the robot's frame.

    Without a calibration the poses are those of the section frame, else of the flange, one per
    profile; without poses the result is in the flange frame.
    """

    calibration: "HandEye | None"
    pose_file: PoseFile | None

    def place(
        self, sections: "Sequence[CylinderSection]", flange: "Pose | None"
    ) -> "list[tuple[PlacedCylinder, PlacedCylinder]]":
        """Return both possible cylinders of each section of one profile.

        `flange` is the pose of the profile from the pose file; None without one.
        """
        from lsvision.cylinder.robot_frame import place_section
        from lsvision.geometry import Pose

        mount = Pose() if self.calibration is None else self.calibration
        return [place_section(section, mount, flange) for section in sections]


def format_robot_frame_table(
    placed: "Sequence[tuple[PlacedCylinder, PlacedCylinder]]",
) -> list[str]:
    """Return the lines of a table with both possible axes of each cylinder; none without any."""
    if not placed:
        return []
    from lsvision.cylinder.robot_frame import PLACED_HEADER, format_placed_cells
    from lsvision.results.tables import format_text_table

    rows: list[tuple[str, ...]] = [("", *PLACED_HEADER)]
    for number, twins in enumerate(placed, 1):
        rows += [
            (f"{number}{sign}", *format_placed_cells(twin))
            for sign, twin in zip("+-", twins, strict=True)
        ]
    first, _ = placed[0]
    caption = format_uncertainty_caption(
        calibrated=first.includes_calibration, in_base=first.frame == "base"
    )
    return [f"{first.frame} frame, {caption}:", *format_text_table(rows)]
