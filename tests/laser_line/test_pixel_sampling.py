"""Thin lines, whose light each pixel integrates: against a renderer that shares no code."""

import math

import numpy as np
import pytest
from scipy.special import erf

from lsvision.laser_line.extraction import LineSettings, extract_laser_line
from lsvision.laser_line.gaussian_fit import locate_by_gaussian_fit
from lsvision.laser_line.pixel_sampling import correct_pixel_sampling, correct_ridge_sampling
from lsvision.laser_line.stripe_windows import Windows
from lsvision.laser_line.subpixel import locate_by_derivative

COLUMNS = 900
METHODS = ("derivative", "gaussian", "steger")
LEVEL, SLANTED = 0.004, 0.03
"""Slopes: from one pixel to the next in 250 columns, and in 33."""


def draw_line(sigma, slope, *, peak=200.0, filled=1.0, seed=1):
    """An image of a straight line with a Gaussian section (sigma in px), and its true rows.

    Pixels integrate the light over a part `filled` of their height.
    """
    columns = np.arange(COLUMNS)
    truth = 30 + slope * columns
    part = np.arange(-3, 4)[:, None] / 7  # of a column
    from_line = np.arange(truth.max() + 30)[:, None, None] - (truth + slope * part)
    scale = math.sqrt(2) * sigma
    light = erf((from_line + filled / 2) / scale) - erf((from_line - filled / 2) / scale)
    light = light.mean(axis=1)
    mean = 10 + peak * light / light.max()
    noise = np.random.default_rng(seed).normal(size=mean.shape) * np.sqrt(1.7 + 0.02 * mean)
    return np.clip(np.rint(mean + noise), 0, 255).astype(np.uint8), truth


def find_errors(image, truth, method="derivative"):
    """Errors along v, their predicted stds, and the true rows."""
    line = extract_laser_line(image, LineSettings(method=method, direction="columns"))
    u, v = line.pixels.T
    rows = np.interp(u, np.arange(len(truth)), truth)
    located = np.isfinite(v)
    assert located.mean() > 0.97
    return (v - rows)[located], line.std[located], rows[located]


def measure_locking(errors, rows):
    """Amplitude of the errors' wave from pixel to pixel. Units: px."""
    return abs(2 * np.mean(errors * np.exp(2j * np.pi * rows)))


@pytest.mark.parametrize("sigma", [0.3, 0.4, 0.5, 0.6])
@pytest.mark.parametrize("slope", [LEVEL, SLANTED])
@pytest.mark.parametrize("method", METHODS)
def test_the_std_of_a_thin_line_holds(method, slope, sigma):
    errors, std, _ = find_errors(*draw_line(sigma, slope), method)
    assert 0.35 < np.mean((errors / std) ** 2) < 1.5


@pytest.mark.parametrize("sigma", [0.3, 0.4, 0.5])
@pytest.mark.parametrize("method", ["derivative", "steger"])
def test_a_thin_line_is_not_drawn_to_the_centres_of_pixels(method, sigma):
    errors, _, rows = find_errors(*draw_line(sigma, SLANTED), method)
    assert measure_locking(errors, rows) < 0.006  # without correction 0.065, 0.021, 0.005


@pytest.mark.parametrize("sigma", [0.4, 0.5])
@pytest.mark.parametrize("peak", [30.0, 80.0])
def test_the_noise_of_a_faint_thin_line_does_not_enlarge_the_correction(peak, sigma):
    errors, std, _ = find_errors(*draw_line(sigma, SLANTED, peak=peak))
    assert 0.7 < np.mean((errors / std) ** 2) < 1.3


@pytest.mark.parametrize("filled", [0.02, 0.5, 0.8])
@pytest.mark.parametrize("sigma", [0.4, 0.5, 0.6])
def test_the_std_holds_for_pixels_that_are_sensitive_in_a_part_of_their_height(sigma, filled):
    errors, std, _ = find_errors(*draw_line(sigma, SLANTED, filled=filled))
    assert 0.5 < np.mean((errors / std) ** 2) < 2.0


@pytest.mark.parametrize("sigma", [0.1, 0.2])
def test_a_line_far_thinner_than_a_pixel_is_not_stated_more_precisely_than_it_is(sigma):
    # Without the correction, the mean squared normalised errors are 59 and 33.
    errors, std, _ = find_errors(*draw_line(sigma, SLANTED))
    assert np.mean((errors / std) ** 2) < 4


@pytest.mark.parametrize("sigma", [0.3, 0.4, 0.5, 0.6])
@pytest.mark.parametrize("exposure", [1.6, 2.4, 6.0])
@pytest.mark.parametrize("method", METHODS)
def test_the_std_of_an_overexposed_thin_line_holds(method, exposure, sigma):
    errors, std, _ = find_errors(*draw_line(sigma, SLANTED, peak=255 * exposure), method)
    assert np.mean((errors / std) ** 2) < 2.2


@pytest.mark.parametrize("sigma", [0.8, 1.2, 3.0])
def test_a_wide_line_is_returned_as_it_is(sigma):
    windows, stripes = locate(sigma, 2.0)
    assert correct_pixel_sampling(windows, stripes, 2.0) is stripes
    assert correct_ridge_sampling(windows, stripes, 2.0) is stripes


@pytest.mark.parametrize("filter_sigma", [0.01, 0.3, 0.6])
def test_a_filter_narrower_than_a_pixel_is_not_corrected(filter_sigma):
    windows, stripes = locate(0.4, 2.0)
    assert correct_pixel_sampling(windows, stripes, filter_sigma) is stripes


@pytest.mark.parametrize("filter_sigma", [1.0, 1.4, 2.0, 3.3])
@pytest.mark.parametrize("sigma", [0.4, 0.5, 0.64])
def test_the_correction_without_noise_is_that_of_the_true_section(sigma, filter_sigma):
    windows, stripes = locate(sigma, filter_sigma)
    corrected = correct_pixel_sampling(windows, stripes, filter_sigma)
    truth = 0.01 * np.arange(len(windows.columns))
    assert np.abs(corrected.pixels[:, 1] - truth).max() < 0.008  # second harmonic of the shift
    assert (corrected.std > 0).all()


def test_the_std_of_a_fit_contains_its_sampling():
    windows, start = locate(0.4, 2.0)
    fits = locate_by_gaussian_fit(windows, start, np.full(windows.values.shape, 1e-6))
    errors = fits.pixels[:, 1] - 0.01 * np.arange(len(windows.columns))
    assert 0.3 < np.mean((errors / fits.std) ** 2) < 1.5


def locate(sigma, filter_sigma):
    """Windows and stripes of a line without noise whose row increases by 0.01 px per column."""
    rows = 0.01 * np.arange(200)
    half_width = math.ceil(3.5 * filter_sigma)
    offsets, centres = np.arange(-half_width, half_width + 1), np.rint(rows).astype(int)
    edges = np.arange(-half_width, half_width + 2) - 0.5 + (centres - rows)[:, None]
    values = 50 * np.diff(erf(edges / (math.sqrt(2) * sigma)), axis=1)
    saturated = np.zeros(values.shape, dtype=bool)
    windows = Windows(np.arange(200), centres, offsets, values, saturated)
    variances = np.full(values.shape, 1e-6)
    return windows, locate_by_derivative(windows, rows, variances, filter_sigma)
