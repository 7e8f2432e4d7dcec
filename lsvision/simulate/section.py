"""Simulate the profile of a scene: one light section with its truth, or a scan of many.

Frame: the section frame, with the origin of the rays at the sensor's own. Assumptions: each
column is one ray in the laser plane and measures the first surface that it meets; a point is lost
outside the sensor's range, hidden from the camera, at grazing incidence or at random; the error of
a point lies along the ray, with a standard deviation that grows with the square of the range;
jumps are errors of several mm along the ray; last of all, coordinates are rounded to the sensor's
quantum. Each kind of error draws the same number of random numbers for every scene, so that a
change of one object leaves the errors of the other columns as they were.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from lsvision.geometry import FloatArray, Points, Pose
from lsvision.geometry.arguments import as_numbers
from lsvision.geometry.arrays import BoolArray
from lsvision.geometry.pose import as_poses
from lsvision.geometry.settings_repr import ShowsChanges
from lsvision.profile import NoiseModel, PointNoise, Profile
from lsvision.sensors.profile_sensor import LATERAL_STD_RATIO, ProfileSensor
from lsvision.simulate.scene import NOTHING, Scene, SectionTruth, list_tube_truths
from lsvision.simulate.solids import Hits, Rays

SAME_SURFACE_TOLERANCE = 1e-6
"""Largest distance between a point and the first hit of the ray to it from the camera, over that of
point and camera, at which the point counts as visible."""


@dataclass(frozen=True, kw_only=True, repr=False)
class SectionSettings(ShowsChanges):
    """Errors of a simulated profile sensor.

    Parameters
    ----------
    rays : {"fan", "parallel"}
        Rays that diverge from the sensor's origin, equally spaced at its far limit; or parallel
        rays of equal pitch over the same width.
    noise_factor : float
        Ratio of the true noise to that of the sensor's noise model; 0 for no noise.
    correlation_columns : float
        Standard deviation of the Gaussian filter that correlates the errors of neighbouring
        columns; 0 for independent errors. Units: columns.
    lost_fraction : float
        Probability that a column is lost, independently of the others.
    lost_runs, lost_run_columns : int
        Number of runs of lost columns, and the largest length of a run; the smallest is 2.
    jump_fraction : float
        Fraction of points displaced by a jump.
    jump_mm : tuple of float
        Smallest and largest jump along the ray, of either sign. Units: mm.
    jump_pair_fraction : float
        Fraction of the jumps that displace the next column as well.
    grazing_limit_deg, grazing_ramp_deg : float
        Incidence angle above which every point is lost, and width of the interval below it in
        which the probability of loss rises from 0 to 1. Units: deg.
    camera : tuple of float, optional
        Position of the camera, section frame: points hidden from it are lost. Units: mm.
    """

    rays: Literal["fan", "parallel"] = "fan"
    noise_factor: float = 1.0
    correlation_columns: float = 0.0
    lost_fraction: float = 0.03
    lost_runs: int = 0
    lost_run_columns: int = 6
    jump_fraction: float = 0.02
    jump_mm: tuple[float, float] = (2.0, 12.0)
    jump_pair_fraction: float = 0.3
    grazing_limit_deg: float = 82.0
    grazing_ramp_deg: float = 6.0
    camera: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.rays not in ("fan", "parallel"):
            raise ValueError(f"expected rays 'fan' or 'parallel', got {self.rays!r}")
        for name in ("lost_fraction", "jump_fraction", "jump_pair_fraction"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"expected {name} in [0, 1], got {getattr(self, name)}")
        for name in ("noise_factor", "correlation_columns", "grazing_ramp_deg", "lost_runs",
                     "grazing_limit_deg"):  # fmt: skip
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"expected {name} >= 0, got {getattr(self, name)}")
        low, high = as_numbers(self.jump_mm, 2, "jump_mm (smallest, largest)")
        if not 0 < low <= high < math.inf:
            raise ValueError(f"expected jump_mm (smallest, largest), got {self.jump_mm}")
        if self.camera is not None:
            as_numbers(self.camera, 3, "camera (x, y, z) in mm")

    @classmethod
    def ideal(cls) -> "SectionSettings":
        """Return settings without noise, losses, jumps and grazing limit."""
        return cls(noise_factor=0, lost_fraction=0, jump_fraction=0, grazing_limit_deg=90.0,
                   grazing_ramp_deg=0)  # fmt: skip


@dataclass(frozen=True, eq=False)
class SimulatedSection:
    """Simulated profile with its truth.

    Parameters
    ----------
    profile : Profile
        Measured profile; its noise model is the sensor, or for parallel rays a covariance per
        point.
    truth : SectionTruth
        Labels and noise-free points of all columns, and the tubes.
    sensor : ProfileSensor
        Simulated sensor.
    settings : SectionSettings
        Simulated errors.
    """

    profile: Profile
    truth: SectionTruth
    sensor: ProfileSensor
    settings: SectionSettings


def simulate_section(
    scene: Scene,
    sensor: ProfileSensor,
    settings: SectionSettings,
    *,
    rng: np.random.Generator,
    base_from_section: Pose | None = None,
) -> SimulatedSection:
    """Simulate one profile of a scene.

    Parameters
    ----------
    scene : Scene
        Scene in the base frame.
    sensor : ProfileSensor
        Columns, measuring range, width of the line and noise of the sensor.
    settings : SectionSettings
        Errors of the sensor.
    rng : numpy.random.Generator
        Source of all random numbers; the same state yields identical bytes.
    base_from_section : Pose, optional
        Pose of the section. None: the section frame is the base frame.

    Returns
    -------
    SimulatedSection
        Profile of `sensor.columns` rows, NaN for a column without a point, and its truth.

    Examples
    --------
    >>> from lsvision.simulate import Scene, Tube
    >>> tube = Tube.of(radius=20.0, theta=0.5, phi=0.3, centre=(0.0, -400.0))
    >>> section = simulate_section(
    ...     Scene((tube,)), ProfileSensor(), SectionSettings(), rng=np.random.default_rng(1)
    ... )
    >>> f"{section.truth.tubes[0].points} points, radius {section.truth.tubes[0].radius:g} mm"
    '50 points, radius 20 mm'
    """
    pose = base_from_section or Pose()
    rays = build_column_rays(sensor, settings)
    base_rays = rays.transformed(pose)
    hits, labels = scene.first_hits(base_rays)
    depths = -hits.distances * rays.directions[:, 1]
    measured = (depths >= sensor.min_range) & (depths <= sensor.max_range)
    measured &= is_visible_at_incidence(hits, base_rays, settings, rng)
    exact = rays.origins + np.where(measured, hits.distances, np.nan)[:, None] * rays.directions
    if settings.camera is not None:
        measured &= _visible_from(settings.camera, exact, scene, pose)
    measured &= ~draw_lost_columns(sensor.columns, settings, rng)
    labels = np.where(measured, labels, NOTHING)
    exact = np.where(measured[:, None], exact, np.nan)[:, :2]
    std = noise_std(exact, sensor)
    jumps = draw_jumps(sensor.columns, settings, rng)
    unit_noise = draw_correlated_unit_noise(sensor.columns, settings.correlation_columns, rng)
    noise = settings.noise_factor * std * unit_noise
    points = exact + (noise + jumps)[:, None] * rays.directions[:, :2]
    if sensor.quantum > 0:
        points = np.round(points / sensor.quantum) * sensor.quantum
    labels = np.where(jumps != 0, NOTHING, labels).astype(np.int64)
    profile = Profile(points, noise=_build_noise_model(std, sensor, settings))
    truth = SectionTruth(labels, exact, list_tube_truths(scene, pose, labels, exact))
    return SimulatedSection(profile, truth, sensor, settings)


def simulate_scan(
    scene: Scene,
    base_from_sections: Sequence[Pose | npt.ArrayLike],
    sensor: ProfileSensor,
    settings: SectionSettings,
    *,
    rng: np.random.Generator,
) -> tuple[SimulatedSection, ...]:
    """Simulate profiles of a scene at several poses.

    Parameters
    ----------
    scene : Scene
        Scene in the base frame.
    base_from_sections : sequence of Pose or (4, 4) array_like
        Pose of each section.
    sensor, settings, rng
        As for `simulate_section`.
    """
    return tuple(
        simulate_section(scene, sensor, settings, rng=rng, base_from_section=pose)
        for pose in as_poses(base_from_sections)
    )


def build_column_rays(sensor: ProfileSensor, settings: SectionSettings) -> Rays:
    """Return the rays of the sensor's columns, section frame, with unit directions."""
    half = sensor.width_at_max_range / 2
    x = np.linspace(-half, half, sensor.columns)
    zeros = np.zeros(sensor.columns)
    origins = np.column_stack([zeros + sensor.origin[0], zeros + sensor.origin[1], zeros])
    if settings.rays == "parallel":
        origins[:, 0] += x
        return Rays(origins, np.column_stack([zeros, zeros - 1.0, zeros]))
    directions = np.column_stack([x, zeros - sensor.max_range, zeros])
    return Rays(origins, directions / np.linalg.norm(directions, axis=1, keepdims=True))


