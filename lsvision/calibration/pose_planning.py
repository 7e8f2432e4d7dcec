"""Next best poses for a hand-eye calibration (greedy, A-optimal)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lsvision.calibration.batched_least_squares import whitened_jacobian_and_residuals
from lsvision.calibration.observations import (
    MM_PER_RADIAN,
    States,
    stack_flange_poses,
)
from lsvision.calibration.plane_observations import PlanePlanningTarget
from lsvision.calibration.robot_std import NOMINAL_ROBOT_STD, compute_robot_whitening
from lsvision.calibration.rotations import build_cross_matrices, rotations_from_vectors
from lsvision.calibration.sphere_observations import SpherePlanningTarget
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import BoolArray, FloatArray, IntArray, Plane, Pose, as_readonly_array
from lsvision.geometry.arguments import as_numbers
from lsvision.geometry.arrays import freeze_arrays
from lsvision.geometry.pose import as_pose, as_poses
from lsvision.geometry.settings_repr import ShowsChanges
from lsvision.results.quantities import Record, convert_numbers_to_json, flatten_record
from lsvision.results.result import Result

UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""``base_from_section`` with the section's Y up; planned tilts are relative to it."""
PRIOR_STD = (1000.0, 1000.0, 1000.0, 1.0, 1.0, 1.0)
"""Prior standard deviation of the sensor's translation (mm) and rotation (rad); uninformative."""


@dataclass(frozen=True, kw_only=True, repr=False)
class PosePlanSettings(ShowsChanges):
    """Reachable poses, and standard deviations of target and robot.

    Parameters
    ----------
    max_tilt, max_spin : float
        Largest tilt about two axes, and rotation about the section's upright Y. Units: rad.
    max_lateral_offset, max_depth_offset : float
        Largest offset of the target along the section's X and Y. Units: mm.
    max_cut_offset : float
        Largest distance of the cut from the sphere's centre, in radii.
    working_y : float
        Y of the target in the middle of the sensor's range, section frame. Units: mm.
    circle_std : float
        Standard deviation of a circle's centre along X; along Y and in radius three times that.
        Units: mm.
    line_std : tuple of float
        Standard deviation of the offset (mm) and slope (rad) of a plate's line.
    robot_std : tuple of float
        Standard deviation in each axis of position (mm) and orientation (rad).
    count : int
        Number of poses to propose.
    candidates : int
        Number of random candidate poses.
    seed : int
        Seed of the random candidates.
    """

    max_tilt: float = np.radians(35.0)
    max_spin: float = np.pi
    max_lateral_offset: float = 30.0
    max_depth_offset: float = 45.0
    max_cut_offset: float = 0.75
    working_y: float = 0.0
    circle_std: float = 0.01
    line_std: tuple[float, float] = (0.005, 2e-4)
    robot_std: tuple[float, float] = NOMINAL_ROBOT_STD
    count: int = 12
    candidates: int = 150
    seed: int = 0

    def __post_init__(self) -> None:
        limits = (self.max_tilt, self.max_spin, self.max_lateral_offset, self.max_depth_offset)
        if not all(0 <= limit < np.inf for limit in (*limits, self.max_cut_offset)):
            raise ValueError(f"expected finite tilts, spin and offsets of at least 0, got {self}")
        line_std = as_numbers(self.line_std, 2, "line_std (mm, rad)")
        robot_std = as_numbers(self.robot_std, 2, "robot_std (mm, rad)")
        stds = (self.circle_std, *line_std, *robot_std)
        if not all(0 < value < np.inf for value in (self.count, self.candidates, *stds)):
            raise ValueError(f"expected positive counts and standard deviations, got {self}")


