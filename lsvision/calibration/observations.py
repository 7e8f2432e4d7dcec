"""Data types of the hand-eye calibration: poses, targets, states and observations.

Each kind of target (`sphere_observations`, `plane_observations`, `board_observations`) reduces
the data of a pose to a few numbers with a covariance, and linearises them by the sensor
pose, the target and the flange pose. `batched_least_squares`, `errors_in_variables` and
`pose_outliers` work on any kind by the protocol `Observations`.

Frames: the sensor is at ``mount_from_sensor`` in the frame that carries it, the mount. Eye in hand,
the mount is the flange and the target is fixed in the base frame; eye to hand, the mount is the
base frame and the target is fixed to the flange.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol, get_args

import numpy as np

from lsvision.calibration.rotations import build_cross_matrices, vectors_from_rotations
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import FloatArray, IntArray, Pose
from lsvision.geometry.arrays import TINY, freeze_arrays
from lsvision.geometry.equality import ComparedByValue

Mounting = Literal["eye_in_hand", "eye_to_hand"]
Sensor = Literal["section", "camera"]

MIN_ROTATION = np.radians(2.0)
"""Smallest angle between two flange poses that counts as a rotation; robots have errors of 0.01 deg
and more. Units: rad."""
MIN_SECOND_AXIS_RATIO = 0.03
"""Smallest ratio of the rotation about a second axis to that about the main axis, such as tilts of
1 deg together with rotations of 30 deg."""
MM_PER_RADIAN = 100.0
"""Length in mm that is equivalent to one radian where translation and rotation are compared: a
convention of the residuals of boards, which are those of a point 100 mm from the board's origin, as
at its edge. Poses planned with 50 to 200 mm are equally good (standard deviations differ by 7
%)."""


@dataclass(frozen=True, eq=False)
class Sphere(ComparedByValue):
    """Sphere that was the target of a calibration.

    Parameters
    ----------
    centre : (3,) array_like
        Centre in the base frame (eye in hand) or flange frame (eye to hand). Units: mm.
    radius : float
        Radius of the sphere. Units: mm.
    radius_std : float
        Standard deviation of the radius; 0 if the radius was given. Units: mm.
    """

    centre: FloatArray
    radius: float
    radius_std: float

    def __post_init__(self) -> None:
        freeze_arrays(self, centre=(3,))


@dataclass(frozen=True)
class RejectedPose:
    """Index of a pose and the reason for its rejection.

    Parameters
    ----------
    index : int
        Index of the pose, from 0.
    reason : str
        Reason in words, with numbers.
    """

    index: int
    reason: str


@dataclass(frozen=True, eq=False)
class FlangePoses:
    """Stacked flange poses with their covariances.

    Parameters
    ----------
    rotations : (n, 3, 3) ndarray
        Rotations from the mount to the frame in which the target is fixed.
    origins : (n, 3) ndarray
        Origin of the mount in that frame. Units: mm.
    covariances : (n, 2, 6, 6) ndarray
        Covariances of translation (mm) and left perturbation (rad): first that by the robot's
        errors of position, then that by its errors of orientation, for its stated or nominal
        standard uncertainty.
    """

    rotations: FloatArray
    origins: FloatArray
    covariances: FloatArray

    def __len__(self) -> int:
        return len(self.origins)

    def select(self, order: IntArray) -> "FlangePoses":
        """Return the poses at the given indices."""
        return FlangePoses(self.rotations[order], self.origins[order], self.covariances[order])


@dataclass(frozen=True, eq=False)
class States:
    """Estimates of sensor pose and targets, one for each initial guess.

    Parameters
    ----------
    rotations : (s, 3, 3) ndarray
        Rotations from the sensor to the mount.
    translations : (s, 3) ndarray
        Origin of the sensor in the mount frame. Units: mm.
    targets : (s, g, k) ndarray
        The k numbers that describe each of g targets; g is 1 except in the test for a moved target.
    """

    rotations: FloatArray
    translations: FloatArray
    targets: FloatArray

    def __len__(self) -> int:
        return len(self.translations)

    def select(self, order: IntArray) -> "States":
        """Return the states at the given indices."""
        return States(self.rotations[order], self.translations[order], self.targets[order])


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals (observed minus predicted) of s states and n poses, and their Jacobians.

    Parameters
    ----------
    residuals : (s, n, m) ndarray
        Observed minus predicted values, in the units of the observation.
    mount_jacobian : (s, n, m, 6) ndarray
        Derivatives by translation (mm) and left perturbation (rad) of the sensor in the mount.
    target_jacobian : (s, n, m, d) ndarray
        Derivatives by the d step coordinates of `Observations.update_targets`.
    flange_jacobian : (s, n, m, 6) ndarray
        Derivatives by translation (mm) and left perturbation (rad) of the flange.
    """

    residuals: FloatArray
    mount_jacobian: FloatArray
    target_jacobian: FloatArray
    flange_jacobian: FloatArray


