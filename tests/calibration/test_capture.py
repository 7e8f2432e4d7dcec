"""Pairs taken from a stream: the frames decide, and what is missing is printed."""

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lsvision.calibration.capture_pairs import (
    CaptureSettings,
    CaptureState,
    advance_state,
    list_missing_views,
    measure_movement,
)
from lsvision.calibration.target import ChArUco, Chessboard, TargetView
from lsvision.io.images import read_image

EXAMPLE = Path(__file__).parents[2] / "calibration" / "example"
TARGET, SETTINGS = ChArUco(), CaptureSettings()
SEE, HOLD, LASER, NEW = "no board", "seen: hold it still", "laser on", "as in an earlier pair"


def shot(kind, number):
    return read_image(EXAMPLE / f"{kind}s" / f"{kind}_{number:02d}.jpg")


def lit():
    """The board with the laser line bright enough to be seen in daylight."""
    line = np.minimum(shot("line", 0).astype(int) * 8, 255).astype(np.uint8)
    return np.maximum(frame("board"), line)


def moved(dx):
    board = frame("board")
    return cv2.warpAffine(board, np.array([[1.0, 0, dx], [0, 1, 0]]), board.shape[1::-1],
                          borderMode=cv2.BORDER_REPLICATE)  # fmt: skip


FRAMES = {
    "board": lambda: shot("board", 0),
    "line": lambda: shot("line", 0),
    "other board": lambda: shot("board", 1),
    "other line": lambda: shot("line", 1),
    "empty": lambda: np.full_like(frame("board"), 90),
    "dark": lambda: np.full_like(frame("board"), 8),
    "lit": lit,
    "2 px aside": lambda: moved(2.0),
    "3 px aside": lambda: moved(3.0),
    "20 px aside": lambda: moved(20.0),
    "unsharp": lambda: cv2.GaussianBlur(frame("board"), (0, 0), 2.1),
    "smooth": lambda: cv2.GaussianBlur(cv2.resize(frame("board"), None, fx=2, fy=2), (0, 0), 3.0),
}


@cache
def frame(name):
    return FRAMES[name]()


@cache
def message(*names):
    """State after the frames, last text, and all pairs."""
    if not names:
        return CaptureState(), "", ()
    state, _, pairs = message(*names[:-1])
    image = frame(names[-1])
    noise = np.random.default_rng(len(names)).normal(0, 1, image.shape)
    noisy = np.clip(image + noise, 0, 255).astype(np.uint8)
    state, text, pair = advance_state(state, noisy, TARGET, SETTINGS)
    return state, text, (*pairs, pair) if pair else pairs


@pytest.mark.parametrize(
    ("frames", "text"),
    [
        (["empty"], SEE),
        (["board"], HOLD),
        (["board", "board"], LASER),
        (["board", "2 px aside"], HOLD),
        (["smooth", "smooth"], "board blurred by"),
        (["unsharp", "unsharp"], "board's edges not sharp: focus"),
        (["board", "board", "dark"], LASER),
        (["board", "board", "board"], LASER),
        (["board", "board", "3 px aside"], HOLD),
        (["board", "board", "line"], "pair 1 taken"),
        (["board", "board", "dark", "dark", "line"], "pair 1 taken"),
        (["board", "board", "lit"], LASER),
        (["board", "board", "line", "board", "board"], NEW),
        (["board", "board", "line", "other board"], HOLD),
    ],
)
def test_the_person_is_reported_what_the_frames_need(frames, text):
    assert text in message(*frames)[1]


def test_a_pair_is_the_held_board_and_its_line():
    state, _, pairs = message("board", "board", "line", "other board", "other board", "other line")
    assert [len(pairs), len(state.pairs)] == [2, 2]
    for number, pair in enumerate(pairs):
        assert np.abs(pair.board.astype(int) - shot("board", number)).mean() < 2
        assert np.abs(pair.line.astype(int) - shot("line", number)).mean() < 2
    assert state.pending is None


def test_a_line_after_a_move_is_not_paired():
    _, text, pairs = message("board", "board", "20 px aside", "line")
    assert pairs == ()
    assert SEE in text


def test_movement_is_that_of_shared_corners():
    points = TARGET.points[:10]
    pixels = np.arange(20.0).reshape(10, 2)
    first = TargetView(points, pixels, (640, 480))
    second = TargetView(points[4:], pixels[4:] + np.array([3.0, 4.0]), (640, 480))
    assert measure_movement(first, second) == pytest.approx(5.0)
    assert (
        measure_movement(first, TargetView(TARGET.points[20:26], pixels[:6], (640, 480))) == np.inf
    )


FOCAL = 900.0
CHESSBOARD = Chessboard(9, 6, 20.0)


def view_of(tilt_x=0.0, tilt_y=0.0, distance=400.0, offset=(0.0, 0.0)):
    """A board before a pinhole camera of 640 x 480 px, turned about u and v. Units: deg, mm."""
    points = CHESSBOARD.points - CHESSBOARD.points.mean(axis=0)
    turn = Rotation.from_euler("xy", [tilt_x, tilt_y], degrees=True)
    seen = turn.apply(points) + np.array([*offset, distance])
    pixels = seen[:, :2] / seen[:, 2:] * FOCAL + (319.5, 239.5)
    return TargetView(CHESSBOARD.points, pixels, (640, 480))


def test_without_a_view_only_their_number_is_missing():
    assert list_missing_views([], 15) == ("15 more",)


def test_one_frontal_view_lacks_sides_tilts_and_depth():
    number, areas, tilts, depth = list_missing_views([view_of()], 15)
    assert number == "14 more"
    named = areas.removeprefix("board into the image's ").split(", ")
    assert len(named) == 8
    assert "middle" not in named
    assert tilts == "tilt with the right, left, lower, upper side nearer"
    assert depth == "nearer and farther"


@pytest.mark.parametrize(
    ("tilts", "left"),
    [
        ({"tilt_y": 30.0}, {"left", "lower", "upper"}),
        ({"tilt_y": -30.0}, {"right", "lower", "upper"}),
        ({"tilt_x": -30.0}, {"right", "left", "upper"}),
        ({"tilt_x": 30.0}, {"right", "left", "lower"}),
    ],
)
def test_a_tilt_is_measured_by_the_side_that_is_nearer(tilts, left):
    view = view_of(**tilts)
    corners = CHESSBOARD.points - CHESSBOARD.points.mean(axis=0)
    turn = Rotation.from_euler("xy", [tilts.get("tilt_x", 0), tilts.get("tilt_y", 0)], degrees=True)
    depths = turn.apply(corners)[:, 2]
    nearest = corners[np.argmin(depths)]
    side = ("right" if nearest[0] > 0 else "left") if "tilt_y" in tilts else (
        "lower" if nearest[1] > 0 else "upper")  # fmt: skip
    assert left == {"right", "left", "lower", "upper"} - {side}
    text = next(text for text in list_missing_views([view], 1) if text.startswith("tilt"))
    assert set(text.removeprefix("tilt with the ").split(" side")[0].split(", ")) == left


def test_a_full_set_lacks_nothing():
    tilts = [view_of(tilt_x=a, tilt_y=b) for a, b in ((30, 0), (-30, 0), (0, 30), (0, -30))]
    moved = [
        view_of(offset=(x, y), distance=distance)
        for x, y in ((-75, -60), (75, -60), (-75, 60), (75, 60))
        for distance in (400.0, 500.0)
    ]
    assert list_missing_views([*tilts, *moved], 12) == ()
