"""What poses show of a plane: the straight line in which each section cuts it.

A line holds two numbers: how far it passes from the plane at its middle, and its slope.
"""

from dataclasses import dataclass, replace

import numpy as np

from lsvision.calibration.observations import FlangePoses, Linearisation, States
from lsvision.calibration.rotations import nearest_rotations
from lsvision.calibration.sensor_frame_points import masked_least_squares
from lsvision.geometry import FloatArray, IntArray

INITIAL_NORMALS = 90
"""Directions over half a sphere, some 15 deg apart: as near as the linear start asks for."""


@dataclass(frozen=True, eq=False)
class PlaneObservations:
    """Lines of a plane (or of several), one a pose.

    Parameters
    ----------
    midpoints : (n, 3) ndarray
        Middle of each line, section frame (z = 0). Units: mm.
    directions : (n, 3) ndarray
        Unit vectors along each line.
    half_lengths : (n,) ndarray
        Root mean square distance of the points from the middle. Units: mm.
    covariances : (n, 2, 2) ndarray
        Of offset (mm) and slope (rad).
    flanges : FlangePoses
        One a line.
    groups : (n,) ndarray
        Which plane each pose saw.
    """

    midpoints: FloatArray
    directions: FloatArray
    half_lengths: FloatArray
    covariances: FloatArray
    flanges: FlangePoses
    groups: IntArray

    @property
    def mm_per_residual(self) -> FloatArray:
        """Offset in mm; slope over half the line's length."""
        return np.array([1.0, float(self.half_lengths.mean())])

    @property
    def target_prior(self) -> tuple[FloatArray, FloatArray]:
        """A plane is free: two numbers of its normal, one of its distance."""
        return np.zeros(3), np.full(3, np.inf)

    def linearise(self, states: States) -> Linearisation:
        """Offset (n.p - d) / |n_xy| at the middle and slope n.u / |n_xy|, with derivatives.

        That of |n_xy| is left out: it counts by the residual's own size (Gauss-Newton).
        """
        targets = states.targets[:, self.groups]
        normal, distance = targets[..., :3], targets[..., 3]
        to_mount = np.swapaxes(self.flanges.rotations, -1, -2)
        in_mount = (to_mount @ normal[..., None])[..., 0]
        by_normal = np.stack(
            [_turned(states, v) for v in (self.midpoints, self.directions)], axis=2
        )
        arm = by_normal.copy()  # rotated by the sensor only: lever of a small turn of the mount
        by_normal[:, :, 0] += states.translations[:, None]
        flat = (in_mount[..., None, :] @ states.rotations[:, None])[..., 0, :2]
        width = np.maximum(np.linalg.norm(flat, axis=-1), 1e-9)[..., None]
        residuals = (by_normal @ in_mount[..., None])[..., 0]
        base = by_normal @ to_mount
        foot = (self.flanges.origins * normal).sum(axis=-1) - distance
        residuals[..., 0] += foot
        by_turn = np.cross(arm, in_mount[..., None, :])
        by_mount = np.concatenate([np.zeros_like(by_turn), by_turn], axis=-1)
        by_mount[..., 0, :3] = in_mount
        by_flange = np.concatenate(
            [np.zeros_like(base), np.cross(base, normal[..., None, :])], axis=-1
        )
        by_flange[..., 0, :3] = normal
        origins = np.zeros_like(base)
        origins[..., 0, :] = self.flanges.origins
        tangents = _tangents(normal)
        by_tilt = (base + origins) @ tangents
        by_distance = np.broadcast_to(np.array([[-1.0], [0.0]]), (*by_tilt.shape[:-1], 1))
        scale = width[..., None]
        return Linearisation(
            residuals / width,
            by_mount / scale,
            np.concatenate([by_tilt, by_distance], axis=-1) / scale,
            by_flange / scale,
        )

    def update_targets(self, targets: FloatArray, steps: FloatArray) -> FloatArray:
        """Plane with its normal tilted along its tangents and its distance changed."""
        tilt = (_tangents(targets[..., :3]) @ steps[..., :2, None])[..., 0]
        normals = targets[..., :3] + tilt
        normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
        return np.concatenate([normals, targets[..., 3:] + steps[..., 2:]], axis=-1)

    def prior_residuals(self, targets: FloatArray) -> FloatArray:
        """No prior."""
        return np.zeros((*targets.shape[:2], 3))

    def with_groups(self, groups: IntArray) -> "PlaneObservations":
        """The same lines, of several planes."""
        return replace(self, groups=groups)

    def with_flange_poses(self, flanges: FlangePoses) -> "PlaneObservations":
        """The same lines, had the flange stood elsewhere."""
        return replace(self, flanges=flanges)

    def target_distance(self, first: FloatArray, second: FloatArray) -> float:
        """Between the planes where they were seen, in the mean over the poses. Units: mm."""
        gaps = self.flanges.origins @ (first - second)[:3] - (first - second)[3]
        return float(np.abs(gaps).mean())

    def initial_guesses(self, masks: FloatArray) -> States:
        """For each selection and each of many normals, the linear solution of the rest.

        With the normal n given, n.(B X p) = d is linear in the first two columns of X's
        rotation, its translation and d.
        """
        normals = _half_sphere(INITIAL_NORMALS)
        count = int(self.groups.max()) + 1
        states = [self._states_of(normal, masks, count) for normal in normals]
        rotations = np.stack([state.rotations for state in states], axis=1)
        translations = np.stack([state.translations for state in states], axis=1)
        targets = np.stack([state.targets for state in states], axis=1)
        return States(
            rotations.reshape(-1, 3, 3),
            translations.reshape(-1, 3),
            targets.reshape(-1, count, 4),
        )

    def _states_of(self, normal: FloatArray, masks: FloatArray, count: int) -> States:
        seen = self.flanges.rotations.transpose(0, 2, 1) @ normal
        one_hot = (self.groups[:, None] == np.arange(count)).astype(np.float64)
        p, u = self.midpoints, self.directions * self.half_lengths[:, None]
        offset = np.concatenate([seen * p[:, :1], seen * p[:, 1:2], seen, -one_hot], axis=1)
        slope = np.concatenate([seen * u[:, :1], seen * u[:, 1:2], 0 * seen, 0 * one_hot], axis=1)
        design = np.stack([offset, slope], axis=1)
        right = np.column_stack([-self.flanges.origins @ normal, np.zeros(len(p))])
        solution = masked_least_squares(design, right, masks)
        first, second = solution[:, :3], solution[:, 3:6]
        raw = np.stack([first, second, np.cross(first, second)], axis=-1)
        length = np.maximum(np.linalg.norm(raw, axis=(1, 2)), 1e-12)[:, None, None]
        normals = np.broadcast_to(normal, (len(masks), count, 3))
        targets = np.concatenate([normals, solution[:, 9:, None]], axis=-1)
        return States(nearest_rotations(raw / length), solution[:, 6:9], targets)


def _turned(states: States, vectors: FloatArray) -> FloatArray:
    """Vectors (n, 3) of the sensor's frame along the mount's axes; (s, n, 3)."""
    turned: FloatArray = np.einsum("sij,nj->sni", states.rotations, vectors)
    return turned


def _tangents(normals: FloatArray) -> FloatArray:
    """Two unit vectors across each normal, as columns; (..., 3) -> (..., 3, 2)."""
    smallest = np.abs(normals).argmin(axis=-1)
    first = np.cross(normals, np.eye(3)[smallest])
    first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=-1)


def _half_sphere(count: int) -> FloatArray:
    """Directions evenly over half a sphere (Fibonacci lattice)."""
    index = np.arange(count) + 0.5
    height = index / count
    angle = np.pi * (1 + 5**0.5) * index
    width = np.sqrt(1 - height**2)
    return np.column_stack([width * np.cos(angle), width * np.sin(angle), height])
