import math
import re

import cv2
import numpy as np
import pytest

from lsvision.calibration.board_pose import guess_board_pose
from lsvision.calibration.target import (
    ChArUco,
    Chessboard,
    CircleGrid,
    Target,
    TargetNotFound,
    TargetView,
    find_target,
)
from lsvision.calibration.target_files import (
    Disc,
    Rectangle,
    lay_out_target,
    render_target_pdf,
    render_target_svg,
)
from lsvision.geometry import Pose
from lsvision.laser_line.image_array import convert_to_grey

PRINTED = 0.05  # px: corners of a rendered board, seen straight on
MACHINE = 1e-9
START = 1e-3  # mm: OpenCV finds the homography in single precision
PER_MM = 6  # px

TARGETS = {
    "charuco": ChArUco(8, 6, 12.0, 9.0),
    "charuco legacy": ChArUco(8, 6, 12.0, 9.0, legacy=True),
    "charuco odd": ChArUco(7, 5, 15.0, 11.0),
    "chessboard": Chessboard(9, 6, 15.0),
    "circles": CircleGrid(4, 7, 12.0, 9.0),
    "symmetric circles": CircleGrid(7, 5, 14.0, 8.0, asymmetric=False),
}
each_target = pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS.keys())


def rasterised(page):
    image = np.full((round(page.height * PER_MM), round(page.width * PER_MM)), 255, np.uint8)
    for shape in page.shapes:
        if isinstance(shape, Disc):
            place = (round((shape.x * PER_MM - 0.5) * 64), round((shape.y * PER_MM - 0.5) * 64))
            radius = round(shape.radius * PER_MM * 64)
            cv2.circle(image, place, radius, 0, -1, cv2.LINE_AA, 6)
        else:
            rows = np.array([shape.y, shape.y + shape.height]) * PER_MM
            columns = np.array([shape.x, shape.x + shape.width]) * PER_MM
            image[slice(*rows.round().astype(int)), slice(*columns.round().astype(int))] = 0
    return image


@each_target
def test_printed_page_shows_the_target_at_true_scale(target):
    view = find_target(rasterised(lay_out_target(target)), target)
    assert len(view.points) == len(target.points)
    in_mm = (view.pixels + 0.5) / PER_MM
    shift = in_mm - view.points[:, :2]
    np.testing.assert_allclose(shift, shift.mean(axis=0) + 0 * shift, atol=PRINTED / PER_MM)


@pytest.mark.parametrize("printed", ["charuco", "charuco legacy"])
def test_a_charuco_board_of_either_pattern_is_found_without_saying_which(printed):
    image = rasterised(lay_out_target(TARGETS[printed]))
    right, other = (find_target(image, ChArUco(8, 6, 12.0, 9.0, legacy=k)) for k in (True, False))
    np.testing.assert_array_equal(right.points, other.points)
    np.testing.assert_array_equal(right.pixels, other.pixels)


def test_charuco_of_opencv_is_found_in_part():
    target = TARGETS["charuco"]
    image = cv2.copyMakeBorder(
        target.board.generateImage((800, 600)), 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255
    )
    assert len(find_target(image, target).points) == 35
    part = find_target(image[:, :500], target)
    assert 6 <= len(part.points) < 35
    shift = part.pixels / (100 / 12) - part.points[:, :2]
    np.testing.assert_allclose(shift, shift.mean(axis=0) + 0 * shift, atol=PRINTED)


@each_target
def test_error_for_an_empty_image_contains_the_target(target):
    empty = np.full((480, 640), 200, np.uint8)
    name = {"Chessboard": "chessboard", "CircleGrid": "grid", "CharucoBoard": "ChArUco"}
    words = rf"no .*{name.get(type(target).__name__, type(target).__name__)}.* 640 x 480 px: show"
    with pytest.raises(TargetNotFound, match=words):
        find_target(empty, target)


@each_target
def test_targets_implement_the_protocol(target):
    assert isinstance(target, Target)
    assert target.points.shape[1] == 3
    assert hash(target) == hash(target)


@pytest.mark.parametrize("scale", [1, 16, 257], ids=["8 bit in 16", "12 bit", "16 bit"])
def test_16_bit_and_colour_images_give_the_same_points(scale):
    target = TARGETS["chessboard"]
    grey = rasterised(lay_out_target(target))
    want = find_target(grey, target).pixels
    deep = grey.astype(np.uint16) * scale
    np.testing.assert_allclose(find_target(deep, target).pixels, want, atol=PRINTED)
    coloured = np.repeat(grey[:, :, None], 3, axis=2)
    np.testing.assert_allclose(find_target(coloured, target).pixels, want, atol=PRINTED)


@pytest.mark.parametrize(
    ("image", "error", "match"),
    [
        (np.zeros((5, 5, 4), np.uint8), ValueError, "expected image of shape"),
        (np.zeros(5, np.uint8), ValueError, "expected image of shape"),
        (np.zeros((0, 5), np.uint8), ValueError, "expected image of shape"),
        (np.zeros((50, 50)), TypeError, "uint8 or uint16, got float64"),
    ],
)
def test_invalid_images_are_rejected(image, error, match):
    with pytest.raises(error, match=match):
        convert_to_grey(image)


