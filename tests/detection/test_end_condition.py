"""Lines of corners and sheets continue tangentially; those of pipes end, kink, or have a fillet."""

import math

import numpy as np
import pytest

from lsvision import Profile, measure_cylinders
from lsvision.detection.end_condition import find_connected_beyond, find_tangential_end_reason
from lsvision.detection.profile_preparation import prepare_profile
from tests.detection.scenes import arc_points, as_screened, circle, exact, identified, walk

STEP_DEG = 2.0
STEP = 2 * 20 * math.sin(math.radians(STEP_DEG / 2))  # mm, chord of the arcs' steps


def sides(left_deg, right_deg, half_deg=60.0, step_deg=STEP_DEG):
    """Return an arc of 20 mm; each side continues in steps at these angles from its tangent.

    A positive turn is a turn towards the sensor, as that of a fillet.
    """
    angles = np.arange(-half_deg, half_deg + step_deg / 2, step_deg)
    step = 2 * 20 * math.sin(math.radians(step_deg / 2))
    arc = arc_points(angles)
    right = walk(arc[-1], np.asarray(right_deg, float) - half_deg, step)
    left = walk(arc[-1], np.asarray(left_deg, float) - half_deg, step)[::-1] * (-1, 1)
    return np.concatenate([left, arc, right]), len(left), len(left) + len(angles)


def reason_of(points, start, stop, *, screened=None, std=0.01):
    arc = identified(start, stop, circle())
    kept = arc if screened is None else identified(*screened, circle())
    profile = exact(points)
    return find_tangential_end_reason(profile, arc, as_screened(profile, kept, std))


def reason(left_deg, right_deg, **arc):
    return reason_of(*sides(left_deg, right_deg, **arc))


KINK, NOTHING = [90.0] * 20, []
CURVED = 1.3
"""Curvature of a fillet over that of the arc."""


@pytest.mark.parametrize("turn_deg", [-1, 1])
@pytest.mark.parametrize("other", [KINK, NOTHING], ids=["kink", "nothing"])
def test_an_end_that_turns_less_than_20_deg_goes_on_tangentially(turn_deg, other):
    for deg, is_rejected in ((0, True), (17, True), (19.4, True), (20.5, False), (23, False)):
        line = [turn_deg * deg] * 20
        for first, second in ((line, other), (other, line)):
            found = reason(first, second)
            assert (found is not None) == is_rejected, (deg, found)
            if is_rejected:
                expected = (
                    f"continues tangentially at one end (turns {deg:.0f} deg): a rounded corner"
                )
                assert found == expected


@pytest.mark.parametrize(("first", "second"), [(KINK, KINK), (NOTHING, NOTHING), (KINK, NOTHING)])
def test_a_kink_or_nothing_at_both_ends_is_a_pipes(first, second):
    assert reason(first, second) is None


def test_where_both_ends_turn_less_than_20_deg_it_is_a_sheet():
    for deg, is_rejected in ((10, True), (19.4, True), (20.5, False), (40, False)):
        found = reason([deg] * 20, [-deg] * 20)
        assert (found is not None) == is_rejected, (deg, found)
    assert reason([15] * 20, [-12] * 20) == (
        "continues tangentially at both ends (turns 12 and 15 deg)"
    )


@pytest.mark.parametrize(("half_deg", "is_rejected"), [(70.0, True), (80.0, False)])
def test_a_line_that_faces_away_from_the_sensor_is_no_continuation(half_deg, is_rejected):
    """It turns by 15 deg: to an inclination of 85 or of 95 deg."""
    for first, second in (([-15.0] * 20, NOTHING), (NOTHING, [-15.0] * 20)):
        assert (reason(first, second, half_deg=half_deg) is not None) == is_rejected


@pytest.mark.parametrize("mixed", [0, 4, 12])
def test_points_into_which_a_sensor_mixes_the_arc_do_not_count(mixed):
    """A line that continues tangentially beyond them does not end at them, either."""
    for count, is_rejected in ((mixed + 5, False), (mixed + 6, True), (mixed + 20, True)):
        points, start, stop = sides([0.0] * count, KINK)
        arc = identified(start, stop, circle())
        profile = exact(points)
        reason = find_tangential_end_reason(profile, arc, as_screened(profile, arc, 0.01, mixed))
        assert (reason is not None) == is_rejected, (count, reason)


