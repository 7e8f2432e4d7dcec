"""What is no image, and images without a laser line."""

from pathlib import Path

import numpy as np
import pytest

from lsvision.errors import NoLaserLine
from lsvision.laser_line.extraction import LineSettings, extract_laser_line
from lsvision.laser_line.line import LaserLine
from lsvision.simulate.image_effects import StrayLight
from tests.laser_line.line_scenes import SMALL_RIG, nothing, plank, rendered

GREY = np.full((200, 300), 10, np.uint8)
COLOUR = np.stack([GREY, GREY, GREY + 1], axis=2)

NO_IMAGE = {
    "name of a file": ("photo.png", None, TypeError, r"read_image\('photo\.png'\)"),
    "path of a file": (Path("a.png"), None, TypeError, r"got 'a\.png': lsvision\.read_image"),
    "nothing": (None, None, TypeError, "got NoneType"),
    "int64": (GREY.astype(int), None, TypeError, r"got int64: .*astype\(np\.uint8\)"),
    "booleans": (GREY > 5, None, TypeError, "got bool"),
    "one row": (GREY[0], None, ValueError, r"shape \(height, width\)"),
    "four channels": (
        np.zeros((99, 99, 4), np.uint8),
        None,
        ValueError,
        r"got \(99, 99, 4\): leave .*:3",
    ),
    "channels first": (np.zeros((3, 99, 99)), None, ValueError, "np.moveaxis"),
    "many images": (np.zeros((7, 99, 98, 3)), None, ValueError, "one image at a time"),
    "tiny": (GREY[:9, :9], None, ValueError, "16 px or more"),
    "float": (GREY / 255, None, TypeError, "full_scale for a float image"),
    "NaN": (np.full((99, 99), np.nan), None, ValueError, "NaN"),
    "colour for grey": (COLOUR, None, ValueError, r'LineSettings\(channel="red"\)'),
    "grey for colour": (GREY, LineSettings(channel="red"), ValueError, 'use channel="grey"'),
}


@pytest.mark.parametrize(("image", "settings", "error", "words"), NO_IMAGE.values(), ids=NO_IMAGE)
def test_invalid_images_are_rejected(image, settings, error, words):
    with pytest.raises(error, match=words):
        extract_laser_line(image, settings)


def test_a_laser_off_image_of_another_size_is_rejected():
    with pytest.raises(ValueError, match=r"expected a laser_off frame like the image"):
        extract_laser_line(GREY, laser_off=GREY[:100])


SETTINGS = {
    "method": ({"method": "centroid"}, "expected method among derivative, gaussian, steger, got"),
    "channel": ({"channel": "infrared"}, "expected channel among"),
    "direction": ({"direction": "diagonal"}, "expected direction among"),
    "bayer": ({"bayer": "RGB", "channel": "red"}, "expected bayer among"),
    "colour of a mosaic": ({"bayer": "RGGB"}, "expected channel red, green or blue beside bayer"),
    "sigma": ({"sigma": 0.0}, "positive sigma"),
    "full_scale": ({"full_scale": -1.0}, "positive full_scale"),
    "gain": ({"gain": -0.1}, "gain >= 0"),
}


@pytest.mark.parametrize(("given", "words"), SETTINGS.values(), ids=SETTINGS)
def test_invalid_settings_are_rejected(given, words):
    with pytest.raises(ValueError, match=words):
        LineSettings(**given)


def noise(seed=0):
    image = np.random.default_rng(seed).normal(120, 20, (480, 640))
    return np.clip(image, 0, 255).astype(np.uint8)


