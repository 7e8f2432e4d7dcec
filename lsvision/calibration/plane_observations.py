"""Hand-eye observations of a plane: the straight line in which each section cuts it.

A line gives two numbers: the distance of its midpoint from the plane, and its slope.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.observations import (
    FlangePoses,
    Linearisation,
    States,
    solve_masked_least_squares,
)
from lsvision.calibration.rotations import rotations_from_columns
from lsvision.geometry import (
    BoolArray,
    FloatArray,
    IntArray,
    Plane,
    Pose,
    build_hemisphere_directions,
)

MAX_LINE_SLOPE = np.radians(60.0)
"""Largest slope of the line from the section's X in a planned pose; steeper planes reflect too
little light back. Units: rad."""
INITIAL_NORMALS = 90
"""Number of normals on a hemisphere, some 15 deg apart, from each of which a linear solution
starts."""


@dataclass(frozen=True, eq=False)
class PlaneObservations:
    """Lines of a plane (or of several), one for each pose.

    Parameters
    ----------
    midpoints : (n, 3) ndarray
        Midpoint of each line, section frame (z = 0). Units: mm.
    directions : (n, 3) ndarray
        Unit vectors along each line.
    rms_lengths : (n,) ndarray
        Root mean square distance of the points from the midpoint. Units: mm.
    covariances : (n, 2, 2) ndarray
        Covariance of offset (mm) and slope (rad).
    flanges : FlangePoses
        Flange pose of each observation.
    groups : (n,) ndarray
        Index of the plane that each pose observes.
    """

    midpoints: FloatArray
    directions: FloatArray
    rms_lengths: FloatArray
    covariances: FloatArray
    flanges: FlangePoses
    groups: IntArray

    @property
    def mm_per_residual(self) -> FloatArray:
        """Factors (2,) that convert residuals to mm: 1, and the mean rms length for the slope."""
        return np.array([1.0, float(self.rms_lengths.mean())])

    @property
    def target_prior(self) -> tuple[FloatArray, FloatArray]:
        """Mean and infinite standard deviation of two tilts and distance of the plane: no prior."""
        return np.zeros(3), np.full(3, np.inf)

    def linearise(self, states: States) -> Linearisation:
        """Return offset (n.p - d) / |n_xy| at the midpoint and slope n.u / |n_xy|, with Jacobians.

        p is the midpoint and u the direction of the line, n and d are normal and distance of the
        plane, and n_xy is the part of the normal in the section plane. The derivative of |n_xy| is
        neglected: it is multiplied by the residual (Gauss-Newton).
        """
        targets = states.targets[:, self.groups]
        normal, distance = targets[..., :3], targets[..., 3]
        mount_from_target = np.swapaxes(self.flanges.rotations, -1, -2)
        normal_in_mount = (mount_from_target @ normal[..., None])[..., 0]
        # Axis 2: the midpoint, for the offset, and the direction, which is not translated.
        vectors = np.stack([self.midpoints, self.directions], axis=1)
        vectors_in_mount = np.einsum("sij,nkj->snki", states.rotations, vectors)
        lever_arms = vectors_in_mount.copy()
        vectors_in_mount[:, :, 0] += states.translations[:, None]
        normal_in_section = (normal_in_mount[..., None, :] @ states.rotations[:, None])[..., 0, :2]
        xy_norm = np.maximum(np.linalg.norm(normal_in_section, axis=-1), 1e-9)[..., None]
        residuals = (vectors_in_mount @ normal_in_mount[..., None])[..., 0]
        vectors_in_target = vectors_in_mount @ mount_from_target
        origin_offset = (self.flanges.origins * normal).sum(axis=-1) - distance
        residuals[..., 0] += origin_offset
        rotation_jacobian = np.cross(lever_arms, normal_in_mount[..., None, :])
        mount_jacobian = np.concatenate(
            [np.zeros_like(rotation_jacobian), rotation_jacobian], axis=-1
        )
        mount_jacobian[..., 0, :3] = normal_in_mount
        flange_jacobian = np.concatenate(
            [np.zeros_like(vectors_in_target), np.cross(vectors_in_target, normal[..., None, :])],
            axis=-1,
        )
        flange_jacobian[..., 0, :3] = normal
        origins = np.zeros_like(vectors_in_target)
        origins[..., 0, :] = self.flanges.origins
        tangents = _build_tangent_bases(normal)
        tilt_jacobian = (vectors_in_target + origins) @ tangents
        distance_jacobian = np.broadcast_to(
            np.array([[-1.0], [0.0]]), (*tilt_jacobian.shape[:-1], 1)
        )
        scale = xy_norm[..., None]
        return Linearisation(
            residuals / xy_norm,
            mount_jacobian / scale,
            np.concatenate([tilt_jacobian, distance_jacobian], axis=-1) / scale,
            flange_jacobian / scale,
        )

    def update_targets(self, targets: FloatArray, steps: FloatArray) -> FloatArray:
        """Return the planes with tilted normal and changed distance."""
        tilt = (_build_tangent_bases(targets[..., :3]) @ steps[..., :2, None])[..., 0]
        normals = targets[..., :3] + tilt
        normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
        return np.concatenate([normals, targets[..., 3:] + steps[..., 2:]], axis=-1)

    def target_distance(self, first: FloatArray, second: FloatArray) -> float:
        """Return the mean distance of two planes at the flange origins. Units: mm."""
        distances = self.flanges.origins @ (first - second)[:3] - (first - second)[3]
        return float(np.abs(distances).mean())

    def estimate_initial_guesses(self, masks: FloatArray) -> States:
        """Return a linear solution for each selection of poses (k, n) and each of many normals.

        With the normal n given, n.(B X p) = d is linear in the first two columns of X's rotation,
        its translation and d; B is the pose of the mount, X that of the sensor on it.
        """
        normals = build_hemisphere_directions(INITIAL_NORMALS)
        count = int(self.groups.max()) + 1
        states = [self._solve_states_with_normal(normal, masks, count) for normal in normals]
        rotations = np.stack([state.rotations for state in states], axis=1)
        translations = np.stack([state.translations for state in states], axis=1)
        targets = np.stack([state.targets for state in states], axis=1)
        return States(
            rotations.reshape(-1, 3, 3),
            translations.reshape(-1, 3),
            targets.reshape(-1, count, 4),
        )

    def _solve_states_with_normal(
        self, normal: FloatArray, masks: FloatArray, count: int
    ) -> States:
        """Return the linear solution of each selection of poses for one normal.

        The normal is given in the target's frame; `count` is the number of planes.
        """
        # The normal in the frame of the mount.
        n = self.flanges.rotations.transpose(0, 2, 1) @ normal
        one_hot = (self.groups[:, None] == np.arange(count)).astype(np.float64)
        p, u = self.midpoints, self.directions * self.rms_lengths[:, None]
        offset = np.concatenate([n * p[:, :1], n * p[:, 1:2], n, -one_hot], axis=1)
        slope = np.concatenate([n * u[:, :1], n * u[:, 1:2], 0 * n, 0 * one_hot], axis=1)
        design = np.stack([offset, slope], axis=1)
        rhs = np.column_stack([-self.flanges.origins @ normal, np.zeros(len(p))])
        solution = solve_masked_least_squares(design, rhs, masks)
        rotations = rotations_from_columns(solution[:, :3], solution[:, 3:6])
        normals = np.broadcast_to(normal, (len(masks), count, 3))
        targets = np.concatenate([normals, solution[:, 9:, None]], axis=-1)
        return States(rotations, solution[:, 6:9], targets)


def _build_tangent_bases(normals: FloatArray) -> FloatArray:
    """Return two unit vectors perpendicular to each normal, as columns (..., 3, 2)."""
    smallest = np.abs(normals).argmin(axis=-1)
    first = np.cross(normals, np.eye(3)[smallest])
    first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=-1)


@dataclass(frozen=True, eq=False)
class PlanePlanningTarget:
    """Plane to be measured in planned poses.

    Parameters
    ----------
    plane : Plane
        Plane in the base frame; its normal points to the side that the sensor measures.
    centre : (3,) ndarray
        Point of the plane where the line is to lie, base frame. Units: mm.
    line_std : tuple of float
        Standard deviation of the line's offset (mm) and slope (rad).
    """

    plane: Plane
    centre: FloatArray
    line_std: tuple[float, float]

    @property
    def requirement(self) -> str:
        """Requirement on a pose, for an error message."""
        slope = np.degrees(MAX_LINE_SLOPE)
        return f"see the plate from its front, within {slope:.0f} deg,"

    @property
    def viewing_rotation(self) -> FloatArray:
        """Smallest rotation from the base's Z to the plane's normal."""
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
        """Largest useful distance of the laser plane from the centre: 0, since it has no effect."""
        return 0.0

    @property
    def state(self) -> FloatArray:
        """Normal and distance (mm) of the plane, base frame, (4,)."""
        return np.array([*self.plane.normal, self.plane.distance])

    @property
    def prior_std(self) -> tuple[float, ...]:
        """Prior standard deviation of two tilts of the normal (rad) and of the distance (mm)."""
        return (1.0, 1.0, 1000.0)

    def check_visibility(self, sections: Sequence[Pose]) -> tuple[FloatArray, BoolArray]:
        """Return the midpoint of each line, and whether its slope is at most `MAX_LINE_SLOPE`.

        The midpoint, (n, 3) in the section frame in mm, is where the plane cuts the section's Y.
        """
        normals = self._normals(sections)
        visible = normals[:, 1] > np.cos(MAX_LINE_SLOPE) * np.hypot(normals[:, 0], normals[:, 1])
        origins = np.array([pose.translation for pose in sections]).reshape(-1, 3)
        heights = -self.plane.signed_distances(origins) / np.where(visible, normals[:, 1], 1.0)
        zero = np.zeros(len(heights))
        return np.column_stack([zero, heights, zero]), visible

    def predict_observations(
        self, positions: FloatArray, sections: Sequence[Pose], flanges: FlangePoses
    ) -> PlaneObservations:
        """Return the lines of the plane without noise, with the midpoints of `check_visibility`."""
        x, y, _ = self._normals(sections).T
        count = len(sections)
        directions = np.column_stack([y, -x, np.zeros(count)])
        offset, slope = self.line_std
        return PlaneObservations(
            positions,
            directions / np.maximum(np.hypot(x, y), 1e-9)[:, None],
            np.full(count, offset / slope),  # rms length: the ratio of both standard deviations
            np.tile(np.diag([offset**2, slope**2]), (count, 1, 1)),
            flanges,
            np.zeros(count, dtype=np.int64),
        )

    def _normals(self, sections: Sequence[Pose]) -> FloatArray:
        """Return the plane's normal (n, 3) in each section frame."""
        normals = [pose.rotation.T @ self.plane.normal for pose in sections]
        return np.array(normals).reshape(-1, 3)
