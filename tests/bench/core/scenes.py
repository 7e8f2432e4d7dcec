"""Scenes by set and index: the same set, index and seed give the same scene, however many are made.

A: the kinds of `lsvision.simulate`; s: with the sensor as noise model; h: with more lost points and
jumps. B, Bu: two tubes in clutter by the second simulator (`tests.other_scenes`), welded and not.
C, C2: shapes that are no pipe. T: arcs that deviate from the model. D: processed data. G: one
tilted tube with noise only. The code under test gets the points and the sensor, but not the truth.
"""

import math
import zlib
from dataclasses import dataclass, replace

import numpy as np

from lsvision.sensors.profile_sensor import ProfileSensor
from lsvision.simulate import NOTHING, SCENE_KINDS, SectionSettings, TubeRanges, random_section
from tests.bench.core import processed, shapes
from tests.bench.core.bound import bound_radius
from tests.other_scenes import other_scene

HARD = SectionSettings(lost_fraction=0.10, jump_fraction=0.05)
CLEAN = SectionSettings(lost_fraction=0.0, jump_fraction=0.0)
HARD_SEEDS, CLEAN_SEEDS = 50_000, 70_000
"""Offsets of the seeds of Ah and Ahs, and of G, from the first seed."""
TILTED = TubeRanges(phi_deg=(15.0, 40.0))


@dataclass(frozen=True)
class TruePipe:
    """A pipe of a scene; `radii` are all correct values of its radius, the nominal one first.

    `bound` is the Cramer-Rao bound of the radius for the true points of the pipe, and
    `linear_error` the error of the linear estimate from the same noise, which attains the bound;
    NaN where unknown. Units: mm.
    """

    label: int
    radii: tuple[float, ...]
    visible: bool = True
    bound: float = math.nan
    linear_error: float = math.nan

    @property
    def radius(self):
        return self.radii[0]


@dataclass(frozen=True, eq=False)
class CoreScene:
    """Points (n, 2), the sensor that is their noise model, if any, labels (n,) and pipes.

    `words` describe the scene in messages.
    """

    name: str
    kind: str
    words: str
    points: np.ndarray
    labels: np.ndarray
    tubes: tuple[TruePipe, ...] = ()
    sensor: ProfileSensor | None = None

    def __str__(self):
        return f"{self.name} {self.kind}, {self.words}"


def simulated_scene(seed, index, settings=None):
    """One of the kinds of `lsvision.simulate` in turn, with its sensor."""
    kinds = list(SCENE_KINDS)
    kind, scene_seed = kinds[index % len(kinds)], seed + index // len(kinds)
    section = random_section(kind, scene_seed, settings=settings)
    return _from_section(kind, scene_seed, section)


def clean_scene(seed, index):
    """Set G: one tilted tube with noise and nothing else, and its sensor."""
    scene_seed = seed + CLEAN_SEEDS + index
    section = random_section("single", scene_seed, settings=CLEAN, tubes=TILTED)
    return _from_section("single", scene_seed, section)


def _from_section(kind, seed, section):
    tubes = tuple(
        TruePipe(tube.label, (tube.radius,), tube.visible, *bound_radius(section, tube))
        for tube in section.truth.tubes
    )
    points, labels = section.profile.points, section.truth.labels
    return CoreScene("", kind, f"seed {seed}", points, labels, tubes, section.sensor)


def without_sensor(scene):
    return replace(scene, sensor=None)


def two_tubes(seed, index, *, welded):
    """Two tubes in clutter, by the second simulator."""
    rng = np.random.default_rng(seed + index)
    points, labels, tubes = other_scene(rng, 2, cluttered=True, welded=welded)
    pipes = tuple(TruePipe(label, (tube.radius,)) for label, tube in enumerate(tubes, 1))
    kind = "welded in clutter" if welded else "two in clutter"
    return CoreScene("", kind, f"seed {seed + index}", points, labels, pipes)


def rectangular_tube(seed, index):
    """Set C: on a ground plate every other time, with losses and jumps every fourth."""
    rng = _generator("C", seed, index)
    outline, height, words = shapes.rectangular_tube(rng)
    tilt = math.radians(rng.uniform(0.0, 20.0) * rng.choice([-1, 1]))
    floor = height if index % 2 else None
    settings = SectionSettings() if index % 4 > 1 else None
    place = {"tilt": tilt, "floor": floor, "settings": settings}
    return _no_pipe("rectangular tube", rng, outline, words, place)


def no_cylinder(seed, index):
    """Set C2: one of `NO_CYLINDERS` in turn."""
    rng = _generator("C2", seed, index)
    kind = NO_CYLINDERS[index % len(NO_CYLINDERS)]
    tilt, floor = math.radians(rng.uniform(-15.0, 15.0)), None
    if kind == "plate edge":
        outline, floor, words = shapes.plate_edge(rng)
    else:
        outline, words = (shapes.FLATS | shapes.CURVES | shapes.PIPE_LIKE)[kind](rng)
    if kind == "bent sheet":
        tilt = math.radians(rng.uniform(-45.0, 45.0))
    return _no_pipe(kind, rng, outline, words, {"tilt": tilt, "floor": floor})


