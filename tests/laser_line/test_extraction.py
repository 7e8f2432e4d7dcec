"""The extracted line against the truth of the simulator."""

import math
import tracemalloc
from functools import cache

import cv2
import numpy as np
import pytest
from scipy.optimize import curve_fit

from lsvision.laser_line import gaussian_fit
from lsvision.laser_line.extraction import LineSettings, extract_laser_line
from lsvision.laser_line.line_image import prepare_line_image
from lsvision.laser_line.noise import estimate_pixel_noise
from lsvision.laser_line.path_search import PathSettings
from lsvision.laser_line.stripe_windows import HALF_WIDTH_SIGMAS, cut_windows
from lsvision.simulate.image_effects import ImageSensor, StrayLight
from tests.laser_line.line_scenes import CLUTTER, SMALL_RIG, pipe_on_floor, plank, rendered
from tests.tolerances import ROUNDING

FALSE = 3.0  # px: another thing than the line
GOALS = {200: 0.016, 100: 0.022, 50: 0.034, 25: 0.055, 12: 0.10}  # DN: px
BIAS = 0.003 * 3  # px: the goal, tested on a third of the goal's points
VALID = (0.7, 1.4)  # NEES / dof
GREY = LineSettings(direction="columns")
MAX_MEMORY = 4.0  # bytes per pixel: the response, 2, the excess of a colour, and less than 1 beside


@cache
def plank_image(**settings):
    """The plank as `rendered`; not to be written to."""
    return rendered(plank(), **settings)


@cache
def cluttered(seed):
    """A pipe on a floor, with speckle, glints, blobs and streaks."""
    return rendered(pipe_on_floor(), seed, speckle_looks=4, stray=CLUTTER)


def errors_of(line, image):
    return line.pixels[:, 1] - image.truth_pixels[:, 1]


def rms(errors):
    return float(np.sqrt(np.nanmean(errors**2)))


def nees(errors, line):
    return float(np.nanmean((errors / line.std) ** 2))


@pytest.mark.parametrize("method", ["derivative", "gaussian"])
@pytest.mark.parametrize("peak", GOALS)
def test_the_error_meets_the_goal_and_the_std_predicts_it(peak, method):
    image = plank_image(peak=peak)
    line = extract_laser_line(image.image, LineSettings(method=method))
    errors = errors_of(line, image)
    assert line.lost == 0
    assert rms(errors) <= GOALS[peak]
    assert abs(errors.mean()) <= BIAS
    assert VALID[0] <= nees(errors, line) <= VALID[1]


@pytest.mark.parametrize(
    ("method", "goal"), [("derivative", 0.035), ("gaussian", 0.013)], ids=["default", "precise"]
)
def test_an_overexposed_line_is_measured_by_its_flanks(method, goal):
    image = plank_image(peak=400)
    line = extract_laser_line(image.image, LineSettings(method=method))
    assert line.saturated.all()
    assert rms(errors_of(line, image)) <= goal


def test_the_std_includes_speckle():
    image = plank_image(speckle_looks=4)
    line = extract_laser_line(image.image)
    errors = errors_of(line, image)
    assert rms(errors) <= 0.30
    assert VALID[0] <= nees(errors, line) <= VALID[1]


@pytest.mark.parametrize(("peak", "noise"), [(60, 4.0), (150, 3.0)])
def test_the_std_of_a_fit_holds_where_a_line_is_narrower_than_two_pixels(peak, noise, rng):
    rows, truth = np.arange(60.0)[:, None], 30 + 0.01 * np.arange(1000.0)
    light = np.exp(-0.5 * ((rows - truth) / 0.5) ** 2)
    image = np.clip(10 + peak * light + rng.normal(0, noise, light.shape), 0, 255)
    line = extract_laser_line(image.round().astype(np.uint8), LineSettings(method="gaussian"))
    errors = (line.pixels[:, 1] - truth) / line.std
    assert np.isfinite(errors).mean() > 0.95
    assert np.sqrt(np.nanmean(errors**2)) < 1.2
    assert np.nanmax(np.abs(errors)) < 6


@pytest.mark.parametrize("sheet_sigma", [0.06, 0.12, 0.3])
@pytest.mark.parametrize("exposure", [2.0, 7.0])
def test_the_std_of_an_overexposed_line_contains_its_sampling(sheet_sigma, exposure):
    # The narrower the line, the steeper are the flanks, and the larger is the error.
    simulated = plank_image(sheet_sigma=sheet_sigma, psf_sigma=0.4, peak=255 * exposure)
    line = extract_laser_line(simulated.image)
    errors = (line.pixels - simulated.truth_pixels)[line.saturated, 1]
    assert np.sqrt(np.mean((errors / line.std[line.saturated]) ** 2)) < 2.2


