"""All points of a scan in the base frame, each with its covariance and where it came from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lsvision.detection.profile_preparation import prepare_profile
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import FloatArray, IntArray, Points, Pose
from lsvision.profile import NoiseModel, Profile

SAME_POSE_MM, SAME_POSE_RAD = 1e-6, 1e-9
"""Sections that differ by less lie in one plane."""


@dataclass(frozen=True, eq=False, slots=True)
class ScanCloud:
    """Points of all sections, in the order of the profiles and along their lines.

    Parameters
    ----------
    points : (n, 3) ndarray
        Base frame, none lost. Units: mm.
    covariances : (n, 3, 3) ndarray
        Base frame. Units: mm^2.
    point_sections : (n,) int ndarray
        Index of each point's profile.
    indices : (n,) int ndarray
        Index of the point in its profile.
    noise_known : bool
        Whether the covariances are a noise model's, not estimates.
    poses : tuple of Pose
        ``base_from_section``, one a profile.
    """

    points: Points
    covariances: FloatArray
    point_sections: IntArray
    indices: IntArray
    noise_known: bool
    poses: tuple[Pose, ...]

    @property
    def towards_sensor(self) -> FloatArray:
        """(k, 3) Y of each section in the base frame."""
        return np.array([pose.rotation[:, 1] for pose in self.poses])

    def __len__(self) -> int:
        return len(self.points)

    def rows_of(self, section: int, indices: IntArray) -> IntArray:
        """Rows of the cloud that hold the given points of a profile."""
        first, last = np.searchsorted(self.point_sections, [section, section + 1])
        found: IntArray = first + np.flatnonzero(np.isin(self.indices[first:last], indices))
        return found

    def subset(self, rows: IntArray) -> "ScanCloud":
        """The cloud of some rows."""
        return replace(
            self,
            points=self.points[rows],
            covariances=self.covariances[rows],
            point_sections=self.point_sections[rows],
            indices=self.indices[rows],
        )

    def excluding(self, other: "ScanCloud") -> "ScanCloud":
        """The cloud less the points of another."""
        stride = int(max(self.indices.max(initial=0), other.indices.max(initial=0))) + 1
        taken = np.isin(
            self.point_sections * stride + self.indices,
            other.point_sections * stride + other.indices,
        )
        return self.subset(np.flatnonzero(~taken))


def build_cloud(
    profiles: Sequence[Profile], base_from_sections: Sequence[Pose], sensor: NoiseModel | None
) -> ScanCloud:
    """Bring the points of all profiles to the base frame.

    Parameters
    ----------
    profiles : sequence of Profile
        Section frames.
    base_from_sections : sequence of Pose
        One a profile.
    sensor : NoiseModel or None
        None: each profile's own; where one of them has none, all are estimated.
    """
    known = sensor is not None or all(profile.noise is not None for profile in profiles)
    parts = []
    for owner, (profile, pose) in enumerate(zip(profiles, base_from_sections, strict=True)):
        weighed = prepare_profile(profile, (sensor or profile.noise) if known else None)
        plane, order = pose.rotation[:, :2], weighed.valid_indices
        covariances = plane @ weighed.noisy_points[order].covariances @ plane.T
        points, columns = pose.apply(weighed.points[order]), weighed.sensor_columns[order]
        parts.append((points, covariances, np.full(len(order), owner), columns))
    points, covariances, owners, indices = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    return ScanCloud(points, covariances, owners, indices, known, tuple(base_from_sections))


def require_noncoplanar_sections(base_from_sections: Sequence[Pose]) -> None:
    """Refuse two or more sections that all lie in one plane.

    Raises
    ------
    DegenerateGeometry
        One plane seen again and again says no more than one section.
    """
    if len(base_from_sections) < 2:
        return
    first = base_from_sections[0]
    normal = first.rotation[:, 2]
    turn = max(np.linalg.norm(np.cross(p.rotation[:, 2], normal)) for p in base_from_sections)
    step = max(abs(normal @ (p.translation - first.translation)) for p in base_from_sections)
    if turn < SAME_POSE_RAD and step < SAME_POSE_MM:
        raise DegenerateGeometry(
            f"all {len(base_from_sections)} sections lie in one plane (poses identical, or moved "
            "along the plane only), which leaves the twins of each axis apart by nothing: move "
            "the sensor out of its laser plane between profiles, or check feed and pose file"
        )