class Observations(Protocol):
    """Observations of one kind of target in n poses, m numbers each; a dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def flanges(self) -> FlangePoses:
        """Flange pose of each observation."""
        ...

    @property
    def groups(self) -> IntArray:
        """Index (n,) of the target that each pose observes.

        All 0 except in the test for a moved target.
        """
        ...

    @property
    def covariances(self) -> FloatArray:
        """Covariance (n, m, m) of each observation, without the error of the robot."""
        ...

    @property
    def mm_per_residual(self) -> FloatArray:
        """Factors (m,) that convert the residuals to mm."""
        ...

    @property
    def target_prior(self) -> tuple[FloatArray, FloatArray]:
        """Prior mean and standard deviation (d,) of the step coordinates of the target.

        Infinite standard deviation: no prior.
        """
        ...

    def linearise(self, states: States) -> Linearisation:
        """Return residuals and Jacobians of all poses for each state."""
        ...

    def update_targets(self, targets: FloatArray, steps: FloatArray) -> FloatArray:
        """Return targets (s, g, k) after steps (s, g, d).

        A target has d degrees of freedom and is described by k numbers, which may be more: a plane
        by 4, its normal and its distance, of 3 degrees of freedom.
        """
        ...

    def target_distance(self, first: FloatArray, second: FloatArray) -> float:
        """Return the distance of two targets (k,). Units: mm."""
        ...

    def estimate_initial_guesses(self, masks: FloatArray) -> States:
        """Return initial guesses, a fixed number for each selection of poses (q, n)."""
        ...


def stack_flange_poses(
    base_from_flanges: Sequence[Pose], mounting: Mounting, robot_std: tuple[float, float]
) -> FlangePoses:
    """Return stacked poses of the mount in the target's frame, with covariances.

    Eye to hand, poses and covariances are inverted. `robot_std` is the standard deviation in each
    axis of position (mm) and orientation (rad). ValueError if the mounting is another string.
    """
    if mounting not in get_args(Mounting):
        raise ValueError(f"expected mounting {' or '.join(get_args(Mounting))}, got {mounting!r}")
    R = np.array([pose.rotation for pose in base_from_flanges])
    t = np.array([pose.translation for pose in base_from_flanges])
    parts = np.zeros((2, 6, 6))
    parts[0, :3, :3], parts[1, 3:, 3:] = np.square(robot_std)[:, None, None] * np.eye(3)
    covariances = np.broadcast_to(parts, (len(t), 2, 6, 6))
    if mounting == "eye_in_hand":
        return FlangePoses(R, t, covariances)
    inverse = np.swapaxes(R, -1, -2)
    # A left perturbation (dt, w) changes the inverse pose to t' = -R't - R'dt + R'(w x t) and
    # (1 - [R'w]x) R'.
    inverse_jacobian = np.zeros((len(t), 1, 6, 6))
    inverse_jacobian[:, 0, :3, :3], inverse_jacobian[:, 0, 3:, 3:] = -inverse, -inverse
    inverse_jacobian[:, 0, :3, 3:] = -inverse @ build_cross_matrices(t)
    covariances = inverse_jacobian @ covariances @ np.swapaxes(inverse_jacobian, -1, -2)
    return FlangePoses(inverse, -(inverse @ t[..., None])[..., 0], covariances)


def _find_main_axis(vectors: FloatArray) -> tuple[FloatArray, float]:
    """Return the main axis (3,) of rotation vectors (n, 3), and how far they are from it.

    The second value is the ratio of their root sums of squares along the second and the main axis.
    """
    eigenvalues, axes = np.linalg.eigh(vectors.T @ vectors)
    main = axes[:, -1] * np.sign(axes[np.abs(axes[:, -1]).argmax(), -1])
    return main, float(np.sqrt(max(eigenvalues[-2], 0.0) / eigenvalues[-1]))


def require_rotation(base_from_flanges: Sequence[Pose]) -> None:
    """Require flange poses, at least two, that rotate about at least two axes.

    DegenerateGeometry if they do not; the message states the missing rotation.
    """
    R = np.array([pose.rotation for pose in base_from_flanges])
    first, second = np.triu_indices(len(R), k=1)
    relative_rotations = vectors_from_rotations(np.swapaxes(R[first], -1, -2) @ R[second])
    largest = float(np.linalg.norm(relative_rotations, axis=1).max())
    if largest < MIN_ROTATION:
        raise DegenerateGeometry(
            f"the flange was translated, never rotated (at most {np.degrees(largest):.2g} deg): "
            "the sensor's position is not determined; add poses tilted 20 to 35 deg about two axes"
        )
    axis, second_axis_ratio = _find_main_axis(relative_rotations)
    if second_axis_ratio < MIN_SECOND_AXIS_RATIO:
        raise DegenerateGeometry(
            f"the flange rotated about one axis, ({axis[0]:.2f}, {axis[1]:.2f}, {axis[2]:.2f}) "
            "of the flange, only: the sensor's position along it is not determined; add poses "
            "tilted 20 to 35 deg about an axis perpendicular to it"
        )


def transform_to_sensor_frame(
    flanges: FlangePoses, states: States, points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return points (s, n, 3) of the target frame in the sensor frame, with Jacobians.

    Returns
    -------
    in_sensor : (s, n, 3) ndarray
        Points in the sensor frame. Units: mm.
    mount_jacobian, point_jacobian, flange_jacobian : ndarray
        Derivatives by the sensor pose (s, n, 3, 6), the point (s, n, 3, 3) and the flange pose
        (s, n, 3, 6); poses by translation (mm) and left perturbation (rad).
    """
    to_mount = np.swapaxes(flanges.rotations, -1, -2)
    to_sensor = np.swapaxes(states.rotations, -1, -2)[:, None]
    # Lever arms of rotations: from the mount's origin, and from the sensor's in the mount's axes.
    from_mount = points - flanges.origins
    from_sensor = (to_mount @ from_mount[..., None])[..., 0] - states.translations[:, None]
    in_sensor = (to_sensor @ from_sensor[..., None])[..., 0]
    point_jacobian = to_sensor @ to_mount
    shape = point_jacobian.shape
    mount_jacobian = np.concatenate(
        [np.broadcast_to(-to_sensor, shape), to_sensor @ build_cross_matrices(from_sensor)], axis=-1
    )
    flange_jacobian = np.concatenate(
        [-point_jacobian, point_jacobian @ build_cross_matrices(from_mount)], axis=-1
    )
    return in_sensor, mount_jacobian, point_jacobian, flange_jacobian


