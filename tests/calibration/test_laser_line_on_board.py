import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from lsvision.calibration.bundle_adjustment import adjust_bundle
from lsvision.calibration.bundle_adjustment_problem import BundleAdjustmentState, Refinement
from lsvision.calibration.intrinsics import calibrate_camera
from lsvision.calibration.laser_line_on_board import (
    LineOnBoardSettings,
    find_laser_view,
    find_laser_views,
)
from lsvision.calibration.laser_plane import LaserPlaneSettings, calibrate_laser_plane
from lsvision.calibration.laser_plane_initial_guess import guess_board_poses
from lsvision.calibration.target import Chessboard
from lsvision.errors import CalibrationFailed, LsvisionError
from lsvision.geometry import Plane
from lsvision.laser_line.extraction import LineSettings
from lsvision.sensors.camera import Camera
from tests.calibration.boards import board_along

REAL = Path(__file__).parents[2] / "../shared/real"
SIZE = (640, 480)
MATRIX = np.array([[900.0, 0.0, 319.5], [0.0, 900.0, 239.5], [0.0, 0.0, 1.0]])
CAMERA = Camera(MATRIX, [], SIZE)
TURNED_MATRIX = np.array([[900.0, 0.0, 239.5], [0.0, 900.0, 319.5], [0.0, 0.0, 1.0]])
PLANE = Plane((0.0, np.cos(np.pi / 6), 0.5), 140.0)
TARGET = Chessboard(7, 6, 10.0)
RENDERED = 0.5  # mm: 0.05 px of the line are 0.03 mm here; six small boards extrapolate it
HELD = LaserPlaneSettings(refine_camera_from=99, fit_bow_from=99)


@cache
def board_and_line(turn, depth, distance=PLANE.distance):
    """Both images of one pose, pixel by pixel: the board's colour, and the laser's glow."""
    R, _ = cv2.Rodrigues(np.array(turn, dtype=float))
    shift = np.array([0, 0, depth]) - R @ (30.0, 25.0, 0.0)
    directions = (R[:, 0], R[:, 1], PLANE.normal)
    x, y, along_normal = board_along(R, shift, 900, (319.5, 239.5), directions)
    x, y = x - shift @ R[:, 0], y - shift @ R[:, 1]
    squares = np.floor(x / 10) + np.floor(y / 10)
    inside = (x > -10) & (x < 70) & (y > -10) & (y < 60)
    white = np.where(inside & (squares % 2 == 0), 0.25, 1.0)
    glow = np.exp(-0.5 * ((along_normal - distance) / 0.3) ** 2)
    return [
        cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA).astype(np.uint8)
        for image in (20 + 180 * white, 5 + 200 * white * glow)
    ]


POSES = [
    ((0.1, 0.4, 0.0), 270),
    ((-0.4, 0.0, 0.1), 285),
    ((0.3, -0.4, 0.0), 290),
    ((0.0, 0.0, 0.0), 275),
    ((0.4, 0.2, 0.1), 280),
    ((-0.3, 0.3, 0.0), 270),
]


@pytest.fixture(scope="module")
def images():
    pairs = [board_and_line(turn, depth) for turn, depth in POSES]
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def test_plane_of_rendered_images_is_correct(images):
    found = calibrate_laser_plane(CAMERA, TARGET, *images, HELD)
    assert found.rejected == ()
    assert np.degrees(np.arccos(min(1.0, found.plane.normal @ PLANE.normal))) < 0.2
    assert found.plane.distance == pytest.approx(PLANE.distance, abs=RENDERED)
    assert found.line_rms < 0.3


def test_a_line_that_runs_down_the_image_is_cleared_of_the_same_edges(images):
    board, line = (np.array(group[3]) for group in images)
    board[230:232, 260:380] = 120  # scratches across and along the line
    board[:, 330:332] = 120
    settings = LineOnBoardSettings(max_points=10_000)
    view = find_laser_view(CAMERA, TARGET, board, line, settings)
    turned = replace(CAMERA, size=SIZE[::-1], matrix=TURNED_MATRIX)
    turned_view = find_laser_view(turned, TARGET, np.rot90(board), np.rot90(line), settings)
    u, v = turned_view.line_pixels[::-1].T
    turned_back = np.column_stack([SIZE[0] - 1 - v, u])
    np.testing.assert_allclose(turned_back, view.line_pixels, rtol=0, atol=1e-6)


