"""Tubes measured in simulated images, in units of the sigma that is said.

In each condition the images are those of `pictures` places of the tube (own rendering of
`tests.laser_line.other_pictures`, or the package's simulator), each with its own noise several
times. Each image is measured twice: with the blur of its lens stated, and not stated.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from lsvision.errors import LsvisionError
from lsvision.measure import measure_cylinders
from lsvision.sensors.camera import Camera
from lsvision.sensors.light_section import LightSection
from lsvision.simulate.scene import Scene
from lsvision.simulate.solids import Tube
from tests.bench.goals import Number
from tests.laser_line.line_scenes import RIG, STAND_OFF, rendered
from tests.laser_line.other_pictures import Picture, photograph

FIRST_SEED = 70_000
WITHIN_SIGMAS = 3.0
MAX_BIAS = 5.0  # um, at 25 mm / 300 mm, with the blur stated
MAX_MISSED = 0.02
BLURS = 0.4, 1.0  # px


@dataclass(frozen=True)
class Conditions:
    """`pictures` places of a tube, each photographed `shots` times."""

    name: str
    place: Callable[[np.random.Generator], Picture]
    max_bias: float = math.inf


def _place(rng, **fixed):
    size = rng.uniform(15, 25)
    centre = rng.uniform(-8, 8), -270.0 + rng.uniform(-4, 4)
    return replace(Picture(), radius=size, centre=centre, psf=rng.uniform(*BLURS), **fixed)


def _goal_place(rng, **fixed):
    centre = rng.uniform(-5, 5), STAND_OFF - 25
    return Picture(
        radius=25.0, centre=centre, focal_length=2264.0, size=(1280, 1024), psf=0.7, **fixed
    )


def _painted(rng):
    picture = _place(rng, roll=rng.uniform(0, 45))
    edge = picture.centre[0] + rng.uniform(-0.7, 0.4) * picture.radius
    return replace(picture, dark=(edge, edge + rng.uniform(0.1, 0.3) * picture.radius))


CONDITIONS = (
    Conditions("25 mm at 300 mm, alone", lambda rng: _goal_place(rng, wall=None), MAX_BIAS),
    Conditions("25 mm at 300 mm, wall", lambda rng: _goal_place(rng, wall=-310.0), MAX_BIAS),
    Conditions("before a wall", _place),
    Conditions("abrupt ends", lambda rng: _place(rng, cut=rng.uniform(0.3, 0.6))),
    Conditions(
        "abrupt ends, diagonal",
        lambda rng: _place(rng, cut=rng.uniform(0.3, 0.6), roll=rng.uniform(0, 45)),
    ),
    Conditions("diagonal 15 deg", lambda rng: _place(rng, roll=15.0)),
    Conditions("diagonal 30 deg", lambda rng: _place(rng, roll=30.0)),
    Conditions("diagonal 45 deg", lambda rng: _place(rng, roll=45.0)),
    Conditions("tilted to X", lambda rng: _place(rng, tilt=(20.0, 0.0))),
    Conditions("tilted to Y, 30 deg", lambda rng: _place(rng, tilt=(0.0, 20.0), roll=30.0)),
    Conditions("thick sheet", lambda rng: _place(rng, sheet=0.3, roll=rng.uniform(0, 45))),
    Conditions("paint", _painted),
)
"""Blur, size and place are drawn for each picture."""


@dataclass(frozen=True)
class Errors:
    """Error of each radius found, in mm and in sigmas, and images without it."""

    errors: np.ndarray
    stds: np.ndarray
    missed: int

    @classmethod
    def of(cls, radii, truths):
        """`radii` are pairs (radius, std), or None where the tube is missed."""
        found = [(got[0] - truth, got[1]) for got, truth in zip(radii, truths, strict=True) if got]
        errors, stds = np.array(found).reshape(-1, 2).T
        return cls(errors, stds, sum(got is None for got in radii))

    def numbers(self, name, max_bias=math.inf) -> Iterator[Number]:
        ratios = np.abs(self.errors) / self.stds
        median, most = np.quantile(ratios, (0.5, 0.95)) if len(ratios) else (math.nan, math.nan)
        beyond = f"median {median:.2f}, {(ratios > WITHIN_SIGMAS).mean():.1%} beyond 3"
        yield Number(f"{name}: 95 % of |error| / sigma", most, high=WITHIN_SIGMAS, note=beyond)
        scatter = f"std {1e3 * self.errors.std():.1f}, said {1e3 * np.median(self.stds):.1f} um"
        bias = 1e3 * abs(self.errors.mean())
        yield Number(f"{name}: |bias|", bias, high=max_bias, unit="um", note=scatter)
        share = self.missed / max(self.missed + len(self.errors), 1)
        yield Number(f"{name}: missed", 100 * share, high=100 * MAX_MISSED, unit="%")


def radius_near(section, image, x):
    """Radius and std of the cylinder nearest to X = x, None where none is found. Units: mm."""
    try:
        cylinders = measure_cylinders(section.profile(image)).cylinders
    except LsvisionError:
        return None
    near = [c for c in cylinders if abs(c.centre[0] - x) < 5]
    return min(((c.radius, c.radius_std) for c in near), key=lambda c: c[1], default=None)


def score(conditions, pictures, shots, seed=FIRST_SEED) -> Iterator[Number]:
    """Rows of one condition, the blur stated and not."""
    stated, unstated, truths = [], [], []
    for k in range(pictures):
        rng = np.random.default_rng([seed, k])
        picture = conditions.place(rng)
        light, x = picture.light(), picture.centre[0]
        for _ in range(shots):
            image = photograph(light, rng)
            stated.append(radius_near(picture.light_section(picture.blur), image, x))
            unstated.append(radius_near(picture.light_section(), image, x))
            truths.append(picture.radius)
    yield from Errors.of(stated, truths).numbers(
        f"{conditions.name}, blur stated", conditions.max_bias
    )
    yield from Errors.of(unstated, truths).numbers(f"{conditions.name}, unstated")


def score_simulator(images, seed=FIRST_SEED) -> Iterator[Number]:
    """The same of the package's own simulator: a pipe of 25 mm, tilted, blur 0.7 px."""
    tube = Tube.of(25.0, math.pi / 2, math.radians(20), (0.0, STAND_OFF - 25))
    camera = Camera(RIG.matrix, RIG.distortion, RIG.size)
    for name, blur, goal in (("stated", 0.7, MAX_BIAS), ("unstated", 0.0, math.inf)):
        section = LightSection(camera, RIG.laser_plane, line_blur_px=blur)
        radii = [
            radius_near(section, rendered(Scene((tube,)), seed + k, psf_sigma=0.7).image, 0)
            for k in range(images)
        ]
        yield from Errors.of(radii, [25.0] * images).numbers(f"own simulator, blur {name}", goal)


def score_images(pictures, shots, seed=FIRST_SEED) -> Iterator[Number]:
    """All rows."""
    for conditions in CONDITIONS:
        yield from score(conditions, pictures, shots, seed)
    yield from score_simulator(pictures * shots, seed)
