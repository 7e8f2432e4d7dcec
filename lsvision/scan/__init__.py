"""Measure cylinders in 3D from several profiles with poses, by a joint fit to all points."""

from lsvision.scan.pose_errors import PoseErrors
from lsvision.scan.scan_pipeline import (
    ScanSettings,
    fit_sections_jointly,
    measure_scan,
    measure_sections,
)
from lsvision.scan.scan_result import ScanMeasurement, ScannedCylinder, ScanRejection
from lsvision.scan.shape import measure_shape
from lsvision.scan.shape_result import CylinderShape

__all__ = [
    "CylinderShape",
    "PoseErrors",
    "ScanMeasurement",
    "ScanRejection",
    "ScanSettings",
    "ScannedCylinder",
    "fit_sections_jointly",
    "measure_scan",
    "measure_sections",
    "measure_shape",
]
