"""Solids of a simulated scene, and their intersections with rays: tube, bent tube, prism.

Tubes are solid: a ray that starts inside meets nothing. A prism is a surface, visible from both
sides. All intersections but those of the bent tube are in closed form.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from lsvision.geometry import Cylinder, FloatArray, IntArray, Points, Pose, build_tangent_frame
from lsvision.geometry.arguments import as_numbers
from lsvision.geometry.arrays import as_unit_vector, freeze_arrays

NO_HIT = math.inf
"""Distance of a ray that meets nothing."""
MIN_AXIS_COSINE = math.sin(1e-6)
"""Cosine between the axis of a tube, or of a prism, and the normal of a section below which the
section does not cut it."""
PARALLEL_SINE = 1e-9
"""Sine of an angle below which two directions, or a direction and a plane, are parallel."""
MAX_TRACING_STEPS = 400
"""Maximum number of sphere tracing steps; at 85 deg incidence, 26 steps gain one digit."""
TRACING_TOLERANCE = 1e-7
"""Distance from the surface at which sphere tracing stops. Units: mm."""


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays in space.

    Parameters
    ----------
    origins : (n, 3) array_like
        Start of each ray. Units: mm.
    directions : (n, 3) array_like
        Direction of each ray, not much shorter than 1; distances along a ray are multiples of it.
    """

    origins: Points
    directions: FloatArray

    def __post_init__(self) -> None:
        freeze_arrays(self, origins=("n", 3))
        freeze_arrays(self, directions=self.origins.shape)

    def transformed(self, a_from_b: Pose) -> "Rays":
        """Return the rays of frame b in the coordinates of frame a."""
        return Rays(a_from_b.apply(self.origins), self.directions @ a_from_b.rotation.T)


@dataclass(frozen=True, eq=False)
class Hits:
    """First intersections of rays with a surface.

    Parameters
    ----------
    distances : (n,) ndarray
        Distance along each ray, in lengths of its direction; `NO_HIT` if it meets nothing.
    normals : (n, 3) ndarray
        Unit normals towards the origins of the rays; undefined where nothing is met.
    """

    distances: FloatArray
    normals: FloatArray


@dataclass(frozen=True, eq=False)
class Tube:
    """Solid straight tube with flat ends.

    Parameters
    ----------
    cylinder : Cylinder
        Cylinder in the base frame.
    span : tuple of float, optional
        Start and end along ``cylinder.direction`` from ``cylinder.point``; infinite length if
        None. Units: mm.

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
        if self.span is not None:
            expected = "a span (start, stop) in mm with start < stop"
            start, stop = as_numbers(self.span, 2, expected)
            if not start < stop:
                raise ValueError(f"expected {expected}, got {self.span}")

    @classmethod
    def of(cls, radius: float, theta: float, phi: float, centre: tuple[float, float]) -> Self:
        """Return the tube of infinite length with a given section in the plane z = 0.

        Its axis crosses the plane at `centre` in mm, and is tilted from Z by `phi` towards the
        major axis, whose direction is `theta`, in rad.
        """
        sin_phi = math.sin(phi)
        axis = np.array([sin_phi * math.cos(theta), sin_phi * math.sin(theta), math.cos(phi)])
        return cls(Cylinder(np.array([*centre, 0.0]), axis, radius))

    def local_cylinder(self, base_from_section: Pose) -> Cylinder | None:
        """Return the cylinder of the tube, or None if the section does not cut its axis."""
        normal, axis = base_from_section.rotation[:, 2], self.cylinder.direction
        cosine = float(normal @ axis)
        if abs(cosine) < MIN_AXIS_COSINE:
            return None
        to_plane = normal @ (base_from_section.translation - self.cylinder.point)
        start, stop = self.span or (-math.inf, math.inf)
        return self.cylinder if start <= float(to_plane) / cosine <= stop else None

    def first_hits(self, rays: Rays) -> Hits:
        """Return where each ray enters the solid; a ray that starts inside meets nothing."""
        axis = self.cylinder.direction
        start = rays.origins - self.cylinder.point
        axial_start, axial_ray = start @ axis, rays.directions @ axis
        radial_start = start - axial_start[:, None] * axis
        radial_ray = rays.directions - axial_ray[:, None] * axis
        side = _circle_interval(radial_start, radial_ray, self.cylinder.radius)
        ends = _slab_interval(axial_start, axial_ray, self.span)
        entry, exit_ = np.maximum(side[0], ends[0]), np.minimum(side[1], ends[1])
        hit = (entry < exit_) & (entry > 0)
        distances = np.where(hit, entry, NO_HIT)
        finite = np.where(hit, entry, 0.0)
        side_normals = (radial_start + finite[:, None] * radial_ray) / self.cylinder.radius
        end_normals = -np.sign(axial_ray)[:, None] * axis
        through_end = (ends[0] > side[0])[:, None]
        return Hits(distances, np.where(through_end, end_normals, side_normals))


def _circle_interval(
    start: FloatArray, ray: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray]:
    """Return where rays enter and leave an infinite tube, from components normal to its axis.

    A ray that meets nothing enters at infinity and leaves at minus infinity; one along the axis
    inside the tube enters at minus infinity.
    """
    squared = np.einsum("ij,ij->i", ray, ray)
    half = np.einsum("ij,ij->i", start, ray)
    outside = np.einsum("ij,ij->i", start, start) - radius**2
    discriminant = half**2 - squared * outside
    parallel = squared < PARALLEL_SINE**2
    root = np.sqrt(np.maximum(discriminant, 0.0))
    divisor = np.where(parallel, 1.0, squared)
    missed = np.where(parallel, outside > 0, discriminant <= 0)
    entry = np.where(parallel, -math.inf, (-half - root) / divisor)
    exit_ = np.where(parallel, math.inf, (-half + root) / divisor)
    return np.where(missed, NO_HIT, entry), np.where(missed, -math.inf, exit_)


def _slab_interval(
    start: FloatArray, ray: FloatArray, span: tuple[float, float] | None
) -> tuple[FloatArray, FloatArray]:
    """Return where rays enter and leave the slab between a tube's ends, along its axis."""
    infinite = np.full(len(start), math.inf)
    if span is None:
        return -infinite, infinite
    parallel = np.abs(ray) < PARALLEL_SINE
    divisor = np.where(parallel, 1.0, ray)
    low, high = (span[0] - start) / divisor, (span[1] - start) / divisor
    outside = (start < span[0]) | (start > span[1])
    entry = np.where(parallel, np.where(outside, math.inf, -math.inf), np.minimum(low, high))
    return entry, np.where(parallel, math.inf, np.maximum(low, high))


