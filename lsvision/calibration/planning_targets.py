"""What the planner of poses must know of each kind of target that is still to be seen.

Each kind says where to look for it from, whether a section there would show it, and what that
would hold, as the very observations its calibration makes of profiles (`sphere_observations`,
`plane_observations`); `pose_planning` works on any of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lsvision.calibration.observations import FlangePoses, Observations
from lsvision.calibration.plane_observations import PlaneObservations
from lsvision.calibration.sphere_observations import HEIGHT_SCALE_PRIOR_STD, SphereObservations
from lsvision.geometry import BoolArray, FloatArray, Plane, Pose

ARC = np.radians(np.linspace(-60.0, 60.0, 61))
"""Angles of the points of an arc, from the section's Y. Units: rad."""
MAX_CUT_OFFSET = 0.95
"""Distance from the sphere's centre, in radii, at which an arc is too small to be found."""
MAX_LINE_SLOPE = np.radians(60.0)
"""Lean of the plate's line from the section's X beyond which little light comes back."""


class PlanningTarget(Protocol):
    """A target before which poses are to be chosen."""

    @property
    def requirement(self) -> str:
        """What a pose must do with the target, for a refusal."""
        ...

    @property
    def centre(self) -> FloatArray:
        """(3,) where the sensor looks, base frame. Units: mm."""
        ...

    @property
    def viewing_rotation(self) -> FloatArray:
        """(3, 3) turn that takes the base's Z to the way from which the target is seen."""
        ...

    @property
    def max_plane_offset(self) -> float:
        """Largest useful distance of the laser plane from the centre. Units: mm."""
        ...

    @property
    def state(self) -> FloatArray:
        """(k,) the target as `States` keeps it."""
        ...

    @property
    def prior_std(self) -> tuple[float, ...]:
        """(d,) one sigma of the target's steps before the first pose: next to nothing known."""
        ...

    def visibility(self, sections: Sequence[Pose]) -> tuple[FloatArray, BoolArray]:
        """(n, 3) place of the target in each section, mm, and whether it shows at all."""
        ...

    def predict_observations(
        self, places: FloatArray, sections: Sequence[Pose], flanges: FlangePoses
    ) -> Observations:
        """What sections would hold, without noise."""
        ...


@dataclass(frozen=True, eq=False)
class SpherePlanningTarget:
    """Sphere to be cut.

    Parameters
    ----------
    centre : (3,) ndarray
        Base frame. Units: mm.
    radius : float
        Units: mm.
    circle_std : float
        One sigma of a circle's centre along X; along Y and in radius three times that. Units: mm.
    offset : float
        Largest useful distance of the cut from the centre, in radii.
    """

    centre: FloatArray
    radius: float
    circle_std: float
    offset: float

    @property
    def requirement(self) -> str:
        """As in `PlanningTarget`."""
        return "cut the sphere"

    @property
    def viewing_rotation(self) -> FloatArray:
        """A sphere is the same from everywhere; it is looked at from above."""
        return np.eye(3)

    @property
    def max_plane_offset(self) -> float:
        """As in `PlanningTarget`."""
        return self.offset * self.radius

    @property
    def state(self) -> FloatArray:
        """Centre, radius and scale of heights."""
        return np.array([*self.centre, self.radius, 0.0])

    @property
    def prior_std(self) -> tuple[float, ...]:
        """Centre and radius in mm, scale of heights."""
        return (1000.0, 1000.0, 1000.0, 10.0, HEIGHT_SCALE_PRIOR_STD)

    def visibility(self, sections: Sequence[Pose]) -> tuple[FloatArray, BoolArray]:
        """Where the centre stands, and whether the cut is large enough."""
        places = np.array([pose.inverse().apply_one(self.centre) for pose in sections])
        places = places.reshape(-1, 3)
        return places, np.abs(places[:, 2]) < MAX_CUT_OFFSET * self.radius

    def predict_observations(
        self, places: FloatArray, sections: Sequence[Pose], flanges: FlangePoses
    ) -> SphereObservations:
        """Circles of the cuts."""
        count = len(sections)
        smallest = (0.1 * self.radius) ** 2
        circle = np.sqrt(np.maximum(self.radius**2 - places[:, 2] ** 2, smallest))
        return SphereObservations(
            np.column_stack([places[:, :2], circle]),
            np.tile(np.diag(self.circle_std**2 * np.array([1.0, 9.0, 9.0])), (count, 1, 1)),
            _stretches(places[:, 1], circle),
            flanges,
            (self.radius, np.inf),
            np.zeros(count, dtype=np.int64),
        )


