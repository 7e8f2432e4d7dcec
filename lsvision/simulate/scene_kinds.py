"""Seven named kinds of random scene, and the simulated section of a kind and a seed.

Tubes have a radius of 10-40 mm, a tilt phi of 0-40 deg and any theta by default. The tubes of a
pair touch in the section. Random scenes are drawn until the visible arc of every tube is at least
`MIN_RANDOM_SCENE_ARC` for an ideal sensor; the truth records the actual arcs, which noise and lost
points may shorten.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lsvision.errors import DegenerateGeometry
from lsvision.geometry import Ellipse
from lsvision.geometry.arguments import as_numbers
from lsvision.sensors.profile_sensor import ProfileSensor
from lsvision.simulate.clutter import DrawShape, draw_clutter_around, draw_mixed, draw_planar
from lsvision.simulate.scene import Scene
from lsvision.simulate.section import SectionSettings, SimulatedSection, simulate_section
from lsvision.simulate.solids import Prism, Tube
from lsvision.simulate.welds import build_weld_bead, compute_nested_centre, compute_touching_centre

MAX_PHI_DEG = 80.0
"""Largest tilt of a random tube; the axis ratio of its section is then almost six."""
NOISE_MM = (0.02, 0.1)
"""Range of the noise's standard deviation at the reference range. Units: mm."""
MIN_RANDOM_SCENE_ARC = math.radians(80.0)
"""Smallest visible arc of every tube of a random scene, for an ideal sensor. Units: rad."""
MAX_BULGE = 0.11
"""Largest bulge of a weld bead (see `build_weld_bead`); a larger one spans an arc of more than
50 deg and resembles a tube."""
TOP_RANGE_MM = (330.0, 440.0)
"""Limits of the range of the tubes' highest point; it is larger if the field is too narrow there.
Units: mm."""
FIELD_MARGIN_MM = 6.0
"""Smallest distance in X from the tubes to the border of the field. Units: mm."""
MAX_DRAWS = 200
"""Largest number of scenes that are drawn until all tubes are visible; usually a few suffice,
except for stacks."""

