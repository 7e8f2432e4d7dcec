"""Outlines of objects around tubes (bars, boxes, angle irons, sheets), and random clutter.

Every outline function returns a `Prism` placed by the middle of its side towards the sensor (a
spline by the origin of its knots) and rotated by `tilt` from X towards Y. Frame: section frame.
Units: mm and rad. Curves are polylines with segments of about 0.3 mm along X, whose sagitta is
about 1 um for radii above 12 mm, 4 um on steep flanks, and 17 um at the sharpest crests of a sine.

No outline contains an arc that resembles a tube's: rounded corners have a radius of at most 5 mm.
The slope of a sheet stays below about 25 deg, so that a crest turns by less than 50 deg; what turns
further has a smaller radius than any tube (below 6 mm), a larger one (above 60 mm), or is concave.
"""

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from lsvision.geometry import Ellipse, FloatArray
from lsvision.simulate.solids import Prism

SEGMENT_LENGTH_MM = 0.3
"""Length along X of the segments of a curve. Units: mm."""
MAX_CORNER_RADIUS = 5.0
"""Largest radius of a rounded corner, half that of the smallest tube. Units: mm."""

MAX_SLOPE = math.tan(math.radians(24.0))
"""Largest slope of a sine, of a spline, or of a bump alone: beside others about 25 deg."""
HALF_FIELD_PER_RANGE = 0.27
"""Half width of the field of view divided by the range, slightly less than the sensor's."""
MIN_RANGE_MM, MAX_RANGE_MM = 330.0, 560.0
"""Limits of the range at which clutter is placed. Units: mm."""

Centre = tuple[float, float]
ORIGIN = (0.0, 0.0)
"""Centre of a shape before it is moved into the scene. Units: mm."""
DrawShape = Callable[[np.random.Generator], Prism]
"""Function that draws a random shape at `ORIGIN`."""


def place_outline(outline: npt.ArrayLike, centre: Centre, tilt: float = 0.0) -> Prism:
    """Return the prism of an outline (k, 2) in mm, rotated about (0, 0) and then translated.

    `centre` is the new position of (0, 0), `tilt` the rotation from X towards Y in rad.
    """
    cos, sin = math.cos(tilt), math.sin(tilt)
    rotated = np.asarray(outline, dtype=np.float64) @ np.array([[cos, sin], [-sin, cos]])
    return Prism(rotated + centre)


def build_ground(width: float, centre: Centre, tilt: float = 0.0) -> Prism:
    """Return a flat ground: a straight line as outline."""
    return place_outline([[-width / 2, 0.0], [width / 2, 0.0]], centre, tilt)


def build_bar(width: float, thickness: float, centre: Centre, tilt: float = 0.0) -> Prism:
    """Return a flat bar or box: a rectangle.

    Examples
    --------
    >>> build_bar(40.0, 5.0, (0.0, -400.0)).outline[0]
    array([ -20., -400.])
    """
    x = width / 2
    corners = [[-x, 0.0], [x, 0.0], [x, -thickness], [-x, -thickness], [-x, 0.0]]
    return place_outline(corners, centre, tilt)


def build_rounded_box(
    width: float, height: float, corner: float, centre: Centre, tilt: float = 0.0
) -> Prism:
    """Return a square tube: a rectangle with rounded corners, open below.

    Raises
    ------
    ValueError
        If the corner radius is not positive, or exceeds 5 mm, half the width or the height.
    """
    largest = min(MAX_CORNER_RADIUS, width / 2, height)
    if not 0 < corner <= largest:
        raise ValueError(f"expected a corner in (0, {largest:g}] mm, got {corner}")
    angle = np.linspace(0.0, math.pi / 2, 25)
    x, y = width / 2 - corner + corner * np.sin(angle), corner * (np.cos(angle) - 1)
    right = np.vstack([np.column_stack([x, y]), [[width / 2, -height]]])
    left = right[::-1] * [-1.0, 1.0]
    return place_outline(np.vstack([left, right]), centre, tilt)


def build_v_groove(
    width: float, opening: float, depth: float, centre: Centre, tilt: float = 0.0
) -> Prism:
    """Return a plate with a V groove, as for a weld."""
    x, half = width / 2, opening / 2
    outline = [[-x, 0.0], [-half, 0.0], [0.0, -depth], [half, 0.0], [x, 0.0]]
    return place_outline(outline, centre, tilt)


def build_angle_iron(leg: float, thickness: float, centre: Centre, tilt: float = 0.0) -> Prism:
    """Return an angle iron with both edges on the ground and its corner towards the sensor."""
    x, edge = leg / math.sqrt(2), thickness / math.sqrt(2)
    inner = [[x - edge, -x - edge], [0.0, -2 * edge], [-x + edge, -x - edge]]
    outline = [[-x, -x], [0.0, 0.0], [x, -x], *inner, [-x, -x]]
    return place_outline(outline, centre, tilt)


