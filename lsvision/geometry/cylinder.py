"""Circular cylinder in space."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lsvision.geometry.arrays import TINY, FloatArray, as_unit_vector, freeze_arrays
from lsvision.geometry.directions import build_tangent_frame
from lsvision.geometry.ellipse import Ellipse
from lsvision.geometry.equality import ComparedByValue
from lsvision.geometry.pose import Pose, as_pose

MIN_COS_PHI = 1e-9
"""Cosine of the tilt below which an axis counts as parallel to the section plane."""


class WithCylinder:
    """Point, direction and radius of an object that has a `cylinder`, in the same frame."""

    if TYPE_CHECKING:

        @property
        def cylinder(self) -> Cylinder:
            """The cylinder."""

    @property
    def point(self) -> FloatArray:
        """Point (3,) of the axis. Units: mm."""
        return self.cylinder.point

    @property
    def direction(self) -> FloatArray:
        """Unit vector (3,) along the axis."""
        return self.cylinder.direction

    @property
    def radius(self) -> float:
        """Radius. Units: mm."""
        return self.cylinder.radius

    @property
    def tangent_basis(self) -> FloatArray:
        """Unit vectors e_phi and e_theta (2, 3) normal to the axis; see `build_tangent_frame`.

        They are tangents of the sphere of all directions, not of the cylinder.
        """
        return build_tangent_frame(self.direction)[:2]


@dataclass(frozen=True, eq=False)
class Cylinder(ComparedByValue):
    """Circular cylinder of infinite length.

    Parameters
    ----------
    point : (3,) array_like
        Point on the axis. Units: mm.
    direction : (3,) array_like
        Direction of the axis, of any non-zero length; stored as a unit vector.
    radius : float
        Radius of the cylinder. Units: mm.

    Raises
    ------
    ValueError
        If the direction has the length 0, the radius is not positive, or a number is not finite.

    Examples
    --------
    >>> rod = Cylinder((0, 0, 0), (0, math.sin(0.5), math.cos(0.5)), radius=10.0)
    >>> section = rod.section()
    >>> f"a {section.semi_major:.2f} mm, b {section.semi_minor:.2f} mm, phi {section.phi:.2f} rad"
    'a 11.39 mm, b 10.00 mm, phi 0.50 rad'
    """

    point: FloatArray
    direction: FloatArray
    radius: float

    def __post_init__(self) -> None:
        freeze_arrays(self, point=(3,))
        if not np.isfinite(self.point).all():
            raise ValueError(f"expected a finite point in mm, got {self.point}")
        object.__setattr__(self, "direction", as_unit_vector(self.direction, "direction")[0])
        if not (math.isfinite(self.radius) and self.radius > 0):
            raise ValueError(f"expected a positive radius in mm, got {self.radius}")

    def transformed(self, a_from_b: Pose | npt.ArrayLike) -> Cylinder:
        """Return the cylinder of frame b in the coordinates of frame a.

        Parameters
        ----------
        a_from_b : Pose or (4, 4) array_like
            Pose of frame b in frame a.

        Returns
        -------
        Cylinder
            Cylinder in frame a.

        Examples
        --------
        >>> pipe = Cylinder((0, 0, 0), (0, 0, 1), radius=10.0)
        >>> pipe.transformed(Pose(translation=(0, 5, 0))).point.tolist()
        [0.0, 5.0, 0.0]
        """
        pose = as_pose(a_from_b)
        return Cylinder(pose.apply_one(self.point), pose.rotation @ self.direction, self.radius)

    def ring(self, position: float, angles: npt.ArrayLike) -> FloatArray:
        """Return points of the circle in which a plane perpendicular to the axis cuts the cylinder.

        Parameters
        ----------
        position : float
            Distance of the plane from `point` along `direction`. Units: mm.
        angles : (n,) array_like
            Angles from e_phi towards e_theta, see `tangent_basis`. Units: rad.

        Returns
        -------
        (n, 3) ndarray
            Points on the surface. Units: mm.

        Examples
        --------
        >>> Cylinder((0, 0, 0), (0, 0, 1), radius=10.0).ring(5.0, [0.0]).tolist()
        [[10.0, 0.0, 5.0]]
        """
        e_phi, e_theta = build_tangent_frame(self.direction)[:2]
        radial = np.outer(np.cos(angles), e_phi) + np.outer(np.sin(angles), e_theta)
        return self.point + position * self.direction + self.radius * radial

    def signed_distances(self, points: npt.ArrayLike) -> FloatArray:
        """Return the signed distances of points from the surface.

        Parameters
        ----------
        points : (n, 3) array_like
            Points in the cylinder's frame. Units: mm.

        Returns
        -------
        (n,) ndarray
            Distances, positive outside. Units: mm.

        Examples
        --------
        >>> Cylinder((0, 0, 0), (0, 0, 1), radius=10.0).signed_distances([[12, 0, 7], [0, 0, 0]])
        array([  2., -10.])
        """
        distances: FloatArray = (
            np.linalg.norm(self._compute_radial_vectors(points), axis=1) - self.radius
        )
        return distances

    def normals(self, points: npt.ArrayLike) -> FloatArray:
        """Return the outward unit normals of the surface at its points nearest to given points.

        Parameters
        ----------
        points : (n, 3) array_like
            Points in the cylinder's frame. Units: mm.

        Returns
        -------
        (n, 3) ndarray
            Unit vectors from the axis towards the points; 0 for a point on the axis.

        Examples
        --------
        >>> Cylinder((0, 0, 0), (0, 0, 1), radius=10.0).normals([[12, 0, 7]]).tolist()
        [[1.0, 0.0, 0.0]]
        """
        radial = self._compute_radial_vectors(points)
        normals: FloatArray = radial / np.maximum(
            np.linalg.norm(radial, axis=1, keepdims=True), TINY
        )
        return normals

    def _compute_radial_vectors(self, points: npt.ArrayLike) -> FloatArray:
        """Return the vectors (n, 3) from the axis to points (n, 3), perpendicular to it."""
        from_point = np.asarray(points, dtype=np.float64) - self.point
        axial_positions = from_point @ self.direction
        radial: FloatArray = from_point - np.outer(axial_positions, self.direction)
        return radial

    def section(self) -> Ellipse:
        """Return the ellipse in which the plane z = 0 cuts the cylinder (paper section 2.2).

        Returns
        -------
        Ellipse
            Section, whose theta is the direction of the projected axis.

        Raises
        ------
        ValueError
            If the axis is parallel to the plane.
        """
        cos_phi = abs(float(self.direction[2]))
        if cos_phi < MIN_COS_PHI:
            raise ValueError(
                "expected an axis that crosses the section plane, got one parallel to it"
            )
        centre = self.point - self.direction * (self.point[2] / self.direction[2])
        theta = math.atan2(self.direction[1], self.direction[0])
        semi_major = self.radius / min(cos_phi, 1.0)
        return Ellipse((float(centre[0]), float(centre[1])), semi_major, self.radius, theta)

    @classmethod
    def twins(cls, ellipse: Ellipse) -> tuple[Cylinder, Cylinder]:
        """Return both cylinders, in the section frame, whose section is `ellipse`.

        Parameters
        ----------
        ellipse : Ellipse
            Ellipse in the section frame.

        Returns
        -------
        tuple of Cylinder
            Cylinders in the order of `Ellipse.axis_twins`.

        Examples
        --------
        >>> first, second = Cylinder.twins(Ellipse((0.0, 0.0), 20.0, 10.0, theta=0.0))
        >>> first.section() == second.section()
        True
        """
        point = np.array([*ellipse.centre, 0.0])
        first, second = ellipse.axis_twins
        return cls(point, first, ellipse.radius), cls(point, second, ellipse.radius)