def _visible_from(
    camera: tuple[float, float, float], exact: Points, scene: Scene, pose: Pose
) -> BoolArray:
    """Return the mask of points (n, 3) of the section that are not hidden from the camera.

    False for lost points.
    """
    visible = np.isfinite(exact[:, 0])
    directions = exact[visible] - np.asarray(camera)
    rays = Rays(np.broadcast_to(camera, directions.shape), directions)
    hits, _ = scene.first_hits(rays.transformed(pose))
    visible[visible] = hits.distances >= 1 - SAME_SURFACE_TOLERANCE
    return visible


def _build_noise_model(
    std: FloatArray, sensor: ProfileSensor, settings: SectionSettings
) -> NoiseModel:
    """Return the sensor; for parallel rays, which it cannot model, the covariance of each point."""
    if settings.rays == "fan":
        return sensor
    covariances = np.zeros((len(std), 2, 2))
    covariances[:, 1, 1] = std**2 + sensor.quantum**2 / 12
    covariances[:, 0, 0] = (LATERAL_STD_RATIO * std) ** 2 + sensor.quantum**2 / 12
    return PointNoise(np.where(np.isnan(std)[:, None, None], np.nan, covariances))


def noise_std(exact: Points, sensor: ProfileSensor) -> FloatArray:
    """Return the standard deviation (n,) along the ray, which grows with the square of the range.

    This repeats the formula of `ProfileSensor` on purpose: it is the truth against which the noise
    model of the sensor is tested. `exact` (n, 2) are the noise-free points, section frame.
    Units: mm.
    """
    dx, dy = exact[:, 0] - sensor.origin[0], exact[:, 1] - sensor.origin[1]
    return sensor.range_std * (dx * dx + dy * dy) / sensor.reference_range**2


