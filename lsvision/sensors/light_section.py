"""Light section: a camera and a laser plane, which turn an image into a profile in mm.

The line is extracted from the raw image and its points are undistorted; undistorting the image
first would blur the line by interpolation.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from lsvision.errors import DegenerateGeometry, LsvisionError
from lsvision.geometry import FloatArray, Plane, Points, Pose
from lsvision.geometry.equality import ComparedByValue
from lsvision.geometry.plane import find_section_pose
from lsvision.laser_line.extraction import LineSettings, extract_laser_line
from lsvision.laser_line.image_array import as_image
from lsvision.laser_line.line import LaserLine
from lsvision.laser_line.line_blur import correct_line_blur
from lsvision.profile import PointNoise, Profile
from lsvision.sensors.camera import Camera
from lsvision.sensors.rig_file import check_line_blur, read_rig, write_rig

STD_RATIO_ALONG_LINE = 0.05
"""Standard deviation along u over that along v of a line with a point in each column (in each row:
the reverse). The column of a point is exact, but without an error along u the weight of a point
at a steep flank would be infinite."""
MIN_BASELINE_MM = 0.1
"""Smallest distance of the laser plane from the camera's centre: a plane through it shows no depth.
Units: mm."""
MIN_SLANT_SINE = 1e-3
"""Smallest sine of the angle between optical axis and laser plane (0.06 deg)."""
NORMAL_STEP_MM = 0.1
"""Length of the plane's normal that is projected to find its direction in the image. Units: mm."""
CHECKED_PIXELS = 9
"""Number of pixels along each side of the image whose rays are intersected with the plane, to check
whether it is in view."""


