"""A camera and the plane of light it watches: from an image to a profile in mm.

The line is extracted on the raw image and its points are undistorted: warping the image
first would smear the line's intensity over its neighbours.
"""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Self

import numpy as np
import numpy.typing as npt

from lsvision.errors import DegenerateGeometry, LsvisionError
from lsvision.geometry import FloatArray, Plane, Points, Pose
from lsvision.laser_line.extraction import LaserLine, LineSettings, extract_laser_line
from lsvision.profile import PointNoise, Profile
from lsvision.sensors.camera import Camera
from lsvision.sensors.line_blur import correct_line_blur
from lsvision.sensors.rig_file import read_rig, write_rig

ALONG_FRACTION = 0.05
"""Error along the line, of that across it: a column's own place is exact, but a point without
any error along the line would get an endless weight at a steep flank."""

MIN_BASELINE = 0.1
"""mm; a plane that passes the camera's centre nearer than this shows no depth."""

MIN_SLANT = 1e-3
"""sin of the angle between view and plane (0.06 deg) below which they count as parallel."""

FACING = 0.98
"""cos of the angle between view and plane's normal (11 deg) from which the plane faces the
camera and the view no longer tells which way the sensor is."""


@dataclass(frozen=True, eq=False)
class LightSection:
    """A camera and a laser plane; what the plane cuts, the camera measures.

    Section frame: origin at the point of the laser plane nearest to the camera's centre;
    Y in the plane, against the camera's view; X = the direction of the laser line on a
    surface that faces the camera, growing with image u (with v where the line runs nearer to
    v); Z = X x Y. Where the plane faces the camera (within 11 deg), the view says nothing
    about Y: then X follows image u and Y points up in the image.

    Parameters
    ----------
    camera : Camera
        The calibrated camera.
    laser_plane : Plane
        Camera frame. Units: mm.
    provenance : mapping of str to str, optional
        Where it comes from (method, date, inputs); kept in the rig file.
    line_blur_px : float
        One sigma of lens and pixel along the laser line, where it was measured; 0 leaves the
        line as it was extracted. A lens blur of 0.7 px makes a pipe of 25 mm at 300 mm 16 um
        too large; see `correct_line_blur`. Units: px.

    Raises
    ------
    ValueError
        If the blur is negative or not finite.
    DegenerateGeometry
        If the plane passes through the camera's centre, is parallel to the view, or is never
        seen.

    Examples
    --------
    >>> camera = Camera([[2264, 0, 640], [0, 2264, 512], [0, 0, 1]], [], (1280, 1024))
    >>> section = LightSection(camera, Plane((0.0, 0.866, 0.5), 150.0))
    >>> section.points_from_pixels([[640.0, 512.0], [840.0, 512.0]]).round(1)
    array([[   0. , -259.8],
           [  26.5, -259.8]])
    """

    camera: Camera
    laser_plane: Plane
    provenance: Mapping[str, str] = field(default_factory=dict)
    line_blur_px: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.line_blur_px) and self.line_blur_px >= 0):
            raise ValueError(f"want line_blur_px >= 0, got {self.line_blur_px}")
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))
        _check_plane(self.camera, self.laser_plane)

    @property
    def camera_from_section(self) -> Pose:
        """Pose of the section frame in the camera's.

        Definition: see the class. Units: mm.
        """
        normal, view = self.laser_plane.normal, np.array([0.0, 0.0, 1.0])
        if abs(normal @ view) > FACING:
            # The line on a facing surface has no direction: take image u.
            x = np.array([1.0, 0.0, 0.0])
            x = x - normal * (normal @ x)
            towards = np.array([0.0, -1.0, 0.0])
        else:
            x = np.cross(normal, view)
            x = x * np.sign(x[np.argmax(np.abs(x))])
            towards = -view
        x = x / np.linalg.norm(x)
        y = np.cross(normal, x)
        y = y * np.sign(y @ towards)
        rotation = np.column_stack([x, y, np.cross(x, y)])
        return Pose(rotation, normal * self.laser_plane.distance)

    def profile(
        self,
        image: npt.ArrayLike,
        settings: LineSettings | None = None,
        laser_off: npt.ArrayLike | None = None,
    ) -> Profile:
        """Profile of the laser line in an image.

        Parameters
        ----------
        image : (height, width) or (height, width, 3) array_like
            Raw image of the camera, 8 to 16 bit.
        settings : LineSettings, optional
            Of `extract_laser_line`.
        laser_off : array_like, optional
            The same view without the laser; of `extract_laser_line`.

        Returns
        -------
        Profile
            Section frame; its ``noise`` holds the covariance of each point.

        Raises
        ------
        LsvisionError
            If the image is of another size than the camera's.
        NoLaserLine
            If no line is found.
        """
        return self.profile_from_line(self.line(image, settings, laser_off))

    def line(
        self,
        image: npt.ArrayLike,
        settings: LineSettings | None = None,
        laser_off: npt.ArrayLike | None = None,
    ) -> LaserLine:
        """Laser line in an image of this camera: what `profile` rests on, in pixels.

        That of `extract_laser_line`, without the pull of the rig's `line_blur_px`.

        Raises
        ------
        LsvisionError
            If the image is of another size than the camera's.
        NoLaserLine
            If no line is found.
        """
        array = np.asarray(image)
        width, height = self.camera.size
        if array.shape[:2] != (height, width):
            got = " x ".join(str(length) for length in array.shape[1::-1])
            raise LsvisionError(
                f"the image is {got} px and the rig's camera {width} x {height} px: take "
                "images with the size of the calibration, uncropped and unscaled"
            )
        return correct_line_blur(extract_laser_line(array, settings, laser_off), self.line_blur_px)

    def profile_from_line(self, line: LaserLine) -> Profile:
        """Profile of an extracted laser line: its points in the section, with their noise.

        Parameters
        ----------
        line : LaserLine
            Extracted on the raw image.

        Returns
        -------
        Profile
            One point for each of the line's; lost where the line is, or where the ray misses
            the laser plane.
        """
        points, jacobians = self._section_points(line.pixels)
        covariances = jacobians @ _pixel_covariances(line) @ jacobians.transpose(0, 2, 1)
        return Profile(points, PointNoise(covariances))

    def points_from_pixels(self, pixels: npt.ArrayLike) -> Points:
        """Points of the section seen in (n, 2) pixels; NaN rows where there is none. Units: mm."""
        return self._section_points(np.asarray(pixels, dtype=np.float64))[0]

    def project(self, points: npt.ArrayLike) -> Points:
        """Pixels in which (n, 2) points of the section appear, for overlays. Units: px."""
        return self.camera.project(self.camera_from_section.apply(points))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the rig file (JSON, whole or not at all).

        Raises
        ------
        UnwritableFile
            If the folder is missing or refuses.
        """
        write_rig(path, self.camera, self.laser_plane, self.provenance, self.line_blur_px)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read the rig file that `save` wrote.

        Raises
        ------
        UnreadableFile
            If the file is missing, damaged, or of another schema; names the file.
        DegenerateGeometry
            If its plane is of no use; see the class.
        """
        camera, plane, provenance, blur = read_rig(path)
        try:
            return cls(camera, plane, provenance, blur)
        except DegenerateGeometry as error:
            raise DegenerateGeometry(f"{path}: {error}") from error

    def _section_points(self, pixels: Points) -> tuple[Points, FloatArray]:
        """Section points (n, 2) of pixels and d point / d pixel (n, 2, 2)."""
        rays, d_rays = self.camera.rays_with_jacobian(pixels)
        normal, pose = self.laser_plane.normal, self.camera_from_section
        depth = _depths(rays, self.laser_plane)
        axes = pose.rotation[:, :2]
        points = (rays * depth[:, None] - pose.translation) @ axes
        # X = z m with z = D / (n . m), so dX/dm_j = z (e_j - m n_j / (n . m)).
        slant = (rays @ normal)[:, None, None]
        d_points = depth[:, None, None] * (
            axes[:2].T - (rays @ axes)[:, :, None] * normal[:2] / slant
        )
        return points, d_points @ d_rays


