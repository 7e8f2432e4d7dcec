"""Arcs on both sides of a gap in a pipe are one arc; those of two bodies stay two."""

import math

import numpy as np
import pytest

from lsvision import Ellipse, Profile, measure_cylinders
from lsvision.detection.arcs import IdentifiedArc
from lsvision.detection.divided_arcs import join_divided_arcs
from lsvision.detection.profile_preparation import prepare_profile

NOISE = 0.05  # mm


def pipe_under_cables(seed, cables, radius=30.0):
    """Noisy points of a pipe at (0, -300) under cables, each with its x and radius. Units: mm."""
    x = np.arange(-0.97 * radius, 0.97 * radius, 0.25)
    y = np.sqrt(radius**2 - x**2)
    for cable_x, cable in cables:
        centre_y = math.sqrt(radius**2 - cable_x**2) + 0.8 * cable
        above = np.maximum(cable**2 - (x - cable_x) ** 2, 0.0)
        y = np.where(above > 0, np.maximum(y, centre_y + np.sqrt(above)), y)
    return np.column_stack([x, y - 300 + np.random.default_rng(seed).normal(0, NOISE, len(x))])


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("cables", [[(0.0, 5.0)], [(3.0, 8.0)], [(-11.0, 3.0), (8.0, 4.0)]])
def test_a_pipe_under_cables_is_one_pipe_as_accurate_as_its_whole_arc(seed, cables):
    measured = measure_cylinders(pipe_under_cables(seed, cables))
    (pipe,) = (cylinder for cylinder in measured.cylinders if cylinder.radius > 15)
    assert pipe.radius_std < 0.1  # mm; of each part alone 1 to 4
    assert abs(pipe.radius - 30) < 4 * pipe.radius_std


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("changed", [lambda p: p[::-1], lambda p: p * (-1.0, 1.0)])
def test_reversed_and_mirrored_profiles_have_the_same_pipe(seed, changed):
    points = pipe_under_cables(seed, [(-11.0, 3.0), (8.0, 4.0)])
    first, second = (
        max(measure_cylinders(profile).cylinders, key=lambda cylinder: cylinder.radius)
        for profile in (points, changed(points))
    )
    assert abs(first.radius - second.radius) < 0.01 * first.radius_std
    assert len(first.indices) == len(second.indices)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("cables", [[-15, -3, 12], [-12, 3, 15], [-18, -6, 6, 18]])
def test_a_pipe_is_found_between_cables_though_no_part_covers_enough(seed, cables):
    measured = measure_cylinders(pipe_under_cables(seed, [(x, 3.0) for x in cables]))
    (pipe,) = (cylinder for cylinder in measured.cylinders if cylinder.radius > 15)
    assert pipe.radius_std < 0.25  # mm
    assert abs(pipe.radius - 30) < 4 * pipe.radius_std


def pipe_behind_a_bar(seed, start, stop, radius=12.0):
    """Noisy points of a pipe at (0, -300), hidden by a bar between two x. Units: mm."""
    x = np.arange(-0.9 * radius, 0.9 * radius, 0.5)
    y = np.where((start < x) & (x < stop), radius + 4, np.sqrt(radius**2 - x**2))
    return np.column_stack([x, y - 300 + np.random.default_rng(seed).normal(0, NOISE, len(x))])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("bar", [(-4, 1), (-1, 3), (1, 5)])
def test_a_part_of_few_points_belongs_to_its_pipe(seed, bar):
    """With 12 to 20 points, it does not determine its curvature alone."""
    (pipe,) = measure_cylinders(pipe_behind_a_bar(seed, *bar)).cylinders
    assert abs(pipe.radius - 12) < 3 * pipe.radius_std < 1  # mm


def circle_arc(degrees, radius=20.0, centre=(0.0, -300.0), count=60):
    """Points of an arc of a circle between two angles from +Y, clockwise."""
    angles = np.radians(np.linspace(*degrees, count))
    return np.add(centre, radius * np.column_stack([np.sin(angles), np.cos(angles)]))


def circle(radius=20.0, centre=(0.0, -300.0)):
    return Ellipse(centre, radius, radius, 0.0)


def joined(*arcs, ellipses=None, order=None, accepted=None, radius_range=(2.0, 200.0)):
    """Numbers of points of the arcs after joining; `order` is that of all points along the line.

    The arcs have noise along Y, and one ellipse each, by default a circle of 20 mm. The shapes of
    all but the first `accepted` have been rejected.
    """
    points = np.concatenate(arcs)
    points[:, 1] += np.random.default_rng(1).normal(0, NOISE, len(points))
    order = np.arange(len(points)) if order is None else order
    owners = np.repeat(np.arange(len(arcs)), list(map(len, arcs)))[order]
    profile = prepare_profile(Profile(points[order]), None)
    identified = [
        IdentifiedArc(np.flatnonzero(owners == number), ellipse)
        for number, ellipse in enumerate(ellipses or [circle()] * len(arcs))
    ]
    parts = identified[:accepted], identified[len(arcs) if accepted is None else accepted :]
    return [len(arc.indices) for arc in join_divided_arcs(profile, *parts, radius_range)]


