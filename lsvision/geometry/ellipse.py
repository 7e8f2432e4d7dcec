"""The ellipse that the laser plane cuts out of a circular cylinder (paper section 2)."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from lsvision.geometry.arrays import FloatArray, Points

TINY = 1e-300
MAX_FOOT_POINT_ITERATIONS = 30
FOOT_POINT_TOLERANCE = 1e-5
"""The search gains about two digits a step near the ellipse and stops after this change of the
direction (rad), which a distance feels by its square only; far from it it needs more steps."""


@dataclass(frozen=True, slots=True)
class Ellipse:
    """Section of a circular cylinder by the laser plane.

    Parameters
    ----------
    centre : tuple of float
        ``(x, y)`` in the section frame. Units: mm.
    semi_major, semi_minor : float
        Symbols: a, b. Units: mm. ``semi_major >= semi_minor > 0``.
    theta : float
        Direction of the major axis from X towards Y; kept in [0, pi). Units: rad.

    Raises
    ------
    ValueError
        If the axes are out of order or not positive, or a number is not finite.

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
        numbers = (*self.centre, self.semi_major, self.semi_minor, self.theta)
        if not all(map(math.isfinite, numbers)):
            raise ValueError(f"want finite numbers, got {numbers}")
        if not self.semi_major >= self.semi_minor > 0:
            raise ValueError(
                f"want semi_major >= semi_minor > 0 mm, got {self.semi_major:g} and "
                f"{self.semi_minor:g}: Ellipse.from_axes orders a pair of axes"
            )
        object.__setattr__(self, "centre", (float(self.centre[0]), float(self.centre[1])))
        theta = self.theta % math.pi
        object.__setattr__(self, "theta", 0.0 if theta == math.pi else theta)

    @classmethod
    def from_axes(
        cls, centre: tuple[float, float], first: float, second: float, direction: float
    ) -> Self:
        """Ellipse of two semi-axes in any order.

        Parameters
        ----------
        centre : tuple of float
            ``(x, y)``. Units: mm.
        first, second : float
            Semi-axes. Units: mm.
        direction : float
            Direction of the `first` semi-axis from X towards Y. Units: rad.
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
        """Both cylinder axes that have this section.

        Definition: cos(phi) n +/- sin(phi) m, with n = Z the laser plane's normal and m the
        major axis; the paper's (theta, phi) does not tell them apart. Shape (2, 3), unit
        vectors in the section frame.
        """
        cos_phi, sin_phi = math.cos(self.phi), math.sin(self.phi)
        m = np.array([math.cos(self.theta), math.sin(self.theta), 0.0])
        n = np.array([0.0, 0.0, 1.0])
        return np.stack([cos_phi * n + sin_phi * m, cos_phi * n - sin_phi * m])

    def points_at(self, parameter: FloatArray) -> Points:
        """Points of the ellipse at the eccentric anomaly.

        Parameters
        ----------
        parameter : (k,) ndarray
            Eccentric anomaly, 0 at the tip of the major axis. Units: rad.

        Returns
        -------
        (k, 2) ndarray
            Section frame. Units: mm.
        """
        along = np.column_stack(
            [self.semi_major * np.cos(parameter), self.semi_minor * np.sin(parameter)]
        )
        return self.from_ellipse_frame(along)

    def to_ellipse_frame(self, points: Points) -> Points:
        """(k, 2) points of the section frame in the frame of the ellipse's own axes. Units: mm."""
        return (points - self.centre) @ self._rotation

    def from_ellipse_frame(self, points: Points) -> Points:
        """(k, 2) points of the ellipse's own axes in the section frame. Units: mm."""
        return points @ self._rotation.T + self.centre

    @property
    def _rotation(self) -> FloatArray:
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        return np.array([[cos, -sin], [sin, cos]])


def radial_residuals(points: Points, ellipse: Ellipse) -> FloatArray:
    """Signed distance of each point from the ellipse, along the ray from its centre.

    Parameters
    ----------
    points : (n, 2) ndarray
        Section frame. Units: mm.
    ellipse : Ellipse
        The ellipse to compare with.

    Returns
    -------
    (n,) ndarray
        Positive outside. Units: mm. The paper's r_j (Eq. 4) without its modulus; -b at the
        centre itself, where the ray has no direction.
    """
    u, v = ellipse.to_ellipse_frame(points).T
    a, b = ellipse.semi_major, ellipse.semi_minor
    # Eq. (4) divides by x_j - x_0; in the ellipse's own frame only the centre is special.
    rho = np.hypot(u, v)
    scaled = np.hypot(b * u, a * v)
    safe = np.where(scaled > 0, scaled, 1.0)
    radial: FloatArray = np.where(scaled > 0, rho - a * b * rho / safe, -b)
    return radial


