"""Scans as JSON, and as CSV with one cylinder per row; each key or column names its unit."""

import csv
import io
import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lsvision.geometry import FloatArray, Pose
from lsvision.results.quantities import Quantity, Record, Unit, build_coordinate_columns

if TYPE_CHECKING:
    from lsvision.cylinder.fit_result import AxisQuantity
    from lsvision.scan import CylinderShape, ScanMeasurement, ScannedCylinder

SCAN_SCHEMA = "lsvision.scan/1"
"""Name and version of the file's format."""
_POINT: "tuple[AxisQuantity, ...]" = ("point_x", "point_y", "point_z")
"""Quantities of the point on the axis."""


def build_scan_record(
    scan: "ScanMeasurement",
    shapes: "Sequence[CylinderShape | None]",
    sources: Sequence[str] = (),
    inputs: Sequence[Record] = (),
) -> Record:
    """Return the record of a scan, ready for JSON, with its shapes, sources and inputs.

    A shape is None where there are too few sections; `sources` are the names of the profiles'
    files, `inputs` how each was read, from `lsvision.io.results.build_input_record`. Base frame;
    lengths in ``*_mm``, angles in ``*_deg``; a number that does not exist (the bow radius of a
    straight cylinder) is None.
    """
    scan_dict = scan.to_dict()
    for record, shape in zip(scan_dict["cylinders"], shapes, strict=True):
        record["shape"] = None if shape is None else shape.to_dict()
    head = {"schema": SCAN_SCHEMA, "frame": scan_dict["frame"], "sources": list(sources)}
    return head | ({"inputs": list(inputs)} if inputs else {}) | scan_dict


def format_scan_json(record: Record) -> str:
    """Return a scan's record as JSON text."""
    return json.dumps(record, indent=2, allow_nan=False) + "\n"


def format_scan_csv(scan: "ScanMeasurement", base_from_sections: Sequence[Pose]) -> str:
    """Return the cylinders of a scan as CSV text.

    phi and theta are those in the first section that shows the cylinder.
    """
    rows = [
        build_scan_row(number, cylinder, base_from_sections[cylinder.sections[0]])
        for number, cylinder in enumerate(scan.cylinders)
    ]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if rows else ["cylinder"], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def build_scan_row(
    number: int, cylinder: "ScannedCylinder", base_from_section: Pose
) -> dict[str, Any]:
    """Return a cylinder, numbered from 0, as a row: mm, deg, empty text where not determined.

    phi and theta are given in the section frame whose pose is `base_from_section`.
    """
    basis, covariance = cylinder.fit.tangent_basis, cylinder.covariance
    row: dict[str, Any] = {
        "cylinder": number,
        "sections": len(cylinder.sections),
        "first_section": cylinder.sections[0],
        "points": len(cylinder.points),
        **_build_quantity_columns(
            "radius", "mm", cylinder.radius, cylinder.radius_std, cylinder.interval("radius")
        ),
        **_build_tilt_columns(cylinder, base_from_section),
    }
    # The covariance is that of the point's shift along the two tangents, base frame.
    point_stds = np.sqrt(np.diag(basis.T @ covariance[:2, :2] @ basis))
    for k, quantity in enumerate(_POINT):
        interval = cylinder.interval(quantity)
        row |= _build_quantity_columns(
            quantity, "mm", float(cylinder.point[k]), float(point_stds[k]), interval
        )
    row |= build_coordinate_columns("direction", cylinder.direction.tolist())
    row["direction_std_deg"] = math.degrees(cylinder.direction_std)
    row["start_mm"], row["end_mm"] = cylinder.axial_range
    row["includes_calibration"] = cylinder.includes_calibration
    return row


def _build_tilt_columns(cylinder: "ScannedCylinder", base_from_section: Pose) -> dict[str, Any]:
    """Return phi and theta of the axis in a section, with stds and intervals, in degrees.

    Definition: phi is the angle between the axis and the section's normal Z, theta the direction of
    the axis in the section's plane, from X towards Y, in [0, pi). If the joint confidence
    region of the two direction errors contains Z, phi may be 0 and theta is not determined. The
    interval of theta is centred on theta and may extend beyond 0 or pi.
    """
    direction = base_from_section.rotation.T @ cylinder.direction
    x, y, z = direction * math.copysign(1.0, direction[2])  # towards the section's Z
    phi, azimuth = math.atan2(math.hypot(x, y), z), math.atan2(y, x)
    theta = azimuth % math.pi
    phi_std, azimuthal_std = _direction_stds(cylinder, base_from_section, phi, azimuth)
    factor = cylinder.fit.coverage_factor()
    determined = phi > cylinder.fit.coverage_factor(quantities=2) * max(phi_std, azimuthal_std)
    low = max(0.0, phi - factor * phi_std) if determined else 0.0
    row = _build_angle_columns("phi", phi, phi_std, (low, min(math.pi / 2, phi + factor * phi_std)))
    if not determined:
        row |= _build_quantity_columns("theta", "deg", "", "", (0.0, 180.0))
        return row | {"theta_determined": False}
    std = azimuthal_std / math.sin(phi)
    row |= _build_angle_columns("theta", theta, std, (theta - factor * std, theta + factor * std))
    return row | {"theta_determined": True}


def _direction_stds(
    cylinder: "ScannedCylinder", base_from_section: Pose, phi: float, azimuth: float
) -> tuple[float, float]:
    """Return the stds (rad) of the axis direction along increasing phi and increasing azimuth.

    Definition: the axis is (sin phi cos azimuth, sin phi sin azimuth, cos phi), section frame.
    """
    cos, sin = math.cos(azimuth), math.sin(azimuth)
    directions: FloatArray = np.array(
        [[math.cos(phi) * cos, math.cos(phi) * sin, -math.sin(phi)], [-sin, cos, 0.0]]
    )
    tangents = cylinder.fit.tangent_basis @ base_from_section.rotation  # in the section frame
    jacobian = directions @ tangents.T
    variances = np.diag(jacobian @ cylinder.covariance[2:4, 2:4] @ jacobian.T)
    phi_std, azimuthal_std = np.sqrt(np.maximum(variances, 0.0)).tolist()
    return phi_std, azimuthal_std


def _build_angle_columns(
    name: str, value: float, std: float, interval: tuple[float, float]
) -> dict[str, Any]:
    low, high = map(math.degrees, interval)
    return _build_quantity_columns(name, "deg", math.degrees(value), math.degrees(std), (low, high))


def _build_quantity_columns(
    name: str, unit: Unit, value: float | str, std: float | str, interval: Sequence[float]
) -> dict[str, Any]:
    """Return the columns of a quantity: value, std and ends of the 95 % interval."""
    return dict(zip(Quantity(name, unit).columns, (value, std, *interval), strict=True))