@dataclass(frozen=True, eq=False, repr=False)
class PosePlan(Result):
    """Proposed poses, the most informative first.

    Parameters
    ----------
    base_from_flanges : tuple of Pose
        Flange poses to move to.
    indices : tuple of int
        Indices of these poses in the candidates.
    predicted_std : (k,) array_like
        `HandEye.std_at` (root of the summed variances) of the target's mean position in the view,
        predicted after each pose and those measured before. Units: mm.
    predicted_origin_std : (k,) array_like
        The same for the sensor's origin. Units: mm.
    """

    base_from_flanges: tuple[Pose, ...]
    indices: tuple[int, ...]
    predicted_std: FloatArray
    predicted_origin_std: FloatArray

    def __post_init__(self) -> None:
        freeze_arrays(self, predicted_std=("k",), predicted_origin_std=("k",))

    def to_dict(self) -> Record:
        """Return the poses and their predicted accuracy, ready for JSON.

        Returns
        -------
        dict
            ``poses``, a record each: candidate's index, 4x4 matrix and predicted std (mm).
        """
        names = ("index", "base_from_flange", "predicted_std_mm", "predicted_origin_std_mm")
        matrices = [pose.matrix.tolist() for pose in self.base_from_flanges]
        stds = (
            convert_numbers_to_json(self.predicted_std),
            convert_numbers_to_json(self.predicted_origin_std),
        )
        rows = zip(self.indices, matrices, *stds, strict=True)
        return {"poses": [dict(zip(names, row, strict=True)) for row in rows]}

    def _summarise(self) -> str:
        return f"{len(self.indices)} poses, then {self.predicted_std[-1]:.4f} mm at the target"

    def _list_cells(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = [("", "x mm", "y mm", "z mm", "std after it mm")]
        for number, pose in enumerate(self.base_from_flanges, 1):
            position = (f"{value:.1f}" for value in pose.translation)
            rows.append((str(number), *position, f"{self.predicted_std[number - 1]:.4f}"))
        return rows

    def _list_rows(self) -> list[Record]:
        return [
            flatten_record(record)
            | flatten_record({"flange_mm": convert_numbers_to_json(pose.translation)})
            for record, pose in zip(self.to_dict()["poses"], self.base_from_flanges, strict=True)
        ]


PlanningTarget = SpherePlanningTarget | PlanePlanningTarget
"""Target of planned poses: viewing direction, visibility, and predicted observations."""

SPHERE_DEFAULTS = PosePlanSettings()
"""Settings of poses that see a sphere."""
PLANE_DEFAULTS = PosePlanSettings(max_tilt=np.radians(40.0))
"""Larger tilts than for a sphere: they add information."""


def plan_hand_eye_poses(
    flange_from_section: Pose | npt.ArrayLike,
    centre: npt.ArrayLike,
    radius: float,
    *,
    measured: Sequence[Pose | npt.ArrayLike] = (),
    candidates: Sequence[Pose | npt.ArrayLike] | None = None,
    settings: PosePlanSettings = SPHERE_DEFAULTS,
) -> PosePlan:
    """Plan the next best flange poses for a sphere (greedy, A-optimal).

    Each step takes the candidate that minimises the summed variance of the sensor's position and of
    its rotation times `MM_PER_RADIAN`. Six determine that position as well as twelve random ones.

    Parameters
    ----------
    flange_from_section : Pose or (4, 4) array_like
        Nominal pose of the sensor, from a drawing or a first calibration, accurate to a few degrees
        and mm.
    centre : (3,) array_like
        Approximate centre of the sphere in the base frame. Units: mm.
    radius : float
        Radius of the sphere. Units: mm.
    measured : sequence of Pose or (4, 4) array_like
        ``base_from_flange`` of poses already measured.
    candidates : sequence of Pose or (4, 4) array_like, optional
        Reachable ``base_from_flange`` poses to choose from, the target in the sensor's range;
        random ones within `settings` by default.
    settings : PosePlanSettings
        Number of poses, limits and standard deviations.

    Returns
    -------
    PosePlan
        Poses with the predicted accuracy.

    Raises
    ------
    ValueError
        If the radius is not positive and finite.
    DegenerateGeometry
        If fewer candidates cut the sphere than poses are requested.

    Examples
    --------
    >>> mount = Pose(translation=(0.0, 80.0, 120.0))
    >>> six = PosePlanSettings(working_y=-150.0, count=6)
    >>> plan = plan_hand_eye_poses(mount, (800, 0, 300), 20.0, settings=six)
    >>> len(plan.base_from_flanges), bool(plan.predicted_std[-1] < 0.5)
    (6, True)
    """
    if not 0 < radius < np.inf:
        raise ValueError(f"expected a positive, finite radius in mm, got {radius}")
    centre = as_readonly_array(centre, (3,), "centre")
    target = SpherePlanningTarget(centre, radius, settings.circle_std, settings.max_cut_offset)
    return _select_poses(target, flange_from_section, measured, candidates, settings)


def plan_hand_eye_poses_plane(
    flange_from_section: Pose | npt.ArrayLike,
    plane: Plane,
    point: npt.ArrayLike,
    *,
    measured: Sequence[Pose | npt.ArrayLike] = (),
    candidates: Sequence[Pose | npt.ArrayLike] | None = None,
    settings: PosePlanSettings = PLANE_DEFAULTS,
) -> PosePlan:
    """Plan the next best flange poses for a plate, as `plan_hand_eye_poses` for a sphere.

    Parameters
    ----------
    flange_from_section : Pose or (4, 4) array_like
        Nominal pose of the sensor, accurate to a few degrees and mm.
    plane : Plane
        Approximate plate in the base frame. The measured side is the one that most of `measured`
        face; without any, the one that the normal points to.
    point : (3,) array_like
        Approximate point of the plate where the line is to lie, base frame. Units: mm.
    measured, candidates, settings
        As in `plan_hand_eye_poses`; tilts of up to 40 deg.

    Returns
    -------
    PosePlan
        Poses with the predicted accuracy.

    Raises
    ------
    DegenerateGeometry
        If fewer candidates see the plate than poses are requested.

    Examples
    --------
    >>> mount, table = Pose(translation=(0.0, 80.0, 120.0)), Plane((0, 0, 1), 300.0)
    >>> six = PosePlanSettings(max_tilt=np.radians(40), working_y=-150.0, count=6)
    >>> plan = plan_hand_eye_poses_plane(mount, table, (800, 0, 300), settings=six)
    >>> len(plan.base_from_flanges), bool(plan.predicted_std[-1] < 0.5)
    (6, True)
    """
    mount = as_pose(flange_from_section)
    facing = [(pose @ mount).rotation[:, 1] @ plane.normal for pose in as_poses(measured)]
    if sum(np.sign(facing)) < 0:
        plane = Plane(-plane.normal, -plane.distance)
    centre = as_readonly_array(point, (3,), "point")
    centre = centre - plane.signed_distances(centre) * plane.normal
    target = PlanePlanningTarget(plane, centre, settings.line_std)
    return _select_poses(target, flange_from_section, measured, candidates, settings)


def _select_poses(
    target: PlanningTarget,
    flange_from_section: Pose | npt.ArrayLike,
    measured: Sequence[Pose | npt.ArrayLike],
    candidates: Sequence[Pose | npt.ArrayLike] | None,
    settings: PosePlanSettings,
) -> PosePlan:
    """Return the plan of the most informative poses for any target."""
    nominal = as_pose(flange_from_section)
    if candidates is None:
        candidates = _draw_random_poses(target, nominal, settings)
    count, poses = settings.count, [*as_poses(measured), *as_poses(candidates)]
    positions, usable = target.check_visibility([pose @ nominal for pose in poses])
    available = usable & (np.arange(len(poses)) >= len(measured))
    if available.sum() < count:
        raise DegenerateGeometry(
            f"{int(available.sum())} candidate poses {target.requirement} and {count} are "
            "requested: give more candidates, or a better nominal pose of the sensor"
        )
    information_matrices = usable[:, None, None] * _compute_information_matrices(
        target, positions, poses, nominal, settings.robot_std
    )
    prior_information = np.diag(np.array([*PRIOR_STD, *target.prior_std]) ** -2)
    information = prior_information + information_matrices[: len(measured)].sum(axis=0)
    lever_arm = nominal.rotation @ positions[usable].mean(axis=0)
    order, predicted = _select_greedily(
        information, information_matrices, available, count, lever_arm
    )
    indices = tuple(int(index) - len(measured) for index in order)
    return PosePlan(tuple(poses[index] for index in order), indices, *np.array(predicted).T)


def _draw_random_poses(
    target: PlanningTarget, nominal: Pose, settings: PosePlanSettings
) -> list[Pose]:
    """Return random flange poses within the limits of the settings."""
    rng = np.random.default_rng(settings.seed)
    size = settings.candidates
    spin = rng.uniform(-settings.max_spin, settings.max_spin, size)
    tilts = rng.uniform(-settings.max_tilt, settings.max_tilt, (size, 2))
    zero = np.zeros(size)
    # From the right: the section upright, tilted about X and Y of the base, turned about its Z.
    spun = target.viewing_rotation @ rotations_from_vectors(np.column_stack([zero, zero, spin]))
    rotations = spun @ rotations_from_vectors(np.column_stack([tilts, zero])) @ UPRIGHT
    targets_in_section = rng.uniform(-1, 1, (size, 3)) * (
        settings.max_lateral_offset,
        settings.max_depth_offset,
        target.max_plane_offset,
    ) + (0.0, settings.working_y, 0.0)
    section_from_flange = nominal.inverse()
    return [
        Pose(rotation, target.centre - rotation @ point) @ section_from_flange
        for rotation, point in zip(rotations, targets_in_section, strict=True)
    ]


def _compute_information_matrices(
    target: PlanningTarget,
    positions: FloatArray,
    poses: Sequence[Pose],
    nominal: Pose,
    robot_std: tuple[float, float],
) -> FloatArray:
    """Return the information (n, p, p) of each pose on the sensor (6) and the target."""
    flanges = stack_flange_poses(poses, "eye_in_hand", robot_std)
    observations = target.predict_observations(
        positions, [pose @ nominal for pose in poses], flanges
    )
    state = States(nominal.rotation[None], nominal.translation[None], target.state[None, None])
    jacobian = whitened_jacobian_and_residuals(
        observations, state, compute_robot_whitening(observations, state, (1.0, 1.0))
    )[0][0]
    information: FloatArray = np.swapaxes(jacobian, -1, -2) @ jacobian
    return information


def _select_greedily(
    information: FloatArray,
    information_matrices: FloatArray,
    available: BoolArray,
    count: int,
    lever_arm: FloatArray,
) -> tuple[IntArray, list[tuple[float, float]]]:
    """Return the indices of the selected poses, and two predicted std (mm) after each of them.

    The first is that of a point at `lever_arm` from the sensor's origin, the second the origin's.
    """
    available = available.copy()
    weights = np.array([1.0] * 3 + [MM_PER_RADIAN**2] * 3)
    point_jacobian = np.hstack([np.eye(3), -build_cross_matrices(lever_arm)])
    selected, predicted = [], []
    for _ in range(count):
        covariances = np.linalg.inv(information + information_matrices)[:, :6, :6]
        variances = np.einsum("nii,i->n", covariances, weights)
        best = int(np.where(available, variances, np.inf).argmin())
        available[best] = False
        information = information + information_matrices[best]
        selected.append(best)
        best_covariance = covariances[best]
        point_variance = np.trace(point_jacobian @ best_covariance @ point_jacobian.T)
        origin_variance = np.trace(best_covariance[:3, :3])
        predicted.append((float(np.sqrt(point_variance)), float(np.sqrt(origin_variance))))
    return np.array(selected, dtype=np.int64), predicted