@pytest.mark.parametrize("method", ["derivative", "gaussian"])
@pytest.mark.parametrize("bits", [8, 16])
def test_the_section_of_an_overexposed_line_is_found_at_any_depth_of_pixels(bits, method, rng):
    # The steps of the fit were damped by a number in DN: in 16 bit its height was 0.7 of the true.
    rows, unit = np.arange(80.0)[:, None], 2 ** (bits - 8)
    mean = unit * (10 + 1000 * np.exp(-0.5 * ((rows - 40.2) / 2.5) ** 2) * np.ones(200))
    noise = rng.normal(0, unit, mean.shape)
    image = np.clip(np.rint(mean + noise), 0, 2**bits - 1).astype(f"uint{bits}")
    line = extract_laser_line(image, LineSettings(method=method))
    assert line.saturated.all()
    assert np.median(line.intensity) == pytest.approx(1000 * unit, rel=0.03)
    assert np.median(line.width) == pytest.approx(2.5, rel=0.01)
    assert rms(line.pixels[:, 1] - 40.2) < 0.02


def test_an_overexposed_line_has_no_columns_far_beyond_the_std_of_their_fit():
    truth, errors = 30 + 0.02 * np.arange(1500.0), []
    mean = 10 + 600 * np.exp(-0.5 * ((np.arange(90.0)[:, None] - truth) / 1.5) ** 2)
    for seed in range(8):
        noise = np.random.default_rng(seed).normal(0, np.sqrt(4 + 0.5 * mean))
        image = np.clip(mean + noise, 0, 255).round().astype(np.uint8)
        line = extract_laser_line(image, LineSettings(method="gaussian"))
        errors.append((line.pixels[:, 1] - truth) / line.std)
    assert np.isfinite(errors).mean() > 0.99
    assert np.nanmean(np.power(errors, 4)) < 6  # 3 for normal errors


@pytest.mark.parametrize("usual_iterations", [3, gaussian_fit.USUAL_ITERATIONS])
def test_fits_that_end_early_because_no_gaussian_fits_change_nothing(usual_iterations, monkeypatch):
    # In speckle the clipped stripes are no Gaussians, and their fits take the most steps.
    image, steps, change = cluttered(1).image, [], gaussian_fit._change_logarithm

    def counted(parameters, step):
        steps.append(len(step))
        return change(parameters, step)

    monkeypatch.setattr(gaussian_fit, "_change_logarithm", counted)
    monkeypatch.setattr(gaussian_fit, "USUAL_ITERATIONS", usual_iterations)
    line, taken = extract_laser_line(image), len(steps)
    monkeypatch.setattr(gaussian_fit, "USUAL_ITERATIONS", gaussian_fit.GAUSS_NEWTON_ITERATIONS)
    assert extract_laser_line(image) == line
    assert line.saturated.any()
    assert usual_iterations <= taken <= gaussian_fit.GAUSS_NEWTON_ITERATIONS
    if usual_iterations == gaussian_fit.USUAL_ITERATIONS:
        assert taken == usual_iterations
    assert len(steps) - taken == gaussian_fit.GAUSS_NEWTON_ITERATIONS


@pytest.mark.parametrize("peak", [180, 400, 1200])
def test_the_fit_is_the_weighted_least_squares_fit_to_the_unsaturated_pixels(peak, rng):
    rows, position = np.arange(80.0), 40.3
    mean = 10 + peak * np.exp(-0.5 * ((rows[:, None] - position) / 1.8) ** 2) * np.ones(60)
    image = np.clip(np.rint(mean + rng.normal(0, 2, mean.shape)), 0, 255).astype(np.uint8)
    settings = LineSettings(method="gaussian", read_noise=2.0, gain=0.0)
    line = extract_laser_line(image, settings)
    half_width = math.ceil(HALF_WIDTH_SIGMAS * line.filter_sigma)
    for column in range(0, 60, 7):
        k = np.arange(40 - half_width, 41 + half_width)
        k = k[image[k, column] < 255]
        fit = curve_fit(
            lambda x, a, m, q, b: a * np.exp(-0.5 * ((x - m) / q) ** 2) + b,
            k,
            image[k, column],
            (peak, position, 1.8, 10),
            sigma=np.full(len(k), 2.0),
            absolute_sigma=True,
        )
        assert line.pixels[column, 1] == pytest.approx(fit[0][1], abs=1e-3)
        assert line.width[column] == pytest.approx(fit[0][2], abs=3e-3)


