"""Random clutter around given tubes: nasty, and never the section of a pipe.

What looks like a pipe for a while must stop before it could pass for one. A sheet's slope stays
below 24 deg, so that a crest turns by less than 48 deg however its curvature falls; what turns
further is sharper than any pipe (radius below 6 mm), flatter (above 60 mm), or hollow.
"""

import math
from collections.abc import Callable

import numpy as np

from lsvision.geometry import Ellipse
from lsvision.simulate import clutter
from lsvision.simulate.clutter import Centre
from lsvision.simulate.prism import Prism

MAX_SLOPE = math.tan(math.radians(24.0))
"""Largest slope of a wavy sheet."""
FIELD = 0.27
"""Half width of the field over the range, a little less than the sensor's."""
NEAREST, FARTHEST = 330.0, 560.0
"""Ranges between which clutter stands. Units: mm."""

Place = Callable[[Centre], Prism]
DrawShape = Callable[[np.random.Generator], Place]


def clutter_around(tubes: list[Ellipse], draw: DrawShape, rng: np.random.Generator) -> list[Prism]:
    """Two to four shapes beside and behind tubes, and often a ground.

    Parameters
    ----------
    tubes : list of Ellipse
        A shape that shares their stretch of X stands behind them, or cuts a flank at most.
    draw : callable
        `draw_planar` or `draw_mixed`.
    rng : numpy.random.Generator
        Same state, same clutter.
    """
    shapes = [_place_shape(draw(rng), tubes, rng) for _ in range(rng.integers(2, 5))]
    if rng.random() < 0.6:
        depth = min([-FARTHEST, *(tube.centre[1] - tube.semi_major for tube in tubes)])
        shapes.append(clutter.ground(500.0, (0.0, depth), rng.uniform(-0.05, 0.05)))
    return shapes


def draw_planar(rng: np.random.Generator) -> Place:
    """Bar, box or angle iron."""
    tilt = rng.uniform(-0.6, 0.6)
    width = rng.uniform(15.0, 90.0)
    choice = rng.integers(4)
    if choice == 0:
        height = rng.uniform(10.0, 60.0)
        return lambda at: clutter.bar(width * 0.6, height, at, tilt / 3)
    if choice == 1:
        leg, thickness = rng.uniform(15.0, 45.0), rng.uniform(3.0, 6.0)
        return lambda at: clutter.angle_iron(leg, thickness, at, tilt)
    thickness = rng.uniform(3.0, 10.0)
    return lambda at: clutter.bar(width, thickness, at, tilt)


def draw_mixed(rng: np.random.Generator) -> Place:
    """Any shape there is, one in three of them planar."""
    if rng.random() < 1 / 3:
        return draw_planar(rng)
    kinds: list[DrawShape] = [_sine, _bumps, _ridge, _trough, _spline, _rounded_box, _v_groove]
    return kinds[rng.integers(len(kinds))](rng)


def _place_shape(place: Place, tubes: list[Ellipse], rng: np.random.Generator) -> Prism:
    """A shape at a random place: beside the tubes at any range, else behind or against them."""
    low, high = _extent(place((0.0, 0.0)).outline)
    top = rng.uniform(NEAREST, FARTHEST - 40.0)
    x = rng.uniform(-FIELD, FIELD) * top
    for tube in tubes:
        left, right = _extent(tube.points_at(np.linspace(0.0, 2 * math.pi, 181)))
        if x + high[0] > left[0] - 3.0 and x + low[0] < right[0] + 3.0:
            top = max(top, rng.uniform(-0.4 * tube.semi_minor, 40.0) - tube.centre[1])
    return place((x, -top - high[1]))


def _extent(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return points.min(axis=0), points.max(axis=0)


def _sine(rng: np.random.Generator) -> Place:
    """Corrugated sheet, shallow; or finely ribbed with crests sharper than a pipe."""
    width, tilt = rng.uniform(50.0, 130.0), rng.uniform(-0.4, 0.4)
    if rng.random() < 0.25:
        wavelength, amplitude = rng.uniform(9.0, 14.0), rng.uniform(1.5, 3.0)
    else:
        wavelength = rng.uniform(22.0, 70.0)
        amplitude = wavelength * MAX_SLOPE * rng.uniform(0.3, 1.0) / (2 * math.pi)
    return lambda at: clutter.sine_sheet(width, amplitude, wavelength, at, tilt)


def _bumps(rng: np.random.Generator) -> Place:
    """Sheet with bumps and dents; a shoulder between two dents is a crest as well."""
    width, tilt = rng.uniform(60.0, 140.0), rng.uniform(-0.3, 0.3)
    bumps = []
    for position in np.arange(-width / 2 + 18.0, width / 2 - 10.0, 36.0):
        spread = rng.uniform(4.0, 10.0)
        steepest = MAX_SLOPE * spread * math.sqrt(math.e)
        height = rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 0.95) * steepest
        bumps.append((position, height, spread))
    return lambda at: clutter.gaussian_bumps(width, bumps, at, tilt)


def _ridge(rng: np.random.Generator) -> Place:
    """Parabola towards the sensor, sharper or flatter at its vertex than any pipe."""
    tilt, flat = rng.uniform(-0.3, 0.3), rng.random() < 0.6
    vertex = rng.uniform(60.0, 150.0) if flat else rng.uniform(1.5, 5.0)
    width = rng.uniform(50.0, 110.0) if flat else rng.uniform(10.0, 24.0)
    return lambda at: clutter.parabola(width, width**2 / (8 * vertex), at, tilt)


def _trough(rng: np.random.Generator) -> Place:
    """Parabola away from the sensor, as curved as a pipe: hollow where a pipe is round."""
    tilt, vertex = rng.uniform(-0.3, 0.3), rng.uniform(12.0, 45.0)
    width = vertex * rng.uniform(0.8, 2.0)
    return lambda at: clutter.parabola(width, -(width**2) / (8 * vertex), at, tilt)


def _spline(rng: np.random.Generator) -> Place:
    """Free-form sheet, its heights scaled to the largest slope."""
    tilt, spacing = rng.uniform(-0.4, 0.4), rng.uniform(10.0, 24.0)
    count = int(rng.integers(5, 8))
    x = (np.arange(count) - (count - 1) / 2) * spacing
    y = rng.uniform(-1.0, 1.0, count)
    drawn = clutter.spline_sheet(np.column_stack([x, y]), (0.0, 0.0)).outline
    steepest = np.abs(np.diff(drawn[:, 1]) / np.diff(drawn[:, 0])).max()
    knots = np.column_stack([x, y * MAX_SLOPE * rng.uniform(0.4, 1.0) / steepest])
    return lambda at: clutter.spline_sheet(knots, at, tilt)


def _rounded_box(rng: np.random.Generator) -> Place:
    """Square tube, corners 2-5 mm."""
    width, height, tilt = rng.uniform(20.0, 70.0), rng.uniform(12.0, 50.0), rng.uniform(-0.5, 0.5)
    corner = rng.uniform(2.0, clutter.MAX_CORNER_RADIUS)
    return lambda at: clutter.rounded_box(width, height, corner, at, tilt)


def _v_groove(rng: np.random.Generator) -> Place:
    """Plate with a groove."""
    width, tilt = rng.uniform(40.0, 110.0), rng.uniform(-0.4, 0.4)
    opening, depth = rng.uniform(8.0, 25.0), rng.uniform(4.0, 15.0)
    return lambda at: clutter.v_groove(width, opening, depth, at, tilt)
