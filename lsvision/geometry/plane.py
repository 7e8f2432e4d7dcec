"""Plane in space (laser plane, board, plate), its section frame, and maps from plane to plane."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lsvision.geometry.arrays import FloatArray, Points, as_unit_vector
from lsvision.geometry.equality import ComparedByValue
from lsvision.geometry.pose import Pose, as_pose

MIN_FACING_COSINE = 0.98
"""Cosine of the angle (11 deg) between the optical axis and the plane's normal above which the
plane faces the camera, so that the optical axis does not determine the direction of Y."""


@dataclass(frozen=True, eq=False)
class Plane(ComparedByValue):
    """Plane of all points p with ``normal . p = distance``.

    Parameters
    ----------
    normal : (3,) array_like
        Normal of any non-zero length; stored as a unit vector, with `distance` divided by the
        same length.
    distance : float
        Right-hand side of the equation for the given normal. Stored for the unit normal: the
        position of the plane along it, from the origin. Units: mm.

    Raises
    ------
    ValueError
        If the normal has the length 0, or a number is not finite.

    Examples
    --------
    >>> Plane((0, 0, 2), 10.0).distance
    5.0
    """

    normal: FloatArray
    distance: float

    def __post_init__(self) -> None:
        normal, length = as_unit_vector(self.normal, "normal")
        distance = float(self.distance) / length
        if not math.isfinite(distance):
            raise ValueError(f"expected a finite distance in mm, got {self.distance}")
        object.__setattr__(self, "normal", normal)
        object.__setattr__(self, "distance", distance)

    def signed_distances(self, points: npt.ArrayLike) -> FloatArray:
        """Return the signed distances of points from the plane.

        Parameters
        ----------
        points : (n, 3) array_like
            Points in the plane's frame. Units: mm.

        Returns
        -------
        (n,) ndarray
            Distances, positive on the side to which the normal points. Units: mm.

        Examples
        --------
        >>> Plane((0, 0, 1), 10.0).signed_distances([[5, 5, 12], [0, 0, 0]])
        array([  2., -10.])
        """
        return np.asarray(points, dtype=np.float64) @ self.normal - self.distance

    def transformed(self, a_from_b: Pose | npt.ArrayLike) -> Plane:
        """Return the plane of frame b in the coordinates of frame a.

        Parameters
        ----------
        a_from_b : Pose or (4, 4) array_like
            Pose of frame b in frame a.

        Returns
        -------
        Plane
            Plane in frame a.

        Examples
        --------
        >>> Plane((0, 0, 1), 10.0).transformed(Pose(translation=(0, 0, 5))).distance
        15.0
        """
        pose = as_pose(a_from_b)
        normal = pose.rotation @ self.normal
        return Plane(normal, self.distance + float(normal @ pose.translation))


def find_section_pose(plane: Plane) -> Pose:
    """Return ``camera_from_section``: the section frame of a plane in the frame of the camera.

    Origin at the point of the plane nearest to the camera's centre; Y in the plane, opposite to the
    optical axis z; X in the plane, perpendicular to Y, increasing with image u (with image v if X
    is closer to the direction of v); Z = X x Y. Where the plane faces the camera (within 11 deg), X
    follows image u and Y points up in the image. Units: mm.

    Examples
    --------
    >>> find_section_pose(Plane((0.0, 0.866, 0.5), 150.0)).rotation[:, 1].round(3)
    array([ 0.   ,  0.5  , -0.866])
    """
    normal, optical_axis = plane.normal, np.array([0.0, 0.0, 1.0])
    if abs(normal @ optical_axis) > MIN_FACING_COSINE:
        # The cross product with the optical axis is nearly zero: X follows image u instead.
        x = np.array([1.0, 0.0, 0.0])
        x = x - normal * (normal @ x)
        upwards = np.array([0.0, -1.0, 0.0])
    else:
        x = np.cross(normal, optical_axis)
        x = x * np.sign(x[np.argmax(np.abs(x))])
        upwards = -optical_axis
    x = x / np.linalg.norm(x)
    y = np.cross(normal, x)
    y = y * np.sign(y @ upwards)
    rotation = np.column_stack([x, y, np.cross(x, y)])
    return Pose(rotation, normal * plane.distance)


def apply_homography(homography: FloatArray, points: Points) -> Points:
    """Return the images (n, 2) of points (n, 2) under a homography (3, 3).

    Points that are mapped to infinity get inf or NaN, with a warning of numpy.

    Examples
    --------
    >>> apply_homography(np.diag([1.0, 1.0, 2.0]), np.array([[4.0, 6.0]]))
    array([[2., 3.]])
    """
    mapped = points @ homography[:, :2].T + homography[:, 2]
    return mapped[:, :2] / mapped[:, 2:]