@pytest.mark.parametrize("noise", [0.0, 3.0])
@pytest.mark.parametrize("full_scale", [255, 65535])
@pytest.mark.parametrize("method", ["derivative", "gaussian"])
def test_the_std_of_a_bar_without_flanks_is_that_of_its_ends(method, full_scale, noise, rng):
    # No pixel between full scale and the background: a Gaussian fits nothing (stated: 7 px).
    columns = np.arange(400)
    truth = 100 + 0.05 * columns - 8 * np.sin(columns / 60)
    bar = np.abs(np.arange(200)[:, None] - truth) <= 3.5
    image = full_scale * (bar + noise / 255 * rng.normal(size=bar.shape))
    image = np.clip(np.rint(image), 0, full_scale).astype(f"uint{full_scale.bit_length()}")
    line = extract_laser_line(image, LineSettings(method=method))
    error = rms(line.pixels[:, 1] - truth)
    assert error < 0.32
    assert error < np.nanmedian(line.std) < 1.3 * error
    assert np.nanmax(line.std) < 0.5


@pytest.mark.parametrize(("halo", "fitted"), [(0.0, True), (0.15, False)])
def test_an_overexposed_line_with_a_halo_is_not_located_by_a_gaussian(halo, fitted, rng):
    x = np.arange(80.0)[:, None] - 40.2 - 0.02 * np.arange(600)
    section = (1 - halo) * np.exp(-0.5 * (x / 1.5) ** 2) + halo / 3 * np.exp(-0.5 * (x / 4.5) ** 2)
    mean = 10 + 750 * section
    noise = rng.normal(size=mean.shape) * np.sqrt(2 + 0.03 * mean)
    line = extract_laser_line(np.clip(np.rint(mean + noise), 0, 255).astype(np.uint8))
    assert np.mean(np.isfinite(line.skew_shift) == fitted) > 0.95


def test_the_noise_of_an_overexposed_image_is_that_of_its_other_pixels(rng):
    # Pixels at full scale do not scatter: they made the noise of all others 4 times too small.
    rows, truth = np.arange(80.0)[:, None], 40.2 + 0.02 * np.arange(1200)
    mean = 10 + 700 * np.exp(-0.5 * ((rows - truth) / 1.5) ** 2)
    noisy = mean + rng.normal(size=mean.shape) * np.sqrt(2 + 0.05 * mean)
    image = prepare_line_image(np.clip(np.rint(noisy), 0, 255).astype(np.uint8), None, "grey", None)
    windows = cut_windows(image, image.signal, np.arange(1200), truth, 2.0)
    noise = estimate_pixel_noise(image, windows, 1 / 12)
    assert noise.gain == pytest.approx(0.05, rel=0.3)
    assert noise.compute_variances(np.array([30.0])) == pytest.approx(3.5, rel=0.25)


def test_noise_given_by_the_settings_is_used():
    image = plank_image(sensor=ImageSensor(prnu=0.0))
    gain = 255 / 10_000
    given = LineSettings(read_noise=13 * gain, gain=gain)
    by_hand, by_image = (
        extract_laser_line(image.image, settings) for settings in (given, LineSettings())
    )
    np.testing.assert_allclose(by_hand.std, by_image.std, rtol=0.15, atol=0)


@pytest.mark.parametrize("degrees", [0, 20, 40, 70])
@pytest.mark.parametrize(("method", "goal"), [("derivative", 0.02), ("steger", 0.01)])
def test_a_slanted_line_is_measured_across_itself(degrees, method, goal, rng):
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    v, u = np.mgrid[:400, :500]
    stripe = 150 * np.exp(-0.5 * (((v - 200.3) * cos - (u - 250) * sin) / 1.5) ** 2)
    image = np.clip(np.rint(10 + stripe + rng.normal(0, 1.5, u.shape)), 0, 255).astype(np.uint8)
    line = extract_laser_line(image, LineSettings(method=method))
    assert line.direction == ("columns" if degrees < 45 else "rows")
    assert rms((line.pixels[:, 1] - 200.3) * cos - (line.pixels[:, 0] - 250) * sin) <= goal
    assert np.nanmedian(line.std) <= 1.4 * goal  # along the column or row: up to 1 / cos 45