def build_sine_sheet(
    width: float, amplitude: float, wavelength: float, centre: Centre, tilt: float = 0.0
) -> Prism:
    """Return a corrugated sheet: a sine."""
    x = _space_abscissae(width)
    wave = amplitude * np.sin(2 * math.pi * x / wavelength)
    return place_outline(np.column_stack([x, wave]), centre, tilt)


def build_gaussian_bumps(
    width: float, bumps: npt.ArrayLike, centre: Centre, tilt: float = 0.0
) -> Prism:
    """Return a sheet with dents and bumps.

    `bumps` (k, 3) are position along the sheet, height (negative: a dent) and standard width, in
    mm.
    """
    x = _space_abscissae(width)
    position, height, spread = np.asarray(bumps, dtype=np.float64).T[:, :, None]
    y = (height * np.exp(-0.5 * ((x - position) / spread) ** 2)).sum(axis=0)
    return place_outline(np.column_stack([x, y]), centre, tilt)


def build_parabola(width: float, depth: float, centre: Centre, tilt: float = 0.0) -> Prism:
    """Return a ridge, or with negative depth a trough, with a parabolic section."""
    x = _space_abscissae(width)
    return place_outline(np.column_stack([x, -depth * (2 * x / width) ** 2]), centre, tilt)


def build_spline_sheet(knots: npt.ArrayLike, centre: Centre, tilt: float = 0.0) -> Prism:
    """Return a free-form sheet: a natural cubic spline.

    It runs through the knots (k, 2) in mm with ascending x; the outline ends within 0.15 mm of the
    last one.
    """
    x, y = np.asarray(knots, dtype=np.float64).T
    curve = CubicSpline(x, y, bc_type="natural")
    x_fine = np.arange(x[0], x[-1] + SEGMENT_LENGTH_MM / 2, SEGMENT_LENGTH_MM)
    return place_outline(np.column_stack([x_fine, curve(x_fine)]), centre, tilt)


def _space_abscissae(width: float) -> FloatArray:
    """Return evenly spaced x from -width / 2 to width / 2. Units: mm."""
    return np.linspace(-width / 2, width / 2, math.ceil(width / SEGMENT_LENGTH_MM) + 1)


def draw_clutter_around(
    tubes: list[Ellipse], draw: DrawShape, rng: np.random.Generator
) -> list[Prism]:
    """Return two to four random shapes beside or behind tubes, and in 60 % of cases a ground.

    `draw` is `draw_planar` or `draw_mixed`. The top of a shape whose x overlaps a tube's is at most
    0.4 semi-minor axes nearer to the sensor than the tube's centre: it covers a flank at most.
    """
    shapes = [_place_shape(draw(rng), tubes, rng) for _ in range(rng.integers(2, 5))]
    if rng.random() < 0.6:
        depth = min([-MAX_RANGE_MM, *(tube.centre[1] - tube.semi_major for tube in tubes)])
        shapes.append(build_ground(500.0, (0.0, depth), rng.uniform(-0.05, 0.05)))
    return shapes


def draw_planar(rng: np.random.Generator) -> Prism:
    """Draw a bar, box or angle iron."""
    tilt = rng.uniform(-0.6, 0.6)
    width = rng.uniform(15.0, 90.0)
    choice = rng.integers(4)
    if choice == 0:
        height = rng.uniform(10.0, 60.0)
        return build_bar(width * 0.6, height, ORIGIN, tilt / 3)
    if choice == 1:
        leg, thickness = rng.uniform(15.0, 45.0), rng.uniform(3.0, 6.0)
        return build_angle_iron(leg, thickness, ORIGIN, tilt)
    thickness = rng.uniform(3.0, 10.0)
    return build_bar(width, thickness, ORIGIN, tilt)


def draw_mixed(rng: np.random.Generator) -> Prism:
    """Draw any kind of shape, planar with probability 1/3."""
    if rng.random() < 1 / 3:
        return draw_planar(rng)
    kinds: list[DrawShape] = [
        _draw_sine,
        _draw_bumps,
        _draw_ridge,
        _draw_trough,
        _draw_spline,
        _draw_rounded_box,
        _draw_v_groove,
    ]
    return kinds[rng.integers(len(kinds))](rng)


