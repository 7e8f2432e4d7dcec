"""Truth for sensor-to-robot calibration: what a moving section or camera sees of a target.

Assumptions, one by one: the sensor's columns are equally spaced in x; the laser plane is z = 0
of the section; a column returns the point nearest to the sensor (largest y); the error of a
point lies along y and is normal, its own or shared with its neighbours (`correlation`); all
heights may be too long by one factor (`height_scale`); a flank that leans more than `max_slope`
from y returns nothing; the robot reports a pose that departs from where it stands by
independent Gaussian errors in each axis of position and rotation.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, Plane, Pose
from lsvision.profile import Profile


@dataclass(frozen=True, kw_only=True, slots=True)
class SectionView:
    """What a simulated profile sensor sees.

    Parameters
    ----------
    columns : int
        Points in a profile.
    width : float
        Length of the line, centred at x = 0. Units: mm.
    depth : tuple of float
        Lowest and highest y that returns a point. Units: mm.
    range_std : float
        One sigma along y. Units: mm.
    max_slope : float
        Steepest surface that returns light. Units: rad.
    correlation : float
        One sigma of the Gaussian by which the errors of neighbours are averaged (and then
        brought back to `range_std`); 0 for independent ones. Units: columns.
    height_scale : float
        What every height y is multiplied by.
    """

    columns: int = 640
    width: float = 80.0
    depth: tuple[float, float] = (-400.0, 400.0)
    range_std: float = 0.05
    max_slope: float = math.radians(65)
    correlation: float = 0.0
    height_scale: float = 1.0

    @property
    def x(self) -> FloatArray:
        """(columns,) positions along the line. Units: mm."""
        return np.linspace(-self.width / 2, self.width / 2, self.columns)


def sphere_profile(
    centre: FloatArray, radius: float, view: SectionView, rng: np.random.Generator
) -> Profile:
    """Profile of a sphere.

    Parameters
    ----------
    centre : (3,) array_like
        Of the sphere, section frame. Units: mm.
    radius : float
        Units: mm.
    view : SectionView
        The sensor.
    rng : numpy.random.Generator
        Of the noise.

    Returns
    -------
    Profile
        Without a point wherever the sphere is missed.

    Examples
    --------
    >>> quiet = SectionView(columns=3, width=6.0, range_std=0.0)
    >>> sphere_profile((0, -300, 4), 5.0, quiet, np.random.default_rng(0)).points
    array([[  nan,   nan],
           [   0., -297.],
           [  nan,   nan]])
    """
    x = view.x
    cx, cy, cz = np.asarray(centre, dtype=np.float64)
    cut2 = radius**2 - cz**2
    rise2 = cut2 - (x - cx) ** 2
    # A flank's lean in the section: sin = |x - cx| / r of the cut circle.
    seen = (rise2 > 0) & (np.abs(x - cx) <= math.sin(view.max_slope) * math.sqrt(max(cut2, 0.0)))
    y = cy + np.sqrt(np.where(seen, rise2, 0.0))
    return _noisy_profile(x, y, seen, view, rng)


def plane_profile(plane: Plane, view: SectionView, rng: np.random.Generator) -> Profile:
    """Profile of a plane given in the section frame; see `sphere_profile`."""
    x = view.x
    nx, ny, _ = plane.normal
    if abs(ny) < math.cos(view.max_slope) * math.hypot(nx, ny):
        return _noisy_profile(x, x, np.zeros(len(x), dtype=bool), view, rng)
    y = (plane.distance - nx * x) / ny
    return _noisy_profile(x, y, np.ones(len(x), dtype=bool), view, rng)


def _noisy_profile(
    x: FloatArray,
    y: FloatArray,
    seen: "np.ndarray[tuple[int], np.dtype[np.bool_]]",
    view: SectionView,
    rng: np.random.Generator,
) -> Profile:
    noisy = (
        view.height_scale * y
        + _correlated_unit_noise(rng.normal(0.0, 1.0, len(x)), view) * view.range_std
    )
    seen = seen & (noisy >= view.depth[0]) & (noisy <= view.depth[1])
    points = np.where(seen[:, None], np.column_stack([x, noisy]), np.nan)
    return Profile(points)


def _correlated_unit_noise(noise: FloatArray, view: SectionView) -> FloatArray:
    """Unit noise whose neighbours are alike."""
    if not view.correlation > 0:
        return noise
    reach = math.ceil(4 * view.correlation)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / view.correlation) ** 2)
    kernel /= np.sqrt((kernel**2).sum())
    wide = np.concatenate([noise[-reach:], noise, noise[:reach]])
    alike: FloatArray = np.convolve(wide, kernel, "valid")
    return alike


def rotation_from_vector(vector: FloatArray) -> FloatArray:
    """Rotation about a vector by its length in rad (Rodrigues), one at a time."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = np.asarray(vector) / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation: FloatArray = (
        np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    )
    return rotation


def noisy_pose(
    pose: Pose, position_std: float, rotation_std: float, rng: np.random.Generator
) -> Pose:
    """What a robot with errors says of where it stands.

    Parameters
    ----------
    pose : Pose
        Where it stands.
    position_std, rotation_std : float
        One sigma in each axis. Units: mm, rad.
    rng : numpy.random.Generator
        Of the errors.
    """
    error = rotation_from_vector(rng.normal(0.0, 1.0, 3) * rotation_std)
    shift = rng.normal(0.0, 1.0, 3) * position_std
    return Pose(error @ pose.rotation, pose.translation + shift)


@dataclass(frozen=True, kw_only=True, slots=True)
class TargetMotion:
    """How a person is told to move the sensor before its target.

    Parameters
    ----------
    tilt, spin : float
        Largest tilt from the section's upright pose and turn about its Y. Units: rad.
    sideways, depth : float
        Largest offset of the target along the section's X and Y. Units: mm.
    offset : float
        Largest offset along Z, across the laser plane. Units: mm.
    standoff : float
        Mean y of the target. Units: mm.
    """

    tilt: float = math.radians(35)
    spin: float = math.pi
    sideways: float = 30.0
    depth: float = 45.0
    offset: float = 16.0
    standoff: float = 0.0


def section_poses_about(
    target: FloatArray, count: int, motion: TargetMotion, rng: np.random.Generator
) -> list[Pose]:
    """Random ``base_from_section`` poses from which a target is seen.

    Parameters
    ----------
    target : (3,) array_like
        Base frame. Units: mm.
    count : int
        How many.
    motion : TargetMotion
        Limits; each quantity is uniform within them.
    rng : numpy.random.Generator
        Of the choice.

    Returns
    -------
    list of Pose
        The section's Y looks up (base Z) where tilt and spin are zero.
    """
    upright = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # section Y up
    poses = []
    for _ in range(count):
        spin = rotation_from_vector(np.array([0, 0, rng.uniform(-motion.spin, motion.spin)]))
        lean = rotation_from_vector(np.array([rng.uniform(-motion.tilt, motion.tilt), 0, 0]))
        roll = rotation_from_vector(np.array([0, rng.uniform(-motion.tilt, motion.tilt), 0]))
        rotation = spin @ lean @ roll @ upright
        seen_at = np.array(
            [
                rng.uniform(-motion.sideways, motion.sideways),
                motion.standoff + rng.uniform(-motion.depth, motion.depth),
                rng.uniform(-motion.offset, motion.offset),
            ]
        )
        poses.append(Pose(rotation, np.asarray(target) - rotation @ seen_at))
    return poses
