"""The straight tube: what is to be found."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from lsvision.geometry import Cylinder, FloatArray, Pose
from lsvision.simulate.rays import NO_HIT, Hits, Rays


@dataclass(frozen=True, eq=False)
class Tube:
    """Solid straight tube with flat ends.

    Parameters
    ----------
    cylinder : Cylinder
        Base frame.
    span : tuple of float, optional
        Where it starts and ends along ``cylinder.direction`` from ``cylinder.point``; endless
        without. Units: mm.

    Examples
    --------
    >>> tube = Tube.of(radius=10.0, theta=0.0, phi=0.5, centre=(0.0, -400.0))
    >>> down = Rays([[0.0, 0.0, 0.0]], [[0.0, -1.0, 0.0]])
    >>> tube.first_hits(down).distances
    array([390.])
    """

    cylinder: Cylinder
    span: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.span is not None and not self.span[0] < self.span[1]:
            raise ValueError(f"want a span (start, stop) in mm with start < stop, got {self.span}")

    @classmethod
    def of(cls, radius: float, theta: float, phi: float, centre: tuple[float, float]) -> Self:
        """Endless tube by what its section in the plane z = 0 shows.

        Parameters
        ----------
        radius : float
            Units: mm.
        theta, phi : float
            Direction of the major axis, and tilt of the axis from Z towards it. Units: rad.
        centre : tuple of float
            Where the axis meets the plane. Units: mm.
        """
        tilt = math.sin(phi)
        axis = np.array([tilt * math.cos(theta), tilt * math.sin(theta), math.cos(phi)])
        return cls(Cylinder(np.array([*centre, 0.0]), axis, radius))

    def local_cylinder(self, base_from_section: Pose) -> Cylinder | None:
        """The tube's own cylinder; None where the section misses its axis."""
        normal, axis = base_from_section.rotation[:, 2], self.cylinder.direction
        slope = float(normal @ axis)
        if abs(slope) < math.sin(1e-6):
            return None
        to_plane = normal @ (base_from_section.translation - self.cylinder.point)
        start, stop = self.span or (-math.inf, math.inf)
        return self.cylinder if start <= float(to_plane) / slope <= stop else None

    def first_hits(self, rays: Rays) -> Hits:
        """Where each ray enters the solid; one that starts inside sees nothing of it."""
        axis = self.cylinder.direction
        start = rays.origins - self.cylinder.point
        start_along, ray_along = start @ axis, rays.directions @ axis
        start_across = start - start_along[:, None] * axis
        ray_across = rays.directions - ray_along[:, None] * axis
        side = _circle_interval(start_across, ray_across, self.cylinder.radius)
        ends = _slab_interval(start_along, ray_along, self.span)
        entry, leave = np.maximum(side[0], ends[0]), np.minimum(side[1], ends[1])
        met = (entry < leave) & (entry > 0)
        distances = np.where(met, entry, NO_HIT)
        reach = np.where(met & np.isfinite(entry), entry, 0.0)
        outward = (start_across + reach[:, None] * ray_across) / self.cylinder.radius
        through_end = (ends[0] > side[0])[:, None]
        facing = -np.sign(ray_along)[:, None] * axis
        return Hits(distances, np.where(through_end, facing, outward))


def _circle_interval(
    start: FloatArray, ray: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray]:
    """Where rays, seen along a tube's axis, enter and leave its round side."""
    squared = np.einsum("ij,ij->i", ray, ray)
    half = np.einsum("ij,ij->i", start, ray)
    gap = np.einsum("ij,ij->i", start, start) - radius**2
    discriminant = half**2 - squared * gap
    parallel = squared < 1e-18
    root = np.sqrt(np.maximum(discriminant, 0.0))
    safe = np.where(parallel, 1.0, squared)
    never = np.where(parallel, gap > 0, discriminant <= 0)
    entry = np.where(parallel, -math.inf, (-half - root) / safe)
    leave = np.where(parallel, math.inf, (-half + root) / safe)
    return np.where(never, NO_HIT, entry), np.where(never, -math.inf, leave)


def _slab_interval(
    start: FloatArray, ray: FloatArray, span: tuple[float, float] | None
) -> tuple[FloatArray, FloatArray]:
    """Where rays enter and leave the slab between a tube's two ends."""
    endless = np.full(len(start), math.inf)
    if span is None:
        return -endless, endless
    level = np.abs(ray) < 1e-12
    safe = np.where(level, 1.0, ray)
    low, high = (span[0] - start) / safe, (span[1] - start) / safe
    outside = (start < span[0]) | (start > span[1])
    entry = np.where(level, np.where(outside, math.inf, -math.inf), np.minimum(low, high))
    return entry, np.where(level, math.inf, np.maximum(low, high))