def _place_shape(shape: Prism, tubes: list[Ellipse], rng: np.random.Generator) -> Prism:
    """Return a shape at a random position: beside the tubes at any range, or behind their crests.

    See `draw_clutter_around`.
    """
    low, high = _compute_bounding_box(shape.outline)
    top = rng.uniform(MIN_RANGE_MM, MAX_RANGE_MM - 40.0)
    x = rng.uniform(-HALF_FIELD_PER_RANGE, HALF_FIELD_PER_RANGE) * top
    for tube in tubes:
        left, right = _compute_bounding_box(tube.points_at(np.linspace(0.0, 2 * math.pi, 181)))
        if x + high[0] > left[0] - 3.0 and x + low[0] < right[0] + 3.0:
            top = max(top, rng.uniform(-0.4 * tube.semi_minor, 40.0) - tube.centre[1])
    return Prism(shape.outline + np.array([x, -top - high[1]]))


def _compute_bounding_box(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    return points.min(axis=0), points.max(axis=0)


def _draw_sine(rng: np.random.Generator) -> Prism:
    """Draw a corrugated sheet: shallow, or with crests of a smaller radius than a tube."""
    width, tilt = rng.uniform(50.0, 130.0), rng.uniform(-0.4, 0.4)
    if rng.random() < 0.25:
        wavelength, amplitude = rng.uniform(9.0, 14.0), rng.uniform(1.5, 3.0)
    else:
        wavelength = rng.uniform(22.0, 70.0)
        amplitude = wavelength * MAX_SLOPE * rng.uniform(0.3, 1.0) / (2 * math.pi)
    return build_sine_sheet(width, amplitude, wavelength, ORIGIN, tilt)


def _draw_bumps(rng: np.random.Generator) -> Prism:
    """Draw a sheet with bumps and dents."""
    width, tilt = rng.uniform(60.0, 140.0), rng.uniform(-0.3, 0.3)
    bumps = []
    for position in np.arange(-width / 2 + 18.0, width / 2 - 10.0, 36.0):
        spread = rng.uniform(4.0, 10.0)
        steepest = MAX_SLOPE * spread * math.sqrt(math.e)
        height = rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 0.95) * steepest
        bumps.append((position, height, spread))
    return build_gaussian_bumps(width, bumps, ORIGIN, tilt)


def _draw_ridge(rng: np.random.Generator) -> Prism:
    """Draw a parabola towards the sensor; its vertex radius is not that of a tube."""
    tilt, flat = rng.uniform(-0.3, 0.3), rng.random() < 0.6
    vertex = rng.uniform(60.0, 150.0) if flat else rng.uniform(1.5, 5.0)
    width = rng.uniform(50.0, 110.0) if flat else rng.uniform(10.0, 24.0)
    return build_parabola(width, width**2 / (8 * vertex), ORIGIN, tilt)


def _draw_trough(rng: np.random.Generator) -> Prism:
    """Draw a concave parabola with the curvature of a tube."""
    tilt, vertex = rng.uniform(-0.3, 0.3), rng.uniform(12.0, 45.0)
    width = vertex * rng.uniform(0.8, 2.0)
    return build_parabola(width, -(width**2) / (8 * vertex), ORIGIN, tilt)


def _draw_spline(rng: np.random.Generator) -> Prism:
    """Draw a free-form sheet, its heights scaled to the largest slope."""
    tilt, spacing = rng.uniform(-0.4, 0.4), rng.uniform(10.0, 24.0)
    count = int(rng.integers(5, 8))
    x = (np.arange(count) - (count - 1) / 2) * spacing
    y = rng.uniform(-1.0, 1.0, count)
    outline = build_spline_sheet(np.column_stack([x, y]), ORIGIN).outline
    steepest = np.abs(np.diff(outline[:, 1]) / np.diff(outline[:, 0])).max()
    knots = np.column_stack([x, y * MAX_SLOPE * rng.uniform(0.4, 1.0) / steepest])
    return build_spline_sheet(knots, ORIGIN, tilt)


def _draw_rounded_box(rng: np.random.Generator) -> Prism:
    """Draw a square tube with corners of 2-5 mm."""
    width, height, tilt = rng.uniform(20.0, 70.0), rng.uniform(12.0, 50.0), rng.uniform(-0.5, 0.5)
    corner = rng.uniform(2.0, MAX_CORNER_RADIUS)
    return build_rounded_box(width, height, corner, ORIGIN, tilt)


def _draw_v_groove(rng: np.random.Generator) -> Prism:
    """Draw a plate with a V groove."""
    width, tilt = rng.uniform(40.0, 110.0), rng.uniform(-0.4, 0.4)
    opening, depth = rng.uniform(8.0, 25.0), rng.uniform(4.0, 15.0)
    return build_v_groove(width, opening, depth, ORIGIN, tilt)