def test_most_pipes_whose_ends_a_filter_has_bent_are_found():
    """A Gaussian filter with a std of 3.8 columns, which is one-sided at the ends of the profile.

    If no mixed points were left out, every third pipe would seem to continue tangentially.
    """
    found = 0
    for seed in range(40):
        rng = np.random.default_rng([41, seed])
        x = np.arange(-15.5, 15.51, 0.22)
        y = np.sqrt(16.0**2 - x * x) - 400 + 0.08 * rng.normal(size=len(x))
        weights = np.exp(-((x[:, None] - x) ** 2) / (2 * (3.8 * 0.22) ** 2))
        smooth = weights @ y / weights.sum(axis=1)
        found += len(measure_cylinders(np.column_stack([x, smooth])).cylinders)
    assert found >= 0.8 * 40


def test_fewer_than_six_points_beyond_are_nothing():
    for count, is_rejected in ((5, False), (6, True)):
        assert (reason([0] * count, NOTHING) is not None) == is_rejected


def test_the_turn_of_a_short_arc_is_measured_over_six_points():
    """An eighth of 41 points is less than six."""
    short = {"half_deg": 40.0}
    assert reason([-18] * 6 + [-28] * 9, KINK, **short) is not None
    assert reason([-24] * 4 + [-10] * 2 + [-18] * 9, KINK, **short) is not None
    assert reason([22] * 4 + [18] * 2 + [10] * 9, KINK, **short) is None


def test_the_turn_of_a_long_arc_is_measured_over_an_eighth_of_its_points():
    """On an arc of 96 points these are 12 points."""
    long = {"half_deg": 47.5, "step_deg": 1.0}
    assert reason([-18] * 12 + [-42] * 12, KINK, **long) is not None
    assert reason([22] * 8 + [14] * 4, KINK, **long) is not None
    assert reason([30] * 8, KINK, **long) is None


def test_points_beyond_a_gap_are_another_thing():
    for step, is_rejected in ((2.5 * STEP, True), (3.5 * STEP, False)):
        arc = arc_points(np.arange(-60, 61, STEP_DEG))
        first = walk(arc[-1], [-60.0], step)
        beyond = walk(first[-1], [-60.0] * 15, STEP)
        found = reason_of(np.concatenate([arc, first, beyond]), 0, len(arc))
        assert (found is not None) == is_rejected


def test_jumps_between_the_points_beyond_do_not_hide_that_they_go_on():
    points, start, stop = sides([], [0] * 20)
    points[stop + 1 : stop + 6 : 2, 1] += 9.0
    assert reason_of(points, start, stop).startswith("continues tangentially at one end")


def fillet(radius_ratio, count):
    """Return the angles of steps along a fillet whose radius is `radius_ratio` times the arc's."""
    return STEP_DEG / radius_ratio * (np.arange(count) + 0.5)


def test_a_fillet_is_a_pipes():
    assert reason(fillet(1 / CURVED, 20), KINK) is None
    assert reason(KINK, fillet(1 / CURVED, 20)) is None


def test_a_fillet_at_the_other_end_of_a_corner_is_not_counted():
    assert reason(fillet(1 / CURVED, 20), [5] * 20) == (
        "continues tangentially at one end (turns 5 deg): a rounded corner"
    )


def test_the_same_bent_the_other_way_is_a_corners():
    assert reason(-fillet(1 / CURVED, 20), KINK) is not None


def test_a_bead_has_twice_the_curvature_of_the_cylinder_at_least():
    """The bead begins beyond a foot that turns by 12 deg; a corner may have half the radius."""
    for ratio, is_rejected in ((1.5, True), (1.8, True), (2.2, False), (4.0, False)):
        bead = 12 + 6 * STEP_DEG * ratio - fillet(1 / ratio, 12)
        for first, second in ((bead, KINK), (KINK, bead)):
            found = reason(first, second)
            assert (found is not None) == is_rejected, (ratio, found)


def test_a_bead_begins_beyond_the_longer_arc():
    """Beyond the screened arc lie points of the pipe first, along which the line is less curved."""
    bead = 15 - fillet(1 / 2.6, 12)
    points, start, stop = sides(NOTHING, bead)
    assert reason_of(points, start, stop, screened=(start, stop - 6)) is None


def test_a_fillet_has_the_curvature_of_the_cylinder_at_least():
    for ratio, is_rejected in ((0.72, True), (0.9, True), (1.1, False), (1.3, False)):
        found = reason(fillet(1 / ratio, 20), KINK)
        assert (found is not None) == is_rejected, (ratio, found)


def curvature_std(count, step, noise):
    """Return the std of 2 c for y = c x^2: var c = 180 sigma^2 / (h^4 n (n^2 - 1) (n^2 - 4))."""
    return 2 * noise * math.sqrt(180 / (count * (count**2 - 1) * (count**2 - 4))) / step**2