@dataclass(frozen=True, eq=False)
class BentTube:
    """Solid tube whose axis is a circle: a torus.

    Parameters
    ----------
    radius : float
        Radius of the tube. Units: mm.
    bend_centre : (3,) array_like
        Centre of the circle, base frame. Units: mm.
    bend_normal : (3,) array_like
        Normal of the circle's plane, of any non-zero length.
    bend_radius : float
        Radius of the circle; larger than `radius`. Units: mm.

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
        freeze_arrays(self, bend_centre=(3,))
        object.__setattr__(self, "bend_normal", as_unit_vector(self.bend_normal, "bend_normal")[0])
        if not 0 < self.radius < self.bend_radius < math.inf:
            raise ValueError(
                f"expected 0 < radius < bend_radius mm, got {self.radius:g} and "
                f"{self.bend_radius:g}"
            )

    def local_cylinder(self, base_from_section: Pose) -> Cylinder | None:
        """Return the cylinder along the tangent of the axis where the section cuts it.

        Of the two intersections, the one nearer to the sensor; None if there is none.
        """
        normal = base_from_section.rotation[:, 2]
        first = normal - (normal @ self.bend_normal) * self.bend_normal
        sine = float(np.linalg.norm(first))
        if sine < PARALLEL_SINE:
            return None
        first = first / sine
        second = np.cross(self.bend_normal, first)
        # The section cuts the plane of the circle in a line at this distance from the centre.
        distance = float(normal @ (base_from_section.translation - self.bend_centre)) / sine
        if abs(distance) >= self.bend_radius:
            return None
        half_chord = math.sqrt(self.bend_radius**2 - distance**2)
        # Coordinates relative to the centre of the circle.
        intersections = [distance * first + sign * half_chord * second for sign in (1.0, -1.0)]
        sensor = base_from_section.translation - self.bend_centre
        nearest = min(intersections, key=lambda point: float(np.linalg.norm(point - sensor)))
        tangent = np.cross(self.bend_normal, nearest)
        return Cylinder(self.bend_centre + nearest, tangent, self.radius)

    def first_hits(self, rays: Rays) -> Hits:
        """Return where each ray enters the solid, by sphere tracing; none if it starts inside.

        Each step is the distance to the surface, so that a ray never passes through it. A ray
        within 2 deg of grazing may not converge and then counts as a miss; no sensor measures
        there.
        """
        scale = np.linalg.norm(rays.directions, axis=1)
        units = rays.directions / scale[:, None]
        max_distances = (
            np.linalg.norm(rays.origins - self.bend_centre, axis=1) + 2 * self.bend_radius
        )
        distances = np.zeros(len(units))
        active = self._surface_distances(rays.origins)[0] > 0
        gaps = np.full(len(units), math.inf)
        for _ in range(MAX_TRACING_STEPS):
            points = rays.origins[active] + distances[active, None] * units[active]
            gaps[active] = self._surface_distances(points)[0]
            distances[active] += gaps[active]
            active &= (gaps > TRACING_TOLERANCE) & (distances < max_distances)
            if not active.any():
                break
        _, normals = self._surface_distances(rays.origins + distances[:, None] * units)
        return Hits(np.where(gaps <= TRACING_TOLERANCE, distances / scale, NO_HIT), normals)

    def _surface_distances(self, points: Points) -> tuple[FloatArray, FloatArray]:
        """Return signed distances of (n, 3) points from the surface, and outward normals."""
        relative = points - self.bend_centre
        height = relative @ self.bend_normal
        in_plane = relative - height[:, None] * self.bend_normal
        distance = np.linalg.norm(in_plane, axis=1)
        central = distance == 0
        # From the axis of the bend all points of the circle are equally near: any one will do.
        in_plane[central], distance[central] = build_tangent_frame(self.bend_normal)[0], 1.0
        from_axis = relative - in_plane * (self.bend_radius / distance)[:, None]
        length = np.linalg.norm(from_axis, axis=1)
        normals = from_axis / np.where(length > 0, length, 1.0)[:, None]
        return length - self.radius, normals


@dataclass(frozen=True, eq=False)
class Prism:
    """Surface of an outline in the plane z = 0, extruded to infinite length.

    Parameters
    ----------
    outline : (k, 2) array_like
        Vertices of a polyline; repeat the first one to close it. Units: mm.
    along : tuple of float
        Direction of extrusion, not parallel to the plane z = 0.

    Examples
    --------
    >>> plate = Prism([[-50.0, -400.0], [50.0, -400.0]])
    >>> down = Rays([[0.0, 0.0, 0.0], [60.0, 0.0, 0.0]], [[0.0, -1.0, 0.0]] * 2)
    >>> plate.first_hits(down).distances
    array([400.,  inf])
    """

    outline: Points
    along: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        freeze_arrays(self, outline=("n", 2))
        if len(self.outline) < 2 or not np.isfinite(self.outline).all():
            raise ValueError(f"expected at least two finite vertices, got {self.outline.tolist()}")
        if abs(self.along[2]) < MIN_AXIS_COSINE * math.hypot(*self.along):
            raise ValueError(f"expected an extrusion that crosses z = 0, got {self.along}")

    def first_hits(self, rays: Rays) -> Hits:
        """Return where each ray first meets the surface, from either side."""
        # Projected along the extrusion, the prism is its outline and a ray a straight line.
        shear = np.array([self.along[0], self.along[1]]) / self.along[2]
        start = rays.origins[:, :2] - rays.origins[:, 2:] * shear
        ray = rays.directions[:, :2] - rays.directions[:, 2:] * shear
        distances, segments = _find_first_segments(start, ray, self.outline)
        dx, dy = np.diff(self.outline, axis=0)[segments].T
        # The normal is perpendicular to the segment and to the direction of extrusion.
        normals = np.column_stack([-dy, dx, dy * shear[0] - dx * shear[1]])
        length = np.linalg.norm(normals, axis=1)
        normals /= np.where(length > 0, length, 1.0)[:, None]
        points_away = np.einsum("ij,ij->i", normals, rays.directions) > 0
        normals[points_away] *= -1
        return Hits(distances, normals)


def _find_first_segments(
    start: Points, ray: FloatArray, outline: Points
) -> tuple[FloatArray, IntArray]:
    """Return the distance along each ray to the outline, and the index of the segment met."""
    segment = np.diff(outline, axis=0)
    determinant = ray[:, 0, None] * segment[:, 1] - ray[:, 1, None] * segment[:, 0]
    divisor = np.where(determinant == 0, 1.0, determinant)
    to_x = outline[:-1, 0] - start[:, 0, None]
    to_y = outline[:-1, 1] - start[:, 1, None]
    distance = (to_x * segment[:, 1] - to_y * segment[:, 0]) / divisor
    fraction = (to_x * ray[:, 1, None] - to_y * ray[:, 0, None]) / divisor
    hit = (determinant != 0) & (fraction >= 0) & (fraction <= 1) & (distance > 0)
    distances = np.where(hit, distance, NO_HIT)
    segments = distances.argmin(axis=1)
    return distances[np.arange(len(start)), segments], segments.astype(np.int64)
