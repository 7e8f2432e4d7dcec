"""Calibrations as rows of a table, each number with its sigma and unit, and as records."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from lsvision.results.number_format import format_value

if TYPE_CHECKING:
    from lsvision.calibration.intrinsics import CameraCalibration
    from lsvision.calibration.laser_plane_result import LaserPlaneCalibration
    from lsvision.calibration.views import RejectedView
    from lsvision.results.quantities import Record

Row = tuple[str, str, str]
"""Name, number with sigma, unit."""


def cells_of_rows(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """Cells of a table with its header."""
    return [("", "value", "unit"), *rows]


def doubt_lines(
    rejected: "Sequence[RejectedView]",
    outliers: "Sequence[RejectedView]",
    warnings: Sequence[str],
) -> list[str]:
    """What was left out, what fits badly, and what makes the set weak, a line each."""
    lines = [f"left out: image {view.index}: {view.reason}" for view in rejected]
    lines += [f"fits badly: image {view.index}: {view.reason}" for view in outliers]
    return lines + [f"warning: {text}" for text in warnings]


def camera_rows(found: "CameraCalibration") -> list[Row]:
    """Intrinsics with one sigma."""
    rows: list[Row] = []
    for name, (value, std) in found.parameters.items():
        if std > 0:
            unit = "px" if name in ("fx", "fy", "cx", "cy") else ""
            rows.append((name, format_value(value, std), unit))
    return [*rows, ("residual, rms", f"{found.rms_px:.3f}", "px"), *_bow_rows(found)]


def camera_record(found: "CameraCalibration") -> "Record":
    """Intrinsics with their standard deviations, and residuals, ready for JSON."""
    record: Record = {}
    for name, (value, std) in found.parameters.items():
        unit = "_px" if name in ("fx", "fy", "cx", "cy") else ""
        record |= {f"{name}{unit}": value, f"{name}_std{unit}": std}
    return record | {
        "rms_px": found.rms_px,
        "views": len(found.views),
        "rejected": [{"image": view.index, "reason": view.reason} for view in found.rejected],
        "outliers": [{"image": view.index, "reason": view.reason} for view in found.outliers],
        "warnings": list(found.warnings),
    }


def camera_parameters(found: "CameraCalibration") -> dict[str, tuple[float, float]]:
    """Value and standard deviation of fx, fy, cx, cy (px) and of each coefficient."""
    matrix = found.camera.matrix
    values = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *found.camera.distortion]
    pairs = zip(values, found.std.items(), strict=False)
    return {name: (float(value), std) for value, (name, std) in pairs}


def laser_plane_rows(found: "LaserPlaneCalibration") -> list[Row]:
    """The plane with one sigma, and residuals."""
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
    return rows + _bow_rows(found)


def _bow_rows(found: "CameraCalibration | LaserPlaneCalibration") -> list[Row]:
    """Bow and twist of the board with one sigma; none where they were not fitted."""
    if not found.board_bow_std.any():
        return []
    names = ("bow along x", "bow along y", "twist")
    pairs = zip(names, found.board_bow, found.board_bow_std, strict=True)
    return [
        (f"board's {name}", format_value(float(bow), float(std)), "mm") for name, bow, std in pairs
    ]


def laser_plane_record(found: "LaserPlaneCalibration") -> "Record":
    """The plane with its standard deviations, and residuals, ready for JSON."""
    from lsvision.results.quantities import numbers

    tilt_x, tilt_y, distance = (math.sqrt(value) for value in found.covariance.diagonal())
    return {
        "normal": numbers(found.plane.normal),
        "tilt_x_std_deg": math.degrees(tilt_x),
        "tilt_y_std_deg": math.degrees(tilt_y),
        "distance_mm": found.plane.distance,
        "distance_std_mm": distance,
        "line_rms_px": found.line_rms,
        "corner_rms_px": found.corner_rms,
        "views": len(found.views),
        "rejected": [{"image": view.index, "reason": view.reason} for view in found.rejected],
        "outliers": [{"image": view.index, "reason": view.reason} for view in found.outliers],
        "warnings": list(found.warnings),
    }
