"""Planned view of a cylinder, planned scan, and the exact points that a sensor measures."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import Cylinder, Ellipse, FloatArray, Points
from lsvision.geometry.arrays import BoolArray
from lsvision.geometry.settings_repr import ShowsChanges
from lsvision.sensors.profile_sensor import LPS36HI, ProfileSensor

MAX_POSE_OR_FEED_STD = 1000.0
"""Largest standard uncertainty of a scan's poses (mm) and of its feed direction (rad), which no
scan has: with far larger ones covariances overflow."""


@dataclass(frozen=True, kw_only=True, repr=False)
class SensorView(ShowsChanges):
    """Sensor, and its position relative to the cylinder.

    Parameters
    ----------
    sensor : ProfileSensor
        Sensor whose rays diverge from its origin, with its noise and measuring range.
    standoff : float
        Distance from the origin of the section frame to the section's centre along -Y.
        Units: mm.
    offset : float
        X of the section's centre. Units: mm.
    pitch : float, optional
        Distance of the rays in X at the standoff. None: the sensor's columns, evenly spaced over
        its width. Units: mm.
    incidence_limit : float
        Largest angle between ray and surface normal at which a point is measured. The default
        is for a matt cylinder; a glossy one needs a smaller one. Units: rad.

    Raises
    ------
    ValueError
        If standoff or pitch is not positive, the offset not finite, or the limit not in (0, pi/2].
    """

    sensor: ProfileSensor = LPS36HI
    standoff: float = 400.0
    offset: float = 0.0
    pitch: float | None = None
    incidence_limit: float = math.radians(70)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.standoff) and self.standoff > 0):
            raise ValueError(f"expected a positive standoff in mm, got {self.standoff}")
        if not math.isfinite(self.offset):
            raise ValueError(f"expected a finite offset in mm, got {self.offset}")
        if self.pitch is not None and not (math.isfinite(self.pitch) and self.pitch > 0):
            raise ValueError(f"expected a positive pitch in mm, got {self.pitch}")
        if not 0 < self.incidence_limit <= math.pi / 2:
            raise ValueError(
                f"expected an incidence_limit in (0, pi/2] rad, got {self.incidence_limit}"
            )

    @property
    def rays(self) -> FloatArray:
        """Unit vectors (n, 2) along the rays from the sensor's origin, by ascending x."""
        sensor = self.sensor
        half = sensor.width_at_max_range / 2
        if self.pitch is None:
            x = np.linspace(-half, half, sensor.columns)
            targets = np.column_stack([x, np.full(len(x), -sensor.max_range)])
        else:
            depth = self.standoff + sensor.origin[1]
            half_at_depth = half * depth / sensor.max_range
            # Rays on either side of the middle one; -1, for a standoff behind the sensor's origin,
            # gives no rays at all.
            count = half_at_depth // self.pitch if depth > 0 else -1.0
            x = self.pitch * np.arange(-count, count + 1)
            targets = np.column_stack([x, np.full(len(x), -depth)])
        rays: FloatArray = targets / np.linalg.norm(targets, axis=1, keepdims=True)
        return rays


@dataclass(frozen=True, kw_only=True)
class Feed:
    """Parallel, equidistant sections of a scan, and the uncertainty of their poses.

    Parameters
    ----------
    sections : int
        Number of sections.
    spacing : float
        Distance between adjacent sections. Units: mm.
    direction : tuple of float
        Direction of the feed in the section frame, of any non-zero length.
    pose_std : float
        Standard uncertainty of each section's position, per axis, independent between sections.
        Units: mm.
    feed_std : float
        Standard uncertainty of the feed direction about each axis perpendicular to it, common to
        all sections. It turns the fitted axis by nearly as much, and hardly changes the
        residuals. Units: rad.

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    sections: int = 20
    spacing: float = 1.0
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0)
    pose_std: float = 0.0
    feed_std: float = 0.0

    def __post_init__(self) -> None:
        if not (isinstance(self.sections, int | np.integer) and self.sections >= 1):
            raise ValueError(f"expected a whole number of sections >= 1, got {self.sections}")
        if not (math.isfinite(self.spacing) and self.spacing > 0):
            raise ValueError(f"expected a positive spacing in mm, got {self.spacing}")
        length = math.hypot(*self.direction)
        if not (math.isfinite(length) and length > 0):
            raise ValueError(f"expected a finite, non-zero feed direction, got {self.direction}")
        for name in ("pose_std", "feed_std"):
            value = getattr(self, name)
            if not 0 <= value <= MAX_POSE_OR_FEED_STD:
                raise ValueError(
                    f"expected {name} >= 0 and at most {MAX_POSE_OR_FEED_STD:g}, got {value}"
                )

    @property
    def unit(self) -> FloatArray:
        """Unit vector (3,) along the feed."""
        return np.array(self.direction) / math.hypot(*self.direction)

    @property
    def length(self) -> float:
        """Distance from the first section to the last. Units: mm."""
        return (self.sections - 1) * self.spacing

    @property
    def shifts(self) -> FloatArray:
        """Positions (sections, 3) of the sections from the middle of the scan. Units: mm."""
        steps = (np.arange(self.sections) - (self.sections - 1) / 2) * self.spacing
        return np.outer(steps, self.unit)


def find_visible_points(cylinder: Cylinder, view: SensorView) -> Points:
    """Return the noise-free points (n, 2) that a sensor measures of one cylinder, in mm.

    Both are in the section frame; the cylinder need not be where the view places it. The
    points are in the order of the rays; a pitch is that at the view's standoff.
    """
    rays, sensor = view.rays, view.sensor
    ranges = _find_first_hits(cylinder.section(), np.asarray(sensor.origin), rays)
    hit = np.isfinite(ranges)
    rays, ranges = rays[hit], ranges[hit]
    points: Points = sensor.origin + rays * ranges[:, None]
    # The limits of the measuring range are depths along -Y, not distances along the ray.
    depths = sensor.origin[1] - points[:, 1]
    cosines = -np.sum(cylinder_normals(cylinder, points)[:, :2] * rays, axis=1)
    visible: BoolArray = (
        (depths >= sensor.min_range)
        & (depths <= sensor.max_range)
        & (cosines >= math.cos(view.incidence_limit))
    )
    return points[visible]


def cylinder_normals(cylinder: Cylinder, points: Points) -> FloatArray:
    """Return the (n, 3) outward unit normals at (n, 2) or (n, 3) points of the surface."""
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    return cylinder.normals(points)


def _find_first_hits(ellipse: Ellipse, origin: FloatArray, rays: FloatArray) -> FloatArray:
    """Return the range at which each ray first meets the ellipse, or NaN. Units: mm."""
    # In the ellipse frame, with each coordinate divided by its semi-axis, the ellipse is the unit
    # circle. Directions are only rotated to that frame: adding the centre cancels the shift.
    axes = (ellipse.semi_major, ellipse.semi_minor)
    start = (ellipse.to_ellipse_frame(origin[None]) / axes)[0]
    direction = ellipse.to_ellipse_frame(rays + ellipse.centre) / axes
    square, half = np.sum(direction**2, axis=1), direction @ start
    discriminant = half**2 - square * (start @ start - 1)
    root = np.sqrt(np.where(discriminant > 0, discriminant, np.nan))
    ranges: FloatArray = (-half - root) / square
    return np.where(ranges > 0, ranges, np.nan)
