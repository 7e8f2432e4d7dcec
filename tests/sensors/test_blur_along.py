"""Blur along the line draws it; taking that back, against an image blurred by OpenCV."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lsvision.laser_line.extraction import extract_laser_line
from lsvision.sensors.line_blur import SLOPE_WINDOW, correct_line_blur

BLUR = 0.8  # px
FADE = 160.0  # px
MIDDLE = slice(40, -40)
U = np.arange(400.0)
FLANK = 60 + (U - 20) ** 2 / 1200  # steeper and darker to the right
BRIGHTNESS = 200 * np.exp(-U / FADE)


def blurred_line(place=FLANK, brightness=BRIGHTNESS, blur=BLUR):
    """Noise-free image of a line, blurred along u alone, where it does harm."""
    rows = np.arange(240.0)[:, None]
    sharp = 5 + brightness * np.exp(-0.5 * ((rows - place) / 1.6) ** 2)
    return cv2.GaussianBlur(sharp, (0, 0), sigmaX=blur, sigmaY=1e-3)


def errors(line, place=FLANK):
    across = 1 if line.direction == "columns" else 0
    return (line.pixels[:, across] - place)[MIDDLE]


@pytest.mark.parametrize("turned", [False, True], ids=["columns", "rows"])
def test_the_known_blur_is_taken_back(turned):
    image = blurred_line().astype(np.float32)
    image = (100 * (image.T if turned else image)).round().astype(np.uint16)
    line = extract_laser_line(image)
    before, after = errors(line), errors(correct_line_blur(line, BLUR))
    assert abs(before.mean()) > 4 * abs(after.mean())


def test_the_pull_is_as_the_formula_says():
    line = extract_laser_line((100 * blurred_line()).round().astype(np.uint16))
    slope, bend, fall = (U - 20) / 600, 1 / 600, -1 / FADE
    expected = (BLUR**2 * (slope * fall + bend / 2))[MIDDLE]
    np.testing.assert_allclose(errors(line), expected, rtol=0, atol=2e-3)
    np.testing.assert_allclose(errors(correct_line_blur(line, BLUR)), 0, rtol=0, atol=2e-3)


def test_without_blur_nothing_moves():
    line = extract_laser_line(blurred_line().round().astype(np.uint8))
    np.testing.assert_array_equal(correct_line_blur(line, 0.0).pixels, line.pixels)


def test_all_but_the_places_stays_and_gaps_stay_gaps():
    image = blurred_line()
    image[:, 200:230] = 5
    line = extract_laser_line(image.round().astype(np.uint8))
    moved = correct_line_blur(line, BLUR)
    np.testing.assert_array_equal(np.isnan(moved.pixels), np.isnan(line.pixels))
    np.testing.assert_array_equal(moved.pixels[:, 0], line.pixels[:, 0])
    np.testing.assert_array_equal(moved.std, line.std)


def test_stretches_shorter_than_the_window_stay():
    line = extract_laser_line(blurred_line().round().astype(np.uint8))
    pixels = line.pixels.copy()
    pixels[:: SLOPE_WINDOW - 1] = np.nan
    pieces = replace(line, pixels=pixels)
    np.testing.assert_array_equal(correct_line_blur(pieces, BLUR).pixels, pixels)
