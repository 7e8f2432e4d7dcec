"""Hand-eye calibration: accuracy, symmetries, outliers and coverage of the covariance."""

from dataclasses import replace

import numpy as np
import pytest

from lsvision.calibration.hand_eye import (
    calibrate_hand_eye_board,
    calibrate_hand_eye_plane,
    calibrate_hand_eye_sphere,
)
from lsvision.errors import CalibrationFailed
from lsvision.geometry import Pose
from lsvision.io.pose_numbers import propagate_to_numbers
from lsvision.simulate.hand_eye import perturb_pose, rotation_from_vector
from tests.calibration.hand_eye_scenes import (
    FEW_TRIALS,
    MOUNT,
    QUIET,
    RADIUS,
    TARGET,
    USUAL,
    WORKING_Y,
    board_scene,
    plane_scene,
    pose_errors,
    sphere_scene,
    wrong_pose,
)

EXACT_MM, EXACT_RAD = 1e-5, 1e-7  # noise-free; circles and lines are fitted to 1e-8 mm
PERFECT = (0.0, 0.0)
FAR_OUT = 25.0  # chi squared with 6 degrees of freedom exceeds it once in 3000


def assert_exact(found, truth):
    error = pose_errors(found, truth)
    np.testing.assert_allclose(error[:3], 0, atol=EXACT_MM)
    np.testing.assert_allclose(error[3:], 0, atol=EXACT_RAD)


def normalised_error(found, truth=MOUNT):
    error = pose_errors(found.mount_from_sensor, truth)
    return error @ np.linalg.solve(found.covariance, error)


@pytest.mark.parametrize("radius", [None, RADIUS])
def test_sphere_is_exact_without_noise(radius):
    profiles, flanges = sphere_scene(1, 8, view=QUIET, robot=PERFECT)
    found = calibrate_hand_eye_sphere(profiles, flanges, radius, settings=FEW_TRIALS)
    assert_exact(found.flange_from_section, MOUNT)
    np.testing.assert_allclose(found.sphere.centre, TARGET, atol=EXACT_MM)
    assert found.sphere.radius == pytest.approx(RADIUS, abs=EXACT_MM)
    assert found.rejected == ()


def test_plane_is_exact_without_noise():
    profiles, flanges = plane_scene(2, 12, view=QUIET, robot=PERFECT)
    found = calibrate_hand_eye_plane(profiles, flanges, settings=FEW_TRIALS)
    assert_exact(found.flange_from_section, MOUNT)


def test_board_is_exact_without_noise():
    boards, flanges = board_scene(3, 6, robot=PERFECT)
    found = calibrate_hand_eye_board(boards, flanges)
    assert_exact(found.flange_from_camera, MOUNT)
    np.testing.assert_allclose(found.target.translation, TARGET, atol=EXACT_MM)


def as_eye_to_hand(flanges):
    """The same relative motion with a standing sensor: the flange carries the target."""
    return [pose.inverse() for pose in flanges]


def test_eye_to_hand_is_the_same_problem_with_inverse_poses():
    profiles, flanges = sphere_scene(4, 8, view=QUIET, robot=PERFECT)
    found = calibrate_hand_eye_sphere(
        profiles, as_eye_to_hand(flanges), mounting="eye_to_hand", settings=FEW_TRIALS
    )
    assert_exact(found.base_from_section, MOUNT)
    profiles, flanges = plane_scene(4, 10, view=QUIET, robot=PERFECT)
    found = calibrate_hand_eye_plane(
        profiles, as_eye_to_hand(flanges), mounting="eye_to_hand", settings=FEW_TRIALS
    )
    assert_exact(found.base_from_section, MOUNT)
    boards, flanges = board_scene(4, 6, robot=PERFECT)
    found = calibrate_hand_eye_board(boards, as_eye_to_hand(flanges), mounting="eye_to_hand")
    assert_exact(found.base_from_camera, MOUNT)


