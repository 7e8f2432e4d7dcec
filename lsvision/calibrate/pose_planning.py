"""The next best poses for a sensor-to-robot calibration on a sphere, before anything is moved."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lsvision.calibrate.adjustment import normal_system
from lsvision.calibrate.flange_poses import stack_flange_poses
from lsvision.calibrate.noisy_poses import ROBOT_SHAPE, robot_whitening
from lsvision.calibrate.rotations import rotations_of
from lsvision.calibrate.sightings import States
from lsvision.calibrate.sphere_poses import HEIGHT_STD, SphereSightings
from lsvision.errors import DegenerateGeometry
from lsvision.shapes import BoolArray, FloatArray, IntArray, Pose, locked

UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""``base_from_section`` with the section's Y up, from which tilts are counted."""
START_STD = (1000.0, 1.0, 1000.0, 10.0, HEIGHT_STD)
"""What is known before the first pose: translation, rotation, centre, radius, scale of heights;
next to nothing."""
ARC = np.radians(np.linspace(-60.0, 60.0, 61))
"""Angles of the points of an arc, from the section's Y. Units: rad."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PosePlanSettings:
    """Which poses are reachable and how well the arc and the robot are known.

    Parameters
    ----------
    tilt, spin : float
        Largest tilt about two axes, and turn about the section's upright Y. Units: rad.
    sideways, depth : float
        Largest offset of the sphere along the section's X and Y. Units: mm.
    offset : float
        Largest distance of the cut from the sphere's centre, in radii.
    standoff : float
        y of the sphere's centre in the middle of the sensor's range. Units: mm.
    circle_std : float
        One sigma of a circle's centre along X; along Y and in radius three times that. Units: mm.
    robot_std : tuple of float
        One sigma in each axis of position (mm) and orientation (rad).
    count : int
        Poses to propose.
    candidates : int
        Random poses tried.
    seed : int
        Of the random poses.
    """

    tilt: float = np.radians(35.0)
    spin: float = np.pi
    sideways: float = 30.0
    depth: float = 45.0
    offset: float = 0.75
    standoff: float = 0.0
    circle_std: float = 0.01
    robot_std: tuple[float, float] = ROBOT_SHAPE
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
        One sigma of a point at the sphere's mean place in the view, after each pose and those
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
            object.__setattr__(self, name, locked(getattr(self, name), ("k",), name))


DEFAULT = PosePlanSettings()


def plan_hand_eye_poses(
    flange_from_section: Pose,
    centre: npt.ArrayLike,
    radius: float,
    *,
    measured: Sequence[Pose] = (),
    candidates: Sequence[Pose] | None = None,
    settings: PosePlanSettings = DEFAULT,
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
        Reachable ``base_from_flange`` poses to choose from; by default random ones within
        `settings`, from which the sphere is seen.
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
    target = locked(centre, (3,), "centre")
    if candidates is None:
        candidates = _candidates(flange_from_section, target, radius, settings)
    pool = [*measured, *candidates]
    cuts = np.array(
        [(pose @ flange_from_section).inverse().apply_one(target) for pose in pool]
    ).reshape(-1, 3)
    usable = np.abs(cuts[:, 2]) < 0.95 * radius
    if usable[len(measured) :].sum() < count:
        raise DegenerateGeometry(
            f"{int(usable[len(measured) :].sum())} candidate poses cut the sphere and {count} are "
            "asked for: give more candidates, or a better nominal pose of the sensor"
        )
    informations = _informations(pool, cuts, flange_from_section, target, radius, settings)
    informations = informations * usable[:, None, None]
    arm = flange_from_section.rotation @ cuts[usable].mean(axis=0)
    chosen, promised = _greedy(informations, len(measured), usable, count, arm)
    indices = tuple(int(index) - len(measured) for index in chosen)
    return PosePlan(tuple(pool[index] for index in chosen), indices, *np.array(promised).T)


def _candidates(
    nominal: Pose, centre: FloatArray, radius: float, settings: PosePlanSettings
) -> list[Pose]:
    rng = np.random.default_rng(settings.seed)
    size = settings.candidates
    spin = rng.uniform(-settings.spin, settings.spin, size)
    tilts = rng.uniform(-settings.tilt, settings.tilt, (size, 2))
    zero = np.zeros(size)
    turned = rotations_of(np.column_stack([zero, zero, spin]))
    rotations = turned @ rotations_of(np.column_stack([tilts, zero])) @ UPRIGHT
    seen = rng.uniform(-1, 1, (size, 3)) * (
        settings.sideways,
        settings.depth,
        settings.offset * radius,
    ) + (0.0, settings.standoff, 0.0)
    back = nominal.inverse()
    return [
        Pose(rotation, centre - rotation @ point) @ back
        for rotation, point in zip(rotations, seen, strict=True)
    ]


def _informations(
    pool: Sequence[Pose],
    cuts: FloatArray,
    nominal: Pose,
    centre: FloatArray,
    radius: float,
    settings: PosePlanSettings,
) -> FloatArray:
    """(n, 11, 11) information of each pose on sensor, centre, radius and scale of heights."""
    circle = np.sqrt(np.maximum(radius**2 - cuts[:, 2] ** 2, (0.1 * radius) ** 2))
    sightings = SphereSightings(
        np.column_stack([cuts[:, :2], circle]),
        np.tile(np.diag(settings.circle_std**2 * np.array([1.0, 9.0, 9.0])), (len(pool), 1, 1)),
        _stretches(cuts[:, 1], circle),
        stack_flange_poses(pool, "eye_in_hand", settings.robot_std),
        (radius, np.inf),
        np.zeros(len(pool), dtype=np.int64),
    )
    target = np.array([*centre, radius, 0.0])[None, None]
    state = States(nominal.rotation[None], nominal.translation[None], target)
    jacobian = normal_system(sightings, state, robot_whitening(sightings, state, 1.0))[0][0]
    information: FloatArray = np.swapaxes(jacobian, -1, -2) @ jacobian
    return information


def _stretches(heights: FloatArray, circle: FloatArray) -> FloatArray:
    """What `SphereSightings` asks for, of arcs not yet seen."""
    # Points r (sin, cos) whose heights grow by s move outwards by s r cos^2; a circle that
    # shifts in y and grows moves its points outwards by y cos + r.
    design = np.column_stack([np.cos(ARC), np.ones(len(ARC))])
    by_height, by_radius = np.linalg.lstsq(design, np.cos(ARC) ** 2, rcond=None)[0]
    stretches = np.zeros((len(circle), 2, 3))
    stretches[:, 0, 1] = by_height * circle + heights - heights.mean()
    stretches[:, 0, 2] = by_radius * circle
    return stretches


def _greedy(
    informations: FloatArray,
    measured: int,
    usable: BoolArray,
    count: int,
    arm: FloatArray,
) -> tuple[IntArray, list[tuple[float, float]]]:
    shift, turn, place, size, scale = START_STD
    prior = np.array([shift] * 3 + [turn] * 3 + [place] * 3 + [size, scale])
    total = np.diag(prior**-2) + informations[:measured].sum(axis=0)
    weights = np.array([1.0] * 3 + [100.0**2] * 3)
    free = usable.copy()
    free[:measured] = False
    x, y, z = arm
    at_work = np.hstack([np.eye(3), -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])])
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
