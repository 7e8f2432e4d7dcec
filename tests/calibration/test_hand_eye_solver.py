"""Hand-eye calibration: errors for degenerate, mispaired and too few data."""

import re

import numpy as np
import pytest

from lsvision.calibration.board_pose import estimate_board_pose
from lsvision.calibration.capture_pairs import CaptureSettings
from lsvision.calibration.hand_eye import (
    calibrate_hand_eye_board,
    calibrate_hand_eye_plane,
    calibrate_hand_eye_sphere,
)
from lsvision.calibration.hand_eye_result import HandEyeSettings
from lsvision.calibration.laser_line_on_board import LineOnBoardSettings
from lsvision.calibration.pose_outliers import OutlierSettings
from lsvision.calibration.sphere_arc import SphereArcSettings
from lsvision.errors import CalibrationFailed, DegenerateGeometry
from lsvision.geometry import Plane, Pose
from lsvision.io.robot_conventions import pose_from_numbers
from lsvision.profile import Profile
from lsvision.sensors.camera import Camera
from lsvision.simulate.hand_eye import (
    TargetMotion,
    perturb_pose,
    rotation_from_vector,
    simulate_plane_profile,
)
from tests.calibration.hand_eye_scenes import (
    FEW_TRIALS,
    MOUNT,
    RADIUS,
    TARGET,
    USUAL,
    WORKING_Y,
    board_scene,
    plane_scene,
    sphere_scene,
    wrong_pose,
)


def motion(**changes):
    full = {"offset": 0.8 * RADIUS, "working_y": WORKING_Y}
    return TargetMotion(**{**full, **changes})


def test_numbers_of_poses_and_profiles_must_be_equal():
    profiles, flanges = sphere_scene(1, 8)
    with pytest.raises(ValueError, match="got 8 profiles and 7 poses"):
        calibrate_hand_eye_sphere(profiles, flanges[:7])
    with pytest.raises(ValueError, match="got 8 boards and 7 poses"):
        calibrate_hand_eye_board(flanges, flanges[:7])


@pytest.mark.parametrize("radius", [-1.0, np.nan, np.inf])
def test_a_radius_must_be_positive_and_finite(radius):
    with pytest.raises(ValueError, match="positive, finite radius"):
        calibrate_hand_eye_sphere(*sphere_scene(1, 8), radius=radius)


def test_too_few_poses_are_rejected_with_their_number():
    profiles, flanges = sphere_scene(2, 5)
    with pytest.raises(CalibrationFailed, match=r"5 poses show a sphere .* 6 are needed"):
        calibrate_hand_eye_sphere(profiles, flanges)
    profiles, flanges = plane_scene(2, 7)
    with pytest.raises(CalibrationFailed, match=r"7 poses show a straight line .* 8 are needed"):
        calibrate_hand_eye_plane(profiles, flanges)
    boards, flanges = board_scene(2, 3)
    with pytest.raises(CalibrationFailed, match=r"3 poses show a board .* 4 are needed"):
        calibrate_hand_eye_board(boards, flanges)


DEGENERATE = {
    "translation only": (motion(tilt=0.0, spin=0.0), "never rotated"),
    "spin only": (motion(tilt=0.0), "rotated about one axis, .* only"),
    "cuts through the centre": (motion(offset=0.3), "the sphere's centre at"),
    "same place": (motion(sideways=0.0, depth=0.0), "same position in all profiles"),
}


@pytest.mark.parametrize("case", DEGENERATE)
def test_degenerate_poses_are_rejected_with_the_missing_motion(case):
    limits, message = DEGENERATE[case]
    profiles, flanges = sphere_scene(3, motion=limits)
    with pytest.raises(DegenerateGeometry, match=message) as caught:
        calibrate_hand_eye_sphere(profiles, flanges)
    assert "add poses" in str(caught.value)


