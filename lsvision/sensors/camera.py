"""Camera model with lens distortion: from pixels to rays, and from points to pixels."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from lsvision.geometry import FloatArray, Points, as_readonly_array
from lsvision.geometry.equality import ComparedByValue
from lsvision.sensors.distortion import COEFFICIENTS, distort, invert_2x2, undistort

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
        above, or the size is not two positive whole numbers.

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
        size = tuple(self.size)
        if len(size) != 2 or not all(_is_length(length) for length in size):
            raise ValueError(f"expected a size (width, height) in px, got {self.size}")
        padded = np.pad(distortion, (0, COEFFICIENTS - len(distortion)))
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "distortion", as_readonly_array(distortion, ("k",)))
        object.__setattr__(self, "size", (int(size[0]), int(size[1])))
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
            Rays in the camera frame, scaled to z = 1. NaN for lost points, and for pixels that no
            ray reaches up to the first fold of the distortion model (the angle from the axis beyond
            which pixels move back towards the middle).
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
            camera. Beyond the first fold of the distortion model they are wrong, and may lie inside
            the image. Units: px.
        """
        array = as_readonly_array(points, ("n", 3), "points")
        depth = np.where(array[:, 2] > 0, array[:, 2], np.nan)
        distorted, _ = distort(array[:, :2] / depth[:, None], self._coefficients)
        return distorted @ self.matrix[:2, :2].T + self.matrix[:2, 2]


def _is_length(value: object) -> bool:
    """Return whether a value is a positive whole number."""
    if not isinstance(value, int | float | np.integer | np.floating):
        return False
    return bool(value > 0 and float(value).is_integer())


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