def test_counts_of_a_target_must_be_whole_numbers():
    with pytest.raises(TypeError, match="'float' object cannot be interpreted as an integer"):
        Chessboard(9.5, 6)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Chessboard(2, 6), "at least 3 columns and rows, got 2 x 6"),
        (lambda: Chessboard(9, 6, -1.0), "positive square in mm, got -1"),
        (lambda: ChArUco(marker=20.0), "0 < marker < square 15 mm, got 20"),
        (lambda: ChArUco(dictionary="DICT_NONE"), "dictionary of cv2.aruco, got 'DICT_NONE'"),
        (lambda: ChArUco(dictionary="CharucoBoard"), "dictionary of cv2.aruco, got 'CharucoB"),
        (lambda: ChArUco(3, 3), "at least 6 inner corners, got a ChArUco board of 3 x 3 squares"),
        (lambda: ChArUco(30, 20), "at most 100 white squares with DICT_4X4_100, got 300: a dict"),
        (lambda: CircleGrid(4, 3, asymmetric=False), "at least 15 discs, got 4 x 3"),
        (lambda: CircleGrid(5, 3), "of an asymmetric grid, at least 5, got 5 x 3"),
        (lambda: CircleGrid(diameter=50.0), "0 < diameter < 21.2132 mm, got 50"),
        (
            lambda: TargetView(np.zeros((2, 3)), np.zeros((3, 2)), (1, 1)),
            r"pixels of shape \(2, 2\), got \(3, 2\)",
        ),
        (
            lambda: TargetView(np.zeros((2, 3)), np.full((2, 2), np.nan), (1, 1)),
            "leave lost points out",
        ),
        (lambda: TargetView(np.zeros((2, 2)), np.zeros((2, 2)), (1, 1)), "board points of shape"),
    ],
)
def test_invalid_targets_are_rejected(make, match):
    with pytest.raises(ValueError, match=match):
        make()


def test_pose_of_a_board_follows_from_its_rays():
    turn, _ = cv2.Rodrigues(np.array([0.4, -0.3, 0.2]))
    truth = Pose(turn, (10.0, -20.0, 300.0))
    board = Chessboard(9, 6, 10.0).points
    seen = truth.apply(board)
    view = TargetView(board, np.zeros((54, 2)), (9, 9))
    found = guess_board_pose(view, seen / seen[:, 2:])
    np.testing.assert_allclose(found.matrix, truth.matrix, rtol=0, atol=START)


@each_target
def test_page_fits_its_sheet_with_a_ruler_of_100_mm(target):
    page = lay_out_target(target)
    assert (page.width, page.height) in [(210, 297), (297, 210)]
    bar = next(shape for shape in page.shapes if getattr(shape, "width", 0) == 100)
    for shape in page.shapes:
        right, bottom = (
            (shape.x + shape.width, shape.y + shape.height)
            if isinstance(shape, Rectangle)
            else (shape.x + shape.radius, shape.y + shape.radius)
        )
        assert min(shape.x, shape.y) >= 5
        assert right <= page.width - 5
        assert bottom <= max(bar.y + 5, page.height - 5)


def test_the_text_of_a_full_page_is_printable():
    """Letters reach 0.22 of their size, 3.5 mm, below the base line."""
    page = lay_out_target(Chessboard(6, 9, 26.3))
    assert page.height == 297
    assert page.text_position[1] + 0.22 * 3.5 <= page.height - 5


def test_svg_is_sized_in_mm_and_draws_every_shape():
    target = TARGETS["chessboard"]
    svg = render_target_svg(target)
    assert 'width="210mm" height="297mm" viewBox="0 0 210 297"' in svg
    assert svg.count("h15v15h-15z") == 35
    assert render_target_svg(TARGETS["circles"]).count('r="4.5"') == 28


def test_pdf_is_sized_in_points_and_its_table_points_at_its_objects():
    pdf = render_target_pdf(TARGETS["charuco"]).decode("latin-1")
    box = [float(value) for value in re.search(r"MediaBox \[(.*?)\]", pdf)[1].split()]
    page = lay_out_target(TARGETS["charuco"])
    np.testing.assert_allclose(np.array(box[2:]) * 25.4 / 72, (page.width, page.height), atol=1e-3)
    offsets = [int(value) for value in re.findall(r"(\d{10}) 00000 n", pdf)]
    for number, offset in enumerate(offsets, start=1):
        assert pdf[offset:].startswith(f"{number} 0 obj")
    stream = pdf.split("stream\n", 1)[1].split("\nendstream")[0]
    assert int(re.search(r"/Length (\d+)", pdf)[1]) == len(stream)
    assert pdf[int(re.search(r"startxref\n(\d+)", pdf)[1]) :].startswith("xref")


def test_unknown_targets_are_rejected_by_the_layout():
    with pytest.raises(TypeError, match="expected a ChArUco, Chessboard or CircleGrid, got 5"):
        lay_out_target(5)


def test_asymmetric_circles_lie_on_a_diagonal_grid():
    points = CircleGrid(4, 11, 15.0).points
    gaps = np.hypot(*(points[:, None, :2] - points[None, :, :2]).T)
    np.fill_diagonal(gaps, np.inf)
    np.testing.assert_allclose(gaps.min(axis=0), 15.0 * math.sqrt(2), atol=MACHINE)
