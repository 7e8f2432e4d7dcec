"""Which points of a pipe a sensor sees."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import Cylinder, Ellipse, FloatArray, Points
from lsvision.geometry.arrays import BoolArray
from lsvision.sensors.profile_sensor import LPS36HI, ProfileSensor


@dataclass(frozen=True, kw_only=True, slots=True)
class SensorView:
    """Sensor and place from which a pipe is looked at.

    Parameters
    ----------
    sensor : ProfileSensor
        Its rays fan out from its origin; noise and limits are its own.
    standoff : float
        Distance from the section frame's origin to the section's centre along -Y. Units: mm.
    offset : float
        The centre's x. Units: mm.
    pitch : float, optional
        Spacing of the rays in X at the standoff; None = the sensor's columns spread evenly
        over its width. Units: mm.
    incidence_limit : float
        Largest angle between the ray and the surface's normal at which a point is still
        returned. The default is that of a matt pipe; a glossy one returns less. Units: rad.

    Raises
    ------
    ValueError
        If a length is not positive or the limit is not in (0, pi/2].
    """

    sensor: ProfileSensor = LPS36HI
    standoff: float = 400.0
    offset: float = 0.0
    pitch: float | None = None
    incidence_limit: float = math.radians(70)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.standoff) and self.standoff > 0):
            raise ValueError(f"want a positive standoff in mm, got {self.standoff}")
        if not math.isfinite(self.offset):
            raise ValueError(f"want a finite offset in mm, got {self.offset}")
        if self.pitch is not None and not (math.isfinite(self.pitch) and self.pitch > 0):
            raise ValueError(f"want a positive pitch in mm, got {self.pitch}")
        if not 0 < self.incidence_limit <= math.pi / 2:
            raise ValueError(
                f"want an incidence_limit in (0, pi/2] rad, got {self.incidence_limit}"
            )

    @property
    def rays(self) -> FloatArray:
        """(n, 2) unit directions of the rays, left to right."""
        sensor = self.sensor
        half = sensor.width_at_max_range / 2
        if self.pitch is None:
            steps = np.linspace(-half, half, sensor.columns)
            targets = np.column_stack([steps, np.full(len(steps), -sensor.max_range)])
        else:
            depth = self.standoff + sensor.origin[1]
            reach = half * depth / sensor.max_range
            steps = self.pitch * np.arange(-(reach // self.pitch), reach // self.pitch + 1)
            targets = np.column_stack([steps, np.full(len(steps), -depth)])
        rays: FloatArray = targets / np.linalg.norm(targets, axis=1, keepdims=True)
        return rays


def visible_points(cylinder: Cylinder, view: SensorView) -> Points:
    """Noise-free points that a view gives of one cylinder alone.

    Parameters
    ----------
    cylinder : Cylinder
        In the section frame; where it stands counts, not the view's standoff and offset.
    view : SensorView
        Sensor, pitch and limit of incidence.

    Returns
    -------
    (n, 2) ndarray
        Section frame, left to right; only the points seen. Units: mm.
    """
    rays, sensor = view.rays, view.sensor
    ranges = _first_hits(cylinder.section(), np.asarray(sensor.origin), rays)
    hit = np.isfinite(ranges)
    rays, ranges = rays[hit], ranges[hit]
    points: Points = sensor.origin + rays * ranges[:, None]
    cosines = -np.sum(cylinder_normals(cylinder, points)[:, :2] * rays, axis=1)
    seen: BoolArray = (
        (ranges >= sensor.min_range)
        & (ranges <= sensor.max_range)
        & (cosines > 0)
        & (cosines >= math.cos(view.incidence_limit))
    )
    return points[seen]


def cylinder_normals(cylinder: Cylinder, points: Points) -> FloatArray:
    """(n, 3) outward unit normals at (n, 2) or (n, 3) points of the surface."""
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    from_axis = points - cylinder.point
    across = from_axis - np.outer(from_axis @ cylinder.direction, cylinder.direction)
    normals: FloatArray = across / np.linalg.norm(across, axis=1, keepdims=True)
    return normals


def _first_hits(ellipse: Ellipse, origin: FloatArray, rays: FloatArray) -> FloatArray:
    """Range at which each ray meets the ellipse first, NaN where it misses. Units: mm."""
    # In the ellipse's own frame, each axis divided by its length, it is the unit circle.
    axes = (ellipse.semi_major, ellipse.semi_minor)
    start = (ellipse.to_ellipse_frame(origin[None]) / axes)[0]
    heading = ellipse.to_ellipse_frame(rays + ellipse.centre) / axes
    square, mixed = np.sum(heading**2, axis=1), heading @ start
    under_root = mixed**2 - square * (start @ start - 1)
    root = np.sqrt(np.where(under_root > 0, under_root, np.nan))
    ranges: FloatArray = (-mixed - root) / square
    return np.where(ranges > 0, ranges, np.nan)
