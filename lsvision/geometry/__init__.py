"""Frozen geometric values: pose, plane, ellipse, cylinder. numpy only."""

from lsvision.geometry.arrays import BoolArray, FloatArray, IntArray, Points, as_readonly_array
from lsvision.geometry.cylinder import Cylinder
from lsvision.geometry.ellipse import Ellipse, orthogonal_residuals, radial_residuals
from lsvision.geometry.plane import Plane
from lsvision.geometry.pose import Pose

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
