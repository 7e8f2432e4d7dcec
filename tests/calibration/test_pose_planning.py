"""Planned poses for a sphere: predicted and real accuracy, errors."""

import numpy as np
import pytest

from lsvision.calibration.hand_eye import calibrate_hand_eye_sphere
from lsvision.calibration.pose_planning import PosePlanSettings, plan_hand_eye_poses
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import Pose
from lsvision.simulate.hand_eye import perturb_pose, simulate_sphere_profile
from tests.calibration.hand_eye_scenes import MOUNT, RADIUS, TARGET, USUAL, WORKING_Y, pose_errors

SETTINGS = PosePlanSettings(working_y=WORKING_Y, count=6)


def test_each_pose_decreases_the_predicted_std():
    plan = plan_hand_eye_poses(MOUNT, TARGET, RADIUS, settings=SETTINGS)
    assert len(plan.base_from_flanges) == 6
    assert (np.diff(plan.predicted_std) < 0).all()


def test_six_planned_poses_have_a_smaller_predicted_std_than_six_random_ones():
    plan = plan_hand_eye_poses(MOUNT, TARGET, RADIUS, settings=SETTINGS)
    few = PosePlanSettings(working_y=WORKING_Y, count=6, candidates=6)
    random = plan_hand_eye_poses(MOUNT, TARGET, RADIUS, settings=few)
    assert plan.predicted_origin_std[-1] < 0.8 * random.predicted_origin_std[-1]


def test_measured_poses_are_taken_into_account():
    plan = plan_hand_eye_poses(MOUNT, TARGET, RADIUS, settings=SETTINGS)
    more = plan_hand_eye_poses(
        MOUNT, TARGET, RADIUS, measured=plan.base_from_flanges, settings=SETTINGS
    )
    assert more.predicted_std[0] < plan.predicted_std[-1]


def test_error_of_a_calibration_with_planned_poses_is_as_predicted():
    settings = PosePlanSettings(working_y=WORKING_Y, count=10)
    plan = plan_hand_eye_poses(MOUNT, TARGET, RADIUS, settings=settings)
    rng = np.random.default_rng(1)
    profiles, flanges = [], []
    for flange in plan.base_from_flanges:
        centre = (flange @ MOUNT).inverse().apply_one(TARGET)
        profiles.append(simulate_sphere_profile(centre, RADIUS, USUAL, rng))
        flanges.append(perturb_pose(flange, 0.05, np.radians(0.01), rng))
    found = calibrate_hand_eye_sphere(profiles, flanges)
    error = found.flange_from_section.apply_one(found.working_point) - MOUNT.apply_one(
        found.working_point
    )
    assert np.linalg.norm(error) < 4 * plan.predicted_std[-1]
    assert np.linalg.norm(pose_errors(found.flange_from_section, MOUNT)[3:]) < np.radians(0.5)


def test_no_candidates_and_invalid_radius_are_rejected():
    with pytest.raises(DegenerateGeometry, match="0 candidate poses cut the sphere and 6"):
        plan_hand_eye_poses(MOUNT, TARGET, RADIUS, candidates=[Pose()], settings=SETTINGS)
    with pytest.raises(ValueError, match="positive, finite radius"):
        plan_hand_eye_poses(MOUNT, TARGET, 0.0)


@pytest.mark.parametrize("limit", ["max_tilt", "max_spin", "max_depth_offset", "max_cut_offset"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0])
def test_limits_of_planned_poses_are_finite(limit, value):
    with pytest.raises(ValueError, match="expected finite tilts, spin and offsets"):
        PosePlanSettings(**{limit: value})
