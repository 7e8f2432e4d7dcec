"""Boards that look the same after a turn, on a robot that shows how they are turned."""

import numpy as np
import pytest

from lsvision.calibration.board_pose import estimate_board_pose
from lsvision.calibration.board_turns import list_pattern_turns, turn_boards
from lsvision.calibration.hand_eye import calibrate_hand_eye_board
from lsvision.calibration.target import ChArUco, Chessboard, CircleGrid
from lsvision.errors import CalibrationFailed
from lsvision.geometry import Pose
from lsvision.sensors.camera import Camera
from lsvision.simulate.hand_eye import rotation_from_vector
from tests.calibration.hand_eye_scenes import MOUNT, board_scene, pose_errors

AMBIGUOUS, SQUARE = Chessboard(9, 7, 10.0), Chessboard(8, 8, 10.0)
CAMERA = Camera([[1200.0, 0, 640], [0, 1200.0, 512], [0, 0, 1]], [], (1280, 1024))
SIGMAS = 4.5


def turned(boards, target, rng):
    """The boards as numbered from any of the ends that look the same."""
    group = [Pose(), *list_pattern_turns(target)]
    labels = rng.integers(len(group), size=len(boards))
    return [board @ group[k] for board, k in zip(boards, labels, strict=True)], labels


@pytest.mark.parametrize(
    ("target", "count"),
    [(AMBIGUOUS, 1), (SQUARE, 3), (Chessboard(7, 7, 5.0), 1), (Chessboard(9, 6, 5.0), 0),
     (CircleGrid(5, 4, 10.0, 5.0, asymmetric=False), 1), (CircleGrid(4, 4, 9.0, 5.0, False), 3),
     (CircleGrid(), 0), (ChArUco(), 0)],
)  # fmt: skip
def test_turns_bring_the_pattern_to_itself(target, count):
    turns = list_pattern_turns(target)
    assert len(turns) == count
    for turn in turns:
        moved = turn.apply(target.points)
        apart = np.linalg.norm(moved[:, None] - target.points, axis=2)
        np.testing.assert_allclose(apart.min(axis=1), 0, atol=1e-9)
        corner = apart[0].argmin()
        if isinstance(target, Chessboard):  # a black square touches the first corner
            row, column = divmod(int(corner), target.columns)
            inward = (turn.rotation @ (1.0, 1.0, 0.0))[:2]
            first = (column + min(inward[0], 0), row + min(inward[1], 0))
            assert sum(first) % 2 == 0


@pytest.mark.parametrize("target", [AMBIGUOUS, SQUARE])
@pytest.mark.parametrize("seed", range(6))
def test_turned_views_are_found_by_the_robot(seed, target):
    noisy = {"robot": (0.3, 0.1), "board_noise": (0.3, 0.1)}
    boards, flanges = board_scene(40 + seed, 10, **noisy)
    views, labels = turned(boards, target, np.random.default_rng(seed))
    found = turn_boards(views, flanges, list_pattern_turns(target))
    steps = [pose.inverse() @ board for pose, board in zip(found.poses, boards, strict=True)]
    for step in steps:  # all by one turn
        np.testing.assert_allclose(step.matrix, steps[0].matrix, atol=1e-9)
    most = np.bincount(labels).argmax()
    assert found.turned == tuple(np.flatnonzero(labels != most)) or len(found.turned) == 5


def test_the_calibration_is_that_of_boards_numbered_from_one_end():
    boards, flanges = board_scene(50, 12)
    views, labels = turned(boards, AMBIGUOUS, np.random.default_rng(1))
    corrected = turn_boards(views, flanges, list_pattern_turns(AMBIGUOUS))
    found = calibrate_hand_eye_board(corrected.poses, flanges)
    error = pose_errors(found.flange_from_camera, MOUNT)
    assert error @ np.linalg.solve(found.covariance, error) < SIGMAS**2
    assert found.rejected == ()
    for index in np.flatnonzero(labels != np.bincount(labels).argmax()):
        assert f"pose {index}" in corrected.warning
    numbered = turn_boards(boards, flanges, list_pattern_turns(AMBIGUOUS))
    assert "all views are numbered from the same end" in numbered.warning


def test_each_board_has_a_flange():
    boards, flanges = board_scene(50, 4)
    with pytest.raises(ValueError, match="as many boards as flanges, got 3 and 4"):
        turn_boards(boards[:3], flanges, list_pattern_turns(AMBIGUOUS))


def test_a_board_on_the_flange_is_turned_too():
    boards, flanges = board_scene(51, 10)
    views, _ = turned(boards, AMBIGUOUS, np.random.default_rng(2))
    corrected = turn_boards(views, flanges, list_pattern_turns(AMBIGUOUS))
    inverse = [pose.inverse() for pose in flanges]
    found = calibrate_hand_eye_board(corrected.poses, inverse, mounting="eye_to_hand")
    assert np.linalg.norm(pose_errors(found.base_from_camera, MOUNT)[:3]) < 0.5


def test_covariances_are_those_of_the_turned_poses():
    """As of the same corners with the points of the turned board."""
    boards, flanges = board_scene(52, 6, robot=(0.0, 0.0))
    (turn,) = list_pattern_turns(AMBIGUOUS)
    rng = np.random.default_rng(3)
    pixels = CAMERA.project(boards[0].apply(AMBIGUOUS.points)) + rng.normal(0, 0.1, (63, 2))
    seen, other = (
        estimate_board_pose(pixels, points, CAMERA)
        for points in (AMBIGUOUS.points, turn.inverse().apply(AMBIGUOUS.points))
    )
    corrected = turn_boards([other.camera_from_board, *boards[1:]], flanges, [turn])
    assert corrected.turned == (0,)
    np.testing.assert_allclose(corrected.poses[0].matrix, seen.camera_from_board.matrix, atol=1e-4)
    given = np.repeat(other.covariance[None], 6, axis=0)
    np.testing.assert_allclose(corrected.covariances(given)[0], seen.covariance, rtol=1e-3)
    shift = np.linalg.cholesky(other.covariance)
    shifts = corrected.compute_shifts(np.repeat(shift.T[:, None], 6, axis=1))[:, 0]
    np.testing.assert_allclose(shifts.T @ shifts, seen.covariance, rtol=1e-3)


def test_poses_that_do_not_tell_the_turn_are_rejected():
    spin = [rotation_from_vector(np.array([0, 0, np.radians(angle)])) for angle in (0, 0, 0, 0, 90)]
    board = Pose(np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, 300.0))
    flanges = [Pose(turn, (10.0 * k, 0.0, 0.0)) for k, turn in enumerate(spin)]
    boards = [Pose(flange.rotation.T @ board.rotation, board.translation) for flange in flanges]
    with pytest.raises(CalibrationFailed, match="do not determine its orientation"):
        turn_boards(boards, flanges, list_pattern_turns(AMBIGUOUS))


def test_a_single_view_is_returned_as_it_is():
    boards, flanges = board_scene(1, 1)
    alone = turn_boards(boards, flanges, list_pattern_turns(AMBIGUOUS))
    assert (alone.poses, alone.turned) == (tuple(boards), ())
