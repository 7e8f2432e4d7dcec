"""A camera and a laser as the simulator knows them, apart from the code on trial."""

import math
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import numpy.typing as npt

from lsvision.geometry import FloatArray, Plane, Points, Pose, as_readonly_array
from lsvision.simulate.rays import Rays

UNDISTORT_STEPS = 60
"""Fixed-point steps; a lens of k1 = -0.35 is exact to 1e-12 after 40."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ImagingRig:
    """Camera beside a laser; the laser plane is z = 0 of the section frame.

    Parameters
    ----------
    matrix : (3, 3) array_like
        Camera matrix. Units: px.
    size : tuple of int
        ``(width, height)``. Units: px.
    camera_from_section : Pose
        Where the laser plane lies before the camera. Units: mm.
    distortion : (k,) array_like, optional
        k1 k2 p1 p2 k3, as many as there are. None by default.
    laser_origin : tuple of float
        Point of the section plane from which the sheet fans out. Units: mm.

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
        object.__setattr__(
            self, "distortion", as_readonly_array(self.distortion, ("k",), "distortion")
        )
        if len(self.distortion) > 5:
            raise ValueError(
                f"want up to 5 distortion coefficients (k1 k2 p1 p2 k3), got {len(self.distortion)}"
            )
        if not min(self.size) > 0:
            raise ValueError(f"want a size (width, height) in px, got {self.size}")

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
        """Level laser line; its plane crosses the optical axis at the stand-off.

        Parameters
        ----------
        focal_length : float
            Units: px.
        size : tuple of int
            ``(width, height)``; the principal point is its middle. Units: px.
        stand_off : float
            Units: mm.
        angle : float
            Triangulation angle between optical axis and laser plane. Units: rad.
        distortion : (k,) array_like
            See the class.
        """
        if not 0 < angle < math.pi / 2:
            raise ValueError(f"want a triangulation angle between 0 and pi/2 rad, got {angle:g}")
        sin, cos = math.sin(angle), math.cos(angle)
        x, y, normal = (1.0, 0.0, 0.0), (0.0, sin, -cos), (0.0, cos, sin)
        foot = np.array(normal) * stand_off * sin
        matrix = np.array(
            [[focal_length, 0, size[0] / 2], [0, focal_length, size[1] / 2], [0, 0, 1]]
        )
        pose = Pose(np.column_stack([x, y, normal]), foot)
        lens = np.asarray(distortion, dtype=np.float64)
        return cls(matrix=matrix, size=size, camera_from_section=pose, distortion=lens)

    @property
    def laser_plane(self) -> Plane:
        """The laser plane in the camera frame. Units: mm."""
        return Plane(np.array([0.0, 0.0, 1.0]), 0.0).transformed(self.camera_from_section)

    def rays(self, pixels: Points) -> Rays:
        """Rays through (n, 2) pixels, section frame; a distance along them is the depth in mm."""
        normalised = (pixels - self.matrix[:2, 2]) @ np.linalg.inv(self.matrix[:2, :2]).T
        directions = np.column_stack([self._undistorted(normalised), np.ones(len(pixels))])
        in_camera = Rays(np.zeros_like(directions), directions)
        return in_camera.seen_from(self.camera_from_section.inverse())

    def _undistorted(self, seen: Points) -> Points:
        if not self.distortion.any():
            return seen
        k1, k2, p1, p2, k3 = np.pad(self.distortion, (0, 5 - len(self.distortion)))
        true = seen
        for _ in range(UNDISTORT_STEPS):
            x, y = true.T
            squared = x**2 + y**2
            radial = 1 + squared * (k1 + squared * (k2 + squared * k3))
            shift_x = 2 * p1 * x * y + p2 * (squared + 2 * x**2)
            shift_y = p1 * (squared + 2 * y**2) + 2 * p2 * x * y
            true = (seen - np.column_stack([shift_x, shift_y])) / radial[:, None]
        return true