@pytest.mark.parametrize("seed", range(4))
def test_the_error_lies_within_its_covariance(seed):
    profiles, flanges = sphere_scene([5, seed])
    assert (
        normalised_error(calibrate_hand_eye_sphere(profiles, flanges, settings=FEW_TRIALS))
        < FAR_OUT
    )


def test_the_error_of_a_plane_and_of_a_board_lies_within_its_covariance():
    assert (
        normalised_error(calibrate_hand_eye_plane(*plane_scene(6, 12), settings=FEW_TRIALS))
        < FAR_OUT
    )
    boards, flanges = board_scene(6)
    assert normalised_error(calibrate_hand_eye_board(boards, flanges)) < FAR_OUT


STANDING = {
    "sphere": (sphere_scene, calibrate_hand_eye_sphere),
    "plane": (plane_scene, calibrate_hand_eye_plane),
    "board": (board_scene, calibrate_hand_eye_board),
}


@pytest.mark.parametrize("target", STANDING)
def test_the_error_of_eye_to_hand_lies_within_its_covariance(target):
    scene, calibrate = STANDING[target]
    to_hand = {"mounting": "eye_to_hand", "settings": FEW_TRIALS}
    seen, flanges = scene(20, robot=PERFECT)
    rng = np.random.default_rng(21)
    # The robot errs in what it says of the flange, not in what is left after inverting.
    stated_poses = [perturb_pose(p, 0.05, np.radians(0.01), rng) for p in as_eye_to_hand(flanges)]
    assert normalised_error(calibrate(seen, stated_poses, **to_hand)) < FAR_OUT


def test_covariance_is_scaled_up_if_the_stated_robot_std_is_too_small():
    profiles, flanges = sphere_scene(7, robot=(0.2, 0.04))
    boast = replace(FEW_TRIALS, robot_std=(0.02, np.radians(0.004)))
    found = calibrate_hand_eye_sphere(profiles, flanges, settings=boast)
    assert found.robot_std[0] > 0.08
    assert normalised_error(found) < FAR_OUT


def test_the_error_at_the_working_point_is_smaller_than_at_the_origin():
    found = calibrate_hand_eye_sphere(*sphere_scene(8), settings=FEW_TRIALS)
    assert found.working_point[1] == pytest.approx(WORKING_Y, abs=45)
    assert found.working_point_std < 0.6 * found.std_at((0, 0))


def test_an_unknown_mounting_is_rejected():
    boards, flanges = board_scene(3, 6)
    with pytest.raises(ValueError, match="mounting eye_in_hand or eye_to_hand, got 'eye-in-hand'"):
        calibrate_hand_eye_board(boards, flanges, mounting="eye-in-hand")


def test_the_std_of_the_rotation_vector_is_that_of_its_numbers():
    calibration = calibrate_hand_eye_sphere(*sphere_scene(5), RADIUS)
    rotation = rotation_from_vector(np.array([1.2, -1.5, 1.4]))
    turned = replace(calibration, mount_from_sensor=Pose(rotation, (1.0, 2.0, 3.0)))
    # A UR controller writes the rotation vector in rad; its std is a difference quotient.
    std = propagate_to_numbers(turned.mount_from_sensor, turned.covariance, "ur")[3:]
    record = turned.to_dict()
    np.testing.assert_allclose(record["rotation_vector_std_deg"], np.degrees(std), rtol=1e-5)


def test_rotating_the_base_rotates_the_target_and_not_the_sensor():
    profiles, flanges = sphere_scene(9, 8)
    other_from_base = Pose.from_matrix(MOUNT.matrix)
    here = calibrate_hand_eye_sphere(profiles, flanges, settings=FEW_TRIALS)
    there = calibrate_hand_eye_sphere(
        profiles, [other_from_base @ pose for pose in flanges], settings=FEW_TRIALS
    )
    assert_exact(there.flange_from_section, here.flange_from_section)
    moved = other_from_base.apply_one(here.sphere.centre)
    np.testing.assert_allclose(there.sphere.centre, moved, atol=EXACT_MM)


