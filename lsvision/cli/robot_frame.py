"""Cylinders in the robot's frame, from sections of a sensor on the robot."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lsvision.cli.robot_poses import PoseFile, format_uncertainty_caption

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.cylinder.robot_frame import PlacedCylinder
    from lsvision.ellipse.section import CylinderSection
    from lsvision.geometry import Pose


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotFrame:
    """Transformation of sections to the robot's frame.

    Parameters
    ----------
    calibration : HandEye, optional
        Hand-eye calibration; None if the poses are those of the section frame.
    pose_file : PoseFile, optional
        Poses of the flange, one per profile; None for a result in the flange frame.
    """

    calibration: "HandEye | None"
    pose_file: PoseFile | None

    def place(
        self, sections: "Sequence[CylinderSection]", flange: "Pose | None"
    ) -> "list[tuple[PlacedCylinder, PlacedCylinder]]":
        """Return both possible cylinders of each section.

        Parameters
        ----------
        sections : sequence of CylinderSection
            Sections of one profile.
        flange : Pose, optional
            Pose of the profile from the pose file; None without one.
        """
        from lsvision.cylinder.robot_frame import place_section
        from lsvision.geometry import Pose

        mount = Pose() if self.calibration is None else self.calibration
        return [place_section(section, mount, flange) for section in sections]


def robot_frame_table(placed: "Sequence[tuple[PlacedCylinder, PlacedCylinder]]") -> list[str]:
    """Return the lines of a table with both possible axes of each cylinder; none without any."""
    if not placed:
        return []
    from lsvision.cylinder.robot_frame import PLACED_HEADER, placed_cells
    from lsvision.results.tables import text_table

    rows: list[tuple[str, ...]] = [("", *PLACED_HEADER)]
    for number, twins in enumerate(placed, 1):
        rows += [
            (f"{number}{sign}", *placed_cells(twin)) for sign, twin in zip("+-", twins, strict=True)
        ]
    first, _ = placed[0]
    caption = format_uncertainty_caption(
        calibrated=first.includes_calibration, in_base=first.frame == "base"
    )
    return [f"{first.frame} frame, {caption}:", *text_table(rows)]
