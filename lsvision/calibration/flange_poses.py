"""Robot poses as the calibration needs them: stacked, with the robot's error, and their motion."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from lsvision.calibration.observations import FlangePoses
from lsvision.calibration.rotations import cross_matrices, rotation_vectors
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import FloatArray, Pose

Mounting = Literal["eye_in_hand", "eye_to_hand"]

MIN_ROTATION = np.radians(2.0)
"""A flange that turns less did not turn: a robot's error in orientation is 0.01 deg and up."""
MIN_SECOND_AXIS = 0.03
"""Least share of turning about a second axis; a tilt of 1 deg beside spins of 30 deg."""


def stack_flange_poses(
    base_from_flanges: Sequence[Pose], mounting: Mounting, robot_std: tuple[float, float]
) -> FlangePoses:
    """Poses ``target's frame from mount`` with the covariance the robot's error gives them.

    Parameters
    ----------
    base_from_flanges : sequence of Pose
        As the robot says.
    mounting : {"eye_in_hand", "eye_to_hand"}
        Sensor on the flange before a target in the base frame, or sensor in the base frame
        before a target on the flange; then the poses are inverted, and their errors with them.
    robot_std : tuple of float
        One sigma in each axis of position (mm) and orientation (rad).
    """
    R = np.array([pose.rotation for pose in base_from_flanges])
    t = np.array([pose.translation for pose in base_from_flanges])
    unit = np.diag([robot_std[0] ** 2] * 3 + [robot_std[1] ** 2] * 3)
    covariances = np.broadcast_to(unit, (len(t), 6, 6))
    if mounting == "eye_in_hand":
        return FlangePoses(R, t, covariances)
    inverse = np.swapaxes(R, -1, -2)
    # B -> (1 + d)(B) gives t' = -R't - R'dt + R'(w x t), R' -> (1 - [R'w]x) R'.
    transfer = np.zeros((len(t), 6, 6))
    transfer[:, :3, :3], transfer[:, 3:, 3:] = -inverse, -inverse
    transfer[:, :3, 3:] = -inverse @ cross_matrices(t)
    covariances = transfer @ covariances @ np.swapaxes(transfer, -1, -2)
    return FlangePoses(inverse, -(inverse @ t[..., None])[..., 0], covariances)


def require_rotation(base_from_flanges: Sequence[Pose]) -> None:
    """Refuse poses whose flange does not turn, or turns about one axis only.

    Raises
    ------
    DegenerateGeometry
        Naming the motion there is and the one that is missing.
    """
    R = np.array([pose.rotation for pose in base_from_flanges])
    first, second = np.triu_indices(len(R), k=1)
    turns = rotation_vectors(np.swapaxes(R[first], -1, -2) @ R[second])
    largest = float(np.linalg.norm(turns, axis=1).max())
    if largest < MIN_ROTATION:
        raise DegenerateGeometry(
            f"the flange was only moved, never turned (by {np.degrees(largest):.2g} deg at most): "
            "the sensor's position cannot be found; add poses tilted 20 to 35 deg about two axes"
        )
    axis, share = _main_axis(turns)
    if share < MIN_SECOND_AXIS:
        raise DegenerateGeometry(
            f"the flange turned about one axis only, ({axis[0]:.2f}, {axis[1]:.2f}, {axis[2]:.2f}) "
            "of the flange: the sensor's place along it cannot be found; add poses tilted 20 to "
            "35 deg about an axis across it"
        )


def _main_axis(turns: FloatArray) -> tuple[FloatArray, float]:
    """Axis of most turning, and the share of turning about the next."""
    strengths, axes = np.linalg.eigh(turns.T @ turns)
    main = axes[:, -1] * np.sign(axes[np.abs(axes[:, -1]).argmax(), -1])
    return main, float(np.sqrt(max(strengths[-2], 0.0) / strengths[-1]))
