"""A tube whose axis is an arc of a circle: the bent pipe that a scan is to notice."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import Cylinder, FloatArray, Points, Pose, as_readonly_array
from lsvision.simulate.rays import NO_HIT, Hits, Rays

STEPS = 400
"""Steps towards the surface; a ray at 85 deg incidence gains a digit in 26."""
ON_SURFACE = 1e-7
"""Distance at which a ray has arrived. Units: mm."""


@dataclass(frozen=True, eq=False)
class BentTube:
    """Solid tube around a full circle; a section near one place sees a bent pipe.

    Parameters
    ----------
    radius : float
        Of the tube. Units: mm.
    bend_centre : (3,) array_like
        Centre of the circle, base frame. Units: mm.
    bend_normal : (3,) array_like
        Normal of the circle's plane, any length but zero.
    bend_radius : float
        Radius of the axis; above `radius`. Units: mm.

    Examples
    --------
    >>> pipe = BentTube(10.0, (0.0, -1400.0, 0.0), (1.0, 0.0, 0.0), 1000.0)
    >>> down = Rays([[0.0, 0.0, 0.0]], [[0.0, -1.0, 0.0]])
    >>> pipe.first_hits(down).distances.round(6)
    array([390.])
    """

    radius: float
    bend_centre: FloatArray
    bend_normal: FloatArray
    bend_radius: float

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "bend_centre", as_readonly_array(self.bend_centre, (3,), "bend_centre")
        )
        normal = as_readonly_array(self.bend_normal, (3,), "bend_normal")
        length = float(np.linalg.norm(normal))
        if not length > 0:
            raise ValueError(f"want a bend_normal with a length, got {normal}")
        object.__setattr__(self, "bend_normal", as_readonly_array(normal / length, (3,)))
        if not 0 < self.radius < self.bend_radius < math.inf:
            raise ValueError(
                f"want 0 < radius < bend_radius mm, got {self.radius:g} and {self.bend_radius:g}"
            )

    def local_cylinder(self, base_from_section: Pose) -> Cylinder | None:
        """Cylinder along the axis' tangent where the section cuts it, nearest to the sensor."""
        normal = base_from_section.rotation[:, 2]
        first = normal - (normal @ self.bend_normal) * self.bend_normal
        slope = float(np.linalg.norm(first))
        if slope < 1e-9:
            return None
        first = first / slope
        second = np.cross(self.bend_normal, first)
        depth = float(normal @ (base_from_section.translation - self.bend_centre)) / slope
        if abs(depth) >= self.bend_radius:
            return None
        reach = math.sqrt(self.bend_radius**2 - depth**2)
        spokes = [depth * first + sign * reach * second for sign in (1.0, -1.0)]
        sensor = base_from_section.translation - self.bend_centre
        spoke = min(spokes, key=lambda place: float(np.linalg.norm(place - sensor)))
        tangent = np.cross(self.bend_normal, spoke)
        return Cylinder(self.bend_centre + spoke, tangent, self.radius)

    def first_hits(self, rays: Rays) -> Hits:
        """Where each ray first meets the tube.

        Each step goes as far as the distance to the surface, which never passes it. A ray
        within a degree of grazing may not arrive and then counts as a miss; no sensor sees there.
        """
        scale = np.linalg.norm(rays.directions, axis=1)
        units = rays.directions / scale[:, None]
        farthest = np.linalg.norm(rays.origins - self.bend_centre, axis=1) + 2 * self.bend_radius
        distances = np.zeros(len(units))
        going = np.ones(len(units), dtype=bool)
        gap = np.full(len(units), math.inf)
        for _ in range(STEPS):
            places = rays.origins[going] + distances[going, None] * units[going]
            gap[going] = self._gaps(places)[0]
            distances[going] += gap[going]
            going &= (gap > ON_SURFACE) & (distances < farthest)
            if not going.any():
                break
        _, outward = self._gaps(rays.origins + distances[:, None] * units)
        return Hits(np.where(gap <= ON_SURFACE, distances / scale, NO_HIT), outward)

    def _gaps(self, places: Points) -> tuple[FloatArray, FloatArray]:
        """Signed distance of (n, 3) places from the surface, and the direction away from it."""
        relative = places - self.bend_centre
        height = relative @ self.bend_normal
        flat = relative - height[:, None] * self.bend_normal
        spoke = np.linalg.norm(flat, axis=1)
        safe = np.where(spoke > 0, spoke, 1.0)
        from_axis = relative - flat * (self.bend_radius / safe)[:, None]
        length = np.linalg.norm(from_axis, axis=1)
        outward = from_axis / np.where(length > 0, length, 1.0)[:, None]
        return length - self.radius, outward