def test_the_order_of_the_poses_does_not_matter():
    profiles, flanges = sphere_scene(10, 8)
    order = np.random.default_rng(0).permutation(8)
    here = calibrate_hand_eye_sphere(profiles, flanges, settings=FEW_TRIALS)
    there = calibrate_hand_eye_sphere(
        [profiles[i] for i in order], [flanges[i] for i in order], settings=FEW_TRIALS
    )
    assert_exact(there.flange_from_section, here.flange_from_section)
    np.testing.assert_allclose(there.residuals, here.residuals[order], atol=EXACT_MM)


@pytest.mark.parametrize(("shift", "turned"), [(30.0, 5.0), (2.0, 0.5)])
def test_a_wrong_pose_is_rejected(shift, turned):
    profiles, flanges = sphere_scene(11)
    flanges[7] = wrong_pose(flanges[7], shift, turned, np.random.default_rng(1))
    found = calibrate_hand_eye_sphere(profiles, flanges)
    assert [pose.index for pose in found.rejected] == [7]
    assert "mm off the prediction of the other poses" in found.rejected[0].reason
    assert normalised_error(found) < FAR_OUT


def test_a_profile_without_the_sphere_is_rejected():
    profiles, flanges = sphere_scene(12)
    profiles[3] = type(profiles[3])(np.full((640, 2), np.nan))
    found = calibrate_hand_eye_sphere(profiles, flanges)
    assert [pose.index for pose in found.rejected] == [3]
    assert "no sphere found" in found.rejected[0].reason
    assert np.isnan(found.residuals[3])


def test_a_wrong_board_is_rejected():
    boards, flanges = board_scene(13)
    flanges[2] = wrong_pose(flanges[2], 5.0, 1.0, np.random.default_rng(2))
    found = calibrate_hand_eye_board(boards, flanges)
    assert [pose.index for pose in found.rejected] == [2]


def test_leave_one_out_residuals_are_those_of_a_calibration_without_the_pose():
    profiles, flanges = sphere_scene(14)
    stated = replace(FEW_TRIALS, robot_std=(0.05, np.radians(0.01)))
    whole = calibrate_hand_eye_sphere(profiles, flanges, settings=stated)
    part = calibrate_hand_eye_sphere(profiles[1:], flanges[1:], settings=stated)
    centre = (flanges[0] @ part.flange_from_section).inverse().apply_one(part.sphere.centre)
    points = profiles[0].points[~np.isnan(profiles[0].points[:, 0])]
    # To first order the mean misfit of the points along their normals is that of the circle.
    gaps = np.linalg.norm(np.column_stack([points, np.zeros(len(points))]) - centre, axis=1)
    assert whole.leave_one_out_residuals[0] > whole.residuals[0]
    assert np.abs(np.mean(gaps - part.sphere.radius)) < 2 * whole.leave_one_out_residuals[0] + 0.01


LONG = 1.07
SIGMAS = 4.0  # of one number; chance 6e-5


def test_wrong_height_scale_gives_a_warning_and_no_error_of_the_radius():
    profiles, flanges = sphere_scene(17, view=replace(USUAL, height_scale=LONG))
    found = calibrate_hand_eye_sphere(profiles, flanges, settings=FEW_TRIALS)
    factor, std = found.height_scale
    assert abs(factor - 1 / LONG) < SIGMAS * std
    assert abs(found.sphere.radius - RADIUS) < SIGMAS * found.sphere.radius_std
    assert "heights must be multiplied by 0.93" in found.warnings[0]
    assert "radius (" not in found.warnings[0]


def test_a_wrong_given_radius_is_named_beside_the_heights():
    found = calibrate_hand_eye_sphere(*sphere_scene(3), RADIUS * 1.015, settings=FEW_TRIALS)
    assert "check the given radius (calibrate without it" in found.warnings[0]


