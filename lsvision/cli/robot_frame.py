"""Sections measured by a sensor on a robot: their cylinders in the robot's frame."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lsvision.cli.robot_poses import (
    PoseFile,
    parse_pose_file,
    read_calibration,
    uncertainty_caption,
)

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.cylinder.robot_frame import PlacedCylinder
    from lsvision.ellipse.section import CylinderSection
    from lsvision.geometry import Pose

HEADER = ("", "point x y z mm", "± mm", "direction x y z", "± deg")


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotFrame:
    """How sections come to the robot's frame.

    Parameters
    ----------
    calibration : HandEye, optional
        Without, the poses are the section's own.
    rows : PoseFile, optional
        Poses of the flange, one a profile; without, the result is in the flange frame.
    """

    calibration: "HandEye | None"
    rows: PoseFile | None

    def place(
        self, sections: "Sequence[CylinderSection]", flange: "Pose | None"
    ) -> "list[tuple[PlacedCylinder, PlacedCylinder]]":
        """Both cylinders of each section."""
        from lsvision.cylinder.robot_frame import place_section
        from lsvision.geometry import Pose

        mount = Pose() if self.calibration is None else self.calibration
        return [place_section(each, mount, flange) for each in sections]


def parse_robot_frame(
    poses: Path | None, convention: str | None, hand_eye: Path | None
) -> RobotFrame | None:
    """What the options say of the robot; None without any.

    Raises
    ------
    typer.BadParameter
        If poses or their convention are missing, or it is unknown.
    LsvisionError
        If the hand-eye file cannot be used.
    """
    rows = parse_pose_file(poses, convention)
    if rows is None and hand_eye is None:
        return None
    calibration = None if hand_eye is None else read_calibration(hand_eye)
    return RobotFrame(calibration=calibration, rows=rows)


def robot_frame_table(placed: "Sequence[tuple[PlacedCylinder, PlacedCylinder]]") -> list[str]:
    """Lines of a table: each cylinder twice, with both directions that one section allows."""
    if not placed:
        return []
    rows: list[tuple[str, ...]] = [HEADER]
    for number, twins in enumerate(placed, 1):
        rows += [_row(f"{number}{sign}", twin) for sign, twin in zip("+-", twins, strict=True)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADER))]
    first, _ = placed[0]
    sigma = uncertainty_caption(
        calibrated=first.includes_calibration, in_base=first.frame == "base"
    )
    return [
        f"{first.frame} frame, {sigma}:",
        *(
            "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ),
    ]


def _row(name: str, cylinder: "PlacedCylinder") -> tuple[str, ...]:
    from lsvision.draw import decimals_for, format_std

    stds = [float(std) for std in cylinder.point_std]
    places = decimals_for(cylinder.direction_std)
    return (
        name,
        " ".join(
            f"{part:.{decimals_for(std)}f}" for part, std in zip(cylinder.point, stds, strict=True)
        ),
        " ".join(format_std(std) for std in stds),
        " ".join(f"{part:+.{places}f}" for part in cylinder.direction),
        format_std(math.degrees(cylinder.direction_std)),
    )