LEFT, RIGHT = (-60.0, -15.0), (10.0, 60.0)
LARGER = 0.21  # mm


def test_both_sides_of_a_gap_are_one():
    assert joined(circle_arc(LEFT), circle_arc(RIGHT)) == [120]


def test_three_parts_are_one_also_if_the_middle_one_comes_last():
    left, right, middle = circle_arc((-70, -40)), circle_arc((40, 70)), circle_arc((-20, 15))
    order = [*range(60), *range(120, 180), *range(60, 120)]
    assert joined(left, right, middle, order=order) == [180]


@pytest.mark.parametrize("accepted", [0, 1])
def test_rejected_parts_are_one_arc_if_it_covers_enough(accepted):
    """The limit is 38 deg."""
    left, right = circle_arc((-25.0, -5.0)), circle_arc((5.0, 25.0))
    assert joined(left, right, accepted=accepted) == [120]
    assert joined(left[30:], right[:30], accepted=0) == []


def test_a_rejected_part_alone_is_left_out():
    assert joined(circle_arc(LEFT), accepted=0) == []
    arcs = circle_arc(LEFT), circle_arc(RIGHT), circle_arc((20.0, 50.0), radius=9.0)
    assert joined(*arcs, ellipses=[circle(), circle(), circle(9.0)], accepted=2) == [120]


@pytest.mark.parametrize(("degrees", "sizes"), [((85, 115), [120]), ((95, 125), [60])])
def test_a_part_that_faces_away_from_the_sensor_is_the_inside_of_a_tube(degrees, sizes):
    """The limit is 120 deg from +Y."""
    assert joined(circle_arc((-60.0, 40.0)), circle_arc(degrees), accepted=1) == sizes


def test_a_joined_arc_has_a_radius_within_the_range():
    assert joined(circle_arc(LEFT), circle_arc(RIGHT), radius_range=(21.0, 200.0)) == [60, 60]
    assert joined(circle_arc(LEFT), circle_arc(RIGHT), radius_range=(19.0, 21.0)) == [120]


@pytest.mark.parametrize(
    ("larger", "sizes"), [(0.0, [120]), (LARGER - 0.015, [120]), (LARGER + 0.015, [60, 60])]
)
def test_a_clamp_around_a_pipe_is_another_body(larger, sizes):
    """At 0.21 mm chi^2 of the joint fit has increased by 20.5 (`MAX_CHI2_INCREASE`)."""
    clamp = circle_arc(RIGHT, radius=20 + larger)
    assert joined(circle_arc(LEFT), clamp, ellipses=[circle(), circle(20 + larger)]) == sizes


def test_the_sections_of_two_bodies_do_not_overlap():
    pipe, neighbour = circle_arc(LEFT), circle_arc(RIGHT, radius=15.0, centre=(35.0, -300.0))
    ellipses = [circle(), circle(15.0, (35.0, -300.0))]
    assert joined(pipe, neighbour, ellipses=ellipses) == [60, 60]


def test_arcs_without_a_gap_are_not_joined():
    """Region growing has compared them: a corner or a step is between them."""
    whole = circle_arc((-60.0, 60.0), count=120)
    assert joined(whole[:60], whole[60:]) == [60, 60]
    # A gap of two points is 0.70 mm, one of three 1.06 mm; the median step along X is 0.31 mm.
    assert joined(whole[:60], whole[61:]) == [60, 59]
    assert joined(whole[:59], whole[61:]) == [118]


def test_arcs_whose_points_alternate_are_not_joined():
    whole = circle_arc((-60.0, 60.0), count=120)
    order = np.arange(120).reshape(2, 60).T.ravel()
    assert joined(whole[::2], whole[1::2], order=order) == [60, 60]


@pytest.mark.parametrize(("seed", "cable"), [(7, (0.0, 9.0)), (98, (0.0, 9.0))])
def test_the_joint_fit_needs_four_steps(seed, cable):
    """With three, the ellipse of a part is still too far from that of the pipe."""
    measured = measure_cylinders(pipe_under_cables(seed, [cable]))
    assert [c.radius_std < 1 for c in measured.cylinders if c.radius > 15] == [True]