@dataclass(frozen=True, eq=False)
class LightSection(ComparedByValue):
    """Camera and laser plane, which measure the section of a scene with the plane.

    Section frame: origin at the point of the laser plane nearest to the camera's centre;
    Y in the plane, opposite to the optical axis; X = the direction of the laser line on a
    surface that faces the camera, increasing with image u (with v if the line is closer to the
    image's v axis than to u); Z = X x Y. Where the plane faces the camera (within 11 deg), the
    optical axis does not determine Y: then X follows image u and Y points up in the image.

    Parameters
    ----------
    camera : Camera
        Calibrated camera.
    laser_plane : Plane
        Laser plane in the camera frame. Units: mm.
    provenance : mapping of str to str, optional
        Origin of the values (method, date, inputs), stored in the rig file.
    line_blur_px : float
        Standard deviation of the point spread function of lens and pixel, if measured; 0: not
        stated, then it is estimated from the width of each line. A blur of 0.7 px makes the radius
        of a pipe of 25 mm at 300 mm 16 um too large; see `correct_line_blur`. Units: px.

    Raises
    ------
    TypeError
        If camera or plane is something else.
    ValueError
        If the blur is negative, above `MAX_LINE_BLUR_PX` or not finite.
    DegenerateGeometry
        If the plane passes through the camera's centre, is parallel to the optical axis, or is
        not in view.

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
        if not (isinstance(self.camera, Camera) and isinstance(self.laser_plane, Plane)):
            raise TypeError(
                "expected a Camera and a Plane, got "
                f"{type(self.camera).__name__} and {type(self.laser_plane).__name__}"
            )
        object.__setattr__(self, "line_blur_px", check_line_blur(self.line_blur_px))
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))
        _check_plane(self.camera, self.laser_plane)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the constructor's arguments: a read-only mapping cannot be pickled."""
        provenance = dict(self.provenance)
        return type(self), (self.camera, self.laser_plane, provenance, self.line_blur_px)

    @cached_property
    def camera_from_section(self) -> Pose:
        """Pose of the section frame in the camera frame, as the class defines it. Units: mm."""
        return find_section_pose(self.laser_plane)

    def profile(
        self,
        image: npt.ArrayLike,
        settings: LineSettings | None = None,
        laser_off: npt.ArrayLike | None = None,
    ) -> Profile:
        """Measure the profile of the laser line in an image.

        Parameters
        ----------
        image : (height, width) or (height, width, 3) array_like
            Raw image of the camera, as for `extract_laser_line`.
        settings : LineSettings, optional
            Settings of `extract_laser_line`.
        laser_off : array_like, optional
            Image of the same view without the laser, to be subtracted.

        Returns
        -------
        Profile
            Profile in the section frame, with the covariance of each point in ``noise``.

        Raises
        ------
        TypeError, ValueError
            If `image` is not an image (for the name of a file use `read_image`), or its colours and
            ``settings.channel`` disagree.
        LsvisionError
            If the size of the image differs from that of the camera.
        NoLaserLine
            If no line is found.

        Examples
        --------
        >>> import lsvision as lsv
        >>> rig = LightSection.load("fixtures/images/rig.json")
        >>> profile = rig.profile(lsv.read_image("fixtures/images/single.png"))
        >>> len(profile), profile.noise is not None
        (800, True)
        """
        return self.profile_from_line(self.line(image, settings, laser_off))

    def line(
        self,
        image: npt.ArrayLike,
        settings: LineSettings | None = None,
        laser_off: npt.ArrayLike | None = None,
    ) -> LaserLine:
        """Extract the laser line from an image of this camera and correct its blur.

        Parameters
        ----------
        image, settings, laser_off
            As for `profile`.

        Returns
        -------
        LaserLine
            Line with one point for each column or row.

        Raises
        ------
        TypeError, ValueError, LsvisionError, NoLaserLine
            As for `profile`.

        Examples
        --------
        >>> import lsvision as lsv
        >>> rig = LightSection.load("fixtures/images/rig.json")
        >>> line = rig.line(lsv.read_image("fixtures/images/single.png"))
        >>> rig.profile_from_line(line).points.shape
        (800, 2)
        """
        array = as_image(image)
        width, height = self.camera.size
        if array.shape[:2] != (height, width):
            got = " x ".join(str(length) for length in array.shape[1::-1])
            raise LsvisionError(
                f"the image is {got} px and the rig's camera {width} x {height} px: take "
                "images with the size of the calibration, uncropped and unscaled"
            )
        line = extract_laser_line(array, settings, laser_off)
        return correct_line_blur(
            line,
            self.line_blur_px or None,
            *self._normal_in_image(line.pixels),
        )

    def profile_from_line(self, line: LaserLine) -> Profile:
        """Return the profile of an extracted laser line, with the covariance of its points.

        Parameters
        ----------
        line : LaserLine
            Line extracted from the raw image.

        Returns
        -------
        Profile
            Profile with one point for each point of the line; lost where the line is lost, or its
            ray does not meet the laser plane.
        """
        points, jacobians = self._intersect_pixels(line.pixels)
        scaled = jacobians * _pixel_stds(line)[:, None, :]
        return Profile(points, PointNoise(scaled @ scaled.transpose(0, 2, 1)))

    def points_from_pixels(self, pixels: npt.ArrayLike) -> Points:
        """Return the points of the section in which rays through pixels meet the laser plane.

        Parameters
        ----------
        pixels : (n, 2) array_like
            Pixels u, v; NaN rows for lost points. Units: px.

        Returns
        -------
        (n, 2) ndarray
            Points in the section frame; NaN rows for lost points and where a ray misses the laser
            plane. Units: mm.
        """
        return self._intersect_pixels(np.asarray(pixels, dtype=np.float64))[0]

    def project(self, points: npt.ArrayLike) -> Points:
        """Return the pixels of points of the section.

        Parameters
        ----------
        points : (n, 2) array_like
            Points in the section frame. Units: mm.

        Returns
        -------
        (n, 2) ndarray
            Pixels u, v, as of `Camera.project`. Units: px.

        Examples
        --------
        >>> rig = LightSection.load("fixtures/images/rig.json")
        >>> pixels = rig.project([[0.0, 0.0]])
        >>> rig.points_from_pixels(pixels).round(6) + 0.0
        array([[0., 0.]])
        """
        return self.camera.project(self.camera_from_section.apply(points))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the rig file (JSON); an existing file is replaced only when all is written.

        Parameters
        ----------
        path : path
            File with the ending ``.json``.

        Raises
        ------
        UnwritableFile
            If the folder is missing or not writable.
        ValueError
            If a number is beyond the limits of rig files, so that `load` would reject it.

        Examples
        --------
        >>> import tempfile
        >>> rig = LightSection.load("fixtures/images/rig.json")
        >>> copy = f"{tempfile.mkdtemp()}/rig.json"
        >>> rig.save(copy)
        >>> LightSection.load(copy) == rig
        True
        """
        write_rig(path, self.camera, self.laser_plane, self.provenance, self.line_blur_px)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Return the light section of a rig file that `save` wrote.

        Parameters
        ----------
        path : path
            File with the ending ``.json``.

        Returns
        -------
        LightSection
            Light section, equal to the one that was saved.

        Raises
        ------
        UnreadableFile
            If the file is missing, damaged, or of another schema.
        DegenerateGeometry
            If its laser plane is rejected; see the class.
        """
        camera, plane, provenance, blur = read_rig(path)
        try:
            return cls(camera, plane, provenance, blur)
        except DegenerateGeometry as error:
            raise DegenerateGeometry(f"{path}: {error}") from error

    def _normal_in_image(self, pixels: Points) -> tuple[FloatArray, float]:
        """Return the image of the plane's normal halfway along a line.

        Its direction (2,), and the relative change of its length for each pixel along it. Zeros
        where the line's ray misses the plane, or the normal is seen end on.
        """
        valid = pixels[np.isfinite(pixels).all(axis=1)]
        ray = self.camera.rays(valid[[len(valid) // 2]])
        point = ray * _intersect_rays(ray, self.laser_plane)
        shifted = point + NORMAL_STEP_MM * self.laser_plane.normal
        start, stop = self.camera.project(np.vstack([point, shifted]))
        length = math.hypot(*(stop - start))
        if not length > 0:
            return np.zeros(2), 0.0
        # At depth z, the normal has the length |m| / z in normalised image coordinates, with
        # m = (n_x, n_y) - p n_z: 1 / z is proportional to n . (p, 1), and m falls by n_z.
        nx, ny, nz = self.laser_plane.normal
        m = np.array([nx, ny]) - ray[0, :2] * nz
        size = math.hypot(*m)
        growth = (np.array([nx, ny]) @ m / size) / (ray[0] @ self.laser_plane.normal) - nz / size
        px_per_unit = length / (NORMAL_STEP_MM * size / point[0, 2])
        return (stop - start) / length, float(growth / px_per_unit)

    def _intersect_pixels(self, pixels: Points) -> tuple[Points, FloatArray]:
        """Return the section points (n, 2) of pixels, and their Jacobian by the pixel (n, 2, 2)."""
        rays, ray_jacobians = self.camera.rays_with_jacobian(pixels)
        normal, pose = self.laser_plane.normal, self.camera_from_section
        depth = _intersect_rays(rays, self.laser_plane)
        axes = pose.rotation[:, :2]
        points = (rays * depth[:, None] - pose.translation) @ axes
        # X = z m with z = D / (n . m), so dX/dm_j = z (e_j - m n_j / (n . m)).
        ray_dot_normal = (rays @ normal)[:, None, None]
        point_jacobians = depth[:, None, None] * (
            axes[:2].T - (rays @ axes)[:, :, None] * normal[:2] / ray_dot_normal
        )
        return points, point_jacobians @ ray_jacobians


def _pixel_stds(line: LaserLine) -> FloatArray:
    """Return the standard deviations of points along u and v (n, 2). Units: px."""
    along_v = line.direction == "columns"
    fractions = (STD_RATIO_ALONG_LINE, 1.0) if along_v else (1.0, STD_RATIO_ALONG_LINE)
    stds: FloatArray = line.std[:, None] * np.array(fractions)
    return stds


def _intersect_rays(rays: Points, plane: Plane) -> FloatArray:
    """Return the depths z (n,) at which rays (z = 1) meet the plane, in mm; NaN if they do not."""
    ray_dot_normal = rays @ plane.normal
    in_front = ray_dot_normal * plane.distance > 0
    return np.where(in_front, plane.distance / np.where(in_front, ray_dot_normal, 1.0), np.nan)


def _check_plane(camera: Camera, plane: Plane) -> None:
    """Raise DegenerateGeometry if the camera cannot measure in the plane."""
    if abs(plane.distance) < MIN_BASELINE_MM:
        raise DegenerateGeometry(
            f"the laser plane passes {abs(plane.distance):.3g} mm from the camera's centre and "
            f"needs at least {MIN_BASELINE_MM:g} mm: from within the plane all depths have the "
            "same image; move the laser sideways and calibrate again"
        )
    if abs(plane.normal[2]) < MIN_SLANT_SINE:
        raise DegenerateGeometry(
            f"the laser plane is parallel to the optical axis (normal {plane.normal.round(6)}): "
            "turn the laser so that its plane crosses the optical axis at the working distance"
        )
    width, height = camera.size
    u, v = np.meshgrid(
        np.linspace(0, width - 1, CHECKED_PIXELS), np.linspace(0, height - 1, CHECKED_PIXELS)
    )
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()]))
    if not np.isfinite(_intersect_rays(rays, plane)).any():
        raise DegenerateGeometry(
            f"the laser plane is not in view (normal {plane.normal.round(4)}, distance "
            f"{plane.distance:.3f} mm): it lies behind the camera or beside the image; check the "
            "plane's sign (normal . p = distance, z along the optical axis) and calibrate again"
        )
