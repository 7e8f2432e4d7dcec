import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from lsvision.detection.windows import (
    Windows,
    build_multiscale_windows,
    fit_window_circles,
    measure_arc_coverage,
)
from lsvision.geometry.noisy_points import as_complex, as_vectors
from tests.detection.scenes import bowl, dome, flat


def window(start, stop):
    """One window of the first row of points."""
    return Windows(*(np.array([number]) for number in (0, start, stop)))


def circle_of(points):
    return fit_window_circles(as_complex(points)[None], window(0, len(points)))


def coverage_of(points):
    centres = circle_of(points).centre
    return measure_arc_coverage(as_complex(points)[None], window(0, len(points)), centres)[0]


@pytest.mark.parametrize("half_deg", [20.0, 60.0, 80.0])
def test_a_clean_arc_has_its_circle(half_deg):
    circle = circle_of(dome(12.0, 25.0, half_deg))
    np.testing.assert_allclose(circle.centre[0], 12 - 440j, atol=1e-6)
    assert circle.radius[0] == pytest.approx(25, abs=1e-6)
    assert circle.rms[0] < 1e-4
    # The last point is up to a pitch before the end: a large angle on a steep flank.
    assert coverage_of(dome(12.0, 25.0, half_deg)) == pytest.approx(
        math.radians(2 * half_deg), rel=0.1
    )
    assert circle.convex[0]


def test_each_window_has_its_own_circle(rng):
    points = np.concatenate([dome(0, 20), dome(60, 30)]) + 0.01 * rng.normal(size=(1, 2))
    count = len(dome(0, 20))
    spans = Windows(np.array([0, 0]), np.array([0, count]), np.array([count, len(points)]))
    both = fit_window_circles(as_complex(points)[None], spans)
    np.testing.assert_allclose(both.radius, (20, 30), atol=1e-6)


def test_a_row_of_points_has_the_circles_that_it_has_alone(rng):
    """Also if other rows lie far away."""
    rows = np.array([dome(0, 20)[:60], 1e4 + dome(0, 25)[:60], dome(0, 30)[:60]])
    spans = Windows(np.array([2, 0, 2]), np.array([0, 5, 20]), np.array([60, 50, 45]))
    together = fit_window_circles(as_complex(rows), spans)
    for i, (row, start, stop) in enumerate(zip(*spans, strict=True)):
        alone = fit_window_circles(as_complex(rows[row])[None], window(start, stop))
        for name in ("centre", "radius", "rms", "line_rms", "convex"):
            assert getattr(together, name)[i] == getattr(alone, name)[0]


def test_the_circle_is_kasas(rng):
    points = dome(12.0, 25.0) + 0.2 * rng.normal(size=dome(12.0, 25.0).shape)

    def algebraic(free):
        x, y, r = free
        return ((points - (x, y)) ** 2).sum(axis=1) - r * r

    x, y, radius = least_squares(algebraic, (10, -430, 20), xtol=1e-14, ftol=1e-14).x
    circle = circle_of(points)
    np.testing.assert_allclose(
        (*as_vectors(circle.centre)[0], circle.radius[0]), (x, y, radius), atol=1e-4
    )
    rms = np.sqrt(np.mean((np.hypot(*(points - (x, y)).T) - radius) ** 2))
    assert circle.rms[0] == pytest.approx(rms, rel=0.05)


def test_a_bowl_is_not_convex_towards_the_sensor():
    assert not circle_of(bowl(0, 20)).convex[0]


def test_past_180_deg_coverage_goes_on_growing():
    turn = np.radians(np.linspace(-20, 200, 60))
    coverage = coverage_of(20 * np.column_stack([np.cos(turn), np.sin(turn)]))
    assert coverage == pytest.approx(math.radians(220), abs=0.01)


def test_a_straight_window_has_a_huge_or_endless_radius():
    circle = circle_of(flat(0, 30))
    assert circle.radius[0] > 1e4


@pytest.mark.parametrize("points", [np.zeros((12, 2)), np.repeat([[1.0, 2], [3, 4]], 6, axis=0)])
def test_windows_without_a_circle_give_no_nan_radius(points):
    circle = circle_of(points)
    assert not np.isnan(circle.radius).any()


def test_no_window_crosses_into_the_next_component():
    sizes = np.array([30, 11, 57])
    starts, stops = build_multiscale_windows(sizes.tolist(), 10)
    ends = np.cumsum(sizes)
    owner = np.searchsorted(ends, starts, side="right")
    assert (stops <= ends[owner]).all()
    assert ((stops - starts) >= 10).all()


def test_every_component_has_a_window_over_all_of_it():
    starts, stops = build_multiscale_windows([30, 11], 10)
    windows = set(zip(starts.tolist(), stops.tolist(), strict=True))
    assert {(0, 30), (30, 41)} <= windows


def test_lengths_double():
    starts, stops = build_multiscale_windows([300], 10)
    assert set((stops - starts).tolist()) == {10, 20, 40, 80, 160, 300}


@pytest.mark.parametrize("length", [10, 40, 160])
def test_windows_are_a_third_of_themselves_apart(length):
    starts, stops = build_multiscale_windows([997], 10)
    own = np.sort(starts[stops - starts == length])
    assert (own[0], own[-1]) == (0, 997 - length)
    assert np.diff(own).max() <= length // 3
    assert np.diff(own).mean() > 0.85 * (length // 3)


def test_windows_are_the_same_from_either_end(rng):
    for _ in range(20):
        sizes = rng.integers(10, 400, rng.integers(1, 6))
        starts, stops = build_multiscale_windows(sizes.tolist(), 10)
        back_starts, back_stops = build_multiscale_windows(sizes[::-1].tolist(), 10)
        mirrored = sizes.sum() - np.column_stack([back_stops, back_starts])
        assert set(zip(starts.tolist(), stops.tolist(), strict=True)) == set(
            map(tuple, mirrored.tolist())
        )
