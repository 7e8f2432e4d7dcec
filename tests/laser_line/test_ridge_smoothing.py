"""Steger's ridge on curves: its smoothing along the line must not move it inwards."""

import numpy as np
import pytest

from lsvision.laser_line.extraction import LineSettings, extract_laser_line
from lsvision.laser_line.ridge_smoothing import correct_ridge_smoothing
from lsvision.laser_line.stripe_windows import Stripes

CENTRE = np.array([200.3, 260.6])


def draw_arch(radius, height=200.0, noise=1.0, seed=0):
    """An image of the upper part of a circle (radius in px) with a Gaussian section."""
    rows, columns = np.mgrid[:240, :400]
    distances = np.hypot(columns - CENTRE[0], rows - CENTRE[1]) - radius
    light = height * np.exp(-0.5 * (distances / 1.2) ** 2) * (rows < CENTRE[1] - 0.6 * radius)
    image = 10 + light + np.random.default_rng(seed).normal(0, noise, light.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def find_radii(line, radius):
    """Distances from the centre of the points that are no more than 40 deg from the top."""
    from_centre = line.pixels - CENTRE
    middle = np.abs(from_centre[:, 0]) < 0.64 * radius
    radii = np.hypot(*from_centre[middle].T)
    return radii[np.isfinite(radii)]


@pytest.mark.parametrize("radius", [60.0, 90.0, 150.0])
@pytest.mark.parametrize("sigma", [1.5, 2.0, 3.0])
def test_the_ridge_of_a_circle_is_not_shifted_inwards(radius, sigma):
    settings = LineSettings(method="steger", sigma=sigma, direction="columns")
    line = extract_laser_line(draw_arch(radius), settings)
    shift = sigma**2 / (2 * radius)  # without correction: 0.008 to 0.075 px
    assert abs(find_radii(line, radius).mean() - radius) < 0.15 * shift + 0.001


def test_the_std_contains_the_uncertainty_of_the_correction():
    columns = np.arange(60.0)
    rows = 20 + 0.01 * (columns - 30) ** 2
    ones = np.ones(60)
    ridge = Stripes(np.column_stack([columns, rows]), 1e-6 * ones, ones, ones, ones)
    corrected = correct_ridge_smoothing(np.arange(60), ridge, 2.0)
    shift = 0.02 * 4 / (2 * (1 + (0.02 * (columns - 30)) ** 2))
    np.testing.assert_allclose(corrected.pixels[:, 1], rows - shift, atol=1e-9)
    np.testing.assert_allclose(corrected.std, 0.3 * shift, atol=1e-5)


def test_runs_of_few_points_are_returned_as_they_are():
    columns, ones = np.arange(10.0), np.ones(10)
    ridge = Stripes(np.column_stack([columns, columns**2 / 20]), ones, ones, ones, ones)
    assert (correct_ridge_smoothing(np.arange(10), ridge, 2.0).pixels == ridge.pixels).all()
