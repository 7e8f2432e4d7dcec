"""What every kind of target must say of what the poses showed of it.

Each kind (`sphere_observations`, `plane_observations`, `board_observations`) reduces what a pose
shows to a few numbers with a covariance and says how those would change with the sensor's pose,
the target and the robot's own pose; `batched_least_squares`, `errors_in_variables` and
`pose_outliers` work on any of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, Self

import numpy as np

from lsvision.calibration.rotations import cross_matrices, rotation_vectors
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import FloatArray, IntArray, Pose


@dataclass(frozen=True, eq=False)
class FlangePoses:
    """Flange poses as stacks, with the covariance a unit robot error gives each.

    Parameters
    ----------
    rotations : (n, 3, 3) ndarray
        Mount (the frame that carries the sensor) to the target's frame.
    origins : (n, 3) ndarray
        Units: mm.
    covariances : (n, 6, 6) ndarray
        Of translation (mm) and left-hand rotation (rad), for the stated or nominal robot.
    """

    rotations: FloatArray
    origins: FloatArray
    covariances: FloatArray

    def __len__(self) -> int:
        return len(self.origins)

    def select(self, order: IntArray) -> "FlangePoses":
        """The poses in another order, or a part of them."""
        return FlangePoses(self.rotations[order], self.origins[order], self.covariances[order])


@dataclass(frozen=True, eq=False)
class States:
    """Sensor poses and targets, one a start.

    Parameters
    ----------
    rotations : (s, 3, 3) ndarray
        Sensor to mount.
    translations : (s, 3) ndarray
        Sensor's origin in the mount frame. Units: mm.
    targets : (s, g, k) ndarray
        What each kind of sighting keeps of its target; `g` targets, one but for a diagnosis.
    """

    rotations: FloatArray
    translations: FloatArray
    targets: FloatArray

    def __len__(self) -> int:
        return len(self.translations)

    def select(self, order: IntArray) -> "States":
        """The starts in another order, or a part of them."""
        return States(self.rotations[order], self.translations[order], self.targets[order])


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals (seen minus expected) of s starts and n poses, and their derivatives.

    Parameters
    ----------
    residuals : (s, n, m) ndarray
        In the sighting's own units.
    mount_jacobian : (s, n, m, 6) ndarray
        By the sensor's translation (mm) and left-hand rotation (rad) in the mount frame.
    target_jacobian : (s, n, m, d) ndarray
        By the step of `Observations.update_targets`.
    flange_jacobian : (s, n, m, 6) ndarray
        By the flange's translation and left-hand rotation.
    """

    residuals: FloatArray
    mount_jacobian: FloatArray
    target_jacobian: FloatArray
    flange_jacobian: FloatArray


class Observations(Protocol):
    """What all poses showed of one kind of target."""

    @property
    def flanges(self) -> FlangePoses:
        """Where the flange stood at each sighting."""
        ...

    @property
    def groups(self) -> IntArray:
        """(n,) which target each pose saw; all 0 unless a moved target is suspected."""
        ...

    @property
    def covariances(self) -> FloatArray:
        """(n, m, m) of what was seen."""
        ...

    @property
    def mm_per_residual(self) -> FloatArray:
        """(m,) factors that make millimetres of the residuals."""
        ...

    @property
    def target_prior(self) -> tuple[FloatArray, FloatArray]:
        """Value and one sigma of each of the target's d steps' coordinates; inf = free."""
        ...

    def linearise(self, states: States) -> Linearisation:
        """Residuals and derivatives."""
        ...

    def update_targets(self, targets: FloatArray, steps: FloatArray) -> FloatArray:
        """Targets (s, g, k) after steps (s, g, d)."""
        ...

    def prior_residuals(self, targets: FloatArray) -> FloatArray:
        """(s, g, d) target minus prior."""
        ...

    def target_distance(self, first: FloatArray, second: FloatArray) -> float:
        """How far two targets (k,) are apart. Units: mm."""
        ...

    def initial_guesses(self, masks: FloatArray) -> States:
        """Starts without any guess, a fixed number for each of (q, n) selections of poses."""
        ...

    def with_groups(self, groups: IntArray) -> Self:
        """The same sightings, of several targets."""
        ...

    def with_flange_poses(self, flanges: FlangePoses) -> Self:
        """The same sightings, had the flange stood elsewhere."""
        ...


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


def _main_axis(turns: FloatArray) -> tuple[FloatArray, float]:
    """Axis of most turning, and the share of turning about the next."""
    strengths, axes = np.linalg.eigh(turns.T @ turns)
    main = axes[:, -1] * np.sign(axes[np.abs(axes[:, -1]).argmax(), -1])
    return main, float(np.sqrt(max(strengths[-2], 0.0) / strengths[-1]))


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


def points_in_sensor_frame(
    flanges: FlangePoses, states: States, points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Points (s, n, 3) of the target's frame in the sensor's, with derivatives.

    By the mount's pose (s, n, 3, 6), the point (s, n, 3, 3) and the flange's pose
    (s, n, 3, 6); rotations act from the left.
    """
    to_mount = np.swapaxes(flanges.rotations, -1, -2)
    to_sensor = np.swapaxes(states.rotations, -1, -2)[:, None]
    offset = points - flanges.origins
    in_mount = (to_mount @ offset[..., None])[..., 0] - states.translations[:, None]
    seen = (to_sensor @ in_mount[..., None])[..., 0]
    by_point = to_sensor @ to_mount
    shape = by_point.shape
    by_mount = np.concatenate(
        [np.broadcast_to(-to_sensor, shape), to_sensor @ cross_matrices(in_mount)], axis=-1
    )
    by_flange = np.concatenate([-by_point, by_point @ cross_matrices(offset)], axis=-1)
    return seen, by_mount, by_point, by_flange


def masked_least_squares(design: FloatArray, right: FloatArray, masks: FloatArray) -> FloatArray:
    """Least squares over the poses of each selection; (n, 3, p), (q or -, n, 3), (q, n) -> (q, p).

    By normal equations with a whiff of ridge: a start need not be exact, only exist.
    """
    scale = np.maximum(np.abs(design).max(axis=(0, 1)), 1e-12)
    scaled = design / scale
    grams = np.einsum("nij,nik->njk", scaled, scaled)
    normal = np.einsum("qn,njk->qjk", masks, grams)
    if right.ndim == 2:
        side = np.einsum("qn,nij,ni->qj", masks, scaled, right)
    else:
        side = np.einsum("qn,nij,qni->qj", masks, scaled, right)
    size = normal.shape[-1]
    ridge = 1e-10 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(size)
    solution: FloatArray = np.linalg.solve(normal + ridge, side[..., None])[..., 0] / scale
    return solution
