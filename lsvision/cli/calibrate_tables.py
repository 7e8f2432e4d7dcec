"""Calibrations as text: values with standard deviations, and warnings."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from lsvision.calibration.result_tables import Row, rejection_lines
from lsvision.cli.calibrate_inputs import add_file_names
from lsvision.results.tables import text_table

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.calibration.intrinsics import CameraCalibration
    from lsvision.calibration.laser_plane_result import LaserPlaneCalibration
    from lsvision.calibration.pose_planning import PosePlan


def pose_rows(hand_eye: "HandEye", names: Sequence[str]) -> list[tuple[str, str, str, str]]:
    """Return for each pose: name, residual and leave-one-out residual (mm), whether left out."""
    left_out = {pose.index for pose in hand_eye.rejected}
    return [
        (
            name,
            _format_mm(residual),
            _format_mm(leave_one_out),
            "left out" if index in left_out else "",
        )
        for index, (name, residual, leave_one_out) in enumerate(
            zip(names, hand_eye.residuals, hand_eye.leave_one_out_residuals, strict=True)
        )
    ]


def plan_rows(plan: "PosePlan") -> list[tuple[str, ...]]:
    """Return for each planned pose: number from 1, position, and std predicted after it, in mm.

    The std is that of the target's mean position in the view.
    """
    return [
        (str(number), *(f"{value:.1f}" for value in pose.translation), f"{std:.4f}")
        for number, (pose, std) in enumerate(
            zip(plan.base_from_flanges, plan.predicted_std, strict=True), start=1
        )
    ]


def value_lines(rows: Sequence[Row]) -> list[str]:
    """Return names and values as lines, with the unit after each value."""
    return text_table([(name, f"{value} {unit}") for name, value, unit in rows], left=2)


def warning_lines(
    names: Sequence[str], calibration: "CameraCalibration | LaserPlaneCalibration"
) -> list[str]:
    """Return lines on rejected views, outliers and warnings, with the names of the images."""
    lines = rejection_lines(calibration.rejected, calibration.outliers, calibration.warnings)
    return [add_file_names(line, image=names) for line in lines]


def _format_mm(value: float) -> str:
    """Return a length in mm as text; "-" if the target was not found."""
    return f"{value:.3f}" if math.isfinite(value) else "-"
