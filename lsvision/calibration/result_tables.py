"""Calibrations as table rows (number with standard deviation, unit) and as records."""

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from lsvision.calibration.observations import Sphere
from lsvision.calibration.rotations import rotation_vector_jacobian, vectors_from_rotations
from lsvision.geometry import FloatArray
from lsvision.results.number_format import format_value
from lsvision.results.quantities import convert_numbers_to_json, replace_nonfinite

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.calibration.intrinsics import CameraCalibration
    from lsvision.calibration.laser_plane_result import LaserPlaneCalibration
    from lsvision.calibration.views import RejectedView
    from lsvision.results.quantities import Record

Row = tuple[str, str, str]
"""Name, number with one sigma, unit."""


def cells_from_rows(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """Return the cells of a table, its header first."""
    return [("", "value", "unit"), *rows]


def format_rejections(
    rejected: "Sequence[RejectedView]",
    outliers: "Sequence[RejectedView]",
    warnings: Sequence[str],
) -> list[str]:
    """Return the lines on rejected views, outlier views, and warnings."""
    lines = [f"left out: image {view.index}: {view.reason}" for view in rejected]
    lines += [f"fits badly: image {view.index}: {view.reason}" for view in outliers]
    return lines + [f"warning: {text}" for text in warnings]


def build_rejection_records(views: "Iterable[RejectedView]") -> "list[Record]":
    """Return the index of the image and the reason of each view, ready for JSON."""
    return [{"image": view.index, "reason": view.reason} for view in views]


def format_camera_rows(calibration: "CameraCalibration") -> list[Row]:
    """Return table rows of the intrinsics, with one sigma."""
    rows: list[Row] = []
    for name, (value, std) in calibration.parameters.items():
        if std > 0:
            unit = "px" if name in ("fx", "fy", "cx", "cy") else ""
            rows.append((name, format_value(value, std), unit))
    return [
        *rows,
        ("residual, rms", f"{calibration.rms_px:.3f}", "px"),
        *_format_bow_rows(calibration),
    ]


def build_common_record(calibration: "CameraCalibration | LaserPlaneCalibration") -> "Record":
    """Return the board's shape, and the views and warnings, ready for JSON."""
    return {
        "board_bow_mm": convert_numbers_to_json(calibration.board_bow),
        "board_bow_std_mm": convert_numbers_to_json(calibration.board_bow_std),
        "views": len(calibration.views),
        "rejected": build_rejection_records(calibration.rejected),
        "outliers": build_rejection_records(calibration.outliers),
        "warnings": list(calibration.warnings),
    }


def format_laser_plane_rows(calibration: "LaserPlaneCalibration") -> list[Row]:
    """Return table rows of the plane, with one sigma, and of the residuals."""
    tilt_x, tilt_y, distance = (math.sqrt(value) for value in calibration.covariance.diagonal())
    normal = ", ".join(f"{value:.6f}" for value in calibration.plane.normal)
    rows: list[Row] = [
        ("normal, camera frame", f"({normal})", ""),
        ("its tilt about X, one sigma", f"{math.degrees(tilt_x):.4f}", "deg"),
        ("its tilt about Y, one sigma", f"{math.degrees(tilt_y):.4f}", "deg"),
        ("distance from the camera", format_value(calibration.plane.distance, distance), "mm"),
        ("laser line, rms", f"{calibration.line_rms:.3f}", "px"),
        ("corners, rms", f"{calibration.corner_rms:.3f}", "px"),
    ]
    return rows + _format_bow_rows(calibration)


def _format_bow_rows(calibration: "CameraCalibration | LaserPlaneCalibration") -> list[Row]:
    """Return table rows of the board's bow and twist, with one sigma, if they were fitted."""
    if not calibration.board_bow_std.any():
        return []
    names = ("bow along x", "bow along y", "twist")
    pairs = zip(names, calibration.board_bow, calibration.board_bow_std, strict=True)
    return [
        (f"board's {name}", format_value(float(bow), float(std)), "mm") for name, bow, std in pairs
    ]


def compute_rotation_vector_deg(hand_eye: "HandEye") -> tuple[FloatArray, FloatArray]:
    """Return the rotation vector (3,) of the sensor's pose and its std (3,). Units: deg."""
    vector = vectors_from_rotations(hand_eye.mount_from_sensor.rotation)
    jacobian = rotation_vector_jacobian(vector)
    covariance = jacobian @ hand_eye.covariance[3:, 3:] @ jacobian.T
    return np.degrees(vector), np.degrees(np.sqrt(covariance.diagonal()))


def format_hand_eye_rows(hand_eye: "HandEye") -> list[Row]:
    """Return table rows of the sensor's pose (rotation vector) and its accuracy, with one sigma."""
    mount = "flange" if hand_eye.mounting == "eye_in_hand" else "base"
    position = hand_eye.mount_from_sensor.translation
    position_std = np.sqrt(hand_eye.covariance.diagonal()[:3])
    vector, vector_std = compute_rotation_vector_deg(hand_eye)
    return [
        *((f"{mount}_from_{hand_eye.sensor} {axis}", format_value(float(value), float(std)), "mm")
          for axis, value, std in zip("xyz", position, position_std, strict=True)),
        *((f"rotation vector {axis}", format_value(float(value), float(std)), "deg")
          for axis, value, std in zip("xyz", vector, vector_std, strict=True)),
        *format_accuracy_rows(hand_eye),
    ]  # fmt: skip


def build_hand_eye_record(hand_eye: "HandEye") -> "Record":
    """Return the pose, its uncertainty and the diagnostics of `HandEye.to_dict`."""
    vector, vector_std = compute_rotation_vector_deg(hand_eye)
    position_std, rotation_std = hand_eye.robot_std
    factor, factor_std = hand_eye.height_scale or (None, None)
    size, size_std = hand_eye.target_scale or (None, None)
    return {
        "mounting": hand_eye.mounting,
        "sensor": hand_eye.sensor,
        "position_mm": convert_numbers_to_json(hand_eye.mount_from_sensor.translation),
        "position_std_mm": convert_numbers_to_json(np.sqrt(np.diag(hand_eye.covariance)[:3])),
        "rotation_vector_deg": convert_numbers_to_json(vector),
        "rotation_vector_std_deg": convert_numbers_to_json(vector_std),
        "working_point_mm": convert_numbers_to_json(hand_eye.working_point),
        "working_point_std_mm": hand_eye.working_point_std,
        "residual_rms_mm": replace_nonfinite(hand_eye.residual_rms),
        "leave_one_out_rms_mm": replace_nonfinite(hand_eye.leave_one_out_rms),
        "degrees_of_freedom": replace_nonfinite(hand_eye.degrees_of_freedom),
        "robot_position_std_mm": position_std,
        "robot_rotation_std_deg": math.degrees(rotation_std),
        "height_scale": factor,
        "height_scale_std": factor_std,
        "target_scale": size,
        "target_scale_std": size_std,
        "residuals_mm": convert_numbers_to_json(hand_eye.residuals),
        "leave_one_out_residuals_mm": convert_numbers_to_json(hand_eye.leave_one_out_residuals),
        "rejected": [{"index": pose.index, "reason": pose.reason} for pose in hand_eye.rejected],
        "warnings": list(hand_eye.warnings),
    }


def format_accuracy_rows(hand_eye: "HandEye") -> list[Row]:
    """Return table rows of the accuracy at the working point and of the residuals."""
    x, y, z = (f"{value:.1f}" for value in hand_eye.working_point)
    rows: list[Row] = [
        (f"error at the working point ({x}, {y}, {z})", f"{hand_eye.working_point_std:.3f}", "mm"),
        ("residual, rms", f"{hand_eye.residual_rms:.3f}", "mm"),
        ("leave-one-out residual, rms", f"{hand_eye.leave_one_out_rms:.3f}", "mm"),
        ("robot's position, one sigma", f"{hand_eye.robot_std[0]:.3f}", "mm"),
        ("robot's rotation, one sigma", f"{math.degrees(hand_eye.robot_std[1]):.4f}", "deg"),
    ]
    if isinstance(hand_eye.target, Sphere):
        sphere = hand_eye.target
        is_estimated = sphere.radius_std > 0
        radius = (
            format_value(sphere.radius, sphere.radius_std) if is_estimated else f"{sphere.radius:g}"
        )
        rows.append(("sphere's radius", radius, "mm" if is_estimated else "mm (given)"))
    if hand_eye.height_scale is not None:
        rows.append(("heights to be multiplied by", format_value(*hand_eye.height_scale), ""))
    if hand_eye.target_scale is not None:
        scale = format_value(*hand_eye.target_scale)
        rows.append(("size of the board to be multiplied by", scale, ""))
    return rows
