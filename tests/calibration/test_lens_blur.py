"""Blur of a board's edges in images drawn by supersampling, without code of the library."""

from functools import cache

import cv2
import numpy as np
import pytest

from lsvision.calibration import lens_blur
from lsvision.calibration.lens_blur import measure_lens_blur
from lsvision.calibration.target import Chessboard, CircleGrid
from lsvision.errors import CalibrationFailed

TARGET = Chessboard(columns=7, rows=6, square=10.0)
FINE = 4  # samples along each side of a pixel
PIXEL = 1 / np.sqrt(12)  # px: one sigma of a pixel's own width
CLOSE = 0.03  # px; a Gaussian and a box are not quite a Gaussian, and corners are 0.05 px off


def board_image(blur, turn=0.15, tilt=(0.0006, -0.0004), noise=1.0, seed=0, square_px=34.0):
    """A board under a homography; `blur` = one sigma along u and v, in px."""
    image = exact_image(blur, turn, tilt, square_px)
    rng = np.random.default_rng(seed)
    return np.clip(np.round(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


@cache
def exact_image(blur, turn, tilt, square_px):
    width, height = 480, 420
    cos, sin = np.cos(turn) * square_px, np.sin(turn) * square_px
    forth = np.array([[cos, -sin, 130.0], [sin, cos, 90.0], [*np.array(tilt) * square_px, 1.0]])
    v, u = (np.mgrid[: height * FINE, : width * FINE] + 0.5) / FINE - 0.5
    x, y, w = np.tensordot(np.linalg.inv(forth), np.stack([u, v, np.ones_like(u)]), axes=1)
    x, y = x / w, y / w
    on_board = (np.abs(x - 3) < 4) & (np.abs(y - 2.5) < 3.5)
    dark = on_board & ((np.floor(x) + np.floor(y)) % 2 == 0)
    along_u, along_v = np.broadcast_to(blur, 2) * FINE
    light = cv2.GaussianBlur(np.where(dark, 40.0, 200.0), (0, 0), along_u, sigmaY=along_v)
    return light.reshape(height, FINE, width, FINE).mean(axis=(1, 3))


@pytest.mark.parametrize("blur", [0.5, 0.7, 1.0, 1.5])
def test_blur_is_that_of_the_drawn_image(blur):
    images = [board_image(blur, turn, seed=k) for k, turn in enumerate((0.05, 0.2))]
    found = measure_lens_blur(images, TARGET)
    assert found.sigma == pytest.approx(np.hypot(blur, PIXEL), abs=CLOSE)
    assert found.std < 0.01
    assert found.edges > 60


def test_no_more_edges_are_measured_than_are_needed(monkeypatch):
    images = [board_image(0.8)] * 2
    every = measure_lens_blur(images, TARGET).edges
    monkeypatch.setattr(lens_blur, "MAX_EDGES_PER_IMAGE", every // 2 - 1)
    assert measure_lens_blur(images, TARGET).edges <= every - 2


def test_each_direction_has_its_own_blur():
    image = board_image((0.6, 1.2), turn=0.02)
    along_u, along_v = (measure_lens_blur([image], TARGET, along) for along in ("u", "v"))
    assert along_u.sigma == pytest.approx(np.hypot(0.6, PIXEL), abs=CLOSE)
    assert along_v.sigma == pytest.approx(np.hypot(1.2, PIXEL), abs=CLOSE)


def test_edges_are_limited_by_their_length_in_any_direction():
    square_px = 1.25 * lens_blur.MIN_EDGE_LENGTH_PX
    image = board_image(0.6, turn=0.7, tilt=(0, 0), square_px=square_px)
    assert measure_lens_blur([image], TARGET).sigma == pytest.approx(np.hypot(0.6, PIXEL), abs=0.1)


def test_noise_increases_the_std_and_not_the_blur():
    calm, noisy = (measure_lens_blur([board_image(0.8, noise=n)], TARGET) for n in (0.5, 6.0))
    assert noisy.std > 2 * calm.std
    assert noisy.sigma == pytest.approx(calm.sigma, abs=4 * noisy.std + CLOSE)


def test_blur_does_not_depend_on_bit_depth_and_colour():
    grey = board_image(0.7)
    colour = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR).astype(np.uint16) * 257
    one, other = (measure_lens_blur([image], TARGET).sigma for image in (grey, colour))
    assert one == pytest.approx(other, abs=0.005)


@pytest.mark.parametrize(
    ("drawn", "target"),
    [
        (lambda: [np.full((300, 300), 128, np.uint8)], TARGET),
        (lambda: [board_image(0.7)], CircleGrid(columns=7, rows=5, spacing=10.0)),
        (lambda: [np.where(board_image(0.7) > 120, 255, 20).astype(np.uint8)], TARGET),
        (list, TARGET),
    ],
    ids=["no board", "circles", "overexposed", "none"],
)
def test_images_without_edges_are_rejected(drawn, target):
    with pytest.raises(CalibrationFailed, match="edges of squares are sharp enough"):
        measure_lens_blur(drawn(), target)


def test_an_unknown_axis_is_rejected():
    with pytest.raises(ValueError, match="expected along 'u' or 'v', got 'x'"):
        measure_lens_blur([board_image(0.7)], TARGET, "x")
