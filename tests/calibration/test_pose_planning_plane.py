"""Planned poses for a plate: predicted and real accuracy, degenerate sets, errors."""

from dataclasses import replace
from itertools import chain

import numpy as np
import pytest

from lsvision.calibration.hand_eye import calibrate_hand_eye_plane
from lsvision.calibration.observations import stack_flange_poses
from lsvision.calibration.plane_line import find_plane_line
from lsvision.calibration.plane_observations import PlanePlanningTarget
from lsvision.calibration.pose_planning import PLANE_DEFAULTS, plan_hand_eye_poses_plane
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import Plane, Pose
from lsvision.simulate.hand_eye import (
    TargetMotion,
    draw_section_poses_about,
    perturb_pose,
    rotation_from_vector,
    simulate_plane_profile,
)
from tests.calibration.hand_eye_scenes import FEW_TRIALS, MOUNT, QUIET, TARGET, USUAL, WORKING_Y

SETTINGS = replace(PLANE_DEFAULTS, working_y=WORKING_Y, count=6)
PLANE = Plane((0.1, -0.05, 1.0), 310.0)
POINT = TARGET - PLANE.signed_distances(TARGET) * PLANE.normal
MOTION = TargetMotion(tilt=np.radians(40), working_y=WORKING_Y, offset=0.0)
WORK = np.array([0.0, WORKING_Y, 0.0])
NOMINAL = Pose(
    rotation_from_vector(np.array([0.0, 0.008, 0.0])) @ MOUNT.rotation, MOUNT.translation + 1.0
)
SAME = 1e-9  # mm or mm of prediction; the same numbers by another way
SAME_FRACTION = 1e-4  # of a prediction; what is taken for known beforehand weighs less
AS_PREDICTED = 4.0  # sigmas of an error in three axes
CLEARLY = 0.75  # of the sigma and error after as many random poses; 0.51 and 0.49 seen
ROBOT = (0.05, np.radians(0.01))


def flanges_about(count, motion, rng):
    return [pose @ MOUNT.inverse() for pose in draw_section_poses_about(TARGET, count, motion, rng)]


def taken(flanges, rng, view=USUAL):
    """Profiles and what the robot reports."""
    sections = [flange @ MOUNT for flange in flanges]
    profiles = [simulate_plane_profile(PLANE.transformed(s.inverse()), view, rng) for s in sections]
    return profiles, [perturb_pose(flange, *ROBOT, rng) for flange in flanges]


def calibrated(*sets):
    profiles, flanges = zip(*sets, strict=True)
    return calibrate_hand_eye_plane([*chain(*profiles)], [*chain(*flanges)], settings=FEW_TRIALS)


def error_at_work(found):
    return np.linalg.norm(found.flange_from_section.apply_one(WORK) - MOUNT.apply_one(WORK))


def test_each_pose_decreases_the_predicted_std_for_a_plate():
    plan = plan_hand_eye_poses_plane(NOMINAL, PLANE, POINT, settings=SETTINGS)
    assert len(plan.base_from_flanges) == 6
    assert (np.diff(plan.predicted_std) < 0).all()
    more = plan_hand_eye_poses_plane(
        NOMINAL, PLANE, POINT, measured=plan.base_from_flanges, settings=SETTINGS
    )
    assert more.predicted_std[0] < plan.predicted_std[-1]


@pytest.mark.slow
def test_six_planned_poses_have_a_smaller_error_than_six_random_ones():
    stds, errors = [], []
    for seed in range(12):
        rng = np.random.default_rng([9, seed])
        first = taken(flanges_about(8, MOTION, rng), rng)
        nominal = perturb_pose(MOUNT, 1.0, np.radians(0.5), rng)
        plan = plan_hand_eye_poses_plane(
            nominal, PLANE, POINT, measured=first[1], settings=replace(SETTINGS, seed=seed)
        )
        ways = (plan.base_from_flanges, flanges_about(6, MOTION, rng))
        found = [calibrated(first, taken(way, rng)) for way in ways]
        stds.append([each.working_point_std for each in found])
        errors.append([error_at_work(each) for each in found])
    (planned_std, random_std), (planned, random) = (
        np.median(stds, axis=0),
        np.median(errors, axis=0),
    )
    assert planned_std < CLEARLY * random_std
    assert planned < CLEARLY * random


UNFIT = {
    "never rotated": (replace(MOTION, tilt=0.0, spin=0.0), r"never rotated.*tilted .* two axes"),
    "one axis": (
        replace(MOTION, tilt=0.0),
        r"about one axis, .* only.*tilted .* perpendicular to it",
    ),
    "hardly tilted": (
        replace(MOTION, tilt=np.radians(6), spin=0.1, depth=0.0, sideways=0.0),
        r"sensor is determined to .* mm only in .* tilted",
    ),
}


