from pathlib import Path

import cv2
import numpy as np
import pytest

from lsvision.calibration.chessboard_corners import detect_initial_corners, locate_corners
from lsvision.calibration.chessboard_numbering import find_corner_order
from lsvision.calibration.intrinsics import calibrate_camera
from lsvision.calibration.target import Chessboard, find_target
from tests.calibration.boards import chessboard_picture, photographed

CASES = Path(__file__).parents[2] / "../shared/cases/calibration"
TURNS = [(0.3, -0.4, 0.1), (-0.45, 0.2, 2.5), (0.1, 0.5, -1.2)]
LIGHT = 0.015  # px: light that changes by half along the board is no plane in its middle


def rms(errors):
    return float(np.sqrt(np.mean(np.square(errors))))


@pytest.mark.parametrize(
    ("blur", "bright", "square", "reach"),
    [
        (0.7, 200, 12.0, 0.02),
        (0.7, 200, 5.0, 0.035),
        (2.5, 60, 12.0, 0.05),
        (4.0, 60, 12.0, 0.05),
        (1.2, 50, 5.0, 0.06),
    ],
    ids=["sharp", "small", "soft and dim", "very soft", "small and dim"],
)
@pytest.mark.parametrize("turn", TURNS[:2])
def test_corners_are_found_to_a_fraction_of_a_pixel(turn, blur, bright, square, reach):
    white, truth = chessboard_picture(turn, square=square, blur=blur)
    image = photographed(white, np.random.default_rng(11), bright=bright)
    view = find_target(image, Chessboard(9, 6, square))
    assert len(view.pixels) == 54
    assert rms(view.pixels - truth) < reach + LIGHT


def test_a_start_with_wrong_corners_ends_at_the_right_ones():
    white, truth = chessboard_picture(TURNS[0], blur=2.0)
    rng = np.random.default_rng(12)
    start = truth + rng.uniform(-3, 3, truth.shape)
    start[:8] += (0.0, 38.0)  # a row that a laser line has captured
    corners, kept = locate_corners(photographed(white, rng), start.reshape(6, 9, 2))
    assert kept.all()
    assert rms(corners.reshape(-1, 2) - truth) < 0.05


def test_two_equal_initial_corners_are_separated():
    white, truth = chessboard_picture(TURNS[0], blur=2.0)
    start = truth.reshape(6, 9, 2).copy()
    start[2, 3] = start[2, 2]
    corners, inliers = locate_corners(photographed(white, np.random.default_rng(13)), start)
    assert inliers.all()
    assert rms(corners.reshape(-1, 2) - truth) < 0.05


def laser_across(truth, first, last, width):
    """Light of a line through two true corners, (480, 640), saturated in its middle."""
    (x1, y1), (x2, y2) = truth[[first, last]]
    v, u = np.mgrid[:480, :640]
    distance = ((u - x1) * (y2 - y1) - (v - y1) * (x2 - x1)) / np.hypot(x2 - x1, y2 - y1)
    return 600 * np.exp(-0.5 * (distance / width) ** 2)


def test_corners_under_a_laser_line_are_left_out_and_the_others_are_right():
    white, truth = chessboard_picture(TURNS[0])
    line = laser_across(truth, 19, 24, 4.0)
    image = photographed(white, np.random.default_rng(13), laser=line)
    view = find_target(image, Chessboard(9, 6, 12.0))
    index = np.round(view.points[:, :2] @ (1, 9) / 12).astype(int)
    assert 45 <= len(index) < 54
    assert not {19, 20, 21, 22, 23, 24} & set(index.tolist())
    assert np.abs(view.pixels - truth[index]).max() < 0.3


def test_corners_that_are_left_out_are_reported():
    rng, images = np.random.default_rng(14), []
    for turn in TURNS:
        white, truth = chessboard_picture(turn)
        images.append(photographed(white, rng))
    images[2] = photographed(white, rng, laser=laser_across(truth, 19, 24, 4.0))
    found = calibrate_camera(images, Chessboard(9, 6, 12.0))
    warnings = [text for text in found.warnings if "left out" in text]
    assert len(warnings) == 1
    assert warnings[0].startswith("image 2: ")
    assert "of 54 corners left out, off the grid of the others: a laser line" in warnings[0]


@pytest.mark.parametrize("step", [0.0, 10.0], ids=["one point", "one line"])
def test_initial_corners_without_a_homography_are_rejected(step):
    initial = np.full((6, 7, 2), 50.0)
    initial[..., 0] += step * np.arange(7)
    assert locate_corners(np.zeros((240, 320), dtype=np.uint8), initial) is None


def test_points_that_are_no_grid_are_rejected():
    white, truth = chessboard_picture(TURNS[0])
    wrong = np.random.default_rng(15).permutation(truth).reshape(6, 9, 2)
    assert locate_corners(photographed(white, np.random.default_rng(16)), wrong) is None


@pytest.mark.parametrize("spin", np.radians([40, 170, 300]))
@pytest.mark.parametrize("counts", [(9, 6), (4, 7)], ids=str)
def test_the_first_corner_is_the_same_in_every_turn_and_for_every_finder(spin, counts):
    white, truth = chessboard_picture((0.1, -0.2, spin), counts=counts, square=9.0)
    image = photographed(white, np.random.default_rng(17))
    seen = list(detect_initial_corners(image, *counts))
    assert len(seen) >= 2
    for corners in seen:
        first = corners.reshape(-1, 2)[find_corner_order(image, corners)[0, 0]]
        assert np.linalg.norm(first - truth[0]) < 3


@pytest.mark.parametrize("counts", [(7, 5), (7, 7), (6, 6)], ids=str)
def test_a_board_that_a_half_turn_does_not_change_is_numbered_from_the_left(counts):
    """Of 7 x 7, two corners of the board are black: no quarter turn, but a half turn is open."""
    for spin in np.radians([20, 200]):
        white, truth = chessboard_picture((0.1, -0.2, spin), counts=counts, square=9.0)
        view = find_target(photographed(white, np.random.default_rng(18)), Chessboard(*counts, 9.0))
        ends = truth[[0, -1]] if spin < 2 else truth[[-1, 0]]
        np.testing.assert_allclose(view.pixels[[0, -1]], ends, rtol=0, atol=0.3)


@pytest.mark.parametrize(
    ("name", "reach"),
    [
        ("soft_board_640_a", 0.4),
        ("soft_board_640_b", 0.2),
        ("soft_board_640_c", 0.2),
        ("soft_board_1280_a", 0.4),
    ],
)
def test_real_soft_boards_lie_on_a_homography(name, reach):
    image = cv2.imread(str(CASES / f"{name}.png"), cv2.IMREAD_GRAYSCALE)
    if image is None:
        pytest.skip(f"{CASES} is not here")
    view = find_target(image, Chessboard(9, 6, 5.0))
    homography, _ = cv2.findHomography(view.points[:, :2].copy(), view.pixels.copy())
    mapped = np.column_stack([view.points[:, :2], np.ones(len(view.points))]) @ homography.T
    errors = mapped[:, :2] / mapped[:, 2:] - view.pixels
    assert len(errors) == 54
    assert np.sqrt(2) * rms(errors) < reach
