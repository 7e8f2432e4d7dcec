"""What was found in an image, drawn into it where it lies."""

from pathlib import Path

import numpy as np
import pytest

from lsvision.draw import draw_laser_line, draw_overlay, figure_bytes
from lsvision.draw.panel import colour_of
from lsvision.io.images import read_image
from lsvision.measure import Measurement, measure_cylinders
from lsvision.sensors.light_section import LightSection

IMAGES = Path(__file__).parents[2] / "fixtures" / "images"
WITHIN = 1.0
"""px between a drawn ellipse and the bright line it was fitted to: their noise is 0.13 px."""
BLUE_BGR = (200, 30, 10)


@pytest.fixture(scope="module")
def pair():
    image, rig = read_image(IMAGES / "pair.png"), LightSection.load(IMAGES / "rig.json")
    profile = rig.profile(image)
    return image, rig, profile, measure_cylinders(profile)


@pytest.fixture(scope="module")
def figure(pair):
    return draw_overlay(*pair, title="pair.png")


def outlines(figure, colour):
    return [
        line.get_xydata() for line in figure.axes[0].lines
        if line.get_color() == colour and line.get_linestyle() == "-"
    ]  # fmt: skip


@pytest.mark.parametrize("number", [1, 2])
def test_an_ellipse_is_drawn_over_the_light_it_was_found_by(pair, figure, number):
    image, *_, measurement = pair
    (outline,) = outlines(figure, colour_of(number))
    for index in measurement.cylinders[number - 1].indices[10:-10:10]:
        u = int(index)
        brightest = np.average(np.arange(len(image)), weights=(image[:, u] > 60) * image[:, u])
        assert np.hypot(*(outline - (u, brightest)).T).min() < WITHIN


def test_the_photo_is_whole_and_in_pixels(pair, figure):
    height, width = pair[0].shape
    assert figure.axes[0].axis() == (-0.5, width - 0.5, height - 0.5, -0.5)
    assert figure.axes[0].get_xlabel() == "u / px"
    assert "mm" in figure.axes[1].get_xlabel()


def test_the_verdict_stands_above_and_the_numbers_beside(figure):
    assert figure.get_suptitle().startswith("pair.png: 2 cylinders")
    words = "\n".join(text.get_text() for part in figure.subfigs for text in part.texts)
    assert "r = 16." in words
    assert "Refused arcs" in words


def test_an_image_without_a_cylinder_is_drawn_all_the_same(pair):
    image, rig, profile, _ = pair
    empty = draw_overlay(image, rig, profile, Measurement((), ()))
    assert empty.get_suptitle() == "no cylinder"
    assert figure_bytes(empty, "png").startswith(b"\x89PNG")


def test_colours_and_deep_images_are_shown_as_they_are(pair):
    image, *found = pair
    colour = np.empty((*image.shape, 3), np.uint8)
    colour[:] = BLUE_BGR
    shown = draw_overlay(colour, *found).axes[0].images[0].get_array()
    assert tuple(shown[0, 0]) == BLUE_BGR[::-1]
    deep = draw_overlay(image.astype(np.uint16) * 16, *found).axes[0].images[0].get_array()
    assert (deep.dtype, int(deep.max())) == (np.uint8, 255)


def test_inputs_are_left_alone(pair):
    image = pair[0].copy()
    draw_overlay(*pair)
    np.testing.assert_array_equal(pair[0], image)


def test_a_laser_line_is_drawn_on_its_image(pair):
    image, rig, *_ = pair
    line = rig.line(image)
    figure = draw_laser_line(image, line, title="pair.png")
    drawn = figure.axes[0].lines[0].get_xydata()
    np.testing.assert_array_equal(drawn, line.pixels)
    assert figure.get_suptitle().startswith("pair.png: 800 columns, 7 lost, std 0.13 px")
    assert [axes.get_ylabel().split(" /")[0] for axes in figure.axes[1:]] == [
        "std",
        "width",
        "brightness",
    ]
