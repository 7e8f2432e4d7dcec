import numpy as np
import pytest

from lsvision import Profile, measure_cylinders
from lsvision.detection.line_order import order_along_line

COUNT = 400


def ring(start_deg=90.0, clockwise=True, count=COUNT, radius=20.0):
    """A closed section in angular order, its centre at the origin."""
    turn = np.radians(start_deg + (-1 if clockwise else 1) * np.arange(count) * 360 / count)
    return radius * np.column_stack([np.cos(turn), np.sin(turn)])


def two_lines(gaps, pitch=0.3):
    """Return columns at y = 0 with second returns at these distances below; NaN: no second one."""
    x = pitch * np.arange(len(gaps))
    rows = np.stack([np.column_stack([x, 0 * x]), np.column_stack([x, -np.asarray(gaps)])], axis=1)
    rows = rows.reshape(-1, 2)
    return rows[np.isfinite(rows[:, 1])]


def ordered(points):
    order = order_along_line(points)
    return points if order is None else points[order]


@pytest.mark.parametrize("x", [[0, 1, 2, 3, 4], [4, 3, 2, 1, 0], [0, 2, 1, 3, 4], [1, 1, 1, 1, 1]])
def test_an_order_in_which_x_progresses_is_kept(x):
    assert order_along_line(np.column_stack([x, np.zeros(5)])) is None


def test_points_without_an_order_are_sorted_by_x(rng):
    points = np.column_stack([np.arange(50.0), np.zeros(50)])
    np.testing.assert_array_equal(ordered(rng.permutation(points)), points)


@pytest.mark.parametrize(("progress", "kept"), [(0.42, False), (0.58, True)])
def test_less_progress_than_half_the_travel_is_no_order(progress, kept):
    backwards = (1 - progress) / (1 + progress)
    x = np.cumsum(np.tile([1.0, -backwards], 300))
    assert (order_along_line(np.column_stack([x, 0 * x])) is None) == kept


@pytest.mark.parametrize("start_deg", [90.0, 0.0, 200.0, -90.0, 37.0])
@pytest.mark.parametrize("clockwise", [True, False])
def test_a_closed_section_is_its_upper_side_and_its_lower_side(start_deg, clockwise):
    points = ordered(ring(start_deg, clockwise))
    lowest = int(points[:, 1].argmin())
    upper, lower = points[:lowest], points[lowest:]
    assert abs(len(upper) - COUNT / 2) <= 1
    assert upper[:, 1].min() > -0.4
    assert lower[:, 1].max() < 0.4
    assert (np.diff(upper[:, 0]) >= 0).all()
    assert np.count_nonzero(np.diff(lower[:, 0]) < 0) == 1  # from the right end to the left one


def test_a_closed_section_in_no_order_is_two_lines_too(rng):
    shuffled = ordered(rng.permutation(ring()))
    length = 2 * np.pi * 20 + 2 * 20 + 20 * 2**0.5  # round it, and from a line's end to the next
    assert np.hypot(*np.diff(shuffled, axis=0).T).sum() == pytest.approx(length, rel=0.05)


def test_a_path_that_does_not_close_keeps_its_order():
    """In an overhang, x decreases along the line."""
    turn = np.radians(np.linspace(-60, 240, 300))
    hook = 20 * np.column_stack([np.cos(turn)[::-1], np.sin(turn)[::-1]])
    line = np.column_stack([np.arange(-60, -11, 0.3), np.full(164, hook[0, 1])])
    assert order_along_line(np.concatenate([line, hook])) is None


@pytest.mark.parametrize("far_first", [False, True])
@pytest.mark.parametrize("falling", [False, True])
@pytest.mark.parametrize("missing", [0.0, 0.5, 0.8], ids=lambda share: f"{share} without")
def test_two_returns_a_column_are_two_lines(far_first, falling, missing, rng):
    gaps = np.where(rng.random(300) < missing, np.nan, 25.0)
    points = two_lines(gaps) + 0.01 * rng.normal(size=(np.isfinite(gaps).sum() + 300, 2)) * (0, 1)
    if far_first:
        points = points[np.lexsort((points[:, 1], points[:, 0]))]
    if falling:
        points = points[::-1]
    lines = ordered(points)
    assert np.abs(lines[:300, 1]).max() < 1
    assert np.abs(lines[300:, 1] + 25).max() < 1
    assert (np.diff(lines[:300, 0]) < 0).all() == falling


def test_returns_that_step_together_are_cut_at_the_steps_only():
    points = two_lines(np.full(300, 10.0))
    points[200:400, 1] += 29
    steps = np.hypot(*np.diff(ordered(points), axis=0).T)
    assert np.count_nonzero(steps > 0.4) == 5  # two a line, and the way back


@pytest.mark.parametrize(("climb_widths", "split"), [(4.2, False), (5.8, True)])
def test_returns_that_climb_less_than_five_widths_are_jumps(climb_widths, split):
    gaps = np.full(400, np.nan)
    gaps[100:120] = climb_widths * 0.3 * 399 / 40
    assert (order_along_line(two_lines(gaps)) is not None) == split


@pytest.mark.parametrize(("steps", "split"), [(8.5, False), (11.5, True)])
def test_two_returns_lie_further_apart_than_ten_steps(steps, split):
    points = two_lines(np.full(60, steps), pitch=0.01)
    points[:, 1] += np.repeat(np.tile([0.0, 1.0], 30), 2)
    assert (order_along_line(points) is not None) == split


def test_a_scan_with_steps_and_jumps_is_one_line(rng):
    points = np.column_stack([0.3 * np.arange(400), 40.0 * (np.arange(400) // 100 % 2)])
    points[::25, 1] += rng.uniform(-8, 8, 16)
    assert order_along_line(points) is None


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_few_points_have_any_order(count):
    assert order_along_line(np.zeros((count, 2))) is None


def test_an_order_is_a_permutation(rng):
    for points in (rng.uniform(size=(200, 2)), ring(), two_lines(np.full(100, 30.0))):
        order = order_along_line(points)
        if order is not None:
            np.testing.assert_array_equal(np.sort(order), np.arange(len(points)))


def assert_measured(points, rng, noise_mm=0.05):
    """The nearest pipe has the radius of 20 mm."""
    noisy = points + noise_mm * rng.normal(size=points.shape)
    pipe = max(measure_cylinders(Profile(noisy)).cylinders, key=lambda pipe: pipe.centre[1])
    assert abs(pipe.radius - 20.0) < 4 * pipe.radius_std
    assert pipe.radius_std < 0.5


@pytest.mark.parametrize("start_deg", [90.0, -90.0, 37.0])
@pytest.mark.parametrize("shuffled", [False, True])
def test_a_closed_section_is_measured(start_deg, shuffled, rng):
    points = ring(start_deg) + np.array([3.0, -140.0])
    assert_measured(rng.permutation(points) if shuffled else points, rng)


def test_a_pipe_above_a_second_return_is_measured(rng):
    gaps = np.full(400, np.nan)
    gaps[150:250] = 25.0
    points = two_lines(gaps)
    away = points[:, 0] - 59.85
    on_pipe = np.abs(away) < 14.8
    height = np.sqrt(400 - away[on_pipe] ** 2)
    points[on_pipe, 1] += height
    assert_measured(points - (0, 170), rng, noise_mm=0.03)
