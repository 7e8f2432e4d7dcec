"""Laser lines on other people's photographs (../shared/real, never copied)."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from lsvision.errors import NoLaserLine
from lsvision.laser_line.extraction import LineSettings, extract_laser_line

REAL = Path(__file__).parents[2] / "../shared/real"
pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="real data not on this machine")

STRAIGHT = 1.0  # px: boards are flat; lens distortion over half a board is a parabola


def image_of(name):
    return cv2.imread(str(REAL / name))


def off_parabola(pixels):
    """Distances along u from the parabola u(v) through most of the points."""
    u, v = pixels[np.isfinite(pixels[:, 0])].T
    keep = np.ones(len(u), dtype=bool)
    for _ in range(5):
        off = u - np.polyval(np.polyfit(v[keep], u[keep], 2), v)
        keep = np.abs(off) < max(3 * 1.4826 * np.median(np.abs(off)), 0.5)
    return np.abs(off)


@pytest.mark.parametrize("number", range(6))
def test_the_green_stripe_on_a_board_is_found(number):
    image = image_of(f"green-stripe/{number}_right.jpg")
    line = extract_laser_line(image, LineSettings(channel="green"))
    assert line.direction == "rows"
    on_board = line.pixels[130:300]
    assert np.isfinite(on_board[:, 0]).mean() > 0.97
    assert np.median(off_parabola(on_board)) < 0.3 * STRAIGHT


@pytest.mark.parametrize("name", ["data_calib3/frame0001", "data_calib3/frame0009",
                                  "data_calib4/frame0001", "data_calib4/frame0003"])  # fmt: skip
def test_the_overexposed_white_stripe_of_etna_is_found(name):
    line = extract_laser_line(image_of(f"etna/{name}.png"), LineSettings(channel="white"))
    assert line.direction == "rows"
    middle = line.pixels[150:850]
    assert np.isfinite(middle[:, 0]).mean() > 0.99
    assert np.median(off_parabola(middle)) < STRAIGHT  # black squares pull the rest


def test_the_red_line_on_the_drill_core_is_an_arc():
    image = image_of("drill-core/cylinder_with_laser.jpg")
    line = extract_laser_line(image, LineSettings(channel="red"))
    assert line.direction == "columns"
    u, v = line.pixels[960:1300].T
    found = np.isfinite(v)
    assert found.mean() > 0.95
    off = v[found] - np.polyval(np.polyfit(u[found], v[found], 4), u[found])
    assert np.median(np.abs(off)) < STRAIGHT
    assert v[found].min() < 670
    assert v[found].max() > 700


@pytest.mark.parametrize("name", ["left01", "left05", "left12", "right02", "right07", "right12"])
def test_daylight_has_no_laser_line(name):
    with pytest.raises(NoLaserLine, match="darken the room"):
        extract_laser_line(image_of(f"opencv-samples/{name}.jpg"))


def test_the_drill_core_has_no_green_line():
    image = image_of("drill-core/cylinder_with_laser.jpg")
    with pytest.raises(NoLaserLine):
        extract_laser_line(image, LineSettings(channel="green"))
