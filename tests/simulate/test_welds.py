"""Touching ellipses and weld beads, compared with dense sampling of the outlines."""

import math

import numpy as np
import pytest

from lsvision.geometry import Ellipse, orthogonal_residuals
from lsvision.simulate.welds import (
    build_weld_bead,
    compute_nested_centre,
    compute_touching_centre,
    find_contact_point,
)

TOUCHING = 1e-5  # mm: what 20000 samples of an outline miss of a contact
TURNS = np.linspace(0.0, 2 * math.pi, 20001)


def ellipse(seed, centre=(0.0, -400.0)):
    rng = np.random.default_rng(seed)
    radius, phi = rng.uniform(10, 40), rng.uniform(0, 0.7)
    return Ellipse(centre, radius / math.cos(phi), radius, rng.uniform(0, math.pi))


def moved(shape, centre):
    return Ellipse(centre, shape.semi_major, shape.semi_minor, shape.theta)


def gap(first, second):
    return orthogonal_residuals(second.points_at(TURNS), first).min()


@pytest.mark.parametrize("seed", range(8))
def test_ellipses_touch_and_do_not_overlap(seed):
    first, shape = ellipse(seed), ellipse(seed + 100)
    direction = np.random.default_rng(seed).uniform(-math.pi, math.pi)
    x, y = compute_touching_centre(first, shape, direction)
    assert gap(first, moved(shape, (x, y))) == pytest.approx(0.0, abs=TOUCHING)
    assert math.atan2(y + 400.0, x) == pytest.approx(direction)


@pytest.mark.parametrize("seed", range(8))
def test_the_contact_point_is_on_both(seed):
    first, shape = ellipse(seed), ellipse(seed + 100)
    second = moved(shape, compute_touching_centre(first, shape, 0.3))
    contact = np.array([find_contact_point(first, second)])
    for touched in (first, second):
        assert orthogonal_residuals(contact, touched)[0] == pytest.approx(0.0, abs=TOUCHING)


@pytest.mark.parametrize("seed", range(5))
def test_a_nested_ellipse_touches_both_from_above(seed):
    left, right, top = (ellipse(seed + k) for k in (0, 100, 200))
    right = moved(right, compute_touching_centre(left, right, 0.1))
    top = moved(top, compute_nested_centre(left, right, top))
    assert gap(left, top) == pytest.approx(0.0, abs=TOUCHING)
    assert gap(right, top) == pytest.approx(0.0, abs=TOUCHING)
    assert top.centre[1] > min(left.centre[1], right.centre[1])


def test_too_wide_a_gap_raises_an_error():
    left, top = ellipse(1), ellipse(2)
    with pytest.raises(ValueError, match="closer than the third is wide"):
        compute_nested_centre(left, moved(left, (900.0, -400.0)), top)


@pytest.mark.parametrize("bulge", [0.0, 0.1])
@pytest.mark.parametrize("seed", range(5))
def test_a_bead_fills_the_groove_towards_the_sensor(seed, bulge):
    first, shape = ellipse(seed), ellipse(seed + 100)
    second = moved(shape, compute_touching_centre(first, shape, 0.2))
    outline = build_weld_bead(first, second, leg=9.0, bulge=bulge).outline
    surface, contact = outline[:41], np.array(find_contact_point(first, second))
    for side, foot in ((first, surface[:1]), (second, surface[-1:])):
        assert orthogonal_residuals(foot, side)[0] == pytest.approx(0.0, abs=TOUCHING)
        # A fillet that runs into a tube must not dip below its surface by more than roundness.
        assert orthogonal_residuals(surface, side).min() > -0.02
    assert surface[20, 1] > contact[1]


def test_a_fillet_is_concave_and_a_bulged_bead_convex():
    left = Ellipse((0.0, -400.0), 20.0, 20.0, 0.0)
    right = Ellipse((40.0, -400.0), 20.0, 20.0, 0.0)
    for bulge, sign in ((0.0, -1.0), (0.1, 1.0)):
        surface = build_weld_bead(left, right, leg=12.0, bulge=bulge).outline[:41]
        middle = surface[20, 1] - (surface[0, 1] + surface[-1, 1]) / 2
        assert sign * middle > 0
        if bulge:
            width = surface[-1, 0] - surface[0, 0]
            assert middle == pytest.approx(bulge * width, rel=1e-9)


@pytest.mark.parametrize("leg", [0.0, -1.0, 70.0])
def test_a_bead_longer_than_half_a_tube_is_rejected(leg):
    first = Ellipse((0.0, 0.0), 20.0, 20.0, 0.0)
    second = moved(first, compute_touching_centre(first, first, 0.0))
    with pytest.raises(ValueError, match=r"leg in \(0, 62\.83\] mm"):
        build_weld_bead(first, second, leg=leg, bulge=0.0)
