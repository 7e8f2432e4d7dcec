"""Immutable geometric objects: pose, plane, ellipse, cylinder. Depends on numpy only."""

from lsvision.geometry.arrays import BoolArray, FloatArray, IntArray, Points, as_readonly_array
from lsvision.geometry.cylinder import Cylinder
from lsvision.geometry.directions import build_hemisphere_directions, build_tangent_frame
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
    "build_hemisphere_directions",
    "build_tangent_frame",
    "orthogonal_residuals",
    "radial_residuals",
]
