"""Plane in space: the laser plane, a calibration board, a plate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lsvision.geometry.arrays import FloatArray, as_unit_vector
from lsvision.geometry.equality import ComparedByValue
from lsvision.geometry.pose import Pose, as_pose


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
