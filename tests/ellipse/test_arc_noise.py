import math

import numpy as np
import pytest
from scipy.stats import norm

from lsvision.ellipse.arc_noise import (
    apply_smoothing_sensor_noise,
    estimate_arc_noise,
    has_errors_growing_with_incidence,
)
from lsvision.geometry.noisy_points import NoisyPoints
from tests.tolerances import FIVE_SIGMA, ROUNDING, spread_of_share

ESTIMATED = 1e-4  # of a variance: smallest factor where the noise is estimated


def fan(count, degrees=140.0):
    """Normals of an arc towards the sensor, evenly from one flank to the other."""
    half = math.radians(degrees) / 2
    return 1j * np.exp(1j * np.linspace(half, -half, count))


def smoothed_along(count, width, rng):
    """Return unit noise averaged over `width` columns, and scaled to a std of 1."""
    kernel = np.ones(width) / math.sqrt(width)
    return np.convolve(rng.normal(size=count + width - 1), kernel, mode="valid")


def std_factors(incidence_deg):
    normals = 1j * np.exp(1j * np.radians(np.atleast_1d(incidence_deg)))
    points = NoisyPoints(0 * normals, np.ones(len(normals)), normals)
    return np.sqrt(apply_smoothing_sensor_noise(points, normals, 0.05).mean_variance) / 0.05


@pytest.mark.parametrize("std_ratio", [0.3, 1.0, 3.0])
def test_the_variance_factor_is_that_of_the_residuals(std_ratio, rng):
    noise = estimate_arc_noise(std_ratio * rng.normal(size=4000), ESTIMATED)
    # A median of moduli has a standard error of 1.17 / sqrt(n); a variance twice that.
    slack = FIVE_SIGMA * 2 * 1.17 / math.sqrt(4000)
    assert noise.variance_factor == pytest.approx(std_ratio**2, rel=slack)


def test_a_given_noise_model_is_not_improved_upon(rng):
    quiet = 0.2 * smoothed_along(200, 9, rng)
    noise = estimate_arc_noise(quiet, 1.0)
    assert (noise.variance_factor, noise.autocorrelation_time) == (1.0, 1.0)
    assert (noise.low_frequency_time, noise.sensor_smooths) == (1.0, False)


def test_a_given_noise_model_may_be_too_small(rng):
    noise = estimate_arc_noise(5 * rng.normal(size=4000), 1.0)
    assert noise.variance_factor == pytest.approx(25, rel=0.2)


def test_an_average_over_five_columns_is_reported(rng):
    noise = estimate_arc_noise(smoothed_along(2000, 5, rng), ESTIMATED)
    assert noise.sensor_smooths
    assert noise.autocorrelation_time == pytest.approx(5, rel=0.15)
    assert noise.low_frequency_time >= noise.autocorrelation_time


def test_low_waves_alone_say_nothing_of_neighbours():
    """A form error of 2.5 waves, smaller than the white noise: the ellipse is less certain."""
    white = np.random.default_rng(5).normal(size=200)
    noise = estimate_arc_noise(white + 0.5 * np.cos(np.linspace(0, 5 * np.pi, 200)), ESTIMATED)
    assert not noise.sensor_smooths
    assert noise.low_frequency_time == noise.autocorrelation_time


def test_outliers_count_as_three_sigma_in_the_correlation(rng):
    far = smoothed_along(201, 5, rng)
    outliers = [50, 51, 120]
    far[outliers] = 60.0
    near = far.copy()
    near[outliers] = 3.0 * 1.4826 * np.median(np.abs(far))
    found, wanted = (estimate_arc_noise(values, ESTIMATED) for values in (far, near))
    assert wanted.autocorrelation_time > 2
    assert found.autocorrelation_time == pytest.approx(wanted.autocorrelation_time, rel=ROUNDING)


def test_smoothed_noise_is_isotropic_and_leaves_the_points():
    normals = fan(30)
    points = NoisyPoints(400 * normals, np.full(30, 7.0), normals)
    noisy = apply_smoothing_sensor_noise(points, normals, 0.05)
    np.testing.assert_array_equal(noisy.z, points.z)
    np.testing.assert_array_equal(noisy.deviator, 0)
    np.testing.assert_allclose(noisy.mean_variance[14:16], 0.05**2, rtol=1e-6)


def test_the_error_has_grown_by_sqrt_2_at_45_deg_either_way():
    np.testing.assert_allclose(std_factors([-45, 45]), math.sqrt(2), rtol=ROUNDING)


def test_the_error_grows_little_before_and_steeply_after():
    """The std on real spheres is constant up to 30 deg of incidence, and 3.3 times that at 60."""
    assert std_factors(30).max() < 1.02
    assert std_factors(60) == pytest.approx(3.3, rel=0.05)


def test_the_error_of_the_steepest_flanks_is_four_times_that_square_on():
    np.testing.assert_allclose(std_factors([64, 75, 90, 120]), 4.0, rtol=ROUNDING)
    assert std_factors(62).max() < 4.0


def test_two_arcs_in_a_hundred_are_wrongly_said_to_err_more_at_their_flanks():
    runs, normals = 4000, fan(100)
    draws = np.random.default_rng(6).normal(size=(runs, 100))
    share = np.mean([has_errors_growing_with_incidence(draw, normals) for draw in draws])
    assert abs(share - norm.sf(2)) < spread_of_share(norm.sf(2), runs)


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_errors_that_grow_with_incidence_are_reported_at_any_scale(scale):
    normals = fan(100)
    stds = std_factors(np.degrees(np.angle(normals / 1j)))
    draws = scale * stds * np.random.default_rng(7).normal(size=(100, 100))
    assert all(has_errors_growing_with_incidence(draw, normals) for draw in draws)


def test_errors_that_shrink_with_incidence_are_not_reported():
    normals = fan(100)
    draws = normals.imag * np.random.default_rng(8).normal(size=(100, 100))
    assert not any(has_errors_growing_with_incidence(draw, normals) for draw in draws)


def test_one_outlier_at_a_flank_is_no_growth():
    normals, draws = fan(100), np.random.default_rng(9).normal(size=(200, 100))
    draws[:, 0] = 30.0
    assert np.mean([has_errors_growing_with_incidence(draw, normals) for draw in draws]) < 0.1


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e200])
def test_residuals_of_any_size_are_compared(size):
    normals = np.exp(1j * np.linspace(0.3, 2.8, 40))
    residuals = size * np.where(np.abs(normals.real) > 0.6, 1.0, 0.1)
    assert has_errors_growing_with_incidence(residuals, normals) == (size > 0)
