"""The steps of the paper's own pipeline, by themselves."""

import numpy as np
import pytest

from lsvision.errors import FitFailed
from lsvision.studies.chen_liu_2016.paper_pipeline import (
    PaperSettings,
    homogenise_profile_paper,
    measure_cylinders_paper,
    smooth_profile_paper,
)
from tests.ellipse.arcs import pipe, upper_arc
from tests.tolerances import MACHINE


def test_smoothing_over_x_keeps_parabolas_and_spoils_circles():
    x = np.linspace(-10, 10, 41)
    parabola = np.column_stack([x, -0.05 * x * x])
    np.testing.assert_allclose(smooth_profile_paper(parabola), parabola, atol=MACHINE)
    arc = upper_arc(pipe(0.0), degrees=150)
    assert np.abs(smooth_profile_paper(arc) - arc).max() > 0.1


def test_homogenising_over_x_leaves_out_points_whose_x_does_not_rise():
    x = np.array([0.0, 1.0, 2.0, 1.5, 2.0, 3.0])
    even = homogenise_profile_paper(np.column_stack([x, 2 * x]))
    np.testing.assert_allclose(even[:, 0], np.arange(0, 3, 0.5), atol=MACHINE)
    np.testing.assert_allclose(even[:, 1], 2 * even[:, 0], atol=MACHINE)


def test_smoothing_over_x_rejects_an_arc_without_width():
    upright = np.column_stack([np.zeros(20), np.arange(20.0)])
    with pytest.raises(FitFailed, match="no width in x"):
        smooth_profile_paper(upright)


def test_homogenising_over_x_rejects_an_arc_whose_x_increases_nowhere():
    with pytest.raises(FitFailed, match="x increases nowhere"):
        homogenise_profile_paper(np.column_stack([np.arange(5.0, 0.0, -1.0), np.zeros(5)]))


def test_a_profile_in_the_order_of_decreasing_x_has_the_same_cylinders():
    points = upper_arc(pipe(0.0), degrees=120)
    rising, falling = (
        measure_cylinders_paper(order, radius=19.0).cylinders for order in (points, points[::-1])
    )
    assert len(rising) == len(falling) > 0
    for one, other in zip(rising, falling, strict=True):
        assert other.radius == pytest.approx(one.radius, abs=MACHINE)
        np.testing.assert_array_equal(np.sort(len(points) - 1 - other.indices), one.indices)


INVALID = {
    "sensor_error_mm": -1.0,
    "window_fraction": 0.0,
    "smoothing_fraction": float("inf"),
    "step_mm": 0.0,
    "end_part_fraction": 0.5,
}


@pytest.mark.parametrize("name", INVALID)
def test_settings_out_of_range_are_rejected(name):
    with pytest.raises(ValueError, match=f"expected .*{name}"):
        PaperSettings(**{name: INVALID[name]})


def test_end_parts_of_a_short_arc_leave_a_middle_part():
    settings = PaperSettings(end_part_fraction=0.49)
    assert [settings.count_end_points(count) for count in (3, 6, 100)] == [1, 2, 49]
    points = upper_arc(pipe(0.0), degrees=120)
    measurement = measure_cylinders_paper(points, radius=19.0, settings=settings)
    assert measurement.cylinders or measurement.rejections


def test_smoothing_over_x_keeps_a_flank_whose_points_have_the_same_x():
    x = np.concatenate([np.zeros(8), np.arange(1.0, 9.0)])
    y = np.concatenate([np.arange(-8.0, 0.0), np.zeros(8)])
    smooth = smooth_profile_paper(np.column_stack([x, y]), 0.2)
    np.testing.assert_array_equal(smooth[:, 0], x)
    np.testing.assert_allclose(smooth[12:, 1], 0.0, atol=MACHINE)


def test_a_profile_without_an_ellipse_says_why(rng):
    points = np.column_stack([np.arange(100.0), rng.uniform(-500, -300, 100)])
    measurement = measure_cylinders_paper(points, radius=19.0)
    assert measurement.reason == "no 10 neighbouring points of 100 lie within 0.9 mm of an ellipse"
