"""Rejection of outlying poses: all found, and no correct pose among them."""

import numpy as np
import pytest

from lsvision.calibration.errors_in_variables import fit_errors_in_variables
from lsvision.calibration.observations import stack_flange_poses
from lsvision.calibration.pose_outliers import (
    OutlierSettings,
    fit_with_outlier_rejection,
    joint_p_value,
    outlier_p_values,
)
from lsvision.calibration.sphere_observations import SpherePlanningTarget
from lsvision.geometry import Pose
from lsvision.simulate.hand_eye import TargetMotion, draw_section_poses_about, perturb_pose
from tests.calibration.hand_eye_scenes import MOUNT, RADIUS, TARGET, pose_errors, wrong_pose

CIRCLE_STD = 0.01
MIN_POSES = 6
SETTINGS = OutlierSettings(trials=8)
FAR = TargetMotion(offset=0.8 * RADIUS, working_y=-300.0)


def circles(seed, robot, wrong=(), shift_mm=0.0, count=12):
    """Observations of a sphere by a robot with errors in mm and deg, and of some wrong poses."""
    rng = np.random.default_rng(seed)
    sections = draw_section_poses_about(TARGET, count, FAR, rng)
    target = SpherePlanningTarget(TARGET, RADIUS, CIRCLE_STD, 0.85)
    flanges = [
        perturb_pose(section @ MOUNT.inverse(), robot[0], np.radians(robot[1]), rng)
        for section in sections
    ]
    for index in wrong:
        flanges[index] = wrong_pose(flanges[index], shift_mm, 0.0, rng)
    stacked = stack_flange_poses(flanges, "eye_in_hand", (0.05, np.radians(0.01)))
    positions, _ = target.check_visibility(sections)
    return target.predict_observations(positions, sections, stacked)


def inlier_fit(observations):
    return fit_with_outlier_rejection(
        observations, SETTINGS, min_poses=MIN_POSES, estimate_robot_std=True
    )


def chi2_of_truth(fit):
    found = Pose(fit.states.rotations[0], fit.states.translations[0])
    errors = pose_errors(found, MOUNT)
    return errors @ np.linalg.solve(fit.covariance[:6, :6], errors)


def test_correct_poses_of_a_robot_that_mainly_rotates_wrongly_are_kept():
    # The search alone takes 3 of these 12 poses for outliers.
    fit = inlier_fit(circles(72, robot=(0.02, 0.2)))
    assert fit.mask.all()
    assert chi2_of_truth(fit) < 16.8  # quantile of chi^2 at 99 % for 6 quantities


@pytest.mark.parametrize("shift_mm", [2.0, 5.0, 20.0])
def test_two_wrong_poses_of_twelve_are_found(shift_mm):
    fit = inlier_fit(circles(9, robot=(0.05, 0.01), wrong=(3, 8), shift_mm=shift_mm))
    assert np.flatnonzero(fit.mask == 0).tolist() == [3, 8]
    assert chi2_of_truth(fit) < 22.5  # quantile at 99.9 %


def test_one_pose_beside_a_stated_robot_has_the_p_value_of_the_f_test():
    observations = circles(4, robot=(0.05, 0.01))
    mask = np.ones(12)
    mask[5] = 0.0
    start = inlier_fit(observations).states
    fit = fit_errors_in_variables(observations, start, mask, estimate_robot_std=False)
    p_value = joint_p_value(observations, fit, np.array([5]))
    assert p_value == pytest.approx(outlier_p_values(fit)[5], rel=1e-6)
