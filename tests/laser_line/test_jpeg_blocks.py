"""Laser lines in images that were once JPEG images, and in images that never were."""

import math

import cv2
import numpy as np
import pytest

from lsvision.laser_line.detection import find_line
from lsvision.laser_line.extraction import LineSettings, extract_laser_line
from lsvision.laser_line.jpeg_blocks import STANDARD_STEPS
from lsvision.laser_line.line_image import prepare_line_image
from tests.bench.images import radius_near, random_picture
from tests.laser_line.other_pictures import photograph
from tests.laser_line.test_colour import COLOURS, errors

QUALITIES = (60, 75, 85, 90, 95)
COLUMNS = 400
MARGIN = 8  # columns at the ends


def straight_line(rng, slope=0.03, width=1.5, height=150.0, noise=2.0, full_scale=255):
    """Image of a straight line with read and shot noise, before it is rounded, and its rows."""
    rows, columns = np.arange(160 + int(COLUMNS * slope))[:, None], np.arange(COLUMNS)
    truth = 80 + rng.uniform(-8, 8) + slope * columns
    section = (rows - truth) / (width * math.hypot(1, slope))
    mean = (10 + height * np.exp(-0.5 * section**2)) * full_scale / 255
    std = full_scale / 255 * noise * np.sqrt(1 + mean / full_scale)
    return np.clip(mean + std * rng.normal(size=mean.shape), 0, full_scale), truth


def compressed(image, quality, *flags):
    image = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality, *flags])[1]
    return cv2.imdecode(content, cv2.IMREAD_UNCHANGED)


def cropped(image, row, column):
    return np.ascontiguousarray(image[row:, column:])


def blocks_of(image, **settings):
    settings = LineSettings(**settings)
    line_image = prepare_line_image(image, None, settings.channel, settings.full_scale)
    return find_line(line_image, settings).blocks


def scores(line, truth):
    """Errors over stds of the points but for the ends, and of mean and slope of a line fit."""
    columns = np.arange(len(truth))[MARGIN:-MARGIN]
    std = line.std[MARGIN:-MARGIN]
    points = (line.pixels[MARGIN:-MARGIN, 1] - truth[MARGIN:-MARGIN]) / std
    design = np.stack([np.ones(len(columns)), columns - columns.mean()], axis=1) / std[:, None]
    covariance = np.linalg.inv(design.T @ design)
    return points, covariance @ design.T @ points / np.sqrt(covariance.diagonal())


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("quality", QUALITIES)
@pytest.mark.parametrize("slope", [0.004, 0.05, 0.4])
def test_a_straight_line_and_a_fit_to_it_have_valid_stds(quality, slope):
    of_points, of_fits = [], []
    for width, height in ((1.0, 180.0), (1.6, 60.0), (3.0, 120.0)):
        for seed in range(3):
            rng = np.random.default_rng([quality, seed, round(10 * width)])
            image, truth = straight_line(rng, slope, width, height)
            row, column = rng.integers(0, 8, 2)
            line = extract_laser_line(
                cropped(compressed(image, quality), row, column), LineSettings(direction="columns")
            )
            points, fit = scores(line, truth[column:] - row)
            of_points.append(points[np.isfinite(points)])
            of_fits.append(fit)
    # Along the rows of pixels all blocks have one error, for which the fit needs larger stds.
    assert 0.35 < rms(np.concatenate(of_points)) < 1.25
    assert 0.5 < rms(of_fits) < 1.5


@pytest.mark.parametrize("method", ["gaussian", "steger"])
def test_the_other_methods_have_valid_stds(method):
    ratios = []
    for quality in (75, 90):
        image, truth = straight_line(np.random.default_rng(quality), 0.05)
        line = extract_laser_line(compressed(image, quality), LineSettings(method=method))
        found = np.isfinite(line.std)
        columns, rows = line.pixels[found].T
        ratios.append((rows - np.interp(columns, np.arange(len(truth)), truth)) / line.std[found])
    assert 0.35 < rms(np.concatenate(ratios)) < 1.25


@pytest.fixture(scope="module")
def tubes():
    """Places of two tubes, and their light."""
    places = [
        random_picture(np.random.default_rng([7, k]), roll=roll, sheet=sheet)
        for k, (roll, sheet) in enumerate(((0.0, 0.15), (20.0, 0.25)))
    ]
    return [(place, place.light()) for place in places]


def test_radii_of_tubes_have_valid_stds(tubes):
    ratios = []
    for k, (place, light) in enumerate(tubes):
        for quality in QUALITIES:
            for peak in (180.0, 90.0):
                image = photograph(light, np.random.default_rng([k, quality]), peak)
                section = place.light_section(place.blur)
                radius = radius_near(section, compressed(image, quality), place.centre[0])
                assert radius is not None
                ratios.append((radius[0] - place.radius) / radius[1])
    assert rms(ratios) < 1.4
    assert np.abs(ratios).max() < 3.0


