"""Calibrations as text: each number with its sigma, and what was left out with its reason."""

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from lsvision.cli.calibrate_inputs import replace_image_numbers

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.calibration.intrinsics import CameraCalibration
    from lsvision.calibration.laser_plane_result import LaserPlaneCalibration
    from lsvision.calibration.pose_planning import PosePlan
    from lsvision.calibration.views import RejectedView

Row = tuple[str, str, str]
"""Name, number with sigma, unit."""


def camera_rows(found: "CameraCalibration") -> list[Row]:
    """Intrinsics with one sigma."""
    from lsvision.draw import format_value

    matrix, lens = found.camera.matrix, found.camera.distortion
    values = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *lens]
    rows: list[Row] = []
    for value, (name, std) in zip(values, found.std.items(), strict=False):
        if std > 0:
            unit = "px" if name in ("fx", "fy", "cx", "cy") else ""
            rows.append((name, format_value(float(value), std), unit))
    return [*rows, ("residual, rms", f"{found.rms_px:.3f}", "px")]


def laser_plane_rows(found: "LaserPlaneCalibration") -> list[Row]:
    """The plane with one sigma, and residuals."""
    from lsvision.draw import format_value

    tilt_x, tilt_y, distance = (math.sqrt(value) for value in found.covariance.diagonal())
    normal = ", ".join(f"{value:.6f}" for value in found.plane.normal)
    rows: list[Row] = [
        ("normal, camera frame", f"({normal})", ""),
        ("its tilt about X, one sigma", f"{math.degrees(tilt_x):.4f}", "deg"),
        ("its tilt about Y, one sigma", f"{math.degrees(tilt_y):.4f}", "deg"),
        ("distance from the camera", format_value(found.plane.distance, distance), "mm"),
        ("laser line, rms", f"{found.line_rms:.3f}", "px"),
        ("corners, rms", f"{found.corner_rms:.3f}", "px"),
    ]
    if found.board_bow_std.any():
        rows += [
            (f"board's bow along {axis}", format_value(float(bow), float(std)), "mm")
            for axis, bow, std in zip("xy", found.board_bow, found.board_bow_std, strict=True)
        ]
    return rows


def hand_eye_rows(found: "HandEye") -> list[Row]:
    """Pose of the sensor with one sigma, and what it is worth where it measures."""
    from scipy.spatial.transform import Rotation

    from lsvision.calibration.hand_eye_result import Sphere
    from lsvision.draw import format_value

    mount = "flange" if found.mounting == "eye_in_hand" else "base"
    std = [math.sqrt(value) for value in found.covariance.diagonal()]
    pose, deg = found.mount_from_sensor, math.degrees(1)
    vector = Rotation.from_matrix(pose.rotation).as_rotvec()
    x, y, z = (f"{value:.1f}" for value in found.working_point)
    rows: list[Row] = [
        *((f"{mount}_from_{found.sensor} {axis}", format_value(float(value), sigma), "mm")
          for axis, value, sigma in zip("xyz", pose.translation, std[:3], strict=True)),
        *((f"rotation vector {axis}", format_value(float(value) * deg, sigma * deg), "deg")
          for axis, value, sigma in zip("xyz", vector, std[3:], strict=True)),
        (f"error at the working point ({x}, {y}, {z})", f"{found.working_point_std:.3f}", "mm"),
        ("residual, rms", f"{found.residual_rms:.3f}", "mm"),
        ("the same, held out", f"{found.leave_one_out_rms:.3f}", "mm"),
        ("robot, one sigma", f"{found.robot_std[0]:.3f}", "mm"),
        ("robot, one sigma", f"{found.robot_std[1] * deg:.4f}", "deg"),
    ]  # fmt: skip
    if isinstance(found.target, Sphere):
        ball = found.target
        free = ball.radius_std > 0
        told = format_value(ball.radius, ball.radius_std) if free else f"{ball.radius:g}"
        rows.append(("sphere's radius", told, "mm" if free else "mm (given)"))
    if found.height_scale is not None:
        rows.append(("heights to be multiplied by", format_value(*found.height_scale), ""))
    return rows


def pose_rows(found: "HandEye", names: Sequence[str]) -> list[tuple[str, str, str, str]]:
    """Each pose: name, residual, held-out residual, whether it was left out."""
    left_out = {pose.index for pose in found.rejected}
    return [
        (name, _mm(residual), _mm(held_out), "left out" if index in left_out else "")
        for index, (name, residual, held_out) in enumerate(
            zip(names, found.residuals, found.leave_one_out_residuals, strict=True)
        )
    ]


def plan_rows(plan: "PosePlan") -> list[tuple[str, ...]]:
    """Each proposed pose with the accuracy it promises."""
    return [
        (str(number), *(f"{value:.1f}" for value in pose.translation), f"{std:.4f}")
        for number, (pose, std) in enumerate(
            zip(plan.base_from_flanges, plan.predicted_std, strict=True), start=1
        )
    ]


def aligned(rows: Iterable[Sequence[str]]) -> list[str]:
    """Rows as lines: the first column to the left, the others to the right."""
    cells = [tuple(row) for row in rows]
    if not cells:
        return []
    widths = [max(len(row[column]) for row in cells) for column in range(len(cells[0]))]
    return [
        "  ".join(
            [row[0].ljust(widths[0])]
            + [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        ).rstrip()
        for row in cells
    ]


def value_lines(rows: Sequence[Row]) -> list[str]:
    """Names and numbers as lines, the unit behind each number."""
    width = max(len(name) for name, _, _ in rows)
    return [f"{name.ljust(width)}  {value} {unit}".rstrip() for name, value, unit in rows]


def warning_lines(
    names: Sequence[str],
    rejected: "Sequence[RejectedView]",
    outliers: "Sequence[RejectedView]",
    warnings: Sequence[str],
) -> list[str]:
    """What was left out, what fits badly, and what makes the set weak; each by name."""
    lines = [f"left out: {names[view.index]}: {view.reason}" for view in rejected]
    lines += [f"fits badly: {names[view.index]}: {view.reason}" for view in outliers]
    return lines + [f"warning: {replace_image_numbers(text, image=names)}" for text in warnings]


def _mm(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else "-"
