"""Scans as JSON; each key names its unit, angles are in degrees."""

import json
import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lsvision.files.atomic_files import write_atomic

if TYPE_CHECKING:
    from lsvision.scan import ScanMeasurement, ScannedCylinder, TubeShape

SCAN_SCHEMA = "lsvision.scan/1"
"""Name and version of the file."""

Record = dict[str, Any]


def scan_record(
    scan: "ScanMeasurement",
    shapes: "Sequence[TubeShape | None]",
    sources: Sequence[str] = (),
    inputs: Sequence[Record] = (),
) -> Record:
    """Record of a scan, ready for JSON.

    Parameters
    ----------
    scan : ScanMeasurement
        Cylinders and rejections.
    shapes : sequence of TubeShape or None
        Of each cylinder; None where it has too few sections.
    sources : sequence of str
        Name of each profile's file.
    inputs : sequence of dict
        How each profile was read, from `lsvision.io.results.input_record`.

    Returns
    -------
    dict
        Base frame; lengths in ``*_mm``, angles in ``*_deg``; a number that does not exist (the
        radius of a bow that is none) is None.
    """
    return {
        "schema": SCAN_SCHEMA,
        "frame": "base",
        "sources": list(sources),
        **({"inputs": list(inputs)} if inputs else {}),
        "cylinders": [
            _cylinder_record(cylinder, shape)
            for cylinder, shape in zip(scan.cylinders, shapes, strict=True)
        ],
        "rejections": [
            {"sections": list(rejection.sections), "reason": rejection.reason}
            for rejection in scan.rejections
        ],
        "cylinders_by_section": [len(measured.cylinders) for measured in scan.measurements],
    }


def write_scan_json(path: str | os.PathLike[str], record: Record) -> None:
    """Write a scan's record, whole or not at all.

    Raises
    ------
    UnwritableFile
        If the file cannot be written.
    """
    write_atomic(path, scan_json(record))


def scan_json(record: Record) -> str:
    """A scan's record as JSON text."""
    return json.dumps(record, indent=2, allow_nan=False) + "\n"


def _cylinder_record(tube: "ScannedCylinder", shape: "TubeShape | None") -> Record:
    residuals = tube.section_residuals
    return {
        "point_mm": _numbers(tube.point),
        "position_std_mm": tube.position_std,
        "direction": _numbers(tube.direction),
        "direction_std_deg": math.degrees(tube.direction_std),
        "radius_mm": tube.radius,
        "radius_std_mm": tube.radius_std,
        "covariance_order": "point along e_phi, e_theta (mm), direction along them (rad), radius",
        "covariance": [_numbers(row) for row in tube.covariance],
        "includes_calibration": tube.includes_calibration,
        "e_phi": _numbers(tube.fit.tangent_basis[0]),
        "e_theta": _numbers(tube.fit.tangent_basis[1]),
        "ends_mm": list(tube.axial_range),
        "ends_std_mm": list(tube.axial_range_std),
        "sections": list(tube.sections),
        "section_residuals_mean_mm": _numbers(residuals[:, 0]),
        "section_residuals_rms_mm": _numbers(residuals[:, 1]),
        "points": len(tube.points),
        "rms_mm": tube.fit.rms,
        "twin_direction": None if tube.twin is None else _numbers(tube.twin.direction),
        "shape": None if shape is None else _shape_record(shape),
    }


def _shape_record(shape: "TubeShape") -> Record:
    centres = shape.centres
    return {
        "bow_mm": shape.bow.size,
        "bow_std_mm": shape.bow.size_std,
        "bow_p_value": shape.bow.p_value,
        "bow_radius_mm": _finite(shape.bow_radius),
        "taper_mm_per_mm": shape.taper_slope,
        "taper_p_value": shape.taper.p_value,
        "ovality": shape.ovality,
        "ovality_std": shape.ovality_std,
        "ovality_p_value": shape.ovality_terms.p_value,
        "sections": [int(section) for section in centres.sections],
        "along_mm": _numbers(centres.along),
        "deviations_mm": [_numbers(row) for row in centres.deviations],
        "deviations_std_mm": [_numbers(row) for row in centres.deviations_std],
        "radii_mm": _numbers(centres.radii),
        "radii_std_mm": _numbers(centres.radii_std),
    }


def _numbers(values: "np.typing.ArrayLike") -> list[float | None]:
    return [_finite(float(value)) for value in np.asarray(values)]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