def test_the_std_of_ridge_points_is_along_their_column(rng):
    """A line of the same section has errors along v that grow with 1 / cos(slope)."""
    settings = LineSettings(method="steger", direction="columns", read_noise=1.5, gain=0.0)

    def std_of_line(slope):
        v, u = np.mgrid[:400, :500]
        distance = (v - 200.3 - slope * (u - 250)) / np.hypot(1, slope)
        stripe = 150 * np.exp(-0.5 * (distance / 1.5) ** 2)
        image = np.rint(10 + stripe + rng.normal(0, 1.5, u.shape)).astype(np.uint8)
        return float(np.nanmedian(extract_laser_line(image, settings).std))

    assert std_of_line(0.9) == pytest.approx(std_of_line(0.0) * np.hypot(1, 0.9), rel=0.05)


def test_intensity_and_width_are_those_of_the_stripe():
    image = plank_image(peak=100, sheet_sigma=0.25)
    line = extract_laser_line(image.image)
    assert np.median(line.intensity) == pytest.approx(100, rel=0.05)
    assert np.median(line.width) == pytest.approx(2.25, abs=0.1)


def test_width_and_intensity_hold_where_the_tails_reach_beyond_the_window():
    v, u = np.mgrid[:200, :400]
    sigma = 1.5 + 3 * (u / 400) ** 3  # 1.5 to 4.5 px
    image = 10 + 150 * np.exp(-0.5 * ((v - 100.3 - 0.01 * u) / sigma) ** 2)
    line = extract_laser_line(image, LineSettings(full_scale=255.0, read_noise=1.0, gain=0.02))
    assert line.filter_sigma == 2.0
    columns = line.pixels[:, 0]
    np.testing.assert_allclose(line.width, 1.5 + 3 * (columns / 400) ** 3, rtol=0.02)
    np.testing.assert_allclose(line.intensity, 150, rtol=0.02)


@pytest.mark.parametrize("subtract", [False, True], ids=["one frame", "laser-off frame"])
def test_glints_blobs_and_streaks_are_not_the_line(subtract):
    false = []
    for seed in range(3):
        image = cluttered(50 + seed)
        off = image.laser_off if subtract else None
        errors = errors_of(extract_laser_line(image.image, laser_off=off), image)
        false.append((np.abs(errors) > FALSE).mean())
    assert np.mean(false) <= (0.002 if subtract else 0.04)


def test_a_brighter_shorter_line_is_not_extracted_but_reported():
    image = rendered(plank(slope=0.0), peak=80)
    ghost = image.image.copy()
    ghost[300:303, 200:900] = 250
    line = extract_laser_line(ghost)
    assert np.abs(errors_of(line, image)).max() < FALSE
    assert line.second_line_fraction == pytest.approx(700 / 1280, abs=0.02)
    assert extract_laser_line(image.image).second_line_fraction == 0


def test_hidden_columns_are_lost_and_stay_in_place():
    image = plank_image().image.copy()
    image[:, 500:600] = 10
    line = extract_laser_line(image)
    assert len(line) == 1280
    assert np.isnan(line.pixels[505:595]).all()
    assert np.isfinite(line.std[:495]).all()
    assert np.isfinite(line.std[605:]).all()


def test_a_step_is_followed():
    image = rendered(pipe_on_floor())
    errors = errors_of(extract_laser_line(image.image), image)
    assert np.isfinite(errors).mean() > 0.98
    assert (np.abs(errors) > FALSE).sum() <= 3


