from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares

from lsvision.calibration.board_in_plane import calibrate_board_in_plane
from lsvision.calibration.board_pose import DEFAULT_FOCAL_RATIO
from lsvision.calibration.target import Chessboard, TargetNotFound
from lsvision.errors import CalibrationFailed
from lsvision.laser_line.extraction import LineSettings
from lsvision.sensors.camera import Camera

DRILL_CORE = Path(__file__).parents[2] / "../shared/real/drill-core"
TARGET = Chessboard(7, 6, 10.0)
RENDERED = 0.03  # mm: 0.05 px of a corner at about 3 px per mm, doubled
MATRIX = np.array([[900.0, 0.0, 319.5], [0.0, 900.0, 239.5], [0.0, 0.0, 1.0]])


def photo(turn, shift=(-30.0, -25.0, 260.0)):
    """Chessboard drawn through its homography, four times too large, and shrunk."""
    R, _ = cv2.Rodrigues(np.array(turn, dtype=float))
    board = np.kron(np.indices((7, 8)).sum(axis=0) % 2, np.ones((100, 100))) * 205 + 50
    board = cv2.copyMakeBorder(board, 100, 100, 100, 100, cv2.BORDER_CONSTANT, value=255)
    # Pixel centres of the drawing, ten to the mm, with the first inner corner at 0 mm.
    to_mm = np.array([[0.1, 0, -19.95], [0, 0.1, -19.95], [0, 0, 1]])
    onto = MATRIX @ np.column_stack([R[:, :2], shift]) @ to_mm
    grow = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1.0]])
    large = cv2.warpPerspective(board, grow @ onto, (2560, 1920), borderValue=255)
    return cv2.resize(large, (640, 480), interpolation=cv2.INTER_AREA).astype(np.uint8), R


def in_board(pixels, turn, shift=(-30.0, -25.0, 260.0)):
    homography = MATRIX @ np.column_stack([turn[:, :2], shift])
    mapped = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(homography).T
    return mapped[:, :2] / mapped[:, 2:]


TURNS = {"from above": (0.7, 0.1, 0.05), "aside": (0.2, -0.6, 0.0), "facing": (0.0, 0.0, 0.0)}


@pytest.mark.parametrize("camera", [None, Camera(MATRIX, [], (640, 480))], ids=["alone", "known"])
@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS.keys())
def test_lengths_in_the_plane_are_correct(turn, camera):
    image, R = photo(turn)
    found = calibrate_board_in_plane(image, TARGET, camera)
    pixels = np.array([[250.0, 180.0], [400.0, 200.0], [300.0, 300.0], [380.0, 290.0]])
    points, truth = found.light_section.points_from_pixels(pixels), in_board(pixels, R)
    gaps = [np.linalg.norm(p[:, None] - p[None], axis=2) for p in (points, truth)]
    np.testing.assert_allclose(*gaps, rtol=0, atol=RENDERED)
    assert found.rms_px < 0.1


def test_equivalent_pinhole_camera_is_near_the_real_one():
    found = calibrate_board_in_plane(photo((0.7, 0.1, 0.05))[0], TARGET)
    matrix = found.light_section.camera.matrix
    np.testing.assert_allclose(matrix[[0, 1], [0, 1]], 900, rtol=0.1)
    assert "equivalent pinhole camera" in found.light_section.provenance["method"]


def test_light_section_of_a_board_is_unchanged_by_saving(tmp_path):
    section = calibrate_board_in_plane(photo((0.7, 0.1, 0.05))[0], TARGET).light_section
    section.save(tmp_path / "rig.json")
    loaded = type(section).load(tmp_path / "rig.json")
    pixels = [[300.0, 200.0]]
    np.testing.assert_allclose(
        loaded.points_from_pixels(pixels), section.points_from_pixels(pixels), atol=1e-9
    )


def test_image_without_board_is_rejected():
    with pytest.raises(TargetNotFound, match="no chessboard of 7 x 6"):
        calibrate_board_in_plane(np.full((480, 640), 128, np.uint8), TARGET)


def test_an_image_of_another_size_than_the_cameras_is_rejected():
    image, camera = photo((0.7, 0.1, 0.05))[0], Camera(MATRIX, [], (640, 480))
    with pytest.raises(CalibrationFailed, match="image is 320 x 240 px and the camera 640 x 480"):
        calibrate_board_in_plane(image[::2, ::2], TARGET, camera)


def circle_radius(points):
    """Geometric circle of robust least squares by scipy: no code of the library."""

    def residuals(circle):
        return np.hypot(*(points - circle[:2]).T) - circle[2]

    start = [*points.mean(axis=0), np.ptp(points[:, 0]) / 2]
    return least_squares(residuals, start, loss="soft_l1", f_scale=0.1).x[2]


def test_drill_core_has_its_diameter():
    if not DRILL_CORE.exists():
        pytest.skip(f"{DRILL_CORE} is not here")
    board = cv2.imread(str(DRILL_CORE / "checkerboard_in_laser_plane.jpg"))
    image = cv2.imread(str(DRILL_CORE / "cylinder_with_laser.jpg"))
    section = calibrate_board_in_plane(board, Chessboard(6, 6, 16.0)).light_section
    # The line is white-hot: the method that censors saturated pixels.
    profile = section.profile(image, LineSettings(channel="red", method="gaussian"))
    pixels = section.project(profile.points)
    # On the core, as seen in the photo: columns 900 to 1340, the line above row 790.
    on_core = (pixels[:, 0] > 900) & (pixels[:, 0] < 1340) & (pixels[:, 1] < 790)
    assert on_core.sum() > 400
    assert 2 * circle_radius(profile.points[on_core]) == pytest.approx(47.5, abs=0.7)


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.0, 2.0])
def test_a_board_parallel_to_the_image_leaves_the_default_focal_length(turn):
    """Which the rounding of its corners must not decide."""
    points, (c, s) = TARGET.points, (np.cos(turn), np.sin(turn))
    for scale in (2.5, 2.97, 3.1):
        target = Detected(points, scale * points[:, :2] @ [[c, s], [-s, c]] + (303.3, 251.7))
        found = calibrate_board_in_plane(np.zeros((480, 640), dtype=np.uint8), target)
        lengths = found.light_section.camera.matrix[[0, 1], [0, 1]]
        np.testing.assert_allclose(lengths, DEFAULT_FOCAL_RATIO * 640, rtol=1e-6)


class Detected:
    """Target whose points are known beforehand."""

    def __init__(self, points, pixels):
        self.points, self.pixels = points, pixels

    def find(self, image):
        return self.points, self.pixels
