import math

import numpy as np
import pytest

from lsvision import Ellipse
from lsvision.ellipse.conditioning import condition_arc
from lsvision.shapes import orthogonal_residuals
from lsvision.shapes.noisy_points import NoisyPoints
from tests.alike import assert_same_ellipse
from tests.ellipse.arcs import SENSOR, about, measured, pipe, upper_arc

TRUTH = pipe(25.0)
SLIGHTLY_OFF = Ellipse((5.2, -400.1), TRUTH.semi_major + 0.2, TRUTH.semi_minor + 0.1, 0.55)


def test_clean_arcs_stay_where_they_are_though_the_screened_ellipse_is_off():
    points = upper_arc(TRUTH)
    conditioned = condition_arc(NoisyPoints.of(points, SENSOR.covariances(points)), SLIGHTLY_OFF)
    # The residual to an ellipse 0.2 mm off is no exact quadratic; 0.4 mm is what y(x) does.
    assert np.abs(orthogonal_residuals(conditioned.points, TRUTH)).max() < 0.02


def test_nearly_all_points_of_honest_noise_are_kept(rng):
    points = measured(upper_arc(TRUTH), rng)
    assert (
        condition_arc(
            NoisyPoints.of(points, SENSOR.covariances(points)), SLIGHTLY_OFF
        ).inliers.mean()
        > 0.97
    )


def test_conditioned_points_stand_half_a_millimetre_apart():
    points = upper_arc(TRUTH)
    even = condition_arc(NoisyPoints.of(points, SENSOR.covariances(points)), TRUTH).points
    np.testing.assert_allclose(np.hypot(*np.diff(even, axis=0).T), 0.5, rtol=0.03)


def test_jumps_are_not_kept(rng):
    points = measured(upper_arc(TRUTH), rng)
    jumps = [10, 33, 34]
    points[jumps, 1] += (3.0, -2.0, 5.0)
    conditioned = condition_arc(NoisyPoints.of(points, SENSOR.covariances(points)), SLIGHTLY_OFF)
    np.testing.assert_array_equal(np.flatnonzero(~conditioned.inliers), jumps)
    assert_same_ellipse(conditioned.ellipse, TRUTH, atol=2.0)


def test_smoothing_brings_the_points_nearer_to_the_truth(rng):
    points = measured(upper_arc(TRUTH), rng)
    conditioned = condition_arc(NoisyPoints.of(points, SENSOR.covariances(points)), TRUTH)
    before, after = (orthogonal_residuals(p, TRUTH) for p in (points, conditioned.points))
    assert after.std() < 0.6 * before.std()


@pytest.mark.parametrize("order", ["reverse", "random"])
def test_the_order_of_the_points_does_not_matter(order, rng):
    points = measured(upper_arc(TRUTH), rng)
    turn = np.arange(70)[::-1] if order == "reverse" else rng.permutation(70)
    there = condition_arc(NoisyPoints.of(points, SENSOR.covariances(points)), TRUTH)
    back = condition_arc(NoisyPoints.of(points[turn], SENSOR.covariances(points[turn])), TRUTH)
    assert_same_ellipse(back.ellipse, there.ellipse, atol=1e-6)
    np.testing.assert_array_equal(back.inliers, there.inliers[turn])


@pytest.mark.parametrize("theta", [0.0, math.pi / 2, math.pi - 1e-6], ids=["0", "90", "180"])
def test_the_seam_of_theta_does_not_cut_an_arc(theta):
    truth = pipe(25.0, theta=theta)
    points = upper_arc(truth, degrees=200)
    conditioned = condition_arc(NoisyPoints.of(points, SENSOR.covariances(points)), truth)
    # Between two points they lie on the chord: its sagitta is step^2 / (8 r).
    sagitta = np.hypot(*np.diff(points, axis=0).T).max() ** 2 / 8 / (19.0**2 / truth.semi_major)
    assert np.abs(orthogonal_residuals(conditioned.points, truth)).max() < 1.1 * sagitta


def test_duplicate_points_are_conditioned_too():
    points = np.repeat(upper_arc(TRUTH, count=20), 3, axis=0)
    conditioned = condition_arc(NoisyPoints.of(points, SENSOR.covariances(points)), about(TRUTH))
    assert np.isfinite(conditioned.points).all()
