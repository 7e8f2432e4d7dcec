"""Cylinders of a scan as CSV: one cylinder per row, each quantity with its 95 % interval."""

import csv
import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lsvision.geometry import Pose

if TYPE_CHECKING:
    from lsvision.cylinder.axis_table import AxisQuantity
    from lsvision.scan import ScanMeasurement, ScannedCylinder

_AXES = "xyz"
_POINT: "tuple[AxisQuantity, ...]" = ("point_x", "point_y", "point_z")


def scan_csv(scan: "ScanMeasurement", base_from_sections: Sequence[Pose]) -> str:
    """Return the cylinders of a scan as CSV text.

    Parameters
    ----------
    scan : ScanMeasurement
        Measurement of the scan.
    base_from_sections : sequence of Pose
        Section frame of each profile in the base frame; phi and theta are those in the first
        section that shows the cylinder.
    """
    rows = [
        scan_row(number, tube, base_from_sections[tube.sections[0]])
        for number, tube in enumerate(scan.cylinders)
    ]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if rows else ["cylinder"], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def scan_row(number: int, tube: "ScannedCylinder", base_from_section: Pose) -> dict[str, Any]:
    """Return a cylinder as a row: lengths in mm, angles in deg, empty text where not determined.

    Parameters
    ----------
    number : int
        Index of the cylinder in the scan, from 0.
    tube : ScannedCylinder
        The cylinder, base frame.
    base_from_section : Pose
        Section frame, in which phi and theta are given, in the base frame.
    """
    basis, covariance = tube.fit.tangent_basis, tube.covariance
    row: dict[str, Any] = {
        "cylinder": number,
        "sections": len(tube.sections),
        "first_section": tube.sections[0],
        "points": len(tube.points),
        **_quantity_columns("radius", "mm", tube.radius, tube.radius_std, tube.interval("radius")),
        **_tilt_columns(tube, base_from_section),
    }
    point_stds = np.sqrt(np.diag(basis.T @ covariance[:2, :2] @ basis))
    for k, quantity in enumerate(_POINT):
        interval = tube.interval(quantity)
        row |= _quantity_columns(
            quantity, "mm", float(tube.point[k]), float(point_stds[k]), interval
        )
    row |= {f"direction_{axis}": float(v) for axis, v in zip(_AXES, tube.direction, strict=True)}
    row["direction_std_deg"] = math.degrees(tube.direction_std)
    row["start_mm"], row["end_mm"] = tube.axial_range
    row["includes_calibration"] = tube.includes_calibration
    return row


def _tilt_columns(tube: "ScannedCylinder", base_from_section: Pose) -> dict[str, Any]:
    """Return phi and theta of the axis in a section, with intervals.

    Definition: phi is the angle between the axis and the section's normal Z, theta the direction of
    the axis in the section's plane, from X towards Y, in [0, pi). If the joint confidence
    region of the two direction errors contains Z, phi may be 0 and theta is not determined.
    """
    x, y, z = base_from_section.rotation.T @ tube.direction
    phi = math.atan2(math.hypot(x, y), abs(z))
    theta = math.atan2(y, x) % math.pi
    sign = math.copysign(1.0, z)
    azimuth = math.atan2(y * sign, x * sign)
    cos, sin = math.cos(azimuth), math.sin(azimuth)
    tilt_axes = np.array(
        [[math.cos(phi) * cos, math.cos(phi) * sin, -math.sin(phi)], [-sin, cos, 0.0]]
    )
    tangents = tube.fit.tangent_basis @ base_from_section.rotation * sign
    jacobian = tilt_axes @ tangents.T
    variances = np.diag(jacobian @ tube.covariance[2:4, 2:4] @ jacobian.T)
    phi_std, tangential_std = (math.sqrt(max(0.0, float(v))) for v in variances)
    factor = tube.fit.coverage_factor()
    determined = phi > tube.fit.coverage_factor(quantities=2) * max(phi_std, tangential_std)
    low = max(0.0, phi - factor * phi_std) if determined else 0.0
    row = _angle_columns("phi", phi, phi_std, (low, min(math.pi / 2, phi + factor * phi_std)))
    if not determined:
        row |= _quantity_columns("theta", "deg", "", "", (0.0, 180.0))
        return row | {"theta_determined": False}
    std = tangential_std / math.sin(phi)
    row |= _angle_columns("theta", theta, std, (theta - factor * std, theta + factor * std))
    return row | {"theta_determined": True}


def _angle_columns(
    name: str, value: float, std: float, interval: tuple[float, float]
) -> dict[str, Any]:
    low, high = map(math.degrees, interval)
    return _quantity_columns(name, "deg", math.degrees(value), math.degrees(std), (low, high))


def _quantity_columns(
    name: str, unit: str, value: float | str, std: float | str, interval: Sequence[float]
) -> dict[str, Any]:
    """Return the columns of a quantity: value, std and ends of the 95 % interval."""
    low, high = interval
    return {
        f"{name}_{unit}": value,
        f"{name}_std_{unit}": std,
        f"{name}_low_95_{unit}": low,
        f"{name}_high_95_{unit}": high,
    }
