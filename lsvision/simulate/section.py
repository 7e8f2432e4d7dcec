"""A sensor's look at a scene: one light section with its truth, or a scan of many.

Frame: the section frame, origin and rays at the sensor. Assumptions, one by one: each column
is one ray in the laser plane; the first surface it meets is measured; a point is lost beyond
the sensor's ranges, hidden from the camera, at grazing incidence or at random; the error of the
rest lies along the ray and grows with the square of the range; jumps are errors of several mm
along the ray; the numbers are rounded to the sensor's quantum last of all.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, Points, Pose
from lsvision.geometry.arrays import BoolArray
from lsvision.profile import NoiseModel, PointNoise, Profile
from lsvision.sensors.profile_sensor import LATERAL_FRACTION, ProfileSensor
from lsvision.simulate.rays import Hits, Rays
from lsvision.simulate.scene import NOTHING, Scene
from lsvision.simulate.sensor_errors import (
    SectionSettings,
    correlated_unit_noise,
    jumps_along,
    lost_columns,
    noise_std,
    visible_at_incidence,
)
from lsvision.simulate.truth import SectionTruth, tube_truths

SAME_SURFACE = 1e-6
"""Relative slack by which the camera's ray may end before the point that it looks at."""


@dataclass(frozen=True, eq=False)
class SimulatedSection:
    """A profile and what is true of it.

    Parameters
    ----------
    profile : Profile
        As the sensor gives it; its noise model is the sensor's (point by point for parallel rays).
    truth : SectionTruth
        Labels and noise-free points column by column, and the tubes.
    sensor : ProfileSensor
        What looked.
    settings : SectionSettings
        What went wrong.
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
    """Look at a scene once.

    Parameters
    ----------
    scene : Scene
        Base frame.
    sensor : ProfileSensor
        Columns, ranges, field and noise.
    settings : SectionSettings
        What goes wrong.
    rng : numpy.random.Generator
        Same state and arguments, same bytes out.
    base_from_section : Pose, optional
        Where the sensor stands; without, the section frame is the base frame.

    Returns
    -------
    SimulatedSection
        Always `sensor.columns` rows; a column that carries no point is a NaN row.

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
    rays = column_rays(sensor, settings)
    hits, labels = scene.first_hits(rays.seen_from(pose))
    seen = _in_range(hits, rays, sensor) & visible_at_incidence(
        hits, rays.seen_from(pose), settings, rng
    )
    exact = rays.origins + np.where(seen, hits.distances, np.nan)[:, None] * rays.directions
    if settings.camera is not None:
        seen &= _visible_from(settings.camera, exact, scene, pose)
    seen &= ~lost_columns(sensor.columns, settings, rng)
    labels = np.where(seen, labels, NOTHING)
    exact = np.where(seen[:, None], exact, np.nan)[:, :2]
    std = noise_std(exact, sensor)
    jumps = jumps_along(sensor.columns, settings, rng)
    error = (
        settings.noise_factor * std * correlated_unit_noise(sensor.columns, settings, rng) + jumps
    )
    points = exact + error[:, None] * rays.directions[:, :2]
    if sensor.quantum > 0:
        points = np.round(points / sensor.quantum) * sensor.quantum
    labels = np.where(jumps != 0, NOTHING, labels).astype(np.int64)
    profile = Profile(points, noise=_noise_model(std, sensor, settings))
    truth = SectionTruth(labels, exact, tube_truths(scene, pose, labels, exact))
    return SimulatedSection(profile, truth, sensor, settings)


def simulate_scan(
    scene: Scene,
    base_from_sections: Sequence[Pose],
    sensor: ProfileSensor,
    settings: SectionSettings,
    *,
    rng: np.random.Generator,
) -> tuple[SimulatedSection, ...]:
    """Look at a scene from many poses, one section each.

    Parameters
    ----------
    scene : Scene
        Base frame.
    base_from_sections : sequence of Pose
        Where the sensor stands for each section.
    sensor, settings, rng
        As for `simulate_section`.
    """
    return tuple(
        simulate_section(scene, sensor, settings, rng=rng, base_from_section=pose)
        for pose in base_from_sections
    )


def column_rays(sensor: ProfileSensor, settings: SectionSettings) -> Rays:
    """Rays of the sensor's columns, section frame, unit directions."""
    half = sensor.width_at_max_range / 2
    x = np.linspace(-half, half, sensor.columns)
    level = np.zeros(sensor.columns)
    origins = np.column_stack([level + sensor.origin[0], level + sensor.origin[1], level])
    if settings.rays == "parallel":
        origins[:, 0] += x
        return Rays(origins, np.column_stack([level, level - 1.0, level]))
    directions = np.column_stack([x, level - sensor.max_range, level])
    return Rays(origins, directions / np.linalg.norm(directions, axis=1, keepdims=True))


def _in_range(hits: Hits, rays: Rays, sensor: ProfileSensor) -> BoolArray:
    depth = -hits.distances * rays.directions[:, 1]
    return (depth >= sensor.min_range) & (depth <= sensor.max_range)


def _visible_from(
    camera: tuple[float, float, float], exact: Points, scene: Scene, pose: Pose
) -> BoolArray:
    """Which points of the section the camera sees unhidden."""
    eye = np.broadcast_to(camera, exact.shape)
    sight = Rays(eye, np.nan_to_num(exact - eye))
    hits, _ = scene.first_hits(sight.seen_from(pose))
    unhidden: BoolArray = hits.distances >= 1 - SAME_SURFACE
    return unhidden


def _noise_model(std: FloatArray, sensor: ProfileSensor, settings: SectionSettings) -> NoiseModel:
    """The sensor itself; for parallel rays, which it does not know, the noise point by point."""
    if settings.rays == "fan":
        return sensor
    covariances = np.zeros((len(std), 2, 2))
    covariances[:, 1, 1] = std**2 + sensor.quantum**2 / 12
    covariances[:, 0, 0] = (LATERAL_FRACTION * std) ** 2 + sensor.quantum**2 / 12
    return PointNoise(np.where(np.isnan(std)[:, None, None], np.nan, covariances))