def compute_residual_norms(observations: Observations, residuals: FloatArray) -> FloatArray:
    """Return the norms (n,) of residuals (n, m) in mm."""
    norms: FloatArray = np.linalg.norm(residuals * observations.mm_per_residual, axis=-1)
    return norms


def solve_masked_least_squares(
    design: FloatArray, rhs: FloatArray, masks: FloatArray
) -> FloatArray:
    """Return the solution (q, p) of linear least squares for each of q selections of poses.

    Normal equations with a ridge of 1e-10 of their trace: accurate enough for an initial guess, and
    never singular; the solution of an empty selection is zero. The design (n, r, p) has r rows for
    each of n poses; the right-hand side is common to all selections (n, r), or one for each (q, n,
    r); `masks` (q, n) are 1 for the poses of a selection, 0 for others.
    """
    scale = np.maximum(np.abs(design).max(axis=(0, 1)), 1e-12)
    scaled = design / scale
    grams = np.einsum("nij,nik->njk", scaled, scaled)
    normal = np.einsum("qn,njk->qjk", masks, grams)
    if rhs.ndim == 2:
        moment = np.einsum("qn,nij,ni->qj", masks, scaled, rhs)
    else:
        moment = np.einsum("qn,nij,qni->qj", masks, scaled, rhs)
    size = normal.shape[-1]
    ridge = np.maximum(1e-10 * np.trace(normal, axis1=1, axis2=2), TINY)[:, None, None]
    solution: FloatArray = (
        np.linalg.solve(normal + ridge * np.eye(size), moment[..., None])[..., 0] / scale
    )
    return solution
