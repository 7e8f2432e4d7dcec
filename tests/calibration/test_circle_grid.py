import cv2
import numpy as np
import pytest

from lsvision.calibration.laser_line_on_board import LineOnBoardSettings, find_laser_view
from lsvision.calibration.target import CircleGrid
from lsvision.geometry import Plane
from lsvision.sensors.camera import Camera
from tests.calibration.boards import board_along

CENTRE = 0.1  # px, rms: the centre of a disc's image is not the image of its centre
CAMERA = Camera([[1200.0, 0, 320], [0, 1200, 240], [0, 0, 1]], [], (640, 480))
PLANE = Plane((0.0, np.sqrt(0.75), 0.5), 165.0)
DISC_WINDOW = 90  # thirds of a px: half the window that holds a disc
ON_SPOT = 0.3  # px: a line of 1 px on one colour


def disc_pictures(target, turn, *, bright):
    """A board of discs, a laser line on it, and the true centres, by a pinhole of its own."""
    R, _ = cv2.Rodrigues(np.array(turn, dtype=float))
    shift = np.array([0, 0, 330.0]) - R @ target.points.mean(axis=0)
    directions = (R[:, 0], R[:, 1], PLANE.normal)
    x, y, along_normal = board_along(R, shift, 1200, (320, 240), directions)
    x, y = x - shift @ R[:, 0], y - shift @ R[:, 1]
    centres = target.points @ R.T + shift
    pixels = centres[:, :2] / centres[:, 2:] * 1200 + (320, 240)
    disc = np.zeros(x.shape, dtype=bool)
    for (centre_x, centre_y, _), pixel in zip(target.points, pixels, strict=True):
        left, top = np.maximum(3 * np.round(pixel).astype(int) - DISC_WINDOW, 0)
        near = np.s_[top : top + 2 * DISC_WINDOW, left : left + 2 * DISC_WINDOW]
        disc[near] |= np.hypot(x[near] - centre_x, y[near] - centre_y) < target.diameter / 2
    white = np.where(disc == bright, 1.0, 0.1)
    glow = white * np.exp(-0.5 * ((along_normal - PLANE.distance) / 0.25) ** 2)
    images = [
        cv2.GaussianBlur(cv2.resize(each, (640, 480), interpolation=cv2.INTER_AREA), (0, 0), 0.8)
        for each in (white, glow)
    ]
    noise = np.random.default_rng(1).normal(0, 2, (2, 480, 640))
    board, line = (np.clip(10 + 200 * np.array(images) + noise, 0, 255)).astype(np.uint8)
    return board, line, pixels


@pytest.mark.parametrize("bright", [False, True], ids=["black on white", "white on black"])
@pytest.mark.parametrize("spin", [0.3, 2.0, 4.4])
def test_asymmetric_grids_are_numbered_alike_in_every_turn(spin, bright):
    target = CircleGrid(4, 11, 9.0, 6.0)
    board, _, truth = disc_pictures(target, (0.2, -0.25, spin), bright=bright)
    _, pixels = target.find(board)
    assert np.sqrt(np.mean((pixels - truth) ** 2)) < CENTRE


@pytest.mark.parametrize("bright", [False, True], ids=["black on white", "white on black"])
@pytest.mark.parametrize("spin", [0.3, 1.2, 3.0, 4.4])
def test_symmetric_grids_are_numbered_as_one_reads(spin, bright):
    target = CircleGrid(7, 5, 9.0, 6.0, asymmetric=False)
    board, _, truth = disc_pictures(target, (0.2, -0.25, spin), bright=bright)
    _, pixels = target.find(board)
    expected = truth if np.cos(spin) > 0 else truth[::-1]
    assert np.sqrt(np.mean((pixels - expected) ** 2)) < CENTRE
    # The rows point to the right, or nearly so.
    assert pixels[6, 0] > pixels[0, 0] or abs(np.cos(spin)) < 0.5


def test_an_even_number_of_rows_of_an_asymmetric_grid_is_rejected():
    with pytest.raises(ValueError, match=r"odd number of rows .* got 11 x 4: count the discs"):
        CircleGrid(11, 4)


@pytest.mark.parametrize("bright", [False, True], ids=["black on white", "white on black"])
def test_the_line_is_left_out_at_the_edges_of_discs_only(bright):
    target = CircleGrid(7, 5, 12.0, 8.0, asymmetric=False)
    board, line, truth = disc_pictures(target, (0.1, 0.2, 0.4), bright=bright)
    view = find_laser_view(CAMERA, target, board, line, LineOnBoardSettings(min_points=40))
    rays = CAMERA.rays(view.line_pixels)
    R, _ = cv2.Rodrigues(np.array((0.1, 0.2, 0.4)))
    shift = np.array([0, 0, 330.0]) - R @ target.points.mean(axis=0)
    on_board = (rays * (R[:, 2] @ shift / (rays @ R[:, 2]))[:, None] - shift) @ R[:, :2]
    distance = np.linalg.norm(on_board[:, None] - target.points[:, :2], axis=2).min(axis=1)
    assert (np.abs(distance - 4.0) > 1.5).all()
    assert (distance < 2.5).any()
    assert (distance > 5.5).any()
    assert len(truth) == 35
