import math

import numpy as np
import pytest

from lsvision import Ellipse
from lsvision.ellipse.homogenising import homogenise_arcs
from lsvision.ellipse.smoothing import smooth_arcs
from lsvision.geometry import orthogonal_residuals
from lsvision.geometry.noisy_points import NoisyPoints
from tests.alike import assert_same_ellipse
from tests.ellipse.arcs import SENSOR, measured, pipe, upper_arc
from tests.tolerances import ROUNDING

TRUTH = pipe(25.0)
SLIGHTLY_OFF = Ellipse((5.2, -400.1), TRUTH.semi_major + 0.2, TRUTH.semi_minor + 0.1, 0.55)


def homogenised(points, screened):
    noisy = NoisyPoints.of(points, SENSOR.covariances(points))
    (found,) = homogenise_arcs(smooth_arcs([noisy], [screened]))
    return found


def steps_between(points):
    return np.hypot(*np.diff(points, axis=0).T)


def crowded_at_one_flank(count=150):
    """Return an arc with more points on one half than on the other."""
    share = np.linspace(0, 1, count) ** 2
    top = math.pi / 2 - TRUTH.theta
    return TRUTH.points_at(top + math.radians(70) * (1 - 2 * share))


@pytest.mark.parametrize("degrees", [60.0, 140.0, 200.0])
def test_points_stand_at_equal_steps_along_the_arc(degrees):
    steps = steps_between(homogenised(upper_arc(TRUTH, degrees), TRUTH).points)
    np.testing.assert_allclose(steps, steps.mean(), rtol=0.03)


def test_a_flank_that_was_sampled_densely_counts_no_more():
    points = crowded_at_one_flank()
    before, after = (steps_between(p) for p in (points, homogenised(points, TRUTH).points))
    assert before.max() > 20 * before.min()
    assert after.max() < 1.1 * after.min()


def test_clean_arcs_stay_where_they_are_though_the_screened_ellipse_is_off():
    even = homogenised(upper_arc(TRUTH), SLIGHTLY_OFF)
    # The residual to an ellipse 0.2 mm off is no exact quadratic; 0.4 mm is what y(x) does.
    assert np.abs(orthogonal_residuals(even.points, TRUTH)).max() < 0.02


def test_the_initial_guess_is_nearer_than_the_screened_ellipse(rng):
    errors = []
    for _ in range(100):
        found = homogenised(measured(upper_arc(TRUTH), rng), SLIGHTLY_OFF).ellipse
        errors.append(
            [abs(e.semi_major - TRUTH.semi_major) for e in (found, SLIGHTLY_OFF)]
            + [math.dist(e.centre, TRUTH.centre) for e in (found, SLIGHTLY_OFF)]
        )
    major, screened_major, centre, screened_centre = np.mean(errors, axis=0)
    assert major < screened_major
    assert centre < screened_centre


def test_without_noise_the_initial_guess_lies_on_the_points():
    """The errors of centre and size that remain after one step cancel along the arc."""
    points = upper_arc(TRUTH)
    found = homogenised(points, SLIGHTLY_OFF).ellipse
    before, after = (np.abs(orthogonal_residuals(points, e)).max() for e in (SLIGHTLY_OFF, found))
    assert before > 0.2
    assert after < 0.1 * before


def test_jumps_do_not_move_the_initial_guess(rng):
    points = measured(upper_arc(TRUTH), rng)
    clean = homogenised(points, SLIGHTLY_OFF).ellipse
    points[[10, 33, 34], 1] += (3.0, -2.0, 5.0)
    assert_same_ellipse(homogenised(points, SLIGHTLY_OFF).ellipse, clean, atol=0.2)


@pytest.mark.parametrize("order", ["reverse", "random"])
def test_the_order_of_the_points_does_not_matter(order, rng):
    points = measured(upper_arc(TRUTH), rng)
    turn = np.arange(70)[::-1] if order == "reverse" else rng.permutation(70)
    there, back = homogenised(points, TRUTH).ellipse, homogenised(points[turn], TRUTH).ellipse
    assert_same_ellipse(back, there, atol=1e-6)


@pytest.mark.parametrize("theta", [0.0, math.pi / 2, math.pi - 1e-6], ids=["0", "90", "180"])
def test_the_seam_of_theta_does_not_cut_an_arc(theta):
    truth = pipe(25.0, theta=theta)
    even = homogenised(upper_arc(truth, degrees=200), truth).points
    # Between two points they lie on the chord: its sagitta is step^2 / (8 r).
    step = steps_between(upper_arc(truth, degrees=200)).max()
    sagitta = step**2 / 8 / (19.0**2 / truth.semi_major)
    assert np.abs(orthogonal_residuals(even, truth)).max() < 1.1 * sagitta


def test_duplicate_points_are_homogenised_too():
    even = homogenised(np.repeat(upper_arc(TRUTH, count=20), 3, axis=0), SLIGHTLY_OFF)
    assert np.isfinite(even.points).all()
    assert_same_ellipse(even.ellipse, TRUTH, atol=0.1)


def test_arcs_in_a_stack_are_homogenised_as_alone(rng):
    ellipses = [pipe(10.0 * i, radius=10.0 + 4 * i, theta=0.4 * i) for i in range(6)]
    points = [measured(upper_arc(each, 100.0, 40 + 20 * i), rng) for i, each in enumerate(ellipses)]
    smoothed = smooth_arcs(
        [NoisyPoints.of(each, SENSOR.covariances(each)) for each in points], ellipses
    )
    for together, arc in zip(homogenise_arcs(smoothed), smoothed, strict=True):
        (alone,) = homogenise_arcs([arc])
        np.testing.assert_allclose(together.points, alone.points, rtol=ROUNDING)
        assert_same_ellipse(together.ellipse, alone.ellipse, atol=ROUNDING)


def test_no_arcs_are_homogenised_to_none():
    assert homogenise_arcs([]) == []