def board(size=40):
    v, u = np.mgrid[:480, :640]
    return (60 + 150 * ((u // size + v // size) % 2)).astype(np.uint8)


def grating():
    return np.repeat((127 + 100 * np.sin(np.arange(480) / 2.0)).astype(np.uint8)[:, None], 640, 1)


WITHOUT_A_LINE = {
    "black": np.zeros((480, 640), np.uint8),
    "dark": rendered(nothing(), rig=SMALL_RIG).image,
    "noise": noise(),
    "board": board(),
    "grating": grating(),
    "edge": np.repeat(np.where(np.arange(480) < 200, 50, 200).astype(np.uint8)[:, None], 640, 1),
    "lamp": rendered(nothing(), stray=StrayLight(ambient=100, gradient=90, blobs=1)).image,
}


@pytest.mark.parametrize("image", WITHOUT_A_LINE.values(), ids=WITHOUT_A_LINE)
def test_an_image_without_a_line_raises_an_error_with_a_remedy(image):
    with pytest.raises(NoLaserLine, match=r"no laser line runs through .* px: .*laser_off frame"):
        extract_laser_line(image)


def test_an_overexposed_image_is_rejected():
    image = np.full((480, 640), 255, np.uint8)
    image[:200] = 90
    with pytest.raises(NoLaserLine, match=r"58% of the image is at its full scale of 255.*shorten"):
        extract_laser_line(image)


def test_a_line_along_the_border_is_rejected():
    image = np.roll(rendered(plank(slope=0.0), rig=SMALL_RIG).image, -159, axis=0)
    with pytest.raises(NoLaserLine, match=r"of the image's border in 100% of its columns.*move"):
        extract_laser_line(image, LineSettings(direction="columns"))


def test_a_line_of_another_colour_is_not_found():
    colours = np.zeros((320, 640, 3), np.uint8)
    colours[..., 1] = rendered(plank(), rig=SMALL_RIG).image
    assert extract_laser_line(colours, LineSettings(channel="green")).lost == 0
    with pytest.raises(NoLaserLine):
        extract_laser_line(colours, LineSettings(channel="red"))


def test_an_image_too_thin_for_the_filter_is_reported():
    with pytest.raises(NoLaserLine, match=r"17 px across .* needs 24 px .* or a smaller sigma"):
        extract_laser_line(np.full((17, 800), 10, np.uint8))


@pytest.mark.parametrize("size", [20, 31])
def test_the_smallest_size_of_a_mosaic_is_that_of_its_image(size):
    """Its planes have half the size."""
    image = np.zeros((size, 200), np.uint8)
    with pytest.raises(ValueError, match=rf"32 px or more each way, got \({size}, 200\)"):
        extract_laser_line(image, LineSettings(bayer="RGGB", channel="red"))


def test_a_laser_off_image_of_a_mosaic_is_reported_with_its_own_size():
    with pytest.raises(ValueError, match=r"like the image, \(200, 300\) .* got \(100, 300\)"):
        extract_laser_line(GREY, LineSettings(bayer="RGGB", channel="red"), laser_off=GREY[:100])


@pytest.mark.parametrize("bayer", [None, "RGGB"])
def test_a_method_that_locates_the_line_nowhere_is_an_error(bayer):
    """A window of 5 pixels has too few for a Gaussian; the filter of a mosaic has half of sigma."""
    rows = np.arange(200)[:, None]
    wave = 100 + 3 * np.sin(np.arange(300) / 50)
    size = 0.6 if bayer is None else 1.2
    image = (10 + 200 * np.exp(-0.5 * ((rows - wave) / size) ** 2)).round().astype(np.uint8)
    channel = "grey" if bayer is None else "red"
    settings = LineSettings(method="gaussian", sigma=0.9 * size, bayer=bayer, channel=channel)
    with pytest.raises(
        NoLaserLine, match=r"'gaussian' locates the line in none of .* larger sigma"
    ):
        extract_laser_line(image, settings)


def test_big_endian_images_are_images():
    """As pixels of a PGM or TIFF file come."""
    image = rendered(plank(), rig=SMALL_RIG).image.astype(np.uint16)
    line = extract_laser_line(image.astype(">u2"))
    assert line == extract_laser_line(image)


def test_a_line_with_flags_of_another_length_is_rejected():
    numbers = np.zeros(5)
    with pytest.raises(ValueError, match=r"expected saturated of shape \(5,\), got \(3,\)"):
        LaserLine(np.zeros((5, 2)), numbers, numbers, numbers, np.zeros(3), "columns", 0.0, 2.0)
    with pytest.raises(ValueError, match="expected direction 'columns' or 'rows', got 'row'"):
        LaserLine(np.zeros((5, 2)), numbers, numbers, numbers, numbers, "row", 0.0, 2.0)


@pytest.mark.parametrize("sigma", [40.0, 1e6])
def test_a_filter_wider_than_the_image_is_named(sigma):
    place = np.exp(-0.5 * ((np.arange(200)[:, None] - 100.3) / 1.5) ** 2)
    image = (10 + 90 * place * np.ones(300)).astype(np.uint8)
    with pytest.raises(NoLaserLine, match=f"needs {4 * 3 * sigma:.0f} px for a filter of sigma"):
        extract_laser_line(image, LineSettings(sigma=sigma))
