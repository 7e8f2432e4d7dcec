"""Camera and laser of the simulation, implemented independently of the tested camera model."""

import math
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import numpy.typing as npt

from lsvision.geometry import FloatArray, Plane, Points, Pose, as_readonly_array
from lsvision.geometry.arguments import as_numbers
from lsvision.geometry.arrays import freeze_arrays
from lsvision.simulate.solids import Rays

UNDISTORT_ITERATIONS = 60
"""Fixed-point iterations; k1 = -0.35 converges to 1e-12 after 40 at 37 deg from the axis."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ImagingRig:
    """Camera and laser; the laser plane is z = 0 of the section frame.

    Parameters
    ----------
    matrix : (3, 3) array_like
        Camera matrix. Units: px.
    size : tuple of int
        ``(width, height)``. Units: px.
    camera_from_section : Pose
        Pose of the section frame in the camera frame. Units: mm.
    distortion : (k,) array_like, optional
        The first k of the coefficients k1 k2 p1 p2 k3; none by default.
    laser_origin : tuple of float
        Point of the section plane from which the sheet diverges. Units: mm.

    Examples
    --------
    >>> rig = ImagingRig.triangulating()
    >>> rig.laser_plane.normal.round(3), round(rig.laser_plane.distance, 6)
    (array([0.   , 0.866, 0.5  ]), 150.0)
    """

    matrix: FloatArray
    size: tuple[int, int]
    camera_from_section: Pose
    distortion: FloatArray = field(default_factory=lambda: np.zeros(0))
    laser_origin: tuple[float, float] = (0.0, 100.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", as_readonly_array(self.matrix, (3, 3), "camera matrix"))
        freeze_arrays(self, distortion=("k",))
        if len(self.distortion) > 5:
            raise ValueError(
                "expected up to 5 distortion coefficients (k1 k2 p1 p2 k3), got "
                f"{len(self.distortion)}"
            )
        as_numbers(self.laser_origin, 2, "a laser_origin (x, y) in mm")
        if not min(as_numbers(self.size, 2, "a size (width, height) in px")) > 0:
            raise ValueError(f"expected a size (width, height) in px, got {self.size}")

    @classmethod
    def triangulating(
        cls,
        *,
        focal_length: float = 2264.0,
        size: tuple[int, int] = (1280, 1024),
        stand_off: float = 300.0,
        angle: float = math.radians(30.0),
        distortion: npt.ArrayLike = (),
    ) -> Self:
        """Return a rig whose laser plane crosses the optical axis at the stand-off.

        The laser line is horizontal in the image. The origin of the section frame is the point of
        the laser plane nearest to the camera, its Y points away from the scene. The principal point
        is at half of the `size` in px, `stand_off` is the distance of the crossing from the camera
        in mm, and `angle` the triangulation angle between optical axis and laser plane in rad;
        other parameters as for the class.
        """
        if not 0 < angle < math.pi / 2:
            raise ValueError(
                f"expected a triangulation angle between 0 and pi/2 rad, got {angle:g}"
            )
        sin, cos = math.sin(angle), math.cos(angle)
        x, y, normal = (1.0, 0.0, 0.0), (0.0, sin, -cos), (0.0, cos, sin)
        nearest_point = np.array(normal) * stand_off * sin
        matrix = np.array(
            [[focal_length, 0, size[0] / 2], [0, focal_length, size[1] / 2], [0, 0, 1]]
        )
        pose = Pose(np.column_stack([x, y, normal]), nearest_point)
        coefficients = np.asarray(distortion, dtype=np.float64)
        return cls(matrix=matrix, size=size, camera_from_section=pose, distortion=coefficients)

    @property
    def laser_plane(self) -> Plane:
        """Laser plane in the camera frame. Units: mm."""
        return Plane(np.array([0.0, 0.0, 1.0]), 0.0).transformed(self.camera_from_section)

    def compute_rays(self, pixels: Points) -> Rays:
        """Return the rays through (n, 2) pixels, section frame; distances are depths in mm.

        Wrong beyond the largest distorted radius of the lens, where no ray has such a pixel.
        """
        normalised = (pixels - self.matrix[:2, 2]) @ np.linalg.inv(self.matrix[:2, :2]).T
        directions = np.column_stack([self._undistort(normalised), np.ones(len(pixels))])
        camera_rays = Rays(np.zeros_like(directions), directions)
        return camera_rays.transformed(self.camera_from_section.inverse())

    def _undistort(self, distorted: Points) -> Points:
        """Return undistorted normalised image points (n, 2), by fixed-point iteration."""
        if not self.distortion.any():
            return distorted
        k1, k2, p1, p2, k3 = np.pad(self.distortion, (0, 5 - len(self.distortion)))
        undistorted = distorted
        for _ in range(UNDISTORT_ITERATIONS):
            x, y = undistorted.T
            r2 = x**2 + y**2
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            shift_x = 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
            shift_y = p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
            tangential = np.column_stack([shift_x, shift_y])
            undistorted = (distorted - tangential) / radial[:, None]
        return undistorted