@pytest.mark.parametrize("max_points", [20, 60, 61])
def test_a_line_has_no_more_than_the_stated_number_of_points(images, max_points):
    settings = LineOnBoardSettings(max_points=max_points)
    views, _ = find_laser_views(CAMERA, TARGET, *images, settings)
    assert all(max_points / 2 <= len(view.line_pixels) <= max_points for view in views)


def mosaic_pairs(pattern="GRBG", blur=0.0):
    """Raw images of a colour camera, lit unevenly in the colours, of a red laser."""
    gains, laser = {"R": 1.0, "G": 0.7, "B": 0.5}, {"R": 1.0, "G": 0.1, "B": 0.05}
    boards, lines = [], []
    for turn, depth in POSES:
        board, line = board_and_line(turn, depth)
        board, line = (cv2.GaussianBlur(i, (0, 0), blur) if blur else i for i in (board, line))
        raw = np.empty((2, *board.shape), np.uint8)
        for place, letter in enumerate(pattern):
            at = np.s_[place // 2 :: 2, place % 2 :: 2]
            raw[0][at], raw[1][at] = gains[letter] * board[at], laser[letter] * line[at]
        boards.append(raw[0])
        lines.append(raw[1])
    return boards, lines


@pytest.mark.parametrize("pattern", ["GRBG"])
def test_raw_mosaics_are_calibrated_by_the_lasers_own_pixels(pattern):
    own = LineOnBoardSettings(extraction=LineSettings(channel="red", bayer=pattern))
    boards, lines = mosaic_pairs(pattern, blur=1.0)
    found = calibrate_laser_plane(CAMERA, TARGET, boards, lines, replace(HELD, line=own))
    assert found.rejected == ()
    assert np.degrees(np.arccos(min(1.0, found.plane.normal @ PLANE.normal))) < 0.2
    assert found.plane.distance == pytest.approx(PLANE.distance, abs=RENDERED)
    assert found.corner_rms < 0.15
    assert found.light_section.line_blur_px == pytest.approx(np.hypot(1.0, 0.27), abs=0.1)


def test_the_blur_along_the_line_is_measured_on_the_boards_edges(images):
    """Pixels of three samples and no lens: one sigma sqrt(2 / 27) = 0.27 px."""
    found = calibrate_laser_plane(CAMERA, TARGET, *images, HELD)
    assert found.light_section.line_blur_px == pytest.approx(np.sqrt(2 / 27), abs=0.05)
    blurred = [cv2.GaussianBlur(image, (0, 0), 1.0) for image in images[0]]
    found = calibrate_laser_plane(CAMERA, TARGET, blurred, images[1], HELD)
    assert found.light_section.line_blur_px == pytest.approx(np.hypot(1.0, 0.27), abs=0.05)


def test_a_board_without_edges_gives_a_warning_and_no_blur(images):
    bright = [np.where(image > 120, 255, image).astype(np.uint8) for image in images[0]]
    found = calibrate_laser_plane(CAMERA, TARGET, bright, images[1], HELD)
    assert found.light_section.line_blur_px == 0
    assert "the blur along the line is not known" in found.warnings[-1]


def test_points_on_the_edges_of_what_is_printed_in_the_squares_are_left_out(images):
    """Marks all over, as of ChArUco markers' bits; a fifth of the line's light on them."""
    v, u = np.mgrid[:480, :640]
    marks = np.where((u // 20 % 2 == 0) & (v // 14 % 2 == 0), 0.2, 1.0)
    boards, lines = images[0], [(image * marks).astype(np.uint8) for image in images[1]]
    marked = [(image * (0.7 + 0.3 * marks)).astype(np.uint8) for image in boards]
    blind = replace(HELD, line=LineOnBoardSettings(max_background_variation=9.0))
    seeing = replace(HELD, line=LineOnBoardSettings(max_background_variation=0.1))
    rms = [
        calibrate_laser_plane(CAMERA, TARGET, marked, lines, settings).line_rms
        for settings in (blind, seeing)
    ]
    assert rms[1] < 0.6 * rms[0]


BESIDE = Plane(PLANE.normal, 180.0)  # 2 to 4 squares below the pattern
POSES_BESIDE = [
    ((0.1, 0.4, 0.0), 270),
    ((0.0, 0.0, 0.0), 275),
    ((0.1, -0.4, 0.0), 282),
    ((-0.1, 0.2, 0.1), 278),
]


@pytest.fixture(scope="module")
def images_beside():
    pairs = [board_and_line(turn, depth, BESIDE.distance) for turn, depth in POSES_BESIDE]
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def test_a_line_beside_the_pattern_is_rejected_with_the_margin_that_gives_the_plane(images_beside):
    message = (
        r"no laser line within 0.9 squares .* squares beside it: set margin \(--margin\) to (\d)"
    )
    with pytest.raises(CalibrationFailed, match=message) as failure:
        calibrate_laser_plane(CAMERA, TARGET, *images_beside, HELD)
    margins = [int(number) for number in re.findall(r"--margin\) to (\d)", str(failure.value))]
    assert len(margins) == 4
    settings = replace(HELD, line=LineOnBoardSettings(margin=max(margins)))
    found = calibrate_laser_plane(CAMERA, TARGET, *images_beside, settings)
    assert len(found.views) == 4
    distance = found.plane.distance - BESIDE.distance
    assert abs(distance) < 3 * np.sqrt(found.covariance[2, 2])
    assert np.degrees(np.arccos(min(1.0, found.plane.normal @ BESIDE.normal))) < 0.5
    assert any("lies beside the pattern, within the margin" in text for text in found.warnings)


def test_a_line_on_the_pattern_gives_no_warning_of_the_margin(images):
    wide = replace(HELD, line=LineOnBoardSettings(margin=3.0))
    found = calibrate_laser_plane(CAMERA, TARGET, *images, wide)
    assert not any("beside the pattern" in text for text in found.warnings)


def test_a_reflection_on_the_pattern_is_no_line_where_a_brighter_one_is_beside_it(images_beside):
    boards = images_beside[0][1:]
    reflections = [board_and_line(turn, depth)[1] for turn, depth in POSES_BESIDE[1:]]
    lines = [
        cv2.addWeighted(line, 1.0, reflection, 0.15, 0.0)
        for line, reflection in zip(images_beside[1][1:], reflections, strict=True)
    ]
    with pytest.raises(CalibrationFailed, match=r"image 0: no laser line within 0.9 squares"):
        calibrate_laser_plane(CAMERA, TARGET, boards, lines, HELD)


def test_two_views_give_a_warning_and_three_times_the_sigma(images):
    boards, lines = [each[:2] for each in images]
    found = calibrate_laser_plane(CAMERA, TARGET, boards, lines, HELD)
    assert len(found.views) == 2
    assert found.warnings[0].startswith("two views cannot check each other")
    views, _ = find_laser_views(CAMERA, TARGET, boards, lines, HELD.line)
    guess = BundleAdjustmentState(CAMERA, PLANE, guess_board_poses(CAMERA, views), np.zeros(3))
    claimed = adjust_bundle(views, guess, Refinement(camera=False, bow=False)).plane_covariance
    np.testing.assert_allclose(found.covariance, 9 * claimed, rtol=0.05, atol=1e-12)


def test_images_without_board_or_line_are_rejected(images):
    boards, lines = [list(each) for each in images]
    boards[1] = np.full((480, 640), 200, np.uint8)
    lines[3] = np.full((480, 640), 5, np.uint8)
    found = calibrate_laser_plane(CAMERA, TARGET, boards, lines, HELD)
    assert [view.index for view in found.rejected] == [1, 3]
    assert "no chessboard of 7 x 6" in found.rejected[0].reason
    assert [view.index for view in found.views] == [0, 2, 4, 5]


def test_line_along_the_edges_of_the_squares_is_rejected_with_a_remedy(images):
    # With this clearance all of the line counts as running along an edge.
    settings = LaserPlaneSettings(line=LineOnBoardSettings(edge_clearance=0.49))
    with pytest.raises(
        CalibrationFailed, match=r"image 0, .*image 5: 0 points .* let the line cross"
    ):
        calibrate_laser_plane(CAMERA, TARGET, *images, settings)


def test_images_without_any_board_are_rejected_with_every_reason(images):
    empty = [np.full((480, 640), 200, np.uint8)] * 2
    with pytest.raises(CalibrationFailed, match=r"0 views (.|\n)*image 0: no(.|\n)*image 1: no"):
        calibrate_laser_plane(CAMERA, TARGET, empty, empty, HELD)


def test_images_of_another_size_are_rejected(images):
    boards, lines = [list(each) for each in images]
    lines[2] = lines[2][:400]
    with pytest.raises(CalibrationFailed, match="line image 2 is 640 x 400 px and the camera 640"):
        calibrate_laser_plane(CAMERA, TARGET, boards, lines, HELD)


def test_lists_of_unequal_length_are_rejected(images):
    with pytest.raises(ValueError, match="a line image for each of 6 board images, got 5"):
        calibrate_laser_plane(CAMERA, TARGET, images[0], images[1][:5], HELD)


def real_images(folder, pattern, colours):
    paths = sorted((REAL / folder).glob(pattern))
    if not paths:
        pytest.skip(f"{REAL / folder} is not here")
    return [cv2.imread(str(path), colours) for path in paths]


def test_plane_of_etna_agrees_with_the_published_one():
    images = real_images("etna/data_calib4", "*.png", cv2.IMREAD_GRAYSCALE)
    target = Chessboard(7, 6, 10.0)
    camera = calibrate_camera(images, target).camera
    # The line falls on the plate beside the pattern.
    settings = LaserPlaneSettings(line=LineOnBoardSettings(margin=8.0))
    found = calibrate_laser_plane(camera, target, images, images, settings)
    published = np.array([0.80572, -0.02855, 0.59161])
    assert np.degrees(np.arccos(min(1.0, found.plane.normal @ published))) < 0.5
    assert found.plane.distance == pytest.approx(173.782, abs=0.5)


def test_plane_of_the_green_stripe_agrees_with_the_recomputed_one():
    images = real_images("green-stripe", "*.jpg", cv2.IMREAD_COLOR)
    matrix = [[514.41205, 0, 329.83671], [0, 685.92876, 237.71471], [0, 0, 1]]
    camera = Camera(matrix, [-0.350373, 0.158447, 0.000735, -0.000231, 0], (640, 480))
    line = LineOnBoardSettings(extraction=LineSettings(channel="green"))
    settings = LaserPlaneSettings(line=line, refine_camera_from=99)
    found = calibrate_laser_plane(camera, Chessboard(6, 8, 40.0), images, images, settings)
    recomputed = np.array([0.99987, 0.01487, 0.00537])
    assert np.degrees(np.arccos(min(1.0, abs(found.plane.normal @ recomputed)))) < 0.5
    # The corners' refinement alone moves it: 39.31 mm with OpenCV's window of 11 px, 39.64 of 3.
    assert abs(found.plane.distance - 39.34) < 4 * np.sqrt(found.covariance[2, 2])
    assert found.plane.distance == pytest.approx(39.34, abs=0.5)


def test_a_line_where_the_distortion_cannot_be_inverted_is_no_line():
    camera = Camera([[300.0, 0, 320], [0, 300.0, 240], [0, 0, 1]], [-0.5, 0, 0, 0, 0], SIZE)
    image = np.full((480, 640), 10, dtype=np.uint8)
    image[20, :60] = 200
    target = Chessboard(7, 6, 5.0)
    board = np.pad(
        np.kron(np.indices((7, 8)).sum(axis=0) % 2, np.ones((8, 8))),
        8,
        "constant",
        constant_values=1,
    )
    boards = np.full((480, 640), 200, dtype=np.uint8)
    boards[: board.shape[0], : board.shape[1]] = 20 + 200 * board
    with pytest.raises(LsvisionError):
        find_laser_view(camera, target, boards, image, LineOnBoardSettings())


@pytest.mark.parametrize("margin", [60.0, 1e3])
def test_a_margin_beyond_the_horizon_of_the_board_rejects_the_pair(images, margin):
    settings = LineOnBoardSettings(margin=margin)
    _, sources = find_laser_views(CAMERA, TARGET, images[0][4:5], images[1][4:5], settings)
    assert f"margin of {margin:g} squares (--margin) reaches beyond" in sources.rejected[0].reason


@pytest.mark.parametrize(
    "numbers", [{"margin": -1.0}, {"margin": np.nan}, {"max_line_deviation_px": np.nan}]
)
def test_invalid_settings_of_the_line_are_rejected(numbers):
    with pytest.raises(ValueError, match=f"expected a finite {next(iter(numbers))} >= 0, got"):
        LineOnBoardSettings(**numbers)


def test_a_largest_deviation_of_zero_is_rejected():
    with pytest.raises(ValueError, match="expected a positive max_line_deviation_px, got 0"):
        LineOnBoardSettings(max_line_deviation_px=0.0)