def test_rotation_about_one_axis_is_rejected_for_boards_and_planes():
    boards, flanges = board_scene(4)
    axis_only = [flanges[0]] * 4
    with pytest.raises(DegenerateGeometry, match="never rotated"):
        calibrate_hand_eye_board(boards[:4], axis_only)
    profiles, flanges = plane_scene(4, 12)
    with pytest.raises(DegenerateGeometry, match="never rotated"):
        calibrate_hand_eye_plane(profiles, [flanges[0]] * 12)


def test_shuffled_pairs_are_rejected_by_their_residual():
    profiles, flanges = sphere_scene(5)
    order = np.random.default_rng(3).permutation(12)
    with pytest.raises(CalibrationFailed, match="check the order of the pairs"):
        calibrate_hand_eye_sphere(profiles, [flanges[index] for index in order])


def test_pairs_shifted_by_one_are_detected():
    profiles, flanges = sphere_scene(6)
    with pytest.raises(CalibrationFailed, match="belongs to the next pose"):
        calibrate_hand_eye_sphere(profiles, [flanges[-1], *flanges[:-1]])


def test_shifted_boards_are_called_boards():
    boards, flanges = board_scene(8)
    with pytest.raises(CalibrationFailed, match="each board belongs to the pose before"):
        calibrate_hand_eye_board(boards, [*flanges[1:], flanges[0]])


@pytest.mark.parametrize("shift", [3.0, 15.0])
def test_a_sphere_that_moved_is_detected(shift):
    targets = [TARGET] * 6 + [TARGET + shift * np.eye(3)[0]] * 6
    # The section poses follow the target, the calibration assumes one.
    profiles, flanges = sphere_scene(7, targets=targets)
    with pytest.raises(CalibrationFailed, match="moved between pose 5 and pose 6"):
        calibrate_hand_eye_sphere(profiles, flanges)


MOVED = 12.0  # mm


@pytest.mark.parametrize("target", ["plane", "board"])
def test_a_plane_or_board_that_moved_is_detected_with_its_distance(target):
    scene, calibrate = {
        "plane": (plane_scene, calibrate_hand_eye_plane),
        "board": (board_scene, calibrate_hand_eye_board),
    }[target]
    seen, flanges = scene(22, 16)
    # Robot and target moved together look the same: later poses mean another target.
    aside = Pose.along((0.0, 0.0, 1.0), MOVED)
    with pytest.raises(CalibrationFailed, match="moved between pose 7 and pose 8") as text:
        calibrate(
            seen, [*flanges[:8], *(aside @ pose for pose in flanges[8:])], settings=FEW_TRIALS
        )
    apart = float(re.search(r"([\d.]+) mm apart", str(text.value))[1])
    assert apart == pytest.approx(MOVED, abs=0.5)


def kuka_angles(rotation):
    """A, B, C of R = Rz(A) Ry(B) Rx(C), written out by hand."""
    a = np.arctan2(rotation[1, 0], rotation[0, 0])
    b = np.arcsin(np.clip(-rotation[2, 0], -1, 1))
    c = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.degrees([a, b, c])


def test_poses_read_in_another_convention_are_rejected():
    profiles, flanges = sphere_scene(8)
    written = [[*pose.translation, *kuka_angles(pose.rotation)] for pose in flanges]
    right = [pose_from_numbers(row, "kuka") for row in written]
    calibrate_hand_eye_sphere(profiles, right)
    wrong = [pose_from_numbers(row, "fanuc") for row in written]
    with pytest.raises(CalibrationFailed, match="convention"):
        calibrate_hand_eye_sphere(profiles, wrong)


def test_poorly_determined_poses_are_rejected_with_the_least_determined_direction():
    strict = HandEyeSettings(max_least_determined_std=0.01)
    with pytest.raises(
        DegenerateGeometry, match=r"sensor is determined to .* mm only in .* the sensor's own"
    ):
        calibrate_hand_eye_sphere(*sphere_scene(9, 8), settings=strict)


