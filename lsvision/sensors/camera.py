"""Camera model with lens distortion: from pixels to rays, and from points to pixels."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from lsvision.geometry import FloatArray, Points, as_readonly_array
from lsvision.geometry.arguments import as_numbers
from lsvision.geometry.equality import ComparedByValue
from lsvision.sensors.distortion import COEFFICIENTS, distort, invert_2x2, undistort

MAX_SIZE_PX = 1 << 20
"""Largest side of an image, the limit of OpenCV's decoders. Units: px."""
MIN_FOCAL_LENGTH_PX = 1e-3
"""Shortest focal length of a camera. Units: px."""
MAX_VALUE = 1e9
"""Largest number in a camera's matrix and distortion, and of a pixel or a ray's slope: products of
larger ones may overflow, and no lens has such a value."""
DISTORTION_COUNTS = (0, 4, 5, 8, 12, 14)
"""Numbers of distortion coefficients in OpenCV's models."""
HOMOGENEOUS_TOLERANCE = 1e-9
"""Largest deviation of the lower entries of a camera matrix from 0 and 1."""


@dataclass(frozen=True, eq=False)
class Camera(ComparedByValue):
    """Pinhole camera with lens distortion (OpenCV's model, up to the 14-coefficient tilted one).

    Camera frame: origin in the projection centre, x along image u, y along image v (down),
    z along the optical axis. Pixel (0, 0) is the centre of the top-left pixel.

    Parameters
    ----------
    matrix : (3, 3) array_like
        ``[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]``. Units: px.
    distortion : (k,) array_like
        k coefficients in OpenCV's order k1 k2 p1 p2 k3 ...; k in 0, 4, 5, 8, 12, 14.
    size : tuple of int
        ``(width, height)`` of the images. Units: px.

    Raises
    ------
    ValueError
        If the matrix does not have this form, the number of coefficients is not one of those
        above, the size is not two positive whole numbers, or a number is beyond `MAX_VALUE`,
        `MAX_SIZE_PX` or `MIN_FOCAL_LENGTH_PX`.

    Examples
    --------
    >>> camera = Camera([[800, 0, 320], [0, 800, 240], [0, 0, 1]], [-0.3, 0.1, 0, 0], (640, 480))
    >>> pixels = camera.project([[50.0, -20.0, 400.0]])
    >>> camera.rays(pixels).round(6)
    array([[ 0.125, -0.05 ,  1.   ]])
    """

    matrix: FloatArray
    distortion: FloatArray
    size: tuple[int, int]
    _coefficients: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        matrix = as_readonly_array(self.matrix, (3, 3), "camera matrix")
        _check_matrix(matrix)
        distortion = np.array(self.distortion, dtype=np.float64).reshape(-1)
        if len(distortion) not in DISTORTION_COUNTS or not np.isfinite(distortion).all():
            raise ValueError(
                f"expected {', '.join(map(str, DISTORTION_COUNTS))} finite distortion "
                f"coefficients in OpenCV's order, got {len(distortion)}: {distortion}"
            )
        if np.abs(distortion).max(initial=0.0) > MAX_VALUE:
            raise ValueError(
                f"expected no number above {MAX_VALUE:g} in the distortion, got {distortion}"
            )
        width, height = as_numbers(self.size, 2, "a size (width, height) in px")
        if not (_is_positive_integer(width) and _is_positive_integer(height)):
            raise ValueError(f"expected a size (width, height) in px, got {self.size}")
        if not max(width, height) <= MAX_SIZE_PX:
            raise ValueError(
                f"expected a size of 1 to {MAX_SIZE_PX} px, got {width:.10g} x {height:.10g}"
            )
        padded = np.pad(distortion, (0, COEFFICIENTS - len(distortion)))
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "distortion", as_readonly_array(distortion, ("k",)))
        object.__setattr__(self, "size", (int(width), int(height)))
        object.__setattr__(self, "_coefficients", as_readonly_array(padded, (COEFFICIENTS,)))

    @property
    def focal_length(self) -> float:
        """Geometric mean of fx and fy. Units: px."""
        return float(np.sqrt(self.matrix[0, 0] * self.matrix[1, 1]))

    def rays(self, pixels: npt.ArrayLike) -> Points:
        """Return the undistorted rays through pixels.

        Parameters
        ----------
        pixels : (n, 2) array_like
            Pixels u, v; NaN rows for lost points. Units: px.

        Returns
        -------
        (n, 3) ndarray
            Rays in the camera frame, scaled to z = 1. NaN for lost points, pixels beyond
            `MAX_VALUE`, and pixels that no ray reaches up to the first fold of the distortion model
            (the angle from the axis beyond which pixels move back towards the middle).
        """
        return self.rays_with_jacobian(pixels)[0]

    def rays_with_jacobian(self, pixels: npt.ArrayLike) -> tuple[Points, FloatArray]:
        """Return the undistorted rays through pixels and their derivatives.

        Parameters
        ----------
        pixels : (n, 2) array_like
            Pixels u, v; NaN rows for lost points. Units: px.

        Returns
        -------
        rays : (n, 3) ndarray
            Result of `rays`.
        jacobian : (n, 2, 2) ndarray
            d(x / z, y / z) / d(u, v); NaN where the ray is. Units: 1 / px.

        Examples
        --------
        >>> camera = Camera([[800, 0, 320], [0, 800, 240], [0, 0, 1]], [], (640, 480))
        >>> rays, jacobian = camera.rays_with_jacobian([[320.0, 240.0]])
        >>> rays.tolist(), jacobian[0].tolist()
        ([[0.0, 0.0, 1.0]], [[0.00125, 0.0], [0.0, 0.00125]])
        """
        array = as_readonly_array(pixels, ("n", 2), "pixels")
        in_image = (np.abs(array) <= MAX_VALUE).all(axis=1, keepdims=True)
        array = np.where(in_image, array, np.nan)
        normalised_from_pixel = np.linalg.inv(self.matrix[:2, :2])
        distorted = (array - self.matrix[:2, 2]) @ normalised_from_pixel.T
        normalised, jacobian = undistort(distorted, self._coefficients)
        rays = np.column_stack([normalised, np.ones(len(array))])
        rays[np.isnan(normalised[:, 0])] = np.nan
        return rays, invert_2x2(jacobian) @ normalised_from_pixel

    def project(self, points: npt.ArrayLike) -> Points:
        """Return the pixels of points.

        Parameters
        ----------
        points : (n, 3) array_like
            Points in the camera frame. Units: mm.

        Returns
        -------
        (n, 2) ndarray
            Pixels u, v, also outside of the image; NaN for points that are not in front of the
            camera, or farther from its axis than `MAX_VALUE` times their depth. Beyond the first
            fold of the distortion model they are wrong, and may lie inside the image. Units: px.
        """
        array = as_readonly_array(points, ("n", 3), "points")
        depth = np.where(array[:, 2] > 0, array[:, 2], np.nan)
        seen = (np.abs(array[:, :2]) / MAX_VALUE <= depth[:, None]).all(axis=1, keepdims=True)
        slopes = np.where(seen, array[:, :2], np.nan) / depth[:, None]
        distorted, _ = distort(slopes, self._coefficients)
        return distorted @ self.matrix[:2, :2].T + self.matrix[:2, 2]


def _is_positive_integer(value: float) -> bool:
    """Return whether a number is positive and whole."""
    return value > 0 and value.is_integer()


def _check_matrix(matrix: FloatArray) -> None:
    """Raise ValueError if a (3, 3) matrix does not have the form of a camera matrix."""
    homogeneous_deviation = np.abs(
        [matrix[1, 0], matrix[2, 0], matrix[2, 1], matrix[2, 2] - 1]
    ).max()
    if not (
        np.isfinite(matrix).all()
        and homogeneous_deviation < HOMOGENEOUS_TOLERANCE
        and matrix[0, 0] > 0
        and matrix[1, 1] > 0
    ):
        raise ValueError(
            "expected a camera matrix [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] in px, "
            f"got {matrix.tolist()}"
        )
    shortest = np.sqrt(matrix[0, 0]) * np.sqrt(matrix[1, 1])
    if np.abs(matrix).max() > MAX_VALUE or shortest < MIN_FOCAL_LENGTH_PX:
        raise ValueError(
            f"expected a focal length of at least {MIN_FOCAL_LENGTH_PX:g} px and no number above "
            f"{MAX_VALUE:g}, got matrix {matrix.tolist()}"
        )
