"""Pairs taken from a stream: the frames decide, and what is missing is printed."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lsvision.calibration.capture_needs import missing_views
from lsvision.calibration.capture_pairs import (
    CaptureSettings,
    CaptureState,
    movement,
    next_state,
)
from lsvision.calibration.target import ChArUco, Chessboard, TargetView
from lsvision.io.images import read_image

EXAMPLE = Path(__file__).parents[2] / "calibration" / "example"
TARGET, SETTINGS = ChArUco(), CaptureSettings()
SEE, HOLD, LASER, NEW = "no board", "hold it still", "laser on", "as in an earlier pair"


def shot(kind, number):
    return read_image(EXAMPLE / f"{kind}s" / f"{kind}_{number:02d}.jpg")


BOARD, LINE = shot("board", 0), shot("line", 0)
EMPTY = np.full_like(BOARD, 90)
DARK = np.full_like(BOARD, 8)
LIT = np.maximum(BOARD, np.minimum(LINE.astype(int) * 8, 255).astype(np.uint8))
UNSHARP = cv2.GaussianBlur(BOARD, (0, 0), 2.1)
SMOOTH = cv2.GaussianBlur(cv2.resize(BOARD, None, fx=2, fy=2), (0, 0), 3.0)


def shifted(image, dx):
    return cv2.warpAffine(image, np.array([[1.0, 0, dx], [0, 1, 0]]), image.shape[1::-1],
                          borderMode=cv2.BORDER_REPLICATE)  # fmt: skip


def message(frames, state=None):
    """State after the frames, last text, and all pairs."""
    state, pairs, text = state or CaptureState(), [], ""
    for seed, frame in enumerate(frames):
        noise = np.random.default_rng(seed).normal(0, 1, frame.shape)
        noisy = np.clip(frame + noise, 0, 255).astype(np.uint8)
        state, text, pair = next_state(state, noisy, TARGET, SETTINGS)
        pairs += [pair] if pair else []
    return state, text, pairs


@pytest.mark.parametrize(
    ("frames", "text"),
    [
        ([EMPTY], SEE),
        ([BOARD], HOLD),
        ([BOARD, BOARD], LASER),
        ([BOARD, shifted(BOARD, 2.0)], HOLD),
        ([SMOOTH, SMOOTH], "board blurred by"),
        ([UNSHARP, UNSHARP], "board's edges not sharp: focus"),
        ([BOARD, BOARD, DARK], LASER),
        ([BOARD, BOARD, BOARD], LASER),
        ([BOARD, BOARD, shifted(BOARD, 3.0)], HOLD),
        ([BOARD, BOARD, shifted(LINE, 0.0)], "pair 1 taken"),
        ([BOARD, BOARD, DARK, DARK, LINE], "pair 1 taken"),
        ([BOARD, BOARD, LIT], LASER),
        ([BOARD, BOARD, LINE, BOARD, BOARD], NEW),
        ([BOARD, BOARD, LINE, shot("board", 1)], HOLD),
    ],
)
def test_the_person_is_reported_what_the_frames_need(frames, text):
    assert text in message(frames)[1]


def test_a_pair_is_the_held_board_and_its_line():
    state, _, pairs = message([BOARD, BOARD, LINE, shot("board", 1), shot("board", 1),
                            shot("line", 1)])  # fmt: skip
    assert [len(pairs), len(state.pairs)] == [2, 2]
    for number, pair in enumerate(pairs):
        assert np.abs(pair.board.astype(int) - shot("board", number)).mean() < 2
        assert np.abs(pair.line.astype(int) - shot("line", number)).mean() < 2
    assert state.pending is None


def test_a_line_after_a_move_is_not_paired():
    _, text, pairs = message([BOARD, BOARD, shifted(BOARD, 20.0), LINE])
    assert pairs == []
    assert SEE in text


def test_movement_is_that_of_shared_corners():
    points = TARGET.points[:10]
    pixels = np.arange(20.0).reshape(10, 2)
    first = TargetView(points, pixels, (640, 480))
    second = TargetView(points[4:], pixels[4:] + np.array([3.0, 4.0]), (640, 480))
    assert movement(first, second) == pytest.approx(5.0)
    assert movement(first, TargetView(TARGET.points[20:26], pixels[:6], (640, 480))) == np.inf


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
    assert missing_views([], 15) == ("15 more",)


def test_one_frontal_view_lacks_sides_tilts_and_depth():
    number, areas, tilts, depth = missing_views([view_of()], 15)
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
    text = next(text for text in missing_views([view], 1) if text.startswith("tilt"))
    assert set(text.removeprefix("tilt with the ").split(" side")[0].split(", ")) == left


def test_a_full_set_lacks_nothing():
    tilts = [view_of(tilt_x=a, tilt_y=b) for a, b in ((30, 0), (-30, 0), (0, 30), (0, -30))]
    moved = [
        view_of(offset=(x, y), distance=distance)
        for x, y in ((-75, -60), (75, -60), (-75, 60), (75, 60))
        for distance in (400.0, 500.0)
    ]
    assert missing_views([*tilts, *moved], 12) == ()