@pytest.mark.parametrize("factor", [5, 1000])
def test_a_given_radius_that_is_far_too_large_is_named_as_the_cause(factor):
    message = f"far less than the given radius of {factor * RADIUS:g} mm"
    with pytest.raises(CalibrationFailed, match=message):
        calibrate_hand_eye_sphere(*sphere_scene(3), factor * RADIUS, settings=FEW_TRIALS)


@pytest.mark.parametrize(
    "calibrate", [calibrate_hand_eye_sphere, calibrate_hand_eye_plane, calibrate_hand_eye_board]
)
def test_one_pose_instead_of_a_sequence_is_rejected_with_the_remedy(calibrate):
    with pytest.raises(TypeError, match="got one Pose: put it into a list"):
        calibrate([], Pose())


def test_a_given_radius_that_is_far_too_small_is_named_as_the_cause():
    with pytest.raises(
        CalibrationFailed, match=r"radii of up to 20 mm, more than the given radius of 10 mm"
    ):
        calibrate_hand_eye_sphere(*sphere_scene(3), RADIUS / 2, settings=FEW_TRIALS)


def test_correct_height_scale_gives_no_warning():
    found = calibrate_hand_eye_sphere(*sphere_scene(18), settings=FEW_TRIALS)
    factor, std = found.height_scale
    assert abs(factor - 1) < SIGMAS * std
    assert found.warnings == ()


@pytest.mark.parametrize("scene", [sphere_scene, plane_scene])
def test_correlated_points_increase_the_covariance(scene):
    calibrate = {sphere_scene: calibrate_hand_eye_sphere, plane_scene: calibrate_hand_eye_plane}
    stated = replace(FEW_TRIALS, robot_std=(0.002, np.radians(0.0005)))
    found = []
    for correlation in (0.0, 5.0):
        view = replace(USUAL, correlation=correlation)
        profiles, flanges = scene(19, 12, view=view, robot=PERFECT)
        found.append(calibrate[scene](profiles, flanges, settings=stated))
        assert normalised_error(found[-1]) < FAR_OUT
    assert found[1].working_point_std > 2 * found[0].working_point_std


def test_pose_is_available_only_under_the_name_of_its_frames():
    found = calibrate_hand_eye_sphere(*sphere_scene(15, 8), settings=FEW_TRIALS)
    with pytest.raises(ValueError, match="expected a calibration of a camera, eye to hand"):
        _ = found.base_from_camera
    with pytest.raises(ValueError, match="expected a point"):
        found.std_at((1, 2, 3, 4))
    boards, flanges = board_scene(15, 6)
    with pytest.raises(ValueError, match="expected a calibration on a sphere, got Pose"):
        _ = calibrate_hand_eye_board(boards, flanges).sphere


def test_the_same_input_gives_the_same_bytes():
    scene = sphere_scene(16, 8)
    first, second = (calibrate_hand_eye_sphere(*scene, settings=FEW_TRIALS) for _ in range(2))
    assert first.covariance.tobytes() == second.covariance.tobytes()


@pytest.mark.parametrize("kind", STANDING)
def test_pairs_stored_twice_count_once_and_are_named(kind):
    scene, calibrate = STANDING[kind]
    seen, flanges = scene(31, 10)
    once = calibrate(seen, flanges, settings=FEW_TRIALS)
    found = calibrate(seen + seen[:1] * 4, flanges + flanges[:1] * 4, settings=FEW_TRIALS)
    assert [pose.index for pose in found.rejected] == list(range(len(seen), len(seen) + 4))
    assert all("as pose 0, stored twice" in pose.reason for pose in found.rejected)
    assert found.covariance == pytest.approx(once.covariance)
    assert np.isnan(found.residuals[-4:]).all()


def test_a_given_radius_is_returned():
    found = calibrate_hand_eye_sphere(*sphere_scene(1), RADIUS, settings=FEW_TRIALS)
    assert (found.sphere.radius, found.sphere.radius_std) == (RADIUS, 0.0)