def test_ambiguous_solution_is_rejected():
    strict = HandEyeSettings(min_ambiguity_ratio=1e9)
    with pytest.raises(DegenerateGeometry, match="another solution fits nearly as well"):
        calibrate_hand_eye_sphere(*sphere_scene(14, 6), settings=strict)


CAMERA = Camera([[2000.0, 0, 640], [0, 2000, 512], [0, 0, 1]], [0, 0, 0, 0, 0], (1280, 1024))


POINTS = np.column_stack([np.arange(8.0), np.arange(8.0) ** 2, np.zeros(8)])
UNSEEN = {
    "few": (POINTS[:5], 500 + POINTS[:5, :2], "5 corners of the board were found and 6 are needed"),
    "point": (POINTS, np.full((8, 2), 500.0), "lie on one line"),
    "line": (POINTS * (1, 0, 0), 500 + POINTS[:, :2], "lie on one line"),
}


@pytest.mark.parametrize("case", UNSEEN)
def test_too_few_or_collinear_corners_are_rejected(case):
    points, pixels, message = UNSEEN[case]
    with pytest.raises(CalibrationFailed, match=message):
        estimate_board_pose(pixels, points, CAMERA)


def test_corners_must_be_finite():
    with pytest.raises(ValueError, match="finite corners"):
        estimate_board_pose(np.full((8, 2), np.nan), POINTS, CAMERA)


def boards_from(flanges):
    """Exact poses of a board before a camera at MOUNT."""
    base_from_board = Pose(translation=TARGET)
    return [(flange @ MOUNT).inverse() @ base_from_board for flange in flanges]


ROTATED = [rotation_from_vector(np.array(v)) for v in ((0.5, 0, 0), (0, 0.5, 0), (0.3, 0.3, 0.2))]


def test_a_board_whose_pose_is_rotated_a_few_times_only_is_calibrated():
    """Some of the random selections of poses contain no rotation."""
    rng = np.random.default_rng(0)
    rotations = [np.eye(3)] * 9 + ROTATED
    flanges = [Pose(R, TARGET + 300 * np.eye(3)[2] + rng.uniform(-100, 100, 3)) for R in rotations]
    found = calibrate_hand_eye_board(boards_from(flanges), flanges)
    np.testing.assert_allclose(found.flange_from_camera.matrix, MOUNT.matrix, rtol=0, atol=1e-6)


def test_a_plane_seen_in_three_rotations_from_one_place_does_not_determine_the_sensor():
    rng, plane = np.random.default_rng(0), Plane((0, 0, 1), 300.0)
    upright = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    profiles, flanges = [], []
    for number in range(9):
        tilt = rotation_from_vector(0.3 * np.eye(3)[number % 3] * (number % 3 < 2))
        rotation = tilt @ upright
        section = Pose(rotation, TARGET - rotation @ (0.0, WORKING_Y, 0.0))
        profiles.append(simulate_plane_profile(plane.transformed(section.inverse()), USUAL, rng))
        flanges.append(section @ MOUNT.inverse())
    with pytest.raises(DegenerateGeometry, match="do not determine all six"):
        calibrate_hand_eye_plane(profiles, flanges, settings=FEW_TRIALS)


def test_a_moved_target_is_told_by_the_poses_of_the_caller():
    targets = [TARGET] * 8 + [TARGET + np.array([3.0, 4.0, 2.0])] * 6
    profiles, flanges = sphere_scene(7, 14, targets=targets)
    for lost in (1, 2):
        profiles[lost] = Profile(np.full((100, 2), np.nan))
    with pytest.raises(CalibrationFailed, match="moved between pose 7 and pose 8"):
        calibrate_hand_eye_sphere(profiles, flanges)


def with_wrong_poses(seed, count, wrong, turn_deg):
    profiles, flanges = sphere_scene(seed, count)
    rng = np.random.default_rng(seed)
    for index in wrong:
        flanges[index] = wrong_pose(flanges[index], 10.0, turn_deg, rng)
    return profiles, flanges


