"""The scatter of a line's places that the noise of its pixels does not explain."""

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from lsvision.laser_line.extraction import LineSettings, extract_laser_line
from lsvision.laser_line.noise import (
    estimate_excess_variance,
    has_correlated_errors,
    measure_line_slopes,
)
from lsvision.simulate.scene import Scene
from lsvision.simulate.solids import Tube
from tests.laser_line.line_scenes import STAND_OFF, rendered

COLUMNS = np.arange(1200)
NOISE = 0.2  # px
MAD_SPREAD = 0.15  # four sigma of a median over 1200 columns that share their noise
LONG_SPREAD = 0.3  # runs of some 8 columns leave 100 independent ones, and a fifth of the size
RADIUS = 235.0  # px; a pipe of 47 mm half filling the image


def std_of(rows, std=0.01, columns=COLUMNS):
    return np.sqrt(estimate_excess_variance(columns, rows, np.full(len(rows), std)))


def test_the_excess_variance_is_that_of_white_noise_minus_the_predicted_one(rng):
    rows = 300 + rng.normal(0, NOISE, len(COLUMNS))
    assert std_of(rows) == pytest.approx(NOISE, rel=MAD_SPREAD)
    assert std_of(rows, std=0.75 * NOISE) == pytest.approx(0.66 * NOISE, rel=2 * MAD_SPREAD)
    assert (std_of(rows, std=1.5 * NOISE) == 0).all()


def test_errors_correlated_along_the_line_are_included(rng):
    """As in an enlarged photograph: neighbours differ by a hundredth of the error."""
    smooth = gaussian_filter1d(rng.normal(size=len(COLUMNS)), 5.0)
    rows = 300 + smooth * NOISE / smooth.std()
    assert std_of(rows) == pytest.approx(NOISE, rel=LONG_SPREAD)


def test_the_curve_of_a_pipe_is_not_noise():
    columns = np.arange(-200, 201)
    rows = 600 - 0.5 * np.sqrt(RADIUS**2 - columns**2)
    assert (std_of(rows, std=0.02, columns=columns + 200) == 0).all()


def test_the_excess_variance_along_columns_grows_with_the_slope(rng):
    """Half level, half at 60 deg, displaced by the same amount across itself."""
    slopes = np.where(COLUMNS < 600, 0.0, math.tan(math.radians(60)))
    rows = np.cumsum(slopes) + rng.normal(0, NOISE, len(COLUMNS)) * np.hypot(1, slopes)
    std = std_of(rows)
    assert std[:590] == pytest.approx(NOISE, rel=MAD_SPREAD)
    assert std[610:] == pytest.approx(2 * NOISE, rel=MAD_SPREAD)


def test_the_slope_beside_a_jump_is_that_of_the_line():
    rows = np.where(np.arange(60) < 30, 0.5 * np.arange(60), 200.0)
    slopes = measure_line_slopes(np.arange(60), rows)
    np.testing.assert_allclose(slopes[:30], 0.5)
    np.testing.assert_allclose(slopes[30:], 0.0)


def test_a_single_point_has_slope_zero_and_a_short_line_no_excess_variance():
    assert measure_line_slopes(np.array([7]), np.array([3.0])) == 0
    assert (std_of(np.array([3.0, 8.0, 1.0]), columns=np.arange(3)) == 0).all()
    assert std_of(np.empty(0), columns=np.empty(0, dtype=int)).shape == (0,)


@pytest.mark.parametrize("looks", [0, 5], ids=["no speckle", "speckle"])
def test_the_std_on_a_pipe_is_valid_from_crown_to_flank(looks):
    pipe = Scene((Tube.of(25.0, math.pi / 2, math.radians(20), (0.0, STAND_OFF - 25.0)),))
    scores = []
    for seed in range(3):
        seen = rendered(pipe, seed, speckle_looks=looks)
        line = extract_laser_line(seen.image)
        scores.append((line.pixels - seen.truth_pixels)[:, 1] / line.std)
    nees = np.square(scores)
    # Level to 40 deg, and the flanks to 65 deg; beyond, blur draws the line.
    for columns in (slice(560, 720), slice(476, 520), slice(760, 804)):
        assert 0.7 < np.nanmean(nees[:, columns]) < 1.4


def test_the_errors_of_a_short_line_are_not_called_correlated(rng):
    """45 columns are too few for the differences of points 6 columns apart."""
    correlated = [has_correlated_errors(COLUMNS[:45], rng.normal(size=45)) for _ in range(50)]
    assert sum(correlated) < 25  # by chance; all of them where the missing scatter counted as 0
    assert not has_correlated_errors(COLUMNS[:20], rng.normal(size=20))


def test_the_noise_of_a_float_image_does_not_depend_on_its_full_scale(rng):
    """Rounding to whole numbers is no error of an image whose largest value is 1."""
    rows = np.arange(120)[:, None]
    image = 10 + 100 * np.exp(-0.5 * ((rows - 60.25) / 1.5) ** 2) + rng.normal(0, 2, (120, 320))
    stds = [
        extract_laser_line(image / 255 * scale, LineSettings(full_scale=scale)).std
        for scale in (1.0, 255.0, 65535.0)
    ]
    np.testing.assert_allclose(stds[0], stds[1], rtol=1e-3)
    np.testing.assert_allclose(stds[2], stds[1], rtol=1e-3)
