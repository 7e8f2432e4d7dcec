"""Pose of a board from its corners: accuracy and coverage of the covariance."""

from dataclasses import replace

import numpy as np

from lsvision.calibration.board_pose import estimate_board_pose
from lsvision.geometry import Pose
from lsvision.sensors.camera import Camera
from lsvision.simulate.hand_eye import rotation_from_vector
from tests.calibration.hand_eye_scenes import pose_errors

CAMERA = Camera([[2264.0, 0, 640], [0, 2264, 512], [0, 0, 1]], [-0.12, 0.1, 0, 0, 0], (1280, 1024))
BOARD = np.array([[12.0 * i, 12.0 * j, 0.0] for j in range(7) for i in range(9)])
TRUTH = Pose(
    rotation_from_vector(np.array([0.3, -0.4, 0.2])) @ np.diag([1.0, -1, -1]), (-40.0, 30.0, 350.0)
)
EXACT_MM, EXACT_RAD = 1e-5, 1e-7  # the undistortion of OpenCV's solver


def test_board_pose_is_exact_without_noise():
    error = pose_errors(
        estimate_board_pose(CAMERA.project(TRUTH.apply(BOARD)), BOARD, CAMERA).camera_from_board,
        TRUTH,
    )
    assert np.abs(error[:3]).max() < EXACT_MM
    assert np.abs(error[3:]).max() < EXACT_RAD


def test_covariance_of_a_board_pose_is_that_of_its_errors():
    rng, pixels = np.random.default_rng(1), CAMERA.project(TRUTH.apply(BOARD))
    scores = []
    for _ in range(60):
        seen = estimate_board_pose(pixels + rng.normal(0, 0.1, pixels.shape), BOARD, CAMERA)
        error = pose_errors(seen.camera_from_board, TRUTH)
        scores.append(error @ np.linalg.solve(seen.covariance, error) / 6)
    # The mean of 360 squared normal numbers has one sigma 0.075.
    assert abs(np.mean(scores) - 1) < 4 * 0.075


def test_the_covariance_of_a_small_far_board_includes_the_pose_of_the_opposite_tilt():
    rng, camera = np.random.default_rng(2), replace(CAMERA, distortion=np.zeros(5))
    scores, wrong = [], 0
    for _ in range(150):
        around = rng.uniform(0, 2 * np.pi)
        tilt = np.radians(rng.uniform(5, 40)) * np.array([np.cos(around), np.sin(around), 0])
        truth = Pose(rotation_from_vector(tilt), (*rng.uniform(-400, 300, 2), 5000.0))
        pixels = camera.project(truth.apply(BOARD))
        seen = estimate_board_pose(pixels + rng.normal(0, 0.15, pixels.shape), BOARD, camera)
        error = pose_errors(seen.camera_from_board, truth)
        wrong += np.linalg.norm(error[3:]) > np.radians(8)
        scores.append(error @ np.linalg.solve(seen.covariance, error) / 6)
    assert wrong > 5  # the opposite tilt fits better
    assert np.mean(scores) < 2  # without it in the covariance: hundreds


def test_the_skew_of_the_camera_is_not_ignored():
    matrix = CAMERA.matrix.copy()
    matrix[0, 1] = 20.0
    skewed = replace(CAMERA, matrix=matrix)
    found = estimate_board_pose(skewed.project(TRUTH.apply(BOARD)), BOARD, skewed)
    error = pose_errors(found.camera_from_board, TRUTH)
    assert np.abs(error[:3]).max() < EXACT_MM
    assert np.abs(error[3:]).max() < EXACT_RAD
