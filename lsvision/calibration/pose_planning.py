"""The next best poses for a sensor-to-robot calibration, before anything is moved."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lsvision.calibration.batched_least_squares import whitened_jacobian_and_residuals
from lsvision.calibration.errors_in_variables import NOMINAL_ROBOT_STD, robot_whitening
from lsvision.calibration.flange_poses import stack_flange_poses
from lsvision.calibration.observations import States
from lsvision.calibration.planning_targets import (
    PlanePlanningTarget,
    PlanningTarget,
    SpherePlanningTarget,
)
from lsvision.calibration.rotations import cross_matrices, rotations_of
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import BoolArray, FloatArray, IntArray, Plane, Pose, as_readonly_array

UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""``base_from_section`` with the section's Y up, from which tilts are counted."""
PRIOR_STD = (1000.0, 1000.0, 1000.0, 1.0, 1.0, 1.0)
"""What is known of the sensor's place (mm) and turn (rad) beforehand: next to nothing."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PosePlanSettings:
    """Which poses are reachable and how well target and robot are known.

    Parameters
    ----------
    max_tilt, max_spin : float
        Largest tilt about two axes, and turn about the section's upright Y. Units: rad.
    max_lateral_offset, max_depth_offset : float
        Largest offset of the target along the section's X and Y. Units: mm.
    max_cut_offset : float
        Largest distance of the cut from the sphere's centre, in radii.
    standoff : float
        y of the target in the middle of the sensor's range. Units: mm.
    circle_std : float
        One sigma of a circle's centre along X; along Y and in radius three times that. Units: mm.
    line_std : tuple of float
        One sigma of the offset (mm) and slope (rad) of a plate's line.
    robot_std : tuple of float
        One sigma in each axis of position (mm) and orientation (rad).
    count : int
        Poses to propose.
    candidates : int
        Random poses tried.
    seed : int
        Of the random poses.
    """

    max_tilt: float = np.radians(35.0)
    max_spin: float = np.pi
    max_lateral_offset: float = 30.0
    max_depth_offset: float = 45.0
    max_cut_offset: float = 0.75
    standoff: float = 0.0
    circle_std: float = 0.01
    line_std: tuple[float, float] = (0.005, 2e-4)
    robot_std: tuple[float, float] = NOMINAL_ROBOT_STD
    count: int = 12
    candidates: int = 150
    seed: int = 0


@dataclass(frozen=True, eq=False)
class PosePlan:
    """Poses to take, best first.

    Parameters
    ----------
    base_from_flanges : tuple of Pose
        To be driven to; the order is that of their worth.
    indices : tuple of int
        Which of the candidates they are.
    predicted_std : (k,) array_like
        One sigma of a point at the target's mean place in the view, after each pose and those
        measured before. Units: mm.
    predicted_origin_std : (k,) array_like
        The same of the sensor's origin. Units: mm.
    """

    base_from_flanges: tuple[Pose, ...]
    indices: tuple[int, ...]
    predicted_std: FloatArray
    predicted_origin_std: FloatArray

    def __post_init__(self) -> None:
        for name in ("predicted_std", "predicted_origin_std"):
            object.__setattr__(self, name, as_readonly_array(getattr(self, name), ("k",), name))


SPHERE_DEFAULTS = PosePlanSettings()
PLANE_DEFAULTS = PosePlanSettings(max_tilt=np.radians(40.0))
"""A plate shows more when it leans more."""


def plan_hand_eye_poses(
    flange_from_section: Pose,
    centre: npt.ArrayLike,
    radius: float,
    *,
    measured: Sequence[Pose] = (),
    candidates: Sequence[Pose] | None = None,
    settings: PosePlanSettings = SPHERE_DEFAULTS,
) -> PosePlan:
    """Next best flange poses before a sphere (greedy, A-optimal).

    Each step takes the candidate that lowers the summed variance of the sensor's position and
    of its rotation over 100 mm most. Six chosen poses are worth about twelve random ones.

    Parameters
    ----------
    flange_from_section : Pose
        Nominal, from a drawing or a first calibration; a few degrees and mm do.
    centre : (3,) array_like
        Of the sphere in the base frame, roughly. Units: mm.
    radius : float
        Units: mm.
    measured : sequence of Pose
        ``base_from_flange`` of poses already taken.
    candidates : sequence of Pose, optional
        Reachable ``base_from_flange`` poses to choose from, the target in the sensor's range; by
        default random ones within `settings`, from which the sphere is seen.
    settings : PosePlanSettings
        How many poses, and within which limits.

    Returns
    -------
    PosePlan
        Poses and the accuracy they promise.

    Raises
    ------
    ValueError
        A radius or count that is not positive.
    DegenerateGeometry
        Fewer candidates that cut the sphere than poses asked for.
    """
    count = settings.count
    if not (radius > 0 and count > 0):
        raise ValueError(f"want a positive radius and count, got {radius} mm and {count}")
    ahead = SpherePlanningTarget(
        as_readonly_array(centre, (3,), "centre"),
        radius,
        settings.circle_std,
        settings.max_cut_offset,
    )
    return _plan(ahead, flange_from_section, measured, candidates, settings)


def plan_hand_eye_poses_plane(
    flange_from_section: Pose,
    plane: Plane,
    point: npt.ArrayLike,
    *,
    measured: Sequence[Pose] = (),
    candidates: Sequence[Pose] | None = None,
    settings: PosePlanSettings = PLANE_DEFAULTS,
) -> PosePlan:
    """Next best flange poses before a plate; otherwise as `plan_hand_eye_poses`.

    Parameters
    ----------
    flange_from_section : Pose
        Nominal, from a drawing or a first calibration; a few degrees and mm do.
    plane : Plane
        The plate in the base frame, roughly. The side of it that is seen is the one that most of
        `measured` face; without any, the one its normal points to.
    point : (3,) array_like
        On the plate, where the line is to lie; base frame, roughly. Units: mm.
    measured, candidates, settings
        As in `plan_hand_eye_poses`; tilts of up to 40 deg.

    Returns
    -------
    PosePlan
        Poses and the accuracy they promise.

    Raises
    ------
    ValueError
        A count that is not positive.
    DegenerateGeometry
        Fewer candidates that see the plate than poses asked for.

    Examples
    --------
    >>> mount, table = Pose(translation=(0.0, 80.0, 120.0)), Plane((0, 0, 1), 300.0)
    >>> six = PosePlanSettings(max_tilt=np.radians(40), standoff=-150.0, count=6)
    >>> plan = plan_hand_eye_poses_plane(mount, table, (800, 0, 300), settings=six)
    >>> len(plan.base_from_flanges), bool(plan.predicted_std[-1] < 0.5)
    (6, True)
    """
    if not settings.count > 0:
        raise ValueError(f"want a positive count of poses, got {settings.count}")
    facing = [(pose @ flange_from_section).rotation[:, 1] @ plane.normal for pose in measured]
    if sum(np.sign(facing)) < 0:
        plane = Plane(-plane.normal, -plane.distance)
    centre = as_readonly_array(point, (3,), "point")
    centre = centre - plane.signed_distances(centre) * plane.normal
    ahead = PlanePlanningTarget(plane, centre, settings.line_std)
    return _plan(ahead, flange_from_section, measured, candidates, settings)


def _plan(
    ahead: PlanningTarget,
    nominal: Pose,
    measured: Sequence[Pose],
    candidates: Sequence[Pose] | None,
    settings: PosePlanSettings,
) -> PosePlan:
    if candidates is None:
        candidates = _candidates(ahead, nominal, settings)
    count, pool = settings.count, [*measured, *candidates]
    places, usable = ahead.visibility([pose @ nominal for pose in pool])
    free = usable & (np.arange(len(pool)) >= len(measured))
    if free.sum() < count:
        raise DegenerateGeometry(
            f"{int(free.sum())} candidate poses {ahead.requirement} and {count} are "
            "asked for: give more candidates, or a better nominal pose of the sensor"
        )
    informations = _informations(ahead, places, pool, nominal, settings.robot_std)
    informations = informations * usable[:, None, None]
    start = np.diag(np.array([*PRIOR_STD, *ahead.prior_std]) ** -2)
    total = start + informations[: len(measured)].sum(axis=0)
    arm = nominal.rotation @ places[usable].mean(axis=0)
    chosen, promised = _greedy(total, informations, free, count, arm)
    indices = tuple(int(index) - len(measured) for index in chosen)
    return PosePlan(tuple(pool[index] for index in chosen), indices, *np.array(promised).T)


def _candidates(ahead: PlanningTarget, nominal: Pose, settings: PosePlanSettings) -> list[Pose]:
    rng = np.random.default_rng(settings.seed)
    size = settings.candidates
    spin = rng.uniform(-settings.max_spin, settings.max_spin, size)
    tilts = rng.uniform(-settings.max_tilt, settings.max_tilt, (size, 2))
    zero = np.zeros(size)
    turned = ahead.viewing_rotation @ rotations_of(np.column_stack([zero, zero, spin]))
    rotations = turned @ rotations_of(np.column_stack([tilts, zero])) @ UPRIGHT
    seen = rng.uniform(-1, 1, (size, 3)) * (
        settings.max_lateral_offset,
        settings.max_depth_offset,
        ahead.max_plane_offset,
    ) + (0.0, settings.standoff, 0.0)
    back = nominal.inverse()
    return [
        Pose(rotation, ahead.centre - rotation @ point) @ back
        for rotation, point in zip(rotations, seen, strict=True)
    ]


def _informations(
    ahead: PlanningTarget,
    places: FloatArray,
    pool: Sequence[Pose],
    nominal: Pose,
    robot_std: tuple[float, float],
) -> FloatArray:
    """(n, p, p) information of each pose on the sensor (6) and the target."""
    flanges = stack_flange_poses(pool, "eye_in_hand", robot_std)
    sightings = ahead.predict_observations(places, [pose @ nominal for pose in pool], flanges)
    state = States(nominal.rotation[None], nominal.translation[None], ahead.state[None, None])
    jacobian = whitened_jacobian_and_residuals(
        sightings, state, robot_whitening(sightings, state, 1.0)
    )[0][0]
    information: FloatArray = np.swapaxes(jacobian, -1, -2) @ jacobian
    return information


def _greedy(
    total: FloatArray, informations: FloatArray, free: BoolArray, count: int, arm: FloatArray
) -> tuple[IntArray, list[tuple[float, float]]]:
    free = free.copy()
    weights = np.array([1.0] * 3 + [100.0**2] * 3)
    at_work = np.hstack([np.eye(3), -cross_matrices(arm)])
    chosen, promised = [], []
    for _ in range(count):
        covariances = np.linalg.inv(total + informations)[:, :6, :6]
        spreads = np.einsum("nii,i->n", covariances, weights)
        best = int(np.where(free, spreads, np.inf).argmin())
        free[best] = False
        total = total + informations[best]
        chosen.append(best)
        best_covariance = covariances[best]
        work = np.trace(at_work @ best_covariance @ at_work.T)
        origin = np.trace(best_covariance[:3, :3])
        promised.append((float(np.sqrt(work)), float(np.sqrt(origin))))
    return np.array(chosen, dtype=np.int64), promised