def is_visible_at_incidence(
    hits: Hits, rays: Rays, settings: SectionSettings, rng: np.random.Generator
) -> BoolArray:
    """Return the mask of points that are not lost because of their angle of incidence.

    The rays, with unit directions, and the normals of the hits are in one frame; `rng` yields one
    number for each ray.
    """
    cosine = np.clip(-np.einsum("ij,ij->i", hits.normals, rays.directions), -1.0, 1.0)
    below_limit_deg = settings.grazing_limit_deg - np.degrees(np.arccos(cosine))
    ramp_deg = max(settings.grazing_ramp_deg, 1e-9)  # a ramp of 0 is a step
    visible: BoolArray = rng.random(len(cosine)) < below_limit_deg / ramp_deg
    return visible


def draw_lost_columns(
    columns: int, settings: SectionSettings, rng: np.random.Generator
) -> BoolArray:
    """Return a random mask of lost columns, single ones and runs."""
    lost: BoolArray = rng.random(columns) < settings.lost_fraction
    for _ in range(settings.lost_runs):
        start = rng.integers(columns)
        lost[start : start + rng.integers(2, max(settings.lost_run_columns, 2) + 1)] = True
    return lost


def draw_jumps(columns: int, settings: SectionSettings, rng: np.random.Generator) -> FloatArray:
    """Return a random displacement of each column by a jump; 0 for most. Units: mm."""
    pair_fraction = settings.jump_pair_fraction
    # A fraction of the jumps displaces two columns; the total is `jump_fraction`.
    starts_jump = rng.random(columns) < settings.jump_fraction / (1 + pair_fraction)
    paired = rng.random(columns) < pair_fraction
    displacement = rng.uniform(*settings.jump_mm, columns) * rng.choice([-1.0, 1.0], columns)
    repeats_jump = np.concatenate([[False], (starts_jump & paired)[:-1]])
    return np.where(
        starts_jump, displacement, np.where(repeats_jump, np.roll(displacement, 1), 0.0)
    )


def draw_correlated_unit_noise(
    columns: int, filter_std: float, rng: np.random.Generator
) -> FloatArray:
    """Return a standard normal error of each column, correlated by a Gaussian filter.

    `filter_std` is its standard deviation in columns; 0 for independent errors.
    """
    if filter_std == 0:
        return rng.standard_normal(columns)
    half_width = math.ceil(4 * filter_std)
    weights = np.exp(-0.5 * (np.arange(-half_width, half_width + 1) / filter_std) ** 2)
    white_noise = rng.standard_normal(columns + 2 * half_width)
    return np.convolve(white_noise, weights / np.linalg.norm(weights), mode="valid")
