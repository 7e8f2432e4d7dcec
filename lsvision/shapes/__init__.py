"""Frozen geometric values: pose, plane, ellipse, cylinder. numpy only."""

from lsvision.shapes.arrays import BoolArray, FloatArray, IntArray, Points, as_readonly_array
from lsvision.shapes.cylinder import Cylinder
from lsvision.shapes.ellipse import Ellipse, orthogonal_residuals, radial_residuals
from lsvision.shapes.plane import Plane
from lsvision.shapes.pose import Pose

__all__ = [
    "BoolArray",
    "Cylinder",
    "Ellipse",
    "FloatArray",
    "IntArray",
    "Plane",
    "Points",
    "Pose",
    "as_readonly_array",
    "orthogonal_residuals",
    "radial_residuals",
]
