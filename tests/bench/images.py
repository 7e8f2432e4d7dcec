"""Errors of the radius of tubes in simulated images, over their predicted standard deviation.

A picture is a tube with its camera, drawn at random; of each, several images with different noise
are rendered by `tests.laser_line.other_pictures`, which shares no code with `lsvision.simulate`, or
by `lsvision.simulate`. Each image is measured twice: with the blur of its lens stated, and not.
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
MAX_SIGMAS = 3.0
"""Largest 95 % quantile of the errors, in predicted standard deviations."""
MAX_BIAS = 5.0
"""Largest bias of a radius of 25 mm at 300 mm, with the blur stated. Units: um."""
MAX_MISSED = 0.02
"""Largest fraction of images in which the tube is not found."""
MAX_OFFSET = 5.0
"""Largest distance of a cylinder from the true X of the centre to be the tube. Units: mm."""
BLURS = 0.4, 1.0  # px


@dataclass(frozen=True)
class Conditions:
    """Kind of pictures: a function that draws one at random, and the largest bias (um)."""

    name: str
    draw: Callable[[np.random.Generator], Picture]
    max_bias: float = math.inf


def random_picture(rng, **fixed):
    radius = rng.uniform(15, 25)
    centre = rng.uniform(-8, 8), -270.0 + rng.uniform(-4, 4)
    return replace(Picture(), radius=radius, centre=centre, psf=rng.uniform(*BLURS), **fixed)


def random_goal_picture(rng, **fixed):
    centre = rng.uniform(-5, 5), STAND_OFF - 25
    return Picture(
        radius=25.0, centre=centre, focal_length=2264.0, size=(1280, 1024), psf=0.7, **fixed
    )


def random_painted_picture(rng):
    picture = random_picture(rng, roll=rng.uniform(0, 45))
    edge = picture.centre[0] + rng.uniform(-0.7, 0.4) * picture.radius
    return replace(picture, dark=(edge, edge + rng.uniform(0.1, 0.3) * picture.radius))


CONDITIONS = (
    Conditions("25 mm at 300 mm, alone", lambda rng: random_goal_picture(rng, wall=None), MAX_BIAS),
    Conditions(
        "25 mm at 300 mm, wall", lambda rng: random_goal_picture(rng, wall=-310.0), MAX_BIAS
    ),
    Conditions("before a wall", random_picture),
    Conditions("abrupt ends", lambda rng: random_picture(rng, cut=rng.uniform(0.3, 0.6))),
    Conditions(
        "abrupt ends, diagonal",
        lambda rng: random_picture(rng, cut=rng.uniform(0.3, 0.6), roll=rng.uniform(0, 45)),
    ),
    Conditions("diagonal 15 deg", lambda rng: random_picture(rng, roll=15.0)),
    Conditions("diagonal 30 deg", lambda rng: random_picture(rng, roll=30.0)),
    Conditions("diagonal 45 deg", lambda rng: random_picture(rng, roll=45.0)),
    Conditions("tilted to X", lambda rng: random_picture(rng, tilt=(20.0, 0.0))),
    Conditions("tilted to Y, 30 deg", lambda rng: random_picture(rng, tilt=(0.0, 20.0), roll=30.0)),
    Conditions("thick sheet", lambda rng: random_picture(rng, sheet=0.3, roll=rng.uniform(0, 45))),
    Conditions("paint", random_painted_picture),
)
"""Blur, radius and centre are drawn for each picture."""


@dataclass(frozen=True)
class Errors:
    """Error and predicted std (mm) of each radius found, and number of images without one."""

    errors: np.ndarray
    stds: np.ndarray
    missed: int

    @classmethod
    def of(cls, radii, truths):
        """Return the errors of `radii`: pairs (radius, std), or None where the tube is missed."""
        found = [(r[0] - truth, r[1]) for r, truth in zip(radii, truths, strict=True) if r]
        errors, stds = np.array(found).reshape(-1, 2).T
        return cls(errors, stds, len(radii) - len(found))

    def numbers(self, name, max_bias=math.inf) -> Iterator[Number]:
        """Yield the rows of one condition; `max_bias` in um."""
        ratios = np.abs(self.errors) / self.stds
        median, high = np.quantile(ratios, (0.5, 0.95)) if len(ratios) else (math.nan, math.nan)
        beyond = f"median {median:.2f}, {(ratios > MAX_SIGMAS).mean():.1%} beyond {MAX_SIGMAS:g}"
        yield Number(f"{name}: 95 % of |error| / sigma", high, high=MAX_SIGMAS, note=beyond)
        stds = f"std {1e3 * self.errors.std():.1f}, predicted {1e3 * np.median(self.stds):.1f} um"
        bias = 1e3 * abs(self.errors.mean())
        yield Number(f"{name}: |bias|", bias, high=max_bias, unit="um", note=stds)
        fraction = self.missed / max(self.missed + len(self.errors), 1)
        yield Number(f"{name}: missed", 100 * fraction, high=100 * MAX_MISSED, unit="%")


def radius_near(section, image, x):
    """Return radius and std of the tube at X = x, None where none is found. Units: mm.

    Of several cylinders within `MAX_OFFSET` it is the one with the smallest std.
    """
    try:
        cylinders = measure_cylinders(section.profile(image)).cylinders
    except LsvisionError:
        return None
    near = [c for c in cylinders if abs(c.centre[0] - x) < MAX_OFFSET]
    best = min(near, key=lambda c: c.radius_std, default=None)
    return None if best is None else (best.radius, best.radius_std)


def score(conditions, pictures, shots, seed=FIRST_SEED) -> Iterator[Number]:
    """Yield the rows of one condition, with the blur stated and not; `shots` images a picture."""
    stated, unstated, truths = [], [], []
    for k in range(pictures):
        rng = np.random.default_rng([seed, k])
        picture = conditions.draw(rng)
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
    """Yield the same rows for `lsvision.simulate`: a tube of 25 mm, tilted, blur 0.7 px."""
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
    """Yield the rows of all conditions."""
    for conditions in CONDITIONS:
        yield from score(conditions, pictures, shots, seed)
    yield from score_simulator(pictures * shots, seed)
