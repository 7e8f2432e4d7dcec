"""The seven named kinds of random scene, and one call from kind and seed to a section.

Tubes: radius 10-40 mm, tilt phi 0-40 deg, any theta. Tubes of a pair touch as ellipses of the
section. A scene is drawn again until every tube of it shows a good arc; what is seen then is
still recorded tube by tube in the truth, because noise and losses come later.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lsvision.errors import DegenerateGeometry
from lsvision.geometry import Ellipse
from lsvision.sensors.profile_sensor import ProfileSensor
from lsvision.simulate.prism import Prism
from lsvision.simulate.random_clutter import clutter_around, draw_mixed, draw_planar
from lsvision.simulate.scene import Scene
from lsvision.simulate.section import SimulatedSection, simulate_section
from lsvision.simulate.sensor_errors import SectionSettings
from lsvision.simulate.tube import Tube
from lsvision.simulate.welds import nested_centre, touching_centre, weld_bead

MAX_PHI_DEG = 80.0
"""Largest tilt of a random tube; its section is then almost six times as long as wide."""
NOISE_MM = (0.02, 0.1)
"""One sigma of random sections at the reference range. Units: mm."""
MIN_VISIBLE_ARC = math.radians(80.0)
"""Arc that every tube of a random scene shows to an ideal sensor."""
MAX_BULGE = 0.11
"""A bead that stands out more turns by over 50 deg and could pass for a pipe of its own."""
MAX_DRAWS = 200
"""Scenes drawn for one whose tubes are seen; a few are enough for all but stacks."""

SCENE_SENSOR = ProfileSensor(
    name="simulated profile sensor",
    range_std=0.05,
    reference_range=400.0,
    quantum=0.01,
    columns=376,
    min_range=200.0,
    max_range=650.0,
    width_at_max_range=366.0,  # pitch 0.6 mm at 400 mm; two pipes of 80 mm fit in side by side
)
"""Like an LPS 36 HI, with the columns of an LPS 36 and a field that holds the scenes."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TubeRanges:
    """From what the tubes of a random scene are drawn, each number evenly.

    Parameters
    ----------
    radius_mm, theta_deg, phi_deg : tuple of float
        Least and largest; alike for a fixed value. Units: mm, deg.
    """

    radius_mm: tuple[float, float] = (10.0, 40.0)
    theta_deg: tuple[float, float] = (0.0, 180.0)
    phi_deg: tuple[float, float] = (0.0, 40.0)

    def __post_init__(self) -> None:
        if not 0 < self.radius_mm[0] <= self.radius_mm[1] < math.inf:
            raise ValueError(f"want 0 < least <= largest radius in mm, got {self.radius_mm}")
        if not 0 <= self.phi_deg[0] <= self.phi_deg[1] <= MAX_PHI_DEG:
            raise ValueError(f"want phi within 0 to {MAX_PHI_DEG:g} deg, got {self.phi_deg}")
        if not -math.inf < self.theta_deg[0] <= self.theta_deg[1] < math.inf:
            raise ValueError(f"want least <= largest theta in deg, got {self.theta_deg}")

    def ellipse(self, rng: np.random.Generator, share: tuple[float, float] = (0.0, 1.0)) -> Ellipse:
        """Section of a random tube, centred on (0, 0).

        Parameters
        ----------
        rng : numpy.random.Generator
            Same state, same ellipse.
        share : tuple of float
            Which stretch of the range of radii to draw from, of 0 to 1.
        """
        low, high = self.radius_mm
        radius = low + (high - low) * rng.uniform(*share)
        phi = math.radians(rng.uniform(*self.phi_deg))
        theta = math.radians(rng.uniform(*self.theta_deg))
        return Ellipse((0.0, 0.0), radius / math.cos(phi), radius, theta)


def random_section(
    kind: str,
    seed: int,
    *,
    noise_mm: float | None = None,
    settings: SectionSettings | None = None,
    tubes: TubeRanges | None = None,
) -> SimulatedSection:
    """Random scene of a kind, seen once by `SCENE_SENSOR`.

    Parameters
    ----------
    kind : str
        A key of `SCENE_KINDS`.
    seed : int
        Same kind, seed and settings, same bytes out; other kinds draw other numbers.
    noise_mm : float, optional
        One sigma along the ray at 400 mm; drawn from 0.02-0.1 mm without. Units: mm.
    settings : SectionSettings, optional
        What goes wrong; 3 % lost and 2 % jumps without.
    tubes : TubeRanges, optional
        Radius 10-40 mm, phi 0-40 deg, any theta without.

    Raises
    ------
    ValueError
        If there is no such kind.
    DegenerateGeometry
        If such tubes cannot all be seen in one field of view.

    Examples
    --------
    >>> section = random_section("welded_pair", 7)
    >>> [tube.visible for tube in section.truth.tubes], len(section.profile)
    ([True, True], 376)
    """
    if kind not in SCENE_KINDS:
        raise ValueError(f"want one of {', '.join(SCENE_KINDS)}, got {kind!r}")
    rng = np.random.default_rng([seed, list(SCENE_KINDS).index(kind)])
    drawn = float(rng.uniform(*NOISE_MM))
    sensor = dataclasses.replace(SCENE_SENSOR, range_std=drawn if noise_mm is None else noise_mm)
    scene = SCENE_KINDS[kind](rng, tubes or TubeRanges())
    return simulate_section(scene, sensor, settings or SectionSettings(), rng=rng)