def test_a_transposed_image_gives_the_transposed_line():
    image = rendered(pipe_on_floor(), peak=100).image
    level, upright = extract_laser_line(image), extract_laser_line(np.ascontiguousarray(image.T))
    assert (level.direction, upright.direction) == ("columns", "rows")
    np.testing.assert_allclose(upright.pixels, level.pixels[:, ::-1], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(upright.std, level.std, rtol=ROUNDING, atol=0)


@pytest.mark.parametrize("method", ["derivative", "gaussian", "steger"])
def test_a_mirrored_image_gives_the_mirrored_line(method):
    image = plank_image(peak=100).image
    settings = LineSettings(method=method, direction="columns")
    line, mirrored = (extract_laser_line(view, settings) for view in (image, image[::-1]))
    np.testing.assert_allclose(mirrored.pixels[:, 1], 1023 - line.pixels[:, 1], rtol=0, atol=1e-4)


def test_a_line_shifted_by_whole_pixels_is_the_same_line():
    image = plank_image(peak=100).image
    line, moved = (extract_laser_line(view, GREY) for view in (image, np.roll(image, 40, axis=0)))
    np.testing.assert_allclose(moved.pixels[:, 1], line.pixels[:, 1] + 40, rtol=0, atol=1e-9)


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_images_of_more_bits_give_the_line_of_the_8_bit_image(bits):
    scale = (2**bits - 1) / 255
    sensor, stray = ImageSensor(bits=bits), StrayLight(ambient=10 * scale)
    image = plank_image(sensor=sensor, stray=stray, peak=200 * scale)
    full_scale = None if bits == 12 else 2**bits - 1
    line = extract_laser_line(image.image, LineSettings(full_scale=full_scale))
    assert rms(errors_of(line, image)) <= GOALS[200]


def test_a_float_image_gives_the_line_of_the_integer_image():
    image = plank_image().image
    whole = extract_laser_line(image, GREY)
    share = extract_laser_line(image / 255.0, LineSettings(direction="columns", full_scale=1.0))
    np.testing.assert_allclose(share.pixels, whole.pixels, rtol=0, atol=1e-4)


@pytest.mark.parametrize(("channel", "index"), [("blue", 0), ("green", 1), ("red", 2)])
def test_a_coloured_line_is_found_among_brighter_white_ones(channel, index):
    image = rendered(plank(slope=0.01), peak=80)
    colours = np.zeros((1024, 1280, 3), np.uint8)
    cv2.line(colours, (0, 900), (1279, 820), (220, 220, 220), 3)
    colours[..., index] = np.maximum(colours[..., index], image.image)
    line = extract_laser_line(colours, LineSettings(channel=channel))
    assert np.nanmax(np.abs(errors_of(line, image))) < 0.5


def test_a_white_line_and_a_grey_image_with_three_channels_give_the_grey_line():
    image = plank_image(rig=SMALL_RIG).image
    stored = np.repeat(image[:, :, None], 3, axis=2)
    grey = extract_laser_line(image)
    for channel in ("grey", "white"):
        same = extract_laser_line(stored, LineSettings(channel=channel))
        np.testing.assert_allclose(same.pixels, grey.pixels, rtol=0, atol=1e-6)


def test_a_wide_line_widens_the_filter():
    image = plank_image(rig=SMALL_RIG, sheet_sigma=1.2, psf_sigma=2.0, peak=500)
    line = extract_laser_line(image.image)
    assert np.median(line.width) > 5
    assert rms(errors_of(line, image)) < 0.15


def test_the_image_is_not_changed():
    image = plank_image(rig=SMALL_RIG).image
    before = image.copy()
    extract_laser_line(image, laser_off=np.zeros_like(image))
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("kind", ["grey", "upright", "coloured"])
def test_an_extraction_takes_little_memory(kind):
    image = rendered(pipe_on_floor()).image
    settings = LineSettings(channel="red" if kind == "coloured" else "grey")
    if kind == "upright":
        image = np.ascontiguousarray(image.T)
    if kind == "coloured":
        image = np.stack([image // 10, image // 10, image], axis=2)
    extract_laser_line(image, settings)
    tracemalloc.start()
    extract_laser_line(image, settings)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak <= MAX_MEMORY * image.shape[0] * image.shape[1]


@pytest.mark.filterwarnings("error")
def test_the_narrowest_filters_overflow_nowhere():
    image = plank_image(sheet_sigma=0.02).image
    line = extract_laser_line(image, LineSettings(sigma=0.01))
    assert np.isfinite(line.std).sum() + line.lost == len(line)


@pytest.mark.parametrize(("empty_column_cost", "fraction"), [(0.95, 0.0), (2.0, 25 / 300)])
def test_a_short_second_line_counts_where_it_outweighs_a_segment(empty_column_cost, fraction):
    """25 columns save 24 by default, and 50 at the higher cost; a segment costs 30."""
    rows = np.arange(200)[:, None]
    image = 10 + 200 * np.exp(-0.5 * ((rows - 60.2) / 1.5) ** 2) * np.ones(300)
    image[:, 100:125] += 200 * np.exp(-0.5 * ((rows - 140.2) / 1.5) ** 2)
    path = PathSettings(empty_column_cost=empty_column_cost)
    line = extract_laser_line(image.round().astype(np.uint8), LineSettings(path=path))
    assert line.second_line_fraction == pytest.approx(fraction)