def orthogonal_residuals(points: Points, ellipse: Ellipse) -> FloatArray:
    """Signed distance of each point from the nearest point of the ellipse.

    Parameters
    ----------
    points : (n, 2) ndarray
        Section frame. Units: mm.
    ellipse : Ellipse
        The ellipse to compare with.

    Returns
    -------
    (n,) ndarray
        Positive outside. Units: mm.

    Examples
    --------
    >>> circle = Ellipse((0.0, 0.0), 10.0, 10.0, 0.0)
    >>> orthogonal_residuals(np.array([[0.0, 12.0], [9.0, 0.0]]), circle)
    array([ 2., -1.])
    """
    own = ellipse.to_ellipse_frame(points)
    foot = foot_points(own, ellipse.semi_major, ellipse.semi_minor)
    u, v = own.T
    outside = np.hypot(u / ellipse.semi_major, v / ellipse.semi_minor) >= 1
    gap: FloatArray = np.hypot(*(own - foot).T)
    return np.where(outside, gap, -gap)


def foot_points(own: Points, a: float, b: float) -> Points:
    """Nearest points of an axis-parallel ellipse at the origin.

    Parameters
    ----------
    own : (n, 2) ndarray
        Points in the ellipse's own frame. Units: mm.
    a, b : float
        Semi-axes along the first and the second coordinate. Units: mm.

    Returns
    -------
    (n, 2) ndarray
        Own frame. Units: mm.
    """
    wu, wv = foot_directions(own[:, 0], own[:, 1], a, b)
    return np.column_stack([a * wu, b * wv])


def foot_directions(
    u: FloatArray, v: FloatArray, a: float, b: float, close: float = FOOT_POINT_TOLERANCE
) -> tuple[FloatArray, FloatArray]:
    """Cosine and sine of the eccentric anomaly of the nearest point of an ellipse.

    Each step replaces the ellipse by its circle of curvature at the foot point found so far;
    outside the evolute that converges from any start, within it from the middle of the quadrant.

    Parameters
    ----------
    u, v : (n,) ndarray
        Points in the ellipse's own frame. Units: mm.
    a, b : float
        Semi-axes along u and v. Units: mm.
    close : float
        A step shorter than this is the last. What remains to the nearest point is of the order
        of its square, times the gap over the radius of curvature.

    Returns
    -------
    cos, sin : (n,) ndarray
        The nearest point is ``(a cos, b sin)``.
    """
    p, q = np.abs(u), np.abs(v)
    cos, sin = _unit(b * p, a * q)
    evolute = abs(a * a - b * b)
    # The evolute's cusps, at evolute / a and evolute / b from the centre, are its farthest points.
    if min(a, b) * (p + q).min(initial=math.inf) < evolute:
        within = (a * p) ** (2 / 3) + (b * q) ** (2 / 3) < evolute ** (2 / 3)
        # Within the evolute the ray from the centre may lead to the farthest point.
        cos, sin = np.where(within, math.sqrt(0.5), cos), np.where(within, math.sqrt(0.5), sin)
    ca, cb = (a * a - b * b) / a, (b * b - a * a) / b
    for _ in range(MAX_FOOT_POINT_ITERATIONS if a != b else 0):
        # Centre of curvature (on the evolute) of the foot point found so far.
        ex, ey = ca * (cos * cos * cos), cb * (sin * sin * sin)
        dx, dy = p - ex, q - ey
        stretch = np.hypot(a * cos - ex, b * sin - ey) / np.maximum(np.hypot(dx, dy), TINY)
        last = cos
        cos, sin = _unit(
            np.maximum(ex + dx * stretch, 0.0) * b, np.maximum(ey + dy * stretch, 0.0) * a
        )
        if np.abs(cos - last).max(initial=0.0) < close:
            break
    return np.copysign(cos, u), np.copysign(sin, v)


def _unit(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    norm = np.maximum(np.hypot(x, y), TINY)
    return x / norm, y / norm