def single(rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """One tube, nothing else."""
    return _seen_scene(lambda: [tubes.ellipse(rng)], _nothing, rng)


def welded_pair(rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """Two touching tubes with a bead, mostly parallel, nothing else."""
    return _seen_scene(lambda: _pair(rng, tubes), _bead, rng)


def planar(rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """One tube among flat bars, boxes and ground."""
    return _seen_scene(
        lambda: [tubes.ellipse(rng)], lambda on, rng: clutter_around(on, draw_planar, rng), rng
    )


def complex_clutter(rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """One tube among bars, sections and curved sheets."""
    return _seen_scene(
        lambda: [tubes.ellipse(rng)], lambda on, rng: clutter_around(on, draw_mixed, rng), rng
    )


def welded_complex(rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """Two touching tubes with a bead among bars, sections and curved sheets."""

    def clutter(on: list[Ellipse], rng: np.random.Generator) -> list[Prism]:
        return _bead(on, rng) + clutter_around(on, draw_mixed, rng)

    return _seen_scene(lambda: _pair(rng, tubes), clutter, rng)


def three_stacked(rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """Two tubes side by side and a third that lies in the groove between them."""
    return _seen_scene(lambda: _stack(rng, tubes), _nothing, rng)


def empty(rng: np.random.Generator, _tubes: TubeRanges) -> Scene:
    """Clutter of every kind and no tube."""
    return Scene(tuple(clutter_around([], draw_mixed, rng)))


SCENE_KINDS: dict[str, Callable[[np.random.Generator, TubeRanges], Scene]] = {
    "single": single,
    "welded_pair": welded_pair,
    "planar": planar,
    "complex": complex_clutter,
    "welded_complex": welded_complex,
    "three_stacked": three_stacked,
    "empty": empty,
}
"""The kinds of random scene by name."""

DrawClutter = Callable[[list[Ellipse], np.random.Generator], list[Prism]]


def _seen_scene(
    draw_tubes: Callable[[], list[Ellipse]], draw_clutter: DrawClutter, rng: np.random.Generator
) -> Scene:
    """First scene drawn whose tubes all show a good arc to a sensor without errors."""
    settings = dataclasses.replace(SectionSettings.ideal(), grazing_limit_deg=80.0)
    for _ in range(MAX_DRAWS):
        ellipses = _in_field(draw_tubes(), rng)
        solids = [_tube(ellipse) for ellipse in ellipses]
        scene = Scene((*solids, *draw_clutter(ellipses, rng)))
        look = simulate_section(scene, SCENE_SENSOR, settings, rng=np.random.default_rng(0))
        if all(tube.arc >= MIN_VISIBLE_ARC and tube.visible for tube in look.truth.tubes):
            return scene
    raise DegenerateGeometry(
        f"{MAX_DRAWS} random scenes drawn and none shows all its tubes to the sensor, whose line "
        f"is {SCENE_SENSOR.width_at_max_range:g} mm long at {SCENE_SENSOR.max_range:g} mm: ask for "
        "smaller or less tilted tubes"
    )


def _nothing(_on: list[Ellipse], _rng: np.random.Generator) -> list[Prism]:
    return []


def _pair(rng: np.random.Generator, tubes: TubeRanges) -> list[Ellipse]:
    """Two touching sections; of two tubes welded along each other mostly, else at an angle."""
    first, second = tubes.ellipse(rng), tubes.ellipse(rng)
    if rng.random() < 0.6:
        stretch = first.semi_major / first.semi_minor
        second = dataclasses.replace(
            second, semi_major=second.semi_minor * stretch, theta=first.theta
        )
    direction = math.radians(rng.uniform(-40.0, 40.0))
    return [first, dataclasses.replace(second, centre=touching_centre(first, second, direction))]


def _stack(rng: np.random.Generator, tubes: TubeRanges) -> list[Ellipse]:
    """Two sections side by side, touching or a little apart, and one in the groove."""
    left, right = (tubes.ellipse(rng, (0.15, 1.0)) for _ in range(2))
    top = tubes.ellipse(rng, (0.0, 0.5))
    x, y = touching_centre(left, right, math.radians(rng.uniform(-15.0, 15.0)))
    apart = 1.0 + rng.uniform(0.0, 0.8) * top.semi_minor / math.hypot(x, y)
    right = dataclasses.replace(right, centre=(x * apart, y * apart))
    return [left, right, dataclasses.replace(top, centre=nested_centre(left, right, top))]


def _bead(pair: list[Ellipse], rng: np.random.Generator) -> list[Prism]:
    """Bead of a pair: a fillet, or one that stands out."""
    leg = rng.uniform(0.45, 0.85) * min(pair[0].semi_minor, pair[1].semi_minor)
    bulge = 0.0 if rng.random() < 0.5 else rng.uniform(0.02, MAX_BULGE)
    return [weld_bead(pair[0], pair[1], leg=leg, bulge=bulge)]


def _in_field(ellipses: list[Ellipse], rng: np.random.Generator) -> list[Ellipse]:
    """The ellipses moved, all alike, to a random place where the sensor sees them whole."""
    turns = np.linspace(0.0, 2 * math.pi, 181)
    points = np.vstack([ellipse.points_at(turns) for ellipse in ellipses])
    low, high = points.min(axis=0), points.max(axis=0)
    half_field = SCENE_SENSOR.width_at_max_range / SCENE_SENSOR.max_range / 2
    half = (high[0] - low[0]) / 2 + 6.0
    top = max(rng.uniform(330.0, 440.0), half / half_field)
    slack = top * half_field - half
    middle = rng.uniform(-1.0, 1.0) * slack
    dx, dy = middle - (low[0] + high[0]) / 2, -top - high[1]
    return [dataclasses.replace(e, centre=(e.centre[0] + dx, e.centre[1] + dy)) for e in ellipses]


def _tube(ellipse: Ellipse) -> Tube:
    return Tube.of(ellipse.radius, ellipse.theta, ellipse.phi, ellipse.centre)