NO_CYLINDERS = ["plate edge", *shapes.FLATS, *shapes.CURVES, *shapes.PIPE_LIKE]


def _no_pipe(kind, rng, outline, words, place):
    """The outline seen at a pitch of 0.1-0.6 mm with noise of 0.02-0.1 mm, both log-uniform."""
    pitch, noise = np.exp(rng.uniform(np.log([0.1, 0.02]), np.log([0.6, 0.1]))).tolist()
    section = shapes.look_at(outline, rng, pitch=pitch, noise=noise, **place)
    words += f" tilt {math.degrees(place['tilt']):.0f} pitch {pitch:.2f} noise {noise:.3f}"
    points = section.profile.points
    return CoreScene("", kind, words, points, np.zeros(len(points), int))


def bent_model(seed, index):
    """Set T: an arc that is not quite what the model says, alone.

    - two radii: 15 and 25 mm (x 0.8-1.2), joined at the crest with a common tangent; either is
      a radius of the crest.
    - flank noise: its sigma grows from one at the crest to three times that at 75 deg.
    - ripple: 0.05 mm of amplitude and 25 mm of period along the arc, on the radius.
    - flank bias: points read low by 0.3 mm (x / 0.65 r)^4.
    """
    rng = _generator("T", seed, index)
    kind = MODEL_FAULTS[index % len(MODEL_FAULTS)]
    radius = rng.uniform(10.0, 25.0)
    noise, pitch = rng.uniform(0.02, 0.1), rng.uniform(0.2, 0.5)
    angles = np.linspace(-math.pi / 2, math.pi / 2, 721)
    radii, along = (radius,), np.full(len(angles), radius)
    if kind == "two radii":
        radii = tuple(rng.permutation(np.array([15.0, 25.0]) * rng.uniform(0.8, 1.2)).tolist())
        along = np.where(angles < 0, *radii)
    elif kind == "ripple":
        along = radius + 0.05 * np.sin(2 * math.pi * angles * radius / 25 + rng.uniform(0, 6.28))
    outline = np.column_stack([along * np.sin(angles), along * (np.cos(angles) - 1)])
    exact = SectionSettings(lost_fraction=0.0, jump_fraction=0.0, noise_factor=0.0)
    section = shapes.look_at(outline, rng, pitch=pitch, noise=noise, settings=exact)
    points = shapes.displaced(section, _error_along_ray(kind, rng, section, radius, noise))
    words = f"r {' '.join(f'{r:.1f}' for r in radii)} noise {noise:.3f} pitch {pitch:.2f}"
    labels = np.where(np.isfinite(points[:, 0]), 1, NOTHING)
    return CoreScene("", kind, words, points, labels, (TruePipe(1, radii),))


MODEL_FAULTS = ["two radii", "flank noise", "ripple", "flank bias"]


def _error_along_ray(kind, rng, section, radius, noise):
    exact = section.truth.points
    offset = exact[:, 0] - exact[np.nanargmax(exact[:, 1]), 0]
    error = noise * rng.standard_normal(len(exact))
    if kind == "flank noise":
        slope = np.degrees(np.arcsin(np.clip(np.abs(offset) / radius, 0, 1)))
        return error * (1 + 2 * np.minimum(slope / 75.0, 1.0))
    if kind == "flank bias":
        return error + 0.3 * (offset / (0.65 * radius)) ** 4
    return error


def processed_circle(seed, index):
    """Set D: one of `processed.PROCESSES` in turn."""
    rng = _generator("D", seed, index)
    kinds = list(processed.PROCESSES)
    kind, ends = kinds[index % len(kinds)], ("one-sided", "lost")[index // len(kinds) % 2]
    x, y, radius, _, words = processed.PROCESSES[kind](rng, ends)
    points = np.column_stack([x, y])
    points[~np.isfinite(y)] = np.nan
    labels = np.where(np.isfinite(y), 1, NOTHING)
    words = f"r {radius:.1f} pitch {x[1] - x[0]:.3f} {words}"
    return CoreScene("", kind, words, points, labels, (TruePipe(1, (radius,)),))


SETS = {
    "A": lambda seed, i: without_sensor(simulated_scene(seed, i)),
    "As": simulated_scene,
    "Ah": lambda seed, i: without_sensor(simulated_scene(seed + HARD_SEEDS, i, HARD)),
    "Ahs": lambda seed, i: simulated_scene(seed + HARD_SEEDS, i, HARD),
    "B": lambda seed, i: two_tubes(seed, i, welded=True),
    "Bu": lambda seed, i: two_tubes(seed, i, welded=False),
    "C": rectangular_tube,
    "C2": no_cylinder,
    "T": bent_model,
    "D": processed_circle,
    "G": clean_scene,
}


def make_scene(name, index, seed):
    """Scene `index` of a set."""
    return replace(SETS[name](seed, index), name=f"{name}:{index}")


def make_scenes(name, count, seed):
    """The first `count` scenes of a set."""
    return [make_scene(name, index, seed) for index in range(count)]


def _generator(name, seed, index):
    return np.random.default_rng([seed, zlib.crc32(name.encode()), index])
