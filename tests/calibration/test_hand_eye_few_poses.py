"""Hand-eye calibration from few poses: none rejected, joint regions with Student's factor."""

import math

import numpy as np
import pytest

from lsvision.calibration.errors_in_variables import count_degrees_of_freedom
from lsvision.calibration.hand_eye import (
    HandEyeSettings,
    calibrate_hand_eye_board,
    calibrate_hand_eye_sphere,
)
from lsvision.calibration.observations import States, stack_flange_poses
from lsvision.calibration.robot_std import compute_robot_whitening
from lsvision.calibration.sphere_observations import SphereObservations
from lsvision.geometry import Pose
from lsvision.simulate.hand_eye import rotation_from_vector
from tests.calibration.hand_eye_scenes import (
    FEW_TRIALS,
    MOUNT,
    RADIUS,
    board_scene,
    pose_errors,
    sphere_scene,
)

ROBOT = (0.05, 0.01)  # mm, deg


@pytest.mark.parametrize("seed", [2167, 2202])
def test_five_poses_of_a_known_sphere_are_not_ambiguous(seed):
    found = calibrate_hand_eye_sphere(*sphere_scene(seed, 5), RADIUS)
    errors = pose_errors(found.flange_from_section, MOUNT)
    chi2 = errors @ np.linalg.solve(found.covariance, errors)
    assert chi2 < found.coverage_factor(0.999, quantities=6) ** 2
    assert found.ambiguity_ratio > 1.2


def test_few_poses_widen_the_region_and_many_do_not():
    few, many = (
        calibrate_hand_eye_board(*board_scene(3, count), settings=FEW_TRIALS) for count in (4, 40)
    )
    assert 4 < few.degrees_of_freedom < 30 < many.degrees_of_freedom
    # 16.8 is the quantile of chi^2 at 99 % for 6 quantities
    assert few.coverage_factor(0.99, quantities=6) > 1.1 * math.sqrt(16.8)
    assert many.coverage_factor(0.99, quantities=6) < 1.02 * math.sqrt(16.8)


def test_a_stated_robot_has_the_factor_of_the_normal_distribution():
    settings = HandEyeSettings(robot_std=(ROBOT[0], math.radians(ROBOT[1])))
    found = calibrate_hand_eye_board(*board_scene(3, 8), settings=settings)
    assert found.degrees_of_freedom == math.inf
    assert found.coverage_factor() == pytest.approx(1.96, abs=1e-3)


@pytest.mark.slow
def test_regions_from_six_poses_have_their_level():
    inside = []
    for seed in range(4000, 4100):
        found = calibrate_hand_eye_board(*board_scene(seed, 6, robot=(0.2, 0.05)))
        errors = pose_errors(found.flange_from_camera, MOUNT)
        chi2 = errors @ np.linalg.solve(found.covariance, errors)
        inside.append(chi2 < found.coverage_factor(0.95, quantities=6) ** 2)
    assert np.mean(inside) > 0.95 - 3 * math.sqrt(0.95 * 0.05 / len(inside))


def test_the_position_of_a_robot_that_mainly_rotates_wrongly_is_not_overstated():
    position, rotation = 0.02, 0.1
    estimates = [
        calibrate_hand_eye_board(
            *board_scene(seed, 12, robot=(position, rotation)), settings=FEW_TRIALS
        ).robot_std
        for seed in range(300, 306)
    ]
    assert np.median(estimates, axis=0)[0] < 1.5 * position
    assert np.median(estimates, axis=0)[1] == pytest.approx(math.radians(rotation), rel=0.2)


@pytest.mark.parametrize(("radius_std", "unknowns"), [(np.inf, 11), (1e-4, 10)])
def test_a_wide_prior_is_no_degree_of_freedom_and_a_narrow_one_no_unknown(radius_std, unknowns):
    rng = np.random.default_rng(5)
    count = 9
    flanges = [
        Pose(rotation_from_vector(rng.normal(0, 0.5, 3)), rng.normal(0, 100, 3))
        for _ in range(count)
    ]
    circles = np.column_stack([rng.uniform(-30, 30, (count, 2)), rng.uniform(10, 18, count)])
    gradients = rng.normal(0, 10, (count, 2, 3))
    observations = SphereObservations(
        circles,
        np.tile(1e-4 * np.eye(3), (count, 1, 1)),
        gradients,
        stack_flange_poses(flanges, "eye_in_hand", (0.05, 1e-4)),
        (RADIUS, radius_std),
        np.zeros(count, dtype=np.int64),
    )
    states = States(np.eye(3)[None], np.zeros((1, 3)), np.array([[[50.0, 0, 0, RADIUS, 0]]]))
    whitening = compute_robot_whitening(observations, states, (1.0, 1.0))
    dof = count_degrees_of_freedom(observations, states, np.ones(count), whitening)
    assert dof == pytest.approx(3 * count - unknowns, abs=0.1)