def _pixel_covariances(line: LaserLine) -> FloatArray:
    """Covariance (n, 2, 2) of each point: across the line as measured, hardly along it."""
    along_v = line.direction == "columns"
    fractions = (ALONG_FRACTION, 1.0) if along_v else (1.0, ALONG_FRACTION)
    covariances: FloatArray = line.std[:, None, None] ** 2 * np.diag(np.square(fractions))
    return covariances


def _depths(rays: Points, plane: Plane) -> FloatArray:
    """Depth z at which rays (z = 1) meet the plane; NaN where they do not. Units: mm."""
    slant = rays @ plane.normal
    ahead = slant * plane.distance > 0
    depths: FloatArray = np.where(ahead, plane.distance / np.where(ahead, slant, 1.0), np.nan)
    return depths


def _check_plane(camera: Camera, plane: Plane) -> None:
    if abs(plane.distance) < MIN_BASELINE:
        raise DegenerateGeometry(
            f"the laser plane passes {abs(plane.distance):.3g} mm from the camera's centre and "
            f"needs {MIN_BASELINE:g} mm at least: every depth looks alike from within the "
            "plane; move the laser sideways and calibrate anew"
        )
    if abs(plane.normal[2]) < MIN_SLANT:
        raise DegenerateGeometry(
            f"the laser plane is parallel to the view (normal {plane.normal.round(6)}): turn "
            "the laser so that its plane crosses the camera's axis at the working distance"
        )
    width, height = camera.size
    u, v = np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9))
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()]))
    if not np.isfinite(_depths(rays, plane)).any():
        raise DegenerateGeometry(
            f"the camera never sees the laser plane (normal {plane.normal.round(4)}, distance "
            f"{plane.distance:.3f} mm): it lies behind or beside the view; check the plane's "
            "sign (normal . p = distance, z along the view) and calibrate anew"
        )
