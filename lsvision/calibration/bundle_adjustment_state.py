"""Boards as measured, and the unknowns that they determine."""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, Plane, Pose, as_readonly_array
from lsvision.sensors.camera import Camera


@dataclass(frozen=True, eq=False)
class LaserView:
    """One board pose as two measurements: its corners, and the laser line on it.

    Parameters
    ----------
    points : (n, 3) array_like
        Corners, board frame, z = 0. Units: mm.
    pixels : (n, 2) array_like
        Where they appear. Units: px.
    line_pixels : (m, 2) array_like
        Points of the laser line on the board, none lost. Units: px.
    line_std : (m,) array_like
        One sigma of each across the line. Units: px.
    """

    points: FloatArray
    pixels: FloatArray
    line_pixels: FloatArray
    line_std: FloatArray

    def __post_init__(self) -> None:
        corners, points = len(self.points), len(self.line_pixels)
        object.__setattr__(self, "points", as_readonly_array(self.points, ("n", 3), "board points"))
        object.__setattr__(self, "pixels", as_readonly_array(self.pixels, (corners, 2), "pixels"))
        object.__setattr__(
            self, "line_pixels", as_readonly_array(self.line_pixels, ("m", 2), "line_pixels")
        )
        object.__setattr__(
            self, "line_std", as_readonly_array(self.line_std, (points,), "line_std")
        )
        if not np.isfinite(self.line_pixels).all():
            raise ValueError("want line_pixels without lost points")
        if not (self.line_std > 0).all():
            raise ValueError("want positive line_std in px")


@dataclass(frozen=True, eq=False)
class BundleAdjustmentState:
    """The unknowns: what a refinement starts from and ends with.

    Parameters
    ----------
    camera : Camera
        With at least the coefficients that are refined.
    plane : Plane
        Laser plane, camera frame. Units: mm.
    camera_from_boards : tuple of Pose
        One for each view.
    bow : (2,) array_like
        b1, b2. Units: mm.
    """

    camera: Camera
    plane: Plane
    camera_from_boards: tuple[Pose, ...]
    bow: FloatArray
