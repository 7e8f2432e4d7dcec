"""Hand-eye observations of a board: its pose in the camera frame.

Eye in hand, ``base_from_flange @ X = Z @ board_from_camera`` at every pose, with
X = ``flange_from_camera`` and Z = ``base_from_board``. Initial guess: Park and Martin (IEEE Trans.
Robotics and Automation 10, 1994).
"""

from dataclasses import dataclass

import numpy as np

from lsvision.calibration.observations import (
    MM_PER_RADIAN,
    FlangePoses,
    Linearisation,
    States,
    solve_masked_least_squares,
    transform_to_sensor_frame,
)
from lsvision.calibration.rotations import (
    find_nearest_rotations,
    rotations_from_vectors,
    vectors_from_rotations,
)
from lsvision.geometry import FloatArray, IntArray

PAIR_ANGLES = np.radians((2.0, 170.0))
"""Smallest and largest rotation between two poses that the initial guess uses. Units: rad."""


@dataclass(frozen=True, eq=False)
class BoardObservations:
    """Poses of a board (or of several) in the camera frame.

    Parameters
    ----------
    rotations : (n, 3, 3) ndarray
        Rotations from the board to the camera frame.
    origins : (n, 3) ndarray
        Origin of the board in the camera frame. Units: mm.
    covariances : (n, 6, 6) ndarray
        Covariance of origin (mm) and left perturbation (rad).
    flanges : FlangePoses
        Flange pose of each observation.
    groups : (n,) ndarray
        Index of the board that each pose observes.
    """

    rotations: FloatArray
    origins: FloatArray
    covariances: FloatArray
    flanges: FlangePoses
    groups: IntArray

    @property
    def mm_per_residual(self) -> FloatArray:
        """Factors (6,) that convert residuals to mm: 1, and `MM_PER_RADIAN` for the rotation."""
        return np.array([1.0] * 3 + [MM_PER_RADIAN] * 3)

    @property
    def target_prior(self) -> tuple[FloatArray, FloatArray]:
        """Mean and infinite standard deviation of a board's pose: no prior."""
        return np.zeros(6), np.full(6, np.inf)

    def linearise(self, states: States) -> Linearisation:
        """Return residuals of origin and rotation, with Jacobians.

        The Jacobians neglect the rotation residual: they are exact where it is zero (Gauss-Newton).
        """
        targets = states.targets[:, self.groups]
        board = targets[..., 3:].reshape(*targets.shape[:-1], 3, 3)
        in_sensor, mount_jacobian, point_jacobian, flange_jacobian = transform_to_sensor_frame(
            self.flanges, states, targets[..., :3]
        )
        predicted = point_jacobian @ board
        rotation_residuals = vectors_from_rotations(self.rotations @ np.swapaxes(predicted, -1, -2))
        residuals = np.concatenate([self.origins - in_sensor, rotation_residuals], axis=-1)
        sensor_from_mount = np.broadcast_to(
            np.swapaxes(states.rotations, -1, -2)[:, None], point_jacobian.shape
        )
        zero = np.zeros_like(point_jacobian)
        return Linearisation(
            residuals,
            _stack_rows(-mount_jacobian, zero, sensor_from_mount),
            np.concatenate(
                [
                    np.concatenate([-point_jacobian, zero], axis=-1),
                    np.concatenate([zero, -point_jacobian], axis=-1),
                ],
                axis=-2,
            ),
            _stack_rows(-flange_jacobian, zero, point_jacobian),
        )

    def update_targets(self, targets: FloatArray, steps: FloatArray) -> FloatArray:
        """Return the boards after steps of translation (mm) and left perturbation (rad)."""
        board = targets[..., 3:].reshape(*targets.shape[:-1], 3, 3)
        rotated = find_nearest_rotations(rotations_from_vectors(steps[..., 3:]) @ board)
        flat = rotated.reshape(*targets.shape[:-1], 9)
        return np.concatenate([targets[..., :3] + steps[..., :3], flat], axis=-1)

    def target_distance(self, first: FloatArray, second: FloatArray) -> float:
        """Return the distance of the origins. Units: mm."""
        return float(np.linalg.norm((first - second)[:3]))

    def estimate_initial_guesses(self, masks: FloatArray) -> States:
        """Return the solution of Park and Martin for each selection of poses."""
        first, second = np.triu_indices(len(self.groups), k=1)
        same = self.groups[first] == self.groups[second]
        first, second = first[same], second[same]
        RB, tB = self.flanges.rotations, self.flanges.origins
        flange = np.swapaxes(RB[first], -1, -2) @ RB[second]
        camera = self.rotations[first] @ np.swapaxes(self.rotations[second], -1, -2)
        # alpha = X beta (Park and Martin) for the rotation vectors of each pair and the rotation X.
        alpha, beta = vectors_from_rotations(flange), vectors_from_rotations(camera)
        angle = np.linalg.norm(alpha, axis=1)
        usable = (angle > PAIR_ANGLES[0]) & (angle < PAIR_ANGLES[1])
        weights = masks[:, first] * masks[:, second] * usable
        moment = np.einsum("qk,ki,kj->qij", weights, alpha, beta)
        rotations = find_nearest_rotations(moment + 1e-12 * np.eye(3))
        # (R_A - 1) t = R t_B - t_A, Park and Martin Eq. (25), for each usable pair.
        flange_shift = np.einsum("kji,kj->ki", RB[first], tB[second] - tB[first])
        camera_shift = self.origins[first] - np.einsum("kij,kj->ki", camera, self.origins[second])
        rhs = np.einsum("qij,kj->qki", rotations, camera_shift) - flange_shift
        translations = solve_masked_least_squares(flange - np.eye(3), rhs, weights)
        return self._with_boards(rotations, translations, masks)

    def _with_boards(
        self, rotations: FloatArray, translations: FloatArray, masks: FloatArray
    ) -> States:
        """Return states with the mean board pose that the camera observes in each selection."""
        RB, tB = self.flanges.rotations, self.flanges.origins
        boards = RB @ rotations[:, None] @ self.rotations
        in_mount = np.einsum("qij,nj->qni", rotations, self.origins) + translations[:, None]
        origins = np.einsum("nij,qnj->qni", RB, in_mount) + tB
        targets = []
        for group in range(int(self.groups.max()) + 1):
            weights = masks * (self.groups == group)
            total = np.maximum(weights.sum(axis=1), 1e-12)[:, None]
            mean = np.einsum("qn,qni->qi", weights, origins) / total
            rotation = find_nearest_rotations(
                np.einsum("qn,qnij->qij", weights, boards) + 1e-12 * np.eye(3)
            )
            targets.append(np.concatenate([mean, rotation.reshape(-1, 9)], axis=-1))
        return States(rotations, translations, np.stack(targets, axis=1))


def _stack_rows(origin_rows: FloatArray, zero: FloatArray, rotation_rows: FloatArray) -> FloatArray:
    """Return six rows: derivatives of the origin, then of the rotation (zero by a translation)."""
    return np.concatenate([origin_rows, np.concatenate([zero, rotation_rows], axis=-1)], axis=-2)