@pytest.mark.parametrize("case", UNFIT)
def test_planned_poses_add_the_motion_that_was_missing(case):
    motion, message = UNFIT[case]
    rng = np.random.default_rng(4)
    first = taken(flanges_about(8, motion, rng), rng)
    with pytest.raises(DegenerateGeometry, match=message):
        calibrated(first)
    plan = plan_hand_eye_poses_plane(NOMINAL, PLANE, POINT, measured=first[1], settings=SETTINGS)
    found = calibrated(first, taken(plan.base_from_flanges, rng))
    assert found.rejected == ()
    assert error_at_work(found) < AS_PREDICTED * plan.predicted_std[-1]
    assert found.working_point_std < 2 * plan.predicted_std[-1]


def test_predicted_lines_equal_those_of_profiles():
    rng = np.random.default_rng(2)
    flanges = flanges_about(5, replace(MOTION, sideways=0.0), rng)
    profiles, _ = taken(flanges, rng, QUIET)
    ahead, sections = (
        PlanePlanningTarget(PLANE, POINT, PLANE_DEFAULTS.line_std),
        [pose @ MOUNT for pose in flanges],
    )
    places, shows = ahead.check_visibility(sections)
    lines = ahead.predict_observations(
        places, sections, stack_flange_poses(flanges, "eye_in_hand", ROBOT)
    )
    for profile, middle, along in zip(profiles, lines.midpoints, lines.directions, strict=True):
        seen = find_plane_line(profile)
        np.testing.assert_allclose(seen.midpoint, middle, rtol=0, atol=SAME)
        np.testing.assert_allclose(abs(seen.direction @ along), 1.0, rtol=0, atol=SAME)
    assert shows.all()


@pytest.mark.parametrize("normal", [(0, 0, -1), (1, 0, 0), (-0.3, 0.9, -0.2), (0, 0, 1)])
def test_a_plate_on_a_wall_or_a_ceiling_is_measured_from_its_front(normal):
    plate = Plane(normal, 700.0)
    plan = plan_hand_eye_poses_plane(NOMINAL, plate, 700 * plate.normal, settings=SETTINGS)
    for flange in plan.base_from_flanges:
        section = flange @ NOMINAL
        assert plate.signed_distances(section.translation) > 0
        assert section.rotation[:, 1] @ plate.normal > np.cos(
            np.hypot(PLANE_DEFAULTS.max_tilt, PLANE_DEFAULTS.max_tilt)
        )


def test_the_planned_side_is_the_measured_one():
    flanges = flanges_about(4, MOTION, np.random.default_rng(3))
    back = Plane(-PLANE.normal, -PLANE.distance)
    one, other = (
        plan_hand_eye_poses_plane(MOUNT, plane, POINT, measured=flanges, settings=SETTINGS)
        for plane in (PLANE, back)
    )
    assert one.indices == other.indices


def test_a_plan_rotates_with_the_base_frame():
    rng = np.random.default_rng(5)
    flanges, turned = (
        flanges_about(40, MOTION, rng),
        Pose(rotation_from_vector(rng.normal(size=3)), (50, 9, -70)),
    )
    first, second = (
        plan_hand_eye_poses_plane(
            MOUNT,
            PLANE.transformed(world),
            world.apply_one(POINT),
            # Without poses before, the little that is taken for known does not turn.
            measured=[world @ pose for pose in flanges[:8]],
            candidates=[world @ pose for pose in flanges[8:]],
            settings=SETTINGS,
        )
        for world in (Pose(), turned)
    )
    assert first.indices == second.indices
    np.testing.assert_allclose(first.predicted_std, second.predicted_std, rtol=SAME_FRACTION)


@pytest.mark.parametrize("wrong", [{"count": 0}, {"line_std": (0.0, 0.0)}, {"circle_std": np.nan}])
def test_counts_and_standard_deviations_must_be_positive(wrong):
    with pytest.raises(ValueError, match="positive counts and standard deviations, got PosePlanS"):
        replace(SETTINGS, **wrong)


def test_no_candidates_are_rejected_for_a_plate():
    flanges = flanges_about(8, MOTION, np.random.default_rng(6))
    back = Plane(-PLANE.normal, -PLANE.distance)
    with pytest.raises(DegenerateGeometry, match=r"0 candidate poses see the plate .* and 6 are"):
        plan_hand_eye_poses_plane(MOUNT, back, POINT, candidates=flanges, settings=SETTINGS)