@pytest.mark.parametrize("count", [6, 12])
def test_noise_hides_a_fillet_that_is_too_short(count):
    """Its curvature is significant from 3 sigma, over 6 to 12 points."""
    points, start, stop = sides(fillet(1 / CURVED, count), KINK)
    chord = math.dist(points[0], points[count - 1]) / (count - 1)
    for sigmas, is_rejected in ((2.2, True), (2.8, True), (3.2, False), (3.8, False)):
        noise = CURVED / 20 / sigmas / curvature_std(count, chord, 1.0)
        assert (reason_of(points, start, stop, std=noise) is not None) == is_rejected


def test_the_curvature_of_a_fillet_is_that_of_its_first_twelve_points():
    """The curvature of 20 points would be significant; that of five never is."""
    points, start, stop = sides(fillet(1 / CURVED, 20), KINK)
    for sigmas, is_rejected in ((2.8, True), (3.2, False)):
        noise = CURVED / 20 / sigmas / curvature_std(12, 0.985 * STEP, 1.0)
        assert (reason_of(points, start, stop, std=noise) is not None) == is_rejected
    assert reason_of(*sides(fillet(1 / CURVED, 5), [0] * 20)) is not None


def test_the_curvature_beyond_a_long_arc_is_that_of_an_eighth_of_its_points():
    """On an arc of 241 points these are 30; the curvature of 22 or 12 would not be significant."""
    points, start, stop = sides(fillet(1 / CURVED, 80) / 4, KINK, step_deg=0.5)
    for sigmas, is_rejected in ((2.8, True), (3.2, False)):
        noise = CURVED / 20 / sigmas / curvature_std(30, 0.985 * STEP / 4, 1.0)
        assert (reason_of(points, start, stop, std=noise) is not None) == is_rejected


def test_the_scatter_of_a_line_hides_its_curvature_as_noise_does():
    """The errors are orthogonal to any parabola; s^2 is the sum of their squares over 6 - 3."""
    points, start, stop = sides(fillet(1 / CURVED, 6), KINK)
    across = np.array([-5, 7, 4, -4, -7, 5])[:, None] / 60**0.5 * [-math.sin(0.87), math.cos(0.87)]
    limit = CURVED / 20 / 3 / curvature_std(6, STEP, 1.0)
    for scatter, is_rejected in ((0.9 * limit, False), (1.15 * limit, True)):
        rough = points.copy()
        rough[:start] += scatter * across
        assert (reason_of(rough, start, stop, std=0.001) is not None) == is_rejected


def test_the_turn_is_that_of_the_end_before_screening():
    """The line of a pipe that screening cut short continues there, but ends in a kink."""
    points, start, stop = sides(KINK, KINK)
    assert reason_of(points, start, stop, screened=(start + 6, stop - 6)) is None


@pytest.mark.parametrize(("count", "is_rejected"), [(11, False), (12, True), (20, True)])
def test_a_line_that_screening_dropped_goes_on_tangentially(count, is_rejected):
    """The line, which rough identification took for the arc, is long enough to show a fillet."""
    for turns in ((NOTHING, [0.0] * count), ([0.0] * count, NOTHING)):
        points, start, stop = sides(*turns)
        reason = reason_of(points, 0, len(points), screened=(start, stop))
        assert (reason is not None) == is_rejected


@pytest.mark.parametrize("dropped", [12, 20])
def test_points_of_the_arc_that_screening_dropped_are_no_other_line(dropped):
    points, start, stop = sides(NOTHING, NOTHING)
    for first, last in ((dropped, 0), (0, dropped)):
        assert reason_of(points, start, stop, screened=(start + first, stop - last)) is None


def test_a_line_beyond_three_sigma_of_the_ellipse_is_another_one():
    """A flat of 12 points, 0.84 mm rms from the circle."""
    points, start, stop = sides(NOTHING, [0.0] * 12)
    for std, is_rejected in ((0.25, True), (0.31, False)):
        reason = reason_of(points, start, len(points), screened=(start, stop), std=std)
        assert (reason is not None) == is_rejected


def test_a_fillet_begins_where_screening_ended():
    """The identified arc has two points of it; the curvature of the other 10 is not significant."""
    points, start, stop = sides(NOTHING, fillet(1 / CURVED, 12))
    noise = CURVED / 20 / 3.3 / curvature_std(12, STEP, 1.0)
    assert reason_of(points, start, stop + 2, screened=(start, stop), std=noise) is None
    assert reason_of(points, start, stop + 2, std=noise) is not None


