"""Simulate hand-eye calibration: profiles of spheres and planes, and noisy robot poses.

Assumptions: the columns of the sensor are equally spaced in x; the laser plane is z = 0 of the
section; a column measures the point nearest to the sensor (largest y); the errors of the points
are along y and normal, independent or correlated between neighbours (`correlation`); all heights
may have a scale error (`height_scale`); surfaces steeper than `max_slope` are not measured; the
reported robot poses have independent normal errors in each axis of position and rotation.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from lsvision.geometry import BoolArray, FloatArray, Plane, Pose
from lsvision.profile import Profile
from lsvision.simulate.section import draw_correlated_unit_noise


@dataclass(frozen=True, kw_only=True, slots=True)
class SectionView:
    """Measuring range and errors of a simulated profile sensor.

    Parameters
    ----------
    columns : int
        Number of points of a profile.
    width : float
        Length of the line, centred at x = 0. Units: mm.
    depth : tuple of float
        Smallest and largest y that is measured; by default the origin of the section frame is the
        middle of the measuring range. Units: mm.
    range_std : float
        Standard deviation of the noise along y. Units: mm.
    max_slope : float
        Largest slope of the surface that is measured. Units: rad.
    correlation : float
        Standard deviation of the Gaussian filter of the noise, which is rescaled to `range_std`;
        0 for independent errors. Units: columns.
    height_scale : float
        Factor on every height y, about the origin of the section frame.
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


def simulate_sphere_profile(
    centre: FloatArray, radius: float, view: SectionView, rng: np.random.Generator
) -> Profile:
    """Simulate the profile of a sphere with a centre (3,) in mm, section frame.

    Points are lost where the sphere is not measured; `rng` is the source of the noise.

    Examples
    --------
    >>> noise_free = SectionView(columns=3, width=6.0, range_std=0.0)
    >>> simulate_sphere_profile((0, -300, 4), 5.0, noise_free, np.random.default_rng(0)).points
    array([[  nan,   nan],
           [   0., -297.],
           [  nan,   nan]])
    """
    x = view.x
    cx, cy, cz = np.asarray(centre, dtype=np.float64)
    circle_radius2 = radius**2 - cz**2
    height2 = circle_radius2 - (x - cx) ** 2
    # The sine of the slope is |x - cx| divided by the radius of the circle in the section.
    max_distance = math.sin(view.max_slope) * math.sqrt(max(circle_radius2, 0.0))
    measured = (height2 > 0) & (np.abs(x - cx) <= max_distance)
    y = cy + np.sqrt(np.where(measured, height2, 0.0))
    return _add_noise(x, y, measured, view, rng)


def simulate_plane_profile(plane: Plane, view: SectionView, rng: np.random.Generator) -> Profile:
    """Simulate the profile of a plane; without points if it is steeper than the view allows.

    The plane is given in the section frame; other parameters are those of
    `simulate_sphere_profile`.
    """
    x = view.x
    nx, ny, _ = plane.normal
    # A plane parallel to the section has neither nx nor ny.
    if ny == 0 or abs(ny) < math.cos(view.max_slope) * math.hypot(nx, ny):
        return _add_noise(x, np.zeros_like(x), np.zeros(len(x), dtype=bool), view, rng)
    y = (plane.distance - nx * x) / ny
    return _add_noise(x, y, np.ones(len(x), dtype=bool), view, rng)


def _add_noise(
    x: FloatArray,
    y: FloatArray,
    measured: BoolArray,
    view: SectionView,
    rng: np.random.Generator,
) -> Profile:
    """Return the profile with noise and height scale; points that are not measured are lost."""
    noise = view.range_std * draw_correlated_unit_noise(len(x), view.correlation, rng)
    heights = view.height_scale * y + noise
    measured = measured & (heights >= view.depth[0]) & (heights <= view.depth[1])
    points = np.where(measured[:, None], np.column_stack([x, heights]), np.nan)
    return Profile(points)


def rotation_from_vector(vector: npt.ArrayLike) -> FloatArray:
    """Return the (3, 3) rotation of a rotation vector (3,) in rad."""
    rotation: FloatArray = Rotation.from_rotvec(vector).as_matrix()
    return rotation


def perturb_pose(
    pose: Pose, position_std: float, rotation_std: float, rng: np.random.Generator
) -> Pose:
    """Return a robot pose with random errors of position (mm) and rotation (rad).

    The standard deviations are those per axis of the base frame.
    """
    error = rotation_from_vector(rng.normal(0.0, 1.0, 3) * rotation_std)
    translation_error = rng.normal(0.0, 1.0, 3) * position_std
    return Pose(error @ pose.rotation, pose.translation + translation_error)


@dataclass(frozen=True, kw_only=True, slots=True)
class TargetMotion:
    """Range of the sensor poses relative to a target.

    Parameters
    ----------
    tilt, spin : float
        Largest tilt of the section from upright about X and about Y of the base frame, and largest
        rotation about its Z, which follows. Units: rad.
    sideways, depth : float
        Largest offset of the target along the section's X and Y. Units: mm.
    offset : float
        Largest offset along Z, normal to the laser plane. Units: mm.
    working_y : float
        Mean Y of the target, section frame: 0 where the origin is the middle of the measuring
        range, negative where it is the sensor. Units: mm.
    """

    tilt: float = math.radians(35)
    spin: float = math.pi
    sideways: float = 30.0
    depth: float = 45.0
    offset: float = 16.0
    working_y: float = 0.0


def draw_section_poses_about(
    target: FloatArray, count: int, motion: TargetMotion, rng: np.random.Generator
) -> list[Pose]:
    """Draw random ``base_from_section`` poses from which a target is visible.

    The position of the target (3,) is in mm, base frame. Each quantity is distributed uniformly
    within the limits of `motion`. The section's Y points upwards (base Z) for zero tilt.
    """
    upright = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # section Y upwards
    poses = []
    for _ in range(count):
        spin = rotation_from_vector(np.array([0, 0, rng.uniform(-motion.spin, motion.spin)]))
        tilt_x = rotation_from_vector(np.array([rng.uniform(-motion.tilt, motion.tilt), 0, 0]))
        tilt_y = rotation_from_vector(np.array([0, rng.uniform(-motion.tilt, motion.tilt), 0]))
        rotation = spin @ tilt_x @ tilt_y @ upright
        target_in_section = np.array(
            [
                rng.uniform(-motion.sideways, motion.sideways),
                motion.working_y + rng.uniform(-motion.depth, motion.depth),
                rng.uniform(-motion.offset, motion.offset),
            ]
        )
        poses.append(Pose(rotation, np.asarray(target) - rotation @ target_in_section))
    return poses
