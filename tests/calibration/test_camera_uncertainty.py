"""The camera's own uncertainty, against OpenCV's and against repeated simulations."""

import numpy as np
import pytest

from lsvision.calibration.board_pose import estimate_board_pose
from lsvision.calibration.bundle_adjustment_problem import LaserView
from lsvision.calibration.camera_uncertainty import compute_board_pose_modes, compute_camera_modes
from lsvision.calibration.hand_eye import calibrate_hand_eye_board
from lsvision.calibration.intrinsics import CameraSettings, fit_camera
from lsvision.calibration.laser_plane import fit_laser_plane
from lsvision.calibration.target import TargetView
from lsvision.geometry import Pose
from lsvision.sensors.camera import Camera
from lsvision.simulate.boards import BoardScene, simulate_boards
from tests.calibration.hand_eye_scenes import MOUNT, TARGET, pose_errors

SCENE = BoardScene(corner_std=0.15)
SAME_FORMULA = 0.03  # relative: OpenCV counts the degrees of freedom in another way
CHI2_MEAN, CHI2_STD = 6.0, np.sqrt(12.0)  # of six errors
RUNS = 40


def seen_by(scene, count, seed):
    boards = simulate_boards(scene, count, rng=np.random.default_rng(seed))
    return boards, [TargetView(board.points, board.pixels, scene.size) for board in boards]


@pytest.mark.parametrize("settings", [CameraSettings(), CameraSettings(fixed_aspect=True)])
def test_the_covariance_has_the_standard_deviations_of_opencv(settings):
    _, views = seen_by(SCENE, 10, 1)
    found = fit_camera(views, settings)
    std = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(std, list(found.std.values()), rtol=SAME_FORMULA, atol=1e-12)
    assert (found.covariance[8] == 0).all()  # k3 is fixed


def test_the_modes_add_up_to_the_covariance():
    _, views = seen_by(SCENE, 10, 2)
    found = fit_camera(views)
    cameras = compute_camera_modes(found.camera, found.covariance)
    shifts = np.array(
        [
            [*(each.matrix - found.camera.matrix)[[0, 1, 0, 1], [0, 1, 2, 2]],
             *(each.distortion - found.camera.distortion)]
            for each in cameras
        ]
    )  # fmt: skip
    std = np.sqrt(np.diag(found.covariance)) + 1e-12
    np.testing.assert_allclose(
        shifts.T @ shifts / np.outer(std, std), found.covariance / np.outer(std, std), atol=1e-5
    )
    with pytest.raises(ValueError, match=r"covariance of 9 intrinsics, got shape \(3, 3\)"):
        compute_camera_modes(found.camera, np.eye(3))


def hand_eye_by(camera, covariance, rng):
    """Calibrate with an uncertain camera and a perfect robot; the errors and two covariances."""
    truth = Camera(SCENE.matrix, SCENE.distortion, SCENE.size)
    base_from_board = Pose(translation=TARGET)
    boards = simulate_boards(SCENE, 10, rng=rng)
    views = [TargetView(board.points, board.pixels, truth.size) for board in boards]
    flanges = [base_from_board @ b.camera_from_board.inverse() @ MOUNT.inverse() for b in boards]
    poses = [estimate_board_pose(view.pixels, view.points, camera) for view in views]
    seen, own = [pose.camera_from_board for pose in poses], [pose.covariance for pose in poses]
    modes = compute_board_pose_modes(views, camera, covariance)
    without = calibrate_hand_eye_board(seen, flanges, covariances=own)
    found = calibrate_hand_eye_board(seen, flanges, covariances=own, camera_modes=modes)
    errors = pose_errors(found.flange_from_camera, MOUNT)
    return [errors @ np.linalg.solve(each.covariance, errors) for each in (found, without)]


@pytest.mark.slow
def test_hand_eye_errors_lie_within_the_covariance_with_the_camera_and_not_without():
    rng, chi2 = np.random.default_rng(3), []
    for _ in range(RUNS):
        boards = simulate_boards(SCENE, 5, rng=rng)
        calibration = fit_camera([TargetView(b.points, b.pixels, SCENE.size) for b in boards])
        chi2.append(hand_eye_by(calibration.camera, calibration.covariance, rng))
    with_camera, without = np.mean(chi2, axis=0)
    assert with_camera < CHI2_MEAN + 3 * CHI2_STD / np.sqrt(RUNS)
    assert without > 2 * with_camera


def test_an_uncertain_camera_widens_the_hand_eye_calibration():
    _, views = seen_by(SCENE, 5, 4)
    calibration = fit_camera(views)
    chi2 = hand_eye_by(calibration.camera, calibration.covariance, np.random.default_rng(5))
    assert chi2[0] < chi2[1]


@pytest.mark.parametrize("runs", [4, pytest.param(40, marks=pytest.mark.slow)])
def test_an_uncertain_camera_widens_a_plane_from_few_views(runs):
    """With a camera of 5 boards, four other ones give a plane: its distance follows fx."""
    chi2 = []
    for seed in range(6, 6 + runs):
        _, of_camera = seen_by(SCENE, 5, seed)
        calibration = fit_camera(of_camera)
        boards, _ = seen_by(SCENE, 4, 100 + seed)
        views = [
            LaserView(b.points, b.pixels, b.line_pixels, np.full(len(b.line_pixels), 0.1))
            for b in boards
        ]
        errors = []
        for covariance in (calibration.covariance, None):
            found = fit_laser_plane(calibration.camera, views, camera_covariance=covariance)
            error = found.plane.distance - SCENE.plane.distance
            errors.append(error / np.sqrt(found.covariance[2, 2]))
        chi2.append(np.square(errors))
    with_camera, without = np.mean(chi2, axis=0)
    assert with_camera < 1 + 3 * np.sqrt(2 / runs)
    assert with_camera < 0.7 * without