def corner(radius, pitch, rng, *, last_deg=75.0, noise=0.02):
    """Return the points of a plate with a rounded right edge, and the indices of the edge."""
    x = np.arange(-3 * radius, radius * math.sin(math.radians(last_deg)), pitch)
    y = np.where(x < 0, radius, np.sqrt(radius**2 - np.maximum(x, 0) ** 2)) - 440
    edge = np.flatnonzero(x >= 0)
    return np.column_stack([x, y + noise * rng.normal(size=len(x))]), edge


@pytest.mark.parametrize("pitch", [0.1, 0.2, 0.35, 0.6])
@pytest.mark.parametrize("count", [10, 20, 50, 120, 400])
@pytest.mark.parametrize("mirror", [1, -1])
def test_a_rounded_corner_is_one_at_any_pitch_and_size(pitch, count, mirror, rng):
    radius = count * pitch / math.sin(math.radians(75))
    points, edge = corner(radius, pitch, rng, noise=0.02 * min(radius / 10, 1))
    points *= (mirror, 1)
    profile = prepare_profile(Profile(points), None)
    arc = identified(edge[0], edge[-1] + 1, circle(radius))
    found = find_tangential_end_reason(profile, arc, as_screened(profile, arc, 0.02))
    assert found.startswith("continues tangentially at one end (turns ")
    assert found.endswith(": a rounded corner")


@pytest.mark.parametrize("pitch", [0.1, 0.3, 0.6])
@pytest.mark.parametrize("half_deg", [25.0, 40.0, 60.0])
def test_the_crest_of_a_bent_sheet_goes_on_at_both_ends(pitch, half_deg, rng):
    reach, slope = 20 * math.sin(math.radians(half_deg)), math.tan(math.radians(half_deg))
    x = np.arange(-reach - 15, reach + 15, pitch)
    crest = np.sqrt(np.maximum(400 - x**2, 0))
    flank = 20 * math.cos(math.radians(half_deg)) - slope * (np.abs(x) - reach)
    y = np.where(np.abs(x) < reach, crest, flank) - 440 + 0.02 * rng.normal(size=len(x))
    edge = np.flatnonzero(np.abs(x) < reach)
    profile = prepare_profile(Profile(np.column_stack([x, y])), None)
    arc = identified(edge[0], edge[-1] + 1, circle())
    assert find_tangential_end_reason(profile, arc, as_screened(profile, arc, 0.02)).startswith(
        "continues tangentially at both ends (turns "
    )


def real_line(*steps):
    return np.concatenate([[0.0], np.cumsum(steps)]).astype(complex)


def test_a_point_within_three_steps_is_connected():
    own = real_line(*[1.0] * 15)
    for gap, connected in ((2.2, 1), (2.9, 1), (3.1, 0), (3.8, 0)):
        assert len(find_connected_beyond(own, np.array([15 + gap + 0j]), 9)) == connected


def test_the_last_twelve_points_tell_the_step():
    """The typical step is the upper median: with six short steps of eleven it is short."""
    far = np.array([25.0 + 0j])
    short = real_line(*[10.0] * 9, *[1.0] * 6)
    assert len(find_connected_beyond(short - short[-1], far, 9)) == 0
    long = real_line(*[10.0] * 9, *[1.0] * 5)
    assert len(find_connected_beyond(long - long[-1], far, 9)) == 1


def test_the_chain_leaves_out_what_is_out_of_reach_and_ends_in_time():
    own = real_line(*[1.0] * 5) - 5
    beyond = np.array([1, 2 + 9j, 3, 4, 9, 5, 6], dtype=complex)
    np.testing.assert_array_equal(find_connected_beyond(own, beyond, 9), [0, 2, 3, 5, 6])
    np.testing.assert_array_equal(find_connected_beyond(own, beyond, 3), [0, 2, 3])
    assert len(find_connected_beyond(own, beyond[:0], 3)) == 0


def reason_of_positions(positions):
    """Return the result for points on the tangent beyond an arc, at these steps from the first."""
    points, start, stop = sides([], [0])
    beyond = points[-1] + np.outer(positions, points[-1] - points[-2])
    return reason_of(np.concatenate([points[:-1], beyond]), start, stop)


@pytest.mark.parametrize("positions", [(0, 1, 2, 3, 3, 2, 1, 0), (0, 0, 0, 0, 1, 1, 1, 1)])
def test_a_tangent_with_no_chord_or_two_positions_is_no_weld(positions):
    assert "a rounded corner" in reason_of_positions(positions)


def test_a_line_ends_where_the_sensor_repeats_its_last_point():
    assert reason_of_positions([0] * 8) is None
