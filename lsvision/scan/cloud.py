"""Point cloud of a scan: the points of all sections in the base frame, with covariances."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from lsvision.cylinder.problem import rotate_covariances
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import BoolArray, FloatArray, IntArray, Points, Pose
from lsvision.profile import NoiseModel, Profile

MIN_POINTS = 6
"""Profiles with fewer points are skipped: too few for an ellipse."""
COPLANAR_MM, COPLANAR_RAD = 1e-6, 1e-9
"""Differences of position and orientation below which two laser planes count as the same."""


class PosedPoints(Protocol):
    """Points of a scan with the poses of their sections, such as a `ScanCloud`."""

    @property
    def points(self) -> Points:
        """Points (n, 3), base frame. Units: mm."""

    @property
    def point_sections(self) -> IntArray:
        """Index of each point's profile, (n,)."""

    @property
    def poses(self) -> tuple[Pose, ...]:
        """``base_from_section`` of each profile."""


@dataclass(frozen=True, eq=False, slots=True)
class ScanCloud:
    """Points of all sections, ordered by profile and along the laser line.

    Parameters
    ----------
    points : (n, 3) ndarray
        Base frame, without lost points. Units: mm.
    covariances : (n, 3, 3) ndarray
        Covariance of each point's error, base frame. Units: mm^2.
    point_sections : (n,) int ndarray
        Index of each point's profile.
    indices : (n,) int ndarray
        Index of each point in its profile.
    noise_known : bool
        Whether the covariances come from a noise model; otherwise they are estimates.
    poses : tuple of Pose
        ``base_from_section`` of each profile.
    """

    points: Points
    covariances: FloatArray
    point_sections: IntArray
    indices: IntArray
    noise_known: bool
    poses: tuple[Pose, ...]

    @property
    def towards_sensor(self) -> FloatArray:
        """Unit vector of each section towards the sensor, (k, 3): its Y axis in the base frame."""
        return np.array([pose.rotation[:, 1] for pose in self.poses])

    def __len__(self) -> int:
        return len(self.points)

    def find_rows(self, section: int, indices: IntArray) -> IntArray:
        """Return the rows with the given points of a profile, without those not in the cloud."""
        start, stop = np.searchsorted(self.point_sections, [section, section + 1])
        present = self.indices[start:stop]
        requested = np.zeros(max(present.max(initial=-1), indices.max(initial=-1)) + 1, dtype=bool)
        requested[indices] = True
        rows: IntArray = start + np.flatnonzero(requested[present])
        return rows

    def contains(self, sections: IntArray, indices: IntArray) -> BoolArray:
        """Return whether the cloud contains each of some points, by profile and index (n,)."""
        stride = int(max(self.indices.max(initial=0), indices.max(initial=0))) + 1
        # A table, which takes a tenth of the time of `np.isin`.
        table = np.zeros((len(self.poses), stride), dtype=bool)
        table[self.point_sections, self.indices] = True
        return table[sections, indices]

    def select_rows(self, rows: IntArray) -> "ScanCloud":
        """Return the cloud with only the given rows."""
        return replace(
            self,
            points=self.points[rows],
            covariances=self.covariances[rows],
            point_sections=self.point_sections[rows],
            indices=self.indices[rows],
        )


def has_enough_points(profile: Profile) -> bool:
    """Return whether a profile has `MIN_POINTS` or more points that are not lost."""
    return len(profile) - profile.lost >= MIN_POINTS


def build_cloud(
    profiles: Sequence[Profile], base_from_sections: Sequence[Pose], sensor: NoiseModel | None
) -> ScanCloud:
    """Return the points of profiles (section frame) in the base frame, with their covariances.

    Profiles without enough points contribute none. Without a noise model of all profiles
    (`sensor`), that of each profile is used; if one profile has none, the noise of all of them is
    estimated.
    """
    noise_known = sensor is not None or all(profile.noise is not None for profile in profiles)
    section_arrays = []
    for section, (profile, pose) in enumerate(zip(profiles, base_from_sections, strict=True)):
        prepared = prepare_profile(profile, (sensor or profile.noise) if noise_known else None)
        axes = pose.rotation[:, :2]
        valid = prepared.valid_indices if has_enough_points(profile) else np.zeros(0, np.int64)
        covariances = rotate_covariances(prepared.noisy_points[valid].covariances, axes)
        points, columns = pose.apply(prepared.points[valid]), prepared.sensor_columns[valid]
        section_arrays.append((points, covariances, np.full(len(valid), section), columns))
    points, covariances, point_sections, indices = (
        np.concatenate(arrays) for arrays in zip(*section_arrays, strict=True)
    )
    return ScanCloud(
        points, covariances, point_sections, indices, noise_known, tuple(base_from_sections)
    )


def require_noncoplanar_sections(base_from_sections: Sequence[Pose]) -> None:
    """Raise an error if two or more sections all lie in one plane.

    Raises
    ------
    DegenerateGeometry
        If they do: like one section, they fit two cylinders equally well (twins), whose axes are
        tilted to opposite sides of the plane's normal.
    """
    if len(base_from_sections) < 2:
        return
    first = base_from_sections[0]
    normal = first.rotation[:, 2]
    normals = np.array([pose.rotation[:, 2] for pose in base_from_sections])
    origins = np.array([pose.translation for pose in base_from_sections])
    angle = np.linalg.norm(np.cross(normals, normal), axis=1).max()
    distance = np.abs((origins - first.translation) @ normal).max()
    if angle < COPLANAR_RAD and distance < COPLANAR_MM:
        raise DegenerateGeometry(
            f"all {len(base_from_sections)} sections lie in one plane (poses identical, or moved "
            "along the plane only), where the two twins of each axis cannot be distinguished: "
            "move the sensor out of its laser plane between profiles, or check feed and pose file"
        )
