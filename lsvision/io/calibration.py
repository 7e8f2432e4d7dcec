"""Write calibration files: JSON with schema, units, residuals and provenance."""

import datetime
import hashlib
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from lsvision import __version__
from lsvision.calibration.intrinsics import CameraCalibration
from lsvision.calibration.laser_plane_result import LaserPlaneCalibration
from lsvision.calibration.result_tables import build_rejection_records
from lsvision.errors import UnwritableFile
from lsvision.files.atomic_files import write_atomic
from lsvision.files.limited_reading import read_bytes
from lsvision.files.printable import escape_text
from lsvision.sensors.rig_file import convert_camera_to_json, convert_plane_to_json, format_json

CAMERA_SCHEMA = "lsvision/camera-calibration/1"
"""Name and version of the format of a camera's calibration."""
LASER_PLANE_SCHEMA = "lsvision/laser-plane-calibration/1"
"""Name and version of the format of a laser plane's calibration."""


def write_calibration(
    path: str | os.PathLike[str],
    calibration: CameraCalibration | LaserPlaneCalibration,
    provenance: Mapping[str, str],
) -> None:
    """Write a camera's or a laser plane's calibration as JSON, with the residuals of each view.

    For measuring, save a laser plane's ``light_section``. `provenance` is that of
    `build_provenance`.

    Raises
    ------
    UnwritableFile
        If the folder is missing or not writable, or a number of the result is not finite.
    """
    if isinstance(calibration, CameraCalibration):
        schema, values = CAMERA_SCHEMA, _collect_camera_values(calibration)
    else:
        schema, values = LASER_PLANE_SCHEMA, _collect_laser_plane_values(calibration)
    details = {
        "rejected": build_rejection_records(calibration.rejected),
        "outliers": build_rejection_records(calibration.outliers),
        "warnings": list(calibration.warnings),
        "provenance": dict(provenance),
    }
    try:
        text = format_json(schema, {**values, **details})
    except ValueError as error:
        raise UnwritableFile(
            f"{path}: expected a calibration of finite numbers, got NaN or infinity: calibrate "
            "again"
        ) from error
    write_atomic(path, text)


def _collect_camera_values(calibration: CameraCalibration) -> dict[str, Any]:
    """Return the content of a camera file. Units: px; board_bow and translations in mm."""
    views = [
        {
            "image": view.index,
            "rms": view.rms_px,
            "camera_from_board": view.camera_from_board.matrix.tolist(),
            "residuals": view.residuals.tolist(),
        }
        for view in calibration.views
    ]
    return {
        "camera": convert_camera_to_json(calibration.camera),
        "std": dict(calibration.std),
        "camera_covariance": None
        if calibration.covariance is None
        else calibration.covariance.tolist(),
        "rms": calibration.rms_px,
        "board_bow": calibration.board_bow.tolist(),
        "board_bow_std": calibration.board_bow_std.tolist(),
        "views": views,
    }


def _collect_laser_plane_values(calibration: LaserPlaneCalibration) -> dict[str, Any]:
    """Return the content of a laser-plane file.

    Units: px for residuals and rms; mm for the plane's distance, board_bow and translations; rad
    for tilts.
    """
    views = [
        {
            "image": view.index,
            "camera_from_board": view.camera_from_board.matrix.tolist(),
            "corner_residuals": view.corner_residuals.tolist(),
            "line_residuals": view.line_residuals.tolist(),
        }
        for view in calibration.views
    ]
    return {
        "camera": convert_camera_to_json(calibration.light_section.camera),
        "laser_plane": convert_plane_to_json(calibration.plane),
        "covariance_order": ["tilt_about_section_x", "tilt_about_section_y", "distance"],
        "covariance": calibration.covariance.tolist(),
        "line_rms": calibration.line_rms,
        "corner_rms": calibration.corner_rms,
        "board_bow": calibration.board_bow.tolist(),
        "board_bow_std": calibration.board_bow_std.tolist(),
        "views": views,
    }


def build_provenance(method: str, inputs: Iterable[str | os.PathLike[str]]) -> dict[str, str]:
    """Return method, date, version, and the names and one hash of the inputs of a calibration.

    The names are in the order of the sorted paths; the hash is the SHA-256 of the files' joined
    SHA-256 digests in this order.

    Raises
    ------
    UnreadableFile
        If an input cannot be read.
    """
    digest, names = hashlib.sha256(), []
    for path in sorted(map(Path, inputs)):
        digest.update(hashlib.sha256(read_bytes(path)).digest())
        names.append(escape_text(path.name))
    return {
        "method": method,
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "version": __version__,
        "inputs": " ".join(names),
        "inputs_sha256": digest.hexdigest(),
    }
