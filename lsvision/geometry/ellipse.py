"""Ellipse in which the laser plane cuts a circular cylinder (paper section 2), and residuals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from lsvision.geometry.arrays import TINY, FloatArray, Points

MAX_FOOT_POINT_ITERATIONS = 30
"""Largest number of steps of the foot point iteration."""
FOOT_POINT_TOLERANCE = 1e-5
"""Change of the cosine of the eccentric anomaly at which the foot point iteration stops. The
anomaly is then exact to 1e-7 rad up to some radii of curvature from the ellipse."""


class WithEllipse:
    """Radius, angles and centre of an object whose `ellipse` is the section of a cylinder."""

    if TYPE_CHECKING:

        @property
        def ellipse(self) -> Ellipse:
            """The section."""

    @property
    def radius(self) -> float:
        """Radius of the cylinder: the semi-minor axis b. Units: mm."""
        return self.ellipse.radius

    @property
    def theta(self) -> float:
        """Direction of the major axis. Units: rad, in [0, pi)."""
        return self.ellipse.theta

    @property
    def phi(self) -> float:
        """Angle between axis and laser plane's normal, arccos(b / a). Units: rad."""
        return self.ellipse.phi

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of the ellipse in the section frame. Units: mm."""
        return self.ellipse.centre


@dataclass(frozen=True)
class Ellipse:
    """Section of a circular cylinder by the laser plane.

    Parameters
    ----------
    centre : tuple of float
        Centre (x, y) in the section frame. Units: mm.
    semi_major, semi_minor : float
        Semi-axes a and b, ``semi_major >= semi_minor > 0``. Units: mm.
    theta : float
        Direction of the major axis from X towards Y; stored in [0, pi). Units: rad.

    Raises
    ------
    ValueError
        If the axes are not in order or not positive, a number is not finite, or the centre has not
        two coordinates.

    Examples
    --------
    >>> pipe = Ellipse((0.0, 0.0), semi_major=20.0, semi_minor=10.0, theta=0.0)
    >>> f"radius {pipe.radius:g} mm, tilt {math.degrees(pipe.phi):.0f} deg"
    'radius 10 mm, tilt 60 deg'
    """

    centre: tuple[float, float]
    semi_major: float
    semi_minor: float
    theta: float

    def __post_init__(self) -> None:
        if len(self.centre) != 2:
            raise ValueError(f"expected a centre (x, y) in mm, got {self.centre!r}")
        x, y = map(float, self.centre)
        numbers = (x, y, self.semi_major, self.semi_minor, self.theta)
        if not all(map(math.isfinite, numbers)):
            raise ValueError(f"expected finite numbers, got {numbers}")
        if not self.semi_major >= self.semi_minor > 0:
            raise ValueError(
                f"expected semi_major >= semi_minor > 0 mm, got {self.semi_major:g} and "
                f"{self.semi_minor:g}: Ellipse.from_axes orders a pair of axes"
            )
        object.__setattr__(self, "centre", (x, y))
        theta = self.theta % math.pi
        object.__setattr__(self, "theta", 0.0 if theta == math.pi else theta)

    @classmethod
    def from_axes(
        cls, centre: tuple[float, float], first: float, second: float, direction: float
    ) -> Self:
        """Return the ellipse of two semi-axes in any order.

        Parameters
        ----------
        centre : tuple of float
            Centre (x, y). Units: mm.
        first, second : float
            Lengths of the semi-axes. Units: mm.
        direction : float
            Direction of the first semi-axis from X towards Y. Units: rad.

        Returns
        -------
        Ellipse
            Ellipse whose semi-major axis is the larger one.

        Examples
        --------
        >>> Ellipse.from_axes((0.0, 0.0), 10.0, 20.0, direction=0.0).theta == math.pi / 2
        True
        """
        if first >= second:
            return cls(centre, first, second, direction)
        return cls(centre, second, first, direction + math.pi / 2)

    @property
    def radius(self) -> float:
        """Radius of the cylinder.

        Definition: b, paper section 2.2.2. Units: mm.
        """
        return self.semi_minor

    @property
    def phi(self) -> float:
        """Angle between the cylinder's axis and the laser plane's normal.

        Definition: arccos(b / a), paper section 2.2.3. Units: rad, in [0, pi/2].
        """
        return math.acos(self.semi_minor / self.semi_major)

    @property
    def axis_twins(self) -> FloatArray:
        """Directions of the two cylinder axes with this section.

        Definition: cos(phi) n +/- sin(phi) m, with n = Z the laser plane's normal and m the
        major axis; (theta, phi) is the same for both. Shape (2, 3), unit vectors in the section
        frame.
        """
        cos_phi, sin_phi = math.cos(self.phi), math.sin(self.phi)
        m = np.array([math.cos(self.theta), math.sin(self.theta), 0.0])
        n = np.array([0.0, 0.0, 1.0])
        return np.stack([cos_phi * n + sin_phi * m, cos_phi * n - sin_phi * m])

    def points_at(self, parameter: FloatArray) -> Points:
        """Return the points of the ellipse at given eccentric anomalies.

        Parameters
        ----------
        parameter : (k,) ndarray
            Eccentric anomalies, 0 at the end of the major axis. Units: rad.

        Returns
        -------
        (k, 2) ndarray
            Points in the section frame. Units: mm.

        Examples
        --------
        >>> Ellipse((3.0, 0.0), 20.0, 10.0, theta=0.0).points_at(np.array([0.0]))
        array([[23.,  0.]])
        """
        points = np.column_stack(
            [self.semi_major * np.cos(parameter), self.semi_minor * np.sin(parameter)]
        )
        return self.from_ellipse_frame(points)

    def to_ellipse_frame(self, points: Points) -> Points:
        """Return points of the section frame in the ellipse frame.

        The ellipse frame has its origin at the centre and its axes along the semi-axes.

        Parameters
        ----------
        points : (k, 2) ndarray
            Points in the section frame. Units: mm.

        Returns
        -------
        (k, 2) ndarray
            Coordinates along the major and the minor axis, from the centre. Units: mm.

        Examples
        --------
        >>> tilted = Ellipse((3.0, 0.0), 20.0, 10.0, theta=math.pi / 2)
        >>> tilted.to_ellipse_frame(np.array([[3.0, 20.0]])).round(9)
        array([[20.,  0.]])
        """
        return (points - self.centre) @ self._rotation

    def from_ellipse_frame(self, points: Points) -> Points:
        """Return points of the ellipse frame in the section frame.

        Parameters
        ----------
        points : (k, 2) ndarray
            Coordinates along the major and the minor axis, from the centre. Units: mm.

        Returns
        -------
        (k, 2) ndarray
            Points in the section frame. Units: mm.

        Examples
        --------
        >>> tilted = Ellipse((3.0, 0.0), 20.0, 10.0, theta=math.pi / 2)
        >>> tilted.from_ellipse_frame(np.array([[20.0, 0.0]])).round(9)
        array([[ 3., 20.]])
        """
        return points @ self._rotation.T + self.centre

    @property
    def _rotation(self) -> FloatArray:
        """Rotation (2, 2) from the ellipse frame to the section frame."""
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        return np.array([[cos, -sin], [sin, cos]])


def radial_residuals(points: Points, ellipse: Ellipse) -> FloatArray:
    """Return the signed distance of each point from the ellipse, along the ray from its centre.

    Parameters
    ----------
    points : (n, 2) ndarray
        Points in the section frame. Units: mm.
    ellipse : Ellipse
        Ellipse in the same frame.

    Returns
    -------
    (n,) ndarray
        Residuals, positive outside; the paper's r_j (Eq. 4) without the modulus. -b at the centre,
        where the ray is undefined. Units: mm.
    """
    u, v = ellipse.to_ellipse_frame(points).T
    a, b = ellipse.semi_major, ellipse.semi_minor
    # Eq. (4) divides by x_j - x_0; in the ellipse frame only the centre is singular.
    rho = np.hypot(u, v)
    scaled = np.hypot(b * u, a * v)
    divisor = np.where(scaled > 0, scaled, 1.0)
    return np.where(scaled > 0, rho - a * b * rho / divisor, -b)


def orthogonal_residuals(points: Points, ellipse: Ellipse) -> FloatArray:
    """Return the signed distance of each point from the nearest point of the ellipse.

    Parameters
    ----------
    points, ellipse
        As for `radial_residuals`.

    Returns
    -------
    (n,) ndarray
        Residuals, positive outside. Units: mm.

    Examples
    --------
    >>> circle = Ellipse((0.0, 0.0), 10.0, 10.0, 0.0)
    >>> orthogonal_residuals(np.array([[0.0, 12.0], [9.0, 0.0]]), circle)
    array([ 2., -1.])
    """
    points = ellipse.to_ellipse_frame(points)
    feet = find_foot_points(points, ellipse.semi_major, ellipse.semi_minor)
    u, v = points.T
    outside = np.hypot(u / ellipse.semi_major, v / ellipse.semi_minor) >= 1
    distances: FloatArray = np.hypot(*(points - feet).T)
    return np.where(outside, distances, -distances)


def find_foot_points(points: Points, a: float, b: float) -> Points:
    """Return the nearest points (n, 2) of an ellipse to points (n, 2), ellipse frame. Units: mm.

    `a` and `b` are its semi-axes along the first and the second coordinate.
    """
    cos, sin = find_foot_directions(points[:, 0], points[:, 1], a, b)
    return np.column_stack([a * cos, b * sin])


def find_foot_directions(
    u: FloatArray, v: FloatArray, a: float, b: float
) -> tuple[FloatArray, FloatArray]:
    """Return cosine and sine of the eccentric anomaly of the nearest point of an ellipse.

    Each step replaces the ellipse by its circle of curvature at the current foot point. The
    iteration converges from any start for points outside the evolute, and from the middle of
    the quadrant for points inside it.

    Parameters
    ----------
    u, v : (n,) ndarray
        Coordinates of the points, ellipse frame. Units: mm.
    a, b : float
        Semi-axes along u and v. Units: mm.

    Returns
    -------
    cos, sin : (n,) ndarray
        The nearest point is ``(a cos, b sin)``. At the centre of a circle, where it is undefined,
        both are sqrt(1/2).
    """
    p, q = np.abs(u), np.abs(v)
    cos, sin = _normalise(b * p, a * q)
    evolute = abs(a * a - b * b)
    # Cheap necessary condition: the evolute's cusps, at evolute / a and evolute / b, bound it.
    if min(a, b) * (p + q).min(initial=math.inf) <= evolute:
        inside = (a * p) ** (2 / 3) + (b * q) ** (2 / 3) <= evolute ** (2 / 3)
        # Inside the evolute the ray from the centre may lead to the farthest point; the evolute of
        # a circle is its centre, from which there is no ray.
        cos, sin = np.where(inside, math.sqrt(0.5), cos), np.where(inside, math.sqrt(0.5), sin)
    ca, cb = (a * a - b * b) / a, (b * b - a * a) / b
    for _ in range(MAX_FOOT_POINT_ITERATIONS if a != b else 0):
        # Centre of curvature (on the evolute) at the current foot point.
        ex, ey = ca * (cos * cos * cos), cb * (sin * sin * sin)
        dx, dy = p - ex, q - ey
        scale = np.hypot(a * cos - ex, b * sin - ey) / np.maximum(np.hypot(dx, dy), TINY)
        previous = cos
        cos, sin = _normalise(
            np.maximum(ex + dx * scale, 0.0) * b, np.maximum(ey + dy * scale, 0.0) * a
        )
        if np.abs(cos - previous).max(initial=0.0) < FOOT_POINT_TOLERANCE:
            break
    return np.copysign(cos, u), np.copysign(sin, v)


def _normalise(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the components of the unit vectors along (x, y); 0 for the zero vector."""
    norm = np.maximum(np.hypot(x, y), TINY)
    return x / norm, y / norm
