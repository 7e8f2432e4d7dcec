"""What poses show of a board: its whole pose before the camera.

``base_from_flange X = Z board_from_camera`` at every pose, X the camera on its mount and Z the
board. The start is Park and Martin's (IEEE Trans. Robotics and Automation 10, 1994).
"""

from dataclasses import dataclass, replace

import numpy as np

from lsvision.calibration.observations import FlangePoses, Linearisation, States
from lsvision.calibration.rotations import nearest_rotations, rotation_vectors, rotations_of
from lsvision.calibration.sensor_frame_points import masked_least_squares, points_in_sensor_frame
from lsvision.geometry import FloatArray, IntArray

MM_PER_RADIAN = 100.0
"""Millimetres that a radian of the board's orientation counts for in a search."""
PAIR_ANGLES = np.radians((2.0, 170.0))
"""Turns between two poses that Park and Martin's start can use."""


@dataclass(frozen=True, eq=False)
class BoardObservations:
    """Poses of a board (or of several) before the camera.

    Parameters
    ----------
    rotations : (n, 3, 3) ndarray
        Board to camera.
    origins : (n, 3) ndarray
        Board's origin in the camera frame. Units: mm.
    covariances : (n, 6, 6) ndarray
        Of origin (mm) and left-hand rotation (rad).
    flanges : FlangePoses
        One a sighting.
    groups : (n,) ndarray
        Which board each pose saw.
    """

    rotations: FloatArray
    origins: FloatArray
    covariances: FloatArray
    flanges: FlangePoses
    groups: IntArray

    @property
    def mm_per_residual(self) -> FloatArray:
        """Origin in mm; orientation over 100 mm."""
        return np.array([1.0] * 3 + [MM_PER_RADIAN] * 3)

    @property
    def target_prior(self) -> tuple[FloatArray, FloatArray]:
        """The board's pose is free."""
        return np.zeros(6), np.full(6, np.inf)

    def linearise(self, states: States) -> Linearisation:
        """Residuals of origin and orientation, to first order of the latter's size."""
        targets = states.targets[:, self.groups]
        board = targets[..., 3:].reshape(*targets.shape[:-1], 3, 3)
        seen, by_mount, by_point, by_flange = points_in_sensor_frame(
            self.flanges, states, targets[..., :3]
        )
        predicted = by_point @ board
        turned = rotation_vectors(self.rotations @ np.swapaxes(predicted, -1, -2))
        residuals = np.concatenate([self.origins - seen, turned], axis=-1)
        to_sensor = np.broadcast_to(np.swapaxes(states.rotations, -1, -2)[:, None], by_point.shape)
        zero = np.zeros_like(by_point)
        return Linearisation(
            residuals,
            _stacked(-by_mount, zero, to_sensor),
            np.concatenate(
                [
                    np.concatenate([-by_point, zero], axis=-1),
                    np.concatenate([zero, -by_point], axis=-1),
                ],
                axis=-2,
            ),
            _stacked(-by_flange, zero, by_point),
        )

    def update_targets(self, targets: FloatArray, steps: FloatArray) -> FloatArray:
        """Board shifted and turned from the left."""
        board = targets[..., 3:].reshape(*targets.shape[:-1], 3, 3)
        turned = nearest_rotations(rotations_of(steps[..., 3:]) @ board)
        flat = turned.reshape(*targets.shape[:-1], 9)
        return np.concatenate([targets[..., :3] + steps[..., :3], flat], axis=-1)

    def prior_residuals(self, targets: FloatArray) -> FloatArray:
        """No prior."""
        return np.zeros((*targets.shape[:2], 6))

    def with_groups(self, groups: IntArray) -> "BoardObservations":
        """The same sightings, of several boards."""
        return replace(self, groups=groups)

    def with_flange_poses(self, flanges: FlangePoses) -> "BoardObservations":
        """The same sightings, had the flange stood elsewhere."""
        return replace(self, flanges=flanges)

    def target_distance(self, first: FloatArray, second: FloatArray) -> float:
        """Between the origins. Units: mm."""
        return float(np.linalg.norm((first - second)[:3]))

    def initial_guesses(self, masks: FloatArray) -> States:
        """Park and Martin's solution, one for each selection."""
        first, second = np.triu_indices(len(self.groups), k=1)
        same = self.groups[first] == self.groups[second]
        first, second = first[same], second[same]
        RB, tB = self.flanges.rotations, self.flanges.origins
        flange = np.swapaxes(RB[first], -1, -2) @ RB[second]
        camera = self.rotations[first] @ np.swapaxes(self.rotations[second], -1, -2)
        alpha, beta = rotation_vectors(flange), rotation_vectors(camera)
        angle = np.linalg.norm(alpha, axis=1)
        usable = (angle > PAIR_ANGLES[0]) & (angle < PAIR_ANGLES[1])
        weights = masks[:, first] * masks[:, second] * usable
        moment = np.einsum("qk,ki,kj->qij", weights, alpha, beta)
        rotations = nearest_rotations(moment + 1e-12 * np.eye(3))
        # (R_A - 1) t = R t_B - t_A, Park and Martin Eq. (25), for each usable pair.
        shift = np.einsum("kji,kj->ki", RB[first], tB[second] - tB[first])
        moved = self.origins[first] - np.einsum("kij,kj->ki", camera, self.origins[second])
        right = np.einsum("qij,kj->qki", rotations, moved) - shift
        translations = masked_least_squares(flange - np.eye(3), right, weights)
        return self._with_boards(rotations, translations, masks)

    def _with_boards(
        self, rotations: FloatArray, translations: FloatArray, masks: FloatArray
    ) -> States:
        """Mean board that each selection's camera sees."""
        RB, tB = self.flanges.rotations, self.flanges.origins
        boards = RB @ rotations[:, None] @ self.rotations
        in_mount = np.einsum("qij,nj->qni", rotations, self.origins) + translations[:, None]
        origins = np.einsum("nij,qnj->qni", RB, in_mount) + tB
        targets = []
        for group in range(int(self.groups.max()) + 1):
            weights = masks * (self.groups == group)
            total = np.maximum(weights.sum(axis=1), 1e-12)[:, None]
            mean = np.einsum("qn,qni->qi", weights, origins) / total
            rotation = nearest_rotations(
                np.einsum("qn,qnij->qij", weights, boards) + 1e-12 * np.eye(3)
            )
            targets.append(np.concatenate([mean, rotation.reshape(-1, 9)], axis=-1))
        return States(rotations, translations, np.stack(targets, axis=1))


def _stacked(of_origin: FloatArray, zero: FloatArray, of_turn: FloatArray) -> FloatArray:
    """Six rows: the origin's derivatives above those of the orientation (rotation only)."""
    return np.concatenate([of_origin, np.concatenate([zero, of_turn], axis=-1)], axis=-2)