@pytest.mark.parametrize("laser", COLOURS)
def test_a_coloured_line_along_the_rows_is_located_in_the_luminance(tubes, laser):
    """Halved colours are smooth there, and wrong by several times their roughness."""
    place, light = tubes[0]
    for quality, sampling in (
        (75, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420),
        (90, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420),
        (85, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422),
        (75, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
    ):
        rng = np.random.default_rng(quality)
        image = np.stack(
            [photograph(part * light, rng, peak=150.0, dark=60.0) for part in COLOURS[laser]],
            axis=2,
        )
        image = compressed(image, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling)
        line = extract_laser_line(image, LineSettings(channel=laser))
        found, std = errors(line, place)
        assert 0.2 < rms(found / std) < 1.5


@pytest.mark.parametrize("quality", QUALITIES)
def test_grid_and_steps_are_those_of_the_file(quality):
    image = compressed(straight_line(np.random.default_rng(quality), 0.3)[0], quality)
    scale = 5000 / quality if quality < 50 else 200 - 2 * quality
    steps = np.maximum((STANDARD_STEPS * scale + 50) // 100, 1)
    for row, column in ((0, 0), (3, 6), (7, 1)):
        blocks = blocks_of(cropped(image, row, column), direction="columns")
        assert (blocks.row, blocks.column) == (-row % 8, -column % 8)
        # The table is not quite symmetrical, as `STANDARD_STEPS` is.
        np.testing.assert_allclose(blocks.steps[:4, :4], steps[:4, :4], rtol=0.2, atol=1.0)
    upright = extract_laser_line(np.ascontiguousarray(image.T))
    level = extract_laser_line(image)
    assert upright.direction == "rows"
    np.testing.assert_allclose(upright.std, level.std, rtol=0.05)


def test_saturated_and_dark_blocks_do_not_hide_the_grid():
    for dark, height in ((-4.0, 150.0), (0.0, 600.0)):
        image, _ = straight_line(np.random.default_rng(3), height=height)
        assert blocks_of(compressed(image - 10 + dark, 80)) is not None


NEVER_COMPRESSED = {
    "8 bit": lambda image: image,
    "smoothed": lambda image: cv2.GaussianBlur(image, (0, 0), 1.5),
    "median": lambda image: cv2.medianBlur(image, 5),
    "bilateral": lambda image: cv2.bilateralFilter(image, 7, 20, 3),
    "enlarged twice": lambda image: cv2.resize(image, None, fx=2, fy=2),
    "enlarged 4 times": lambda image: cv2.resize(image[40:120, :120], None, fx=4, fy=4),
    "pixels repeated": lambda image: image[40:120, :120].repeat(4, axis=0).repeat(4, axis=1),
    "blocks of 8": lambda image: image[55:110, :60].repeat(8, axis=0).repeat(8, axis=1),
    "reduced": lambda image: cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA),
    "saturated": lambda image: np.clip(4.0 * image, 0, 255).astype(np.uint8),
    "brighter": lambda image: np.rint(255 * (image / 255) ** 0.5).astype(np.uint8),
    "16 levels": lambda image: image // 16 * 16,
    "8 levels": lambda image: image // 32 * 32,
    "two levels": lambda image: np.where(image > 90, 255, 0).astype(np.uint8),
    "in the upper bits": lambda image: image.astype(np.uint16) << 8,
}


@pytest.mark.parametrize("change", NEVER_COMPRESSED.values(), ids=NEVER_COMPRESSED)
def test_images_that_were_never_compressed_are_not_taken_for_jpeg(change):
    for slope in (0.0, 0.03, 0.5):
        for noise in (0.0, 0.5, 2.0):
            rng = np.random.default_rng([round(100 * slope), round(10 * noise)])
            width = rng.uniform(0.7, 2.5)
            image = np.rint(straight_line(rng, slope, width, 180, noise)[0]).astype(np.uint8)
            assert blocks_of(change(image), direction="columns") is None


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_deep_images_are_not_taken_for_jpeg(bits):
    for noise in (0.0, 1.0):
        full_scale = 2**bits - 1
        image, _ = straight_line(np.random.default_rng(bits), noise=noise, full_scale=full_scale)
        assert blocks_of(np.rint(image).astype(np.uint16)) is None
        assert blocks_of(image.astype(np.float32), full_scale=float(full_scale)) is None


def test_a_line_of_few_columns_is_extracted():
    image, truth = straight_line(np.random.default_rng(5), 0.1)
    image = compressed(image, 80)[:, :40]
    line = extract_laser_line(np.ascontiguousarray(image), LineSettings(direction="columns"))
    assert rms(((line.pixels[:, 1] - truth[:40]) / line.std)[2:-2]) < 1.6


def test_a_float_image_that_was_a_jpeg_image_has_the_same_stds(rng):
    image = compressed(straight_line(rng)[0], 75)
    of_bytes = extract_laser_line(image)
    of_floats = extract_laser_line(image / 255, LineSettings(full_scale=1.0))
    assert blocks_of(image / 255, full_scale=1.0) is not None
    np.testing.assert_allclose(of_floats.std, of_bytes.std, rtol=1e-3)