SCENE_SENSOR = ProfileSensor(
    name="simulated profile sensor",
    range_std=0.05,
    reference_range=400.0,
    quantum=0.01,
    columns=376,
    min_range=200.0,
    max_range=650.0,
    width_at_max_range=366.0,  # pitch 0.6 mm at 400 mm; space for two tubes of 80 mm diameter
)
"""Similar to an LPS 36 HI, with the columns of an LPS 36 and a field of view for the scenes."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TubeRanges:
    """Ranges of the uniform distributions of random tubes.

    Parameters
    ----------
    radius_mm, theta_deg, phi_deg : tuple of float
        Smallest and largest value; equal for a fixed one. Units: mm, deg.

    Raises
    ------
    ValueError
        If a range is not ascending and finite, a radius not above 0, or phi not within 0-80 deg.
    """

    radius_mm: tuple[float, float] = (10.0, 40.0)
    theta_deg: tuple[float, float] = (0.0, 180.0)
    phi_deg: tuple[float, float] = (0.0, 40.0)

    def __post_init__(self) -> None:
        for name in ("radius_mm", "theta_deg", "phi_deg"):
            as_numbers(getattr(self, name), 2, f"{name} (smallest, largest)")
        if not 0 < self.radius_mm[0] <= self.radius_mm[1] < math.inf:
            raise ValueError(
                f"expected radius min:max above 0 mm, got {_format_range(self.radius_mm)}"
            )
        if not 0 <= self.phi_deg[0] <= self.phi_deg[1] <= MAX_PHI_DEG:
            raise ValueError(
                f"expected phi within 0 to {MAX_PHI_DEG:g} deg, got {_format_range(self.phi_deg)}"
            )
        if not -math.inf < self.theta_deg[0] <= self.theta_deg[1] < math.inf:
            raise ValueError(f"expected theta min:max in deg, got {_format_range(self.theta_deg)}")

    def draw_ellipse(
        self, rng: np.random.Generator, radius_fractions: tuple[float, float] = (0.0, 1.0)
    ) -> Ellipse:
        """Draw the section of a random tube, centred on (0, 0).

        `radius_fractions` are the limits of the radii to draw from, as fractions of the range.
        """
        low, high = self.radius_mm
        radius = low + (high - low) * rng.uniform(*radius_fractions)
        phi = math.radians(rng.uniform(*self.phi_deg))
        theta = math.radians(rng.uniform(*self.theta_deg))
        return Ellipse((0.0, 0.0), radius / math.cos(phi), radius, theta)


def _format_range(limits: tuple[float, float]) -> str:
    return f"{limits[0]:g} to {limits[1]:g}"


def random_section(
    kind: str,
    seed: int,
    *,
    noise_mm: float | None = None,
    settings: SectionSettings | None = None,
    tubes: TubeRanges | None = None,
) -> SimulatedSection:
    """Simulate one profile of a random scene by `SCENE_SENSOR`.

    Parameters
    ----------
    kind : str
        Kind of scene, a key of `SCENE_KINDS`.
    seed : int
        Seed of all random numbers, together with the kind, not negative; the same arguments yield
        the same section, bit by bit.
    noise_mm : float, optional
        Standard deviation along the ray at 400 mm. None: drawn from 0.02-0.1 mm. Units: mm.
    settings : SectionSettings, optional
        Errors of the sensor. None: 3 % lost points and 2 % jumps.
    tubes : TubeRanges, optional
        Ranges of the tubes. None: radius 10-40 mm, phi 0-40 deg, any theta.

    Returns
    -------
    SimulatedSection
        The profile, and the truth about it.

    Raises
    ------
    ValueError
        If the kind is unknown, `noise_mm` not positive and finite, or `seed` negative.
    DegenerateGeometry
        If no scene is found in which all tubes are visible.

    Examples
    --------
    >>> section = random_section("welded_pair", 7)
    >>> [tube.visible for tube in section.truth.tubes], len(section.profile)
    ([True, True], 376)
    """
    if kind not in SCENE_KINDS:
        raise ValueError(f"expected one of {', '.join(SCENE_KINDS)}, got {kind!r}")
    rng = np.random.default_rng([seed, list(SCENE_KINDS).index(kind)])
    random_noise = float(rng.uniform(*NOISE_MM))
    range_std = random_noise if noise_mm is None else noise_mm
    sensor = dataclasses.replace(SCENE_SENSOR, range_std=range_std)
    scene = SCENE_KINDS[kind](rng, tubes or TubeRanges())
    return simulate_section(scene, sensor, settings or SectionSettings(), rng=rng)


def draw_single_scene(rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """Draw one tube without clutter."""
    return _draw_visible(lambda rng: [tubes.draw_ellipse(rng)], _draw_no_clutter, rng)


def draw_welded_pair_scene(rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """Draw two touching, mostly parallel tubes with a weld bead, without clutter."""
    return _draw_visible(lambda rng: _draw_pair(rng, tubes), _draw_bead, rng)


def draw_planar_scene(rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """Draw one tube among bars, boxes and angle irons, mostly with a ground."""
    return _draw_in_clutter(draw_planar, rng, tubes)


def draw_complex_scene(rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """Draw one tube among shapes of every kind, flat and curved; see `draw_mixed`."""
    return _draw_in_clutter(draw_mixed, rng, tubes)


def _draw_in_clutter(draw: DrawShape, rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """Draw one tube among shapes of a kind."""
    return _draw_visible(
        lambda rng: [tubes.draw_ellipse(rng)],
        lambda ellipses, rng: draw_clutter_around(ellipses, draw, rng),
        rng,
    )


def draw_welded_complex_scene(rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """Draw two touching tubes with a weld bead among shapes of every kind; see `draw_mixed`."""

    def draw_clutter(ellipses: list[Ellipse], rng: np.random.Generator) -> list[Prism]:
        return _draw_bead(ellipses, rng) + draw_clutter_around(ellipses, draw_mixed, rng)

    return _draw_visible(lambda rng: _draw_pair(rng, tubes), draw_clutter, rng)


def draw_three_stacked_scene(rng: np.random.Generator, tubes: TubeRanges) -> Scene:
    """Draw two tubes side by side and a third in the groove between them."""
    return _draw_visible(lambda rng: _draw_stack(rng, tubes), _draw_no_clutter, rng)


def draw_empty_scene(rng: np.random.Generator, _tubes: TubeRanges) -> Scene:
    """Draw shapes of every kind without a tube; see `draw_mixed`."""
    return Scene(tuple(draw_clutter_around([], draw_mixed, rng)))


SCENE_KINDS: dict[str, Callable[[np.random.Generator, TubeRanges], Scene]] = {
    "single": draw_single_scene,
    "welded_pair": draw_welded_pair_scene,
    "planar": draw_planar_scene,
    "complex": draw_complex_scene,
    "welded_complex": draw_welded_complex_scene,
    "three_stacked": draw_three_stacked_scene,
    "empty": draw_empty_scene,
}
"""Function that draws a random scene, by the name of its kind."""

DrawTubes = Callable[[np.random.Generator], list[Ellipse]]
"""Function that draws the sections of tubes, placed relative to each other."""
DrawClutter = Callable[[list[Ellipse], np.random.Generator], list[Prism]]
"""Function that draws the other objects of a scene around the sections of its tubes."""


def _draw_visible(
    draw_tubes: DrawTubes, draw_clutter: DrawClutter, rng: np.random.Generator
) -> Scene:
    """Draw scenes until an ideal sensor sees a sufficient arc of every tube."""
    settings = dataclasses.replace(SectionSettings.ideal(), grazing_limit_deg=80.0)
    for _ in range(MAX_DRAWS):
        ellipses = _move_into_field(draw_tubes(rng), rng)
        solids = [Tube.of(e.radius, e.theta, e.phi, e.centre) for e in ellipses]
        scene = Scene((*solids, *draw_clutter(ellipses, rng)))
        section = simulate_section(scene, SCENE_SENSOR, settings, rng=np.random.default_rng(0))
        if all(tube.arc >= MIN_RANDOM_SCENE_ARC and tube.visible for tube in section.truth.tubes):
            return scene
    raise DegenerateGeometry(
        f"{MAX_DRAWS} random scenes drawn and in none are all tubes visible to the sensor, whose "
        f"line is {SCENE_SENSOR.width_at_max_range:g} mm long at {SCENE_SENSOR.max_range:g} mm: "
        "ask for radii of about 10 to 40 mm (smaller tubes have too few points, larger ones exceed "
        "the field or hide each other), or less tilted tubes"
    )


def _draw_no_clutter(_ellipses: list[Ellipse], _rng: np.random.Generator) -> list[Prism]:
    """Return no clutter, for scenes of tubes alone."""
    return []


def _draw_pair(rng: np.random.Generator, tubes: TubeRanges) -> list[Ellipse]:
    """Draw the touching sections of two tubes, parallel with probability 0.6."""
    first, second = tubes.draw_ellipse(rng), tubes.draw_ellipse(rng)
    if rng.random() < 0.6:
        axis_ratio = first.semi_major / first.semi_minor
        second = dataclasses.replace(
            second, semi_major=second.semi_minor * axis_ratio, theta=first.theta
        )
    direction = math.radians(rng.uniform(-40.0, 40.0))
    return [
        first,
        dataclasses.replace(second, centre=compute_touching_centre(first, second, direction)),
    ]


def _draw_stack(rng: np.random.Generator, tubes: TubeRanges) -> list[Ellipse]:
    """Draw two sections side by side, touching or slightly apart, and one in the groove."""
    left, right = (tubes.draw_ellipse(rng, (0.15, 1.0)) for _ in range(2))
    top = tubes.draw_ellipse(rng, (0.0, 0.5))
    x, y = compute_touching_centre(left, right, math.radians(rng.uniform(-15.0, 15.0)))
    gap = rng.uniform(0.0, 0.8) * top.semi_minor  # the third tube must rest on both
    factor = 1.0 + gap / math.hypot(x, y)
    right = dataclasses.replace(right, centre=(x * factor, y * factor))
    return [left, right, dataclasses.replace(top, centre=compute_nested_centre(left, right, top))]


def _draw_bead(pair: list[Ellipse], rng: np.random.Generator) -> list[Prism]:
    """Draw the weld bead of a pair: a concave fillet (bulge 0) or a convex bead."""
    leg = rng.uniform(0.45, 0.85) * min(pair[0].semi_minor, pair[1].semi_minor)
    bulge = 0.0 if rng.random() < 0.5 else rng.uniform(0.02, MAX_BULGE)
    return [build_weld_bead(pair[0], pair[1], leg=leg, bulge=bulge)]


def _move_into_field(ellipses: list[Ellipse], rng: np.random.Generator) -> list[Ellipse]:
    """Translate the ellipses together to a random position within the field of view."""
    anomalies = np.linspace(0.0, 2 * math.pi, 181)
    points = np.vstack([ellipse.points_at(anomalies) for ellipse in ellipses])
    low, high = points.min(axis=0), points.max(axis=0)
    half_field_per_range = SCENE_SENSOR.width_at_max_range / SCENE_SENSOR.max_range / 2
    half_width = (high[0] - low[0]) / 2 + FIELD_MARGIN_MM
    top = max(rng.uniform(*TOP_RANGE_MM), half_width / half_field_per_range)
    max_offset = top * half_field_per_range - half_width
    x = rng.uniform(-1.0, 1.0) * max_offset
    dx, dy = x - (low[0] + high[0]) / 2, -top - high[1]
    return [dataclasses.replace(e, centre=(e.centre[0] + dx, e.centre[1] + dy)) for e in ellipses]