def allowing(fraction):
    return HandEyeSettings(outliers=OutlierSettings(max_outlier_fraction=fraction))


def test_a_third_of_nine_poses_may_be_wrong():
    scene = with_wrong_poses(2, 9, (1, 4, 7), 0.0)
    found = calibrate_hand_eye_sphere(*scene, RADIUS, settings=allowing(1 / 3))
    assert [pose.index for pose in found.rejected] == [1, 4, 7]


def test_too_few_poses_that_agree_are_not_blamed_on_their_residual():
    scene = with_wrong_poses(2, 12, (4, 7), 0.0)
    with pytest.raises(CalibrationFailed, match=r"10 of 12 poses, and 11 .* are needed") as error:
        calibrate_hand_eye_sphere(*scene, RADIUS, settings=allowing(0.1))
    assert "--max-residual" not in str(error.value)
    assert "repeat those that disagree (4, 7, counted from 0)" in str(error.value)


@pytest.mark.parametrize("limit", [0.0, -1.0, np.nan])
def test_a_limit_must_be_positive(limit):
    with pytest.raises(ValueError, match="max_residual_rms above 0 mm"):
        HandEyeSettings(max_residual_rms=limit)


@pytest.mark.parametrize(
    "robot_std", [(0.05, 0.0), (-0.05, 1e-4), (np.nan, 1e-4), (1e200, 1e-4), (0.1, 2.0)]
)
def test_a_stated_robot_must_be_positive_and_finite(robot_std):
    with pytest.raises(ValueError, match=r"robot_std .* above 0 and finite"):
        HandEyeSettings(robot_std=robot_std)


@pytest.mark.parametrize(
    "make",
    [
        lambda: HandEyeSettings(max_least_determined_std=np.nan),
        lambda: HandEyeSettings(min_ambiguity_ratio=np.nan),
        lambda: OutlierSettings(significance=np.nan),
        lambda: OutlierSettings(max_outlier_fraction=1.5),
        lambda: SphereArcSettings(min_points=3),
        lambda: LineOnBoardSettings(max_points=0),
        lambda: LineOnBoardSettings(min_points=15.5),
        lambda: LineOnBoardSettings(margin=np.nan),
        lambda: LineOnBoardSettings(edge_clearance=-1.0),
        lambda: LineOnBoardSettings(max_line_deviation_px=np.inf),
        lambda: CaptureSettings(still_px=np.nan),
    ],
)
def test_settings_that_turn_a_check_off_by_mistake_are_rejected(make):
    with pytest.raises(ValueError, match="expected"):
        make()


def test_shifts_by_the_camera_must_be_finite():
    boards, flanges = board_scene(2, 8)
    with pytest.raises(ValueError, match="finite camera_modes"):
        calibrate_hand_eye_board(boards, flanges, camera_modes=np.full((1, 8, 6), np.nan))


@pytest.mark.parametrize("variance", [-1.0, np.nan])
def test_covariances_of_boards_must_be_covariances(variance):
    boards, flanges = board_scene(2, 8)
    with pytest.raises(ValueError, match=r"expected .*covariance"):
        calibrate_hand_eye_board(boards, flanges, covariances=[variance * np.eye(6)] * 8)


def test_the_size_of_a_board_is_unknown_if_the_flange_only_rotates_about_its_origin():
    rng = np.random.default_rng(2)
    rotations = [rotation_from_vector(rng.uniform(-0.6, 0.6, 3)) for _ in range(10)]
    flanges = [Pose(rotation, TARGET + 400 * np.eye(3)[2]) for rotation in rotations]
    boards = [perturb_pose(board, 0.03, 1e-4, rng) for board in boards_from(flanges)]
    found = calibrate_hand_eye_board(boards, flanges)
    assert found.target_scale is None
    assert found.warnings == ()
