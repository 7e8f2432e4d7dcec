"""Photos in the pages of calibrations: points where they were found, arrows to the predicted."""

import base64
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from lsvision.calibration.camera_warnings import find_covered_cells
from lsvision.calibration.intrinsics import calibrate_camera
from lsvision.calibration.laser_plane import LaserPlaneSettings, calibrate_laser_plane
from lsvision.calibration.target import ChArUco, TargetView
from lsvision.draw.calibration_report import (
    ReportContent,
    compute_line_vectors,
    render_camera_page,
    render_laser_plane_page,
)
from lsvision.draw.view_photos import (
    ViewPhoto,
    combine_photos,
    compute_arrow_factor,
    render_photo_svg,
)
from lsvision.io.images import read_image

EXAMPLE = Path(__file__).parents[2] / "calibration" / "example"
NONE = np.empty((0, 2))
LENS = 0.06  # residuals are those without distortion, which scales by 3 k1 r^2 = 5.5 % at r^2 = 0.2
STORED_PX = 0.06  # the SVG keeps a tenth of a pixel


@pytest.fixture(scope="module")
def solved():
    """A camera and a laser plane from seven views, one image without a board among them."""
    names = [f"{k:02d}.jpg" for k in (0, 2, 4, 6, 8, 10, 12)]
    boards = [read_image(EXAMPLE / "boards" / f"board_{name}") for name in names]
    lines = [read_image(EXAMPLE / "lines" / f"line_{name}") for name in names]
    boards[3] = np.full_like(boards[3], 90)
    camera = calibrate_camera(boards, ChArUco())
    flat = LaserPlaneSettings(fit_bow_from=99)
    plane = calibrate_laser_plane(camera.camera, ChArUco(), boards, lines, flat)
    return camera, plane, boards, lines


def page_of(images):
    return ReportContent([], [], [f"view {k}" for k in range(len(images))], {}, images)


def test_camera_page_shows_each_photo_with_its_corners_and_arrows(solved):
    found, _, boards, _ = solved
    text = render_camera_page(found, page_of(boards))
    photos = re.findall(r"<svg[^>]*viewBox=\"-0.5.*?</figure>", text, re.DOTALL)
    assert len(photos) == 7
    assert "view 3: left out: no ChArUco board" in photos[3]
    for view in found.views:
        photo = photos[view.index]
        corners = re.search(r'<g class="corners".*?</g>', photo)[0]
        drawn = np.array(re.findall(r'cx="([^"]+)" cy="([^"]+)"', corners), dtype=float)
        np.testing.assert_allclose(drawn, view.target_view.pixels, atol=STORED_PX)
        factor = float(re.search(r"arrows ×([\d.e+]+)", photo)[1])
        shafts = re.findall(r"M([\d.-]+) ([\d.-]+)l([\d.-]+) ([\d.-]+)l", photo)
        arrows = np.array(shafts, dtype=float)
        np.testing.assert_allclose(arrows[:, 2:], view.residuals * factor, atol=STORED_PX)
    assert "Good" not in text


def heights_on_board(found, view, pixels):
    """Distances from the board of the points of the laser plane in pixels. Units: mm."""
    rays = found.light_section.camera.rays(pixels)
    on_plane = rays * (found.plane.distance / (rays @ found.plane.normal))[:, None]
    return view.camera_from_board.inverse().apply(on_plane)[:, 2]


def test_arrows_of_the_line_end_where_plane_and_board_meet(solved):
    _, found, _, _ = solved
    assert len(found.views) == 6
    for view in found.views:
        predicted = view.laser_view.line_pixels + compute_line_vectors(found, view)
        heights, seen = (
            heights_on_board(found, view, pixels)
            for pixels in (predicted, view.laser_view.line_pixels)
        )
        assert np.all(np.abs(heights) < LENS * np.abs(seen) + 1e-6)


def test_laser_page_shows_line_and_scale(solved):
    _, found, boards, lines = solved
    lit = [combine_photos(*pair) for pair in zip(boards, lines, strict=True)]
    text = render_laser_plane_page(found, ChArUco().points, page_of(lit))
    assert text.count('class="line"') == 7
    caption = re.search(r"view 0: (.*?)</figcaption>", text)[1]
    assert re.fullmatch(
        r"\d+ corners, 0\.0\d+ px rms, arrows ×[\d.]+; \d+ points of the laser line, 0\.1\d+ px "
        r"rms, arrows ×[\d.]+",
        caption,
    )


def test_scale_is_a_round_number_that_does_not_overshoot():
    residuals = [np.full((5, 2), 0.1), np.full((4, 2), 0.1)]
    assert compute_arrow_factor(residuals, 1000) == 200.0  # 30 px wanted, 0.1414 px long: 212
    assert compute_arrow_factor([np.zeros((3, 2))], 640) == 1.0
    assert compute_arrow_factor([], 640) == 1.0


def test_scale_just_below_a_power_of_ten():
    below = np.nextafter(100.0, 0.0)
    length = next(  # of an arrow whose largest magnification is rounded to this number
        length
        for length in 19.2 / below * (1 + np.arange(-9, 9) * 2.0**-53)
        if 0.03 * 640 / length == below
    )
    assert compute_arrow_factor([np.array([[length, 0.0]])], 640) == 100.0


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_photo_is_stored_small_and_in_its_place(kind):
    image = np.zeros((900, 1600, 3), dtype=kind)
    image[:, 800:] = np.iinfo(kind).max
    photo = ViewPhoto(name="a", image=image, corners=NONE, corner_residuals=NONE, line=NONE,
                      line_residuals=NONE)  # fmt: skip
    text = render_photo_svg(photo, (1.0, 1.0))
    assert 'viewBox="-0.5 -0.5 1600 900"' in text
    data = base64.b64decode(re.search(r"base64,([^\"]+)", text)[1])
    shown = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert shown.shape == (360, 640)
    assert shown[:, :300].max() < 30
    assert shown[:, 340:].min() > 225


def test_board_and_line_are_one_photo():
    board = np.full((16, 18), 80, dtype=np.uint8)
    line = np.zeros((16, 18, 3), dtype=np.uint8)
    line[3] = 255
    both = combine_photos(board, line)
    assert both[3].min() == 255
    assert both[0].max() == 80


def test_cells_of_corners_are_counted_where_they_lie():
    pixels = np.array([[0.0, 0.0], [99.0, 0.0], [50.0, 79.0]])
    cells = find_covered_cells((100, 80), [TargetView(np.zeros((3, 3)), pixels, (100, 80))])
    assert np.argwhere(cells).tolist() == [[0, 0], [0, 4], [4, 2]]