def _stretches(heights: FloatArray, circle: FloatArray) -> FloatArray:
    """What `SphereObservations` asks for, of arcs not yet seen."""
    # Points r (sin, cos) whose heights grow by s move outwards by s r cos^2; a circle that
    # shifts in y and grows moves its points outwards by y cos + r.
    design = np.column_stack([np.cos(ARC), np.ones(len(ARC))])
    by_height, by_radius = np.linalg.lstsq(design, np.cos(ARC) ** 2, rcond=None)[0]
    stretches = np.zeros((len(circle), 2, 3))
    stretches[:, 0, 1] = by_height * circle + heights - heights.mean()
    stretches[:, 0, 2] = by_radius * circle
    return stretches


@dataclass(frozen=True, eq=False)
class PlanePlanningTarget:
    """Plate to be looked at.

    Parameters
    ----------
    plane : Plane
        Base frame; the normal points to the side that is seen.
    centre : (3,) ndarray
        On the plate, where the line is to lie. Units: mm.
    line_std : tuple of float
        One sigma of a line's offset (mm) and slope (rad).
    """

    plane: Plane
    centre: FloatArray
    line_std: tuple[float, float]

    @property
    def requirement(self) -> str:
        """As in `PlanningTarget`."""
        return "see the plate from its front, within 60 deg,"

    @property
    def viewing_rotation(self) -> FloatArray:
        """The shortest turn from the base's Z to the plate's normal."""
        x, y, z = self.plane.normal
        if z < -1 + 1e-9:
            return np.diag([1.0, -1.0, -1.0])
        # Rodrigues' formula with sin^2 / (1 - cos) = 1 + cos of the angle between the two.
        return np.array(
            [
                [1 - x * x / (1 + z), -x * y / (1 + z), x],
                [-x * y / (1 + z), 1 - y * y / (1 + z), y],
                [-x, -y, z],
            ]
        )

    @property
    def max_plane_offset(self) -> float:
        """A plate is the same everywhere: nothing is won beside the centre."""
        return 0.0

    @property
    def state(self) -> FloatArray:
        """Normal and distance."""
        return np.array([*self.plane.normal, self.plane.distance])

    @property
    def prior_std(self) -> tuple[float, ...]:
        """Two tilts of the normal in rad, distance in mm."""
        return (1.0, 1.0, 1000.0)

    def visibility(self, sections: Sequence[Pose]) -> tuple[FloatArray, BoolArray]:
        """Middle of the line below the section's origin, and whether it leans too far."""
        normals = self._normals(sections)
        shows = normals[:, 1] > np.cos(MAX_LINE_SLOPE) * np.hypot(normals[:, 0], normals[:, 1])
        origins = np.array([pose.translation for pose in sections]).reshape(-1, 3)
        heights = -self.plane.signed_distances(origins) / np.where(shows, normals[:, 1], 1.0)
        zero = np.zeros(len(heights))
        return np.column_stack([zero, heights, zero]), shows

    def predict_observations(
        self, places: FloatArray, sections: Sequence[Pose], flanges: FlangePoses
    ) -> PlaneObservations:
        """Lines of the plate."""
        x, y, _ = self._normals(sections).T
        count = len(sections)
        along = np.column_stack([y, -x, np.zeros(count)])
        offset, slope = self.line_std
        return PlaneObservations(
            places,
            along / np.maximum(np.hypot(x, y), 1e-9)[:, None],
            np.full(count, offset / slope),
            np.tile(np.diag([offset**2, slope**2]), (count, 1, 1)),
            flanges,
            np.zeros(count, dtype=np.int64),
        )

    def _normals(self, sections: Sequence[Pose]) -> FloatArray:
        """(n, 3) the plate's normal in each section."""
        turned = [pose.rotation.T @ self.plane.normal for pose in sections]
        return np.array(turned).reshape(-1, 3)
