"""Simulated hand-eye data; the truth is from `simulate`, independent of `calibration`."""

import numpy as np

from lsvision.calibration.hand_eye import HandEyeSettings
from lsvision.calibration.pose_outliers import OutlierSettings
from lsvision.geometry import Plane, Pose
from lsvision.simulate.hand_eye import (
    SectionView,
    TargetMotion,
    draw_section_poses_about,
    perturb_pose,
    rotation_from_vector,
    simulate_plane_profile,
    simulate_sphere_profile,
)

RADIUS = 20.0
TARGET = np.array([800.0, 100.0, 300.0])
MOUNT = Pose(rotation_from_vector(np.array([0.4, -1.1, 2.0])), (30.0, -60.0, 150.0))
WORKING_Y = -150.0
MOTION = TargetMotion(offset=0.8 * RADIUS, working_y=WORKING_Y)
QUIET = SectionView(range_std=0.0)
USUAL = SectionView(range_std=0.05)
FEW_TRIALS = HandEyeSettings(outliers=OutlierSettings(trials=8))
"""For scenes without a wrong pose, of which any selection will do: a plane needs 4 s of processor
time with 40."""


def sphere_scene(seed, count=12, *, view=USUAL, robot=(0.05, 0.01), motion=MOTION, targets=None):
    """Profiles and reported flange poses; `targets` gives each pose's own sphere centre."""
    rng = np.random.default_rng(seed)
    profiles, flanges = [], []
    while len(flanges) < count:
        target = TARGET if targets is None else targets[len(flanges)]
        (section,) = draw_section_poses_about(target, 1, motion, rng)
        profile = simulate_sphere_profile(section.inverse().apply_one(target), RADIUS, view, rng)
        if len(profile) - profile.lost >= 60:
            profiles.append(profile)
            flange = section @ MOUNT.inverse()
            flanges.append(perturb_pose(flange, robot[0], np.radians(robot[1]), rng))
    return profiles, flanges


def plane_scene(seed, count=20, *, view=USUAL, robot=(0.05, 0.01)):
    rng = np.random.default_rng(seed)
    plane = Plane((0.1, -0.05, 1.0), 310.0)
    motion = TargetMotion(tilt=np.radians(40), working_y=WORKING_Y, offset=0.0)
    profiles, flanges = [], []
    for section in draw_section_poses_about(TARGET, count, motion, rng):
        profiles.append(simulate_plane_profile(plane.transformed(section.inverse()), view, rng))
        flanges.append(perturb_pose(section @ MOUNT.inverse(), robot[0], np.radians(robot[1]), rng))
    return profiles, flanges


def board_scene(seed, count=12, *, robot=(0.05, 0.01), board_noise=(0.0, 0.0)):
    """Board poses before a camera at MOUNT, its noise in mm and deg."""
    rng = np.random.default_rng(seed)
    base_from_board = Pose(rotation_from_vector(np.array([0.2, -0.1, 0.4])), TARGET)
    boards, flanges = [], []
    for _ in range(count):
        lean = rotation_from_vector(rng.uniform(-1, 1, 3) * np.radians([35, 35, 170]))
        seen = Pose(lean @ np.diag([1.0, -1.0, -1.0]), (*rng.uniform(-40, 40, 2), 350.0))
        flange = base_from_board @ seen.inverse() @ MOUNT.inverse()
        boards.append(perturb_pose(seen, board_noise[0], np.radians(board_noise[1]), rng))
        flanges.append(perturb_pose(flange, robot[0], np.radians(robot[1]), rng))
    return boards, flanges


def pose_errors(found, truth):
    """Six errors (mm, rad), rotation small and from the left; written out by hand."""
    delta = found.rotation @ truth.rotation.T
    small = [delta[2, 1] - delta[1, 2], delta[0, 2] - delta[2, 0], delta[1, 0] - delta[0, 1]]
    return np.r_[found.translation - truth.translation, np.array(small) / 2]


def wrong_pose(pose, shift_mm, turn_deg, rng):
    axis, way = rng.normal(size=3), rng.normal(size=3)
    return Pose(
        rotation_from_vector(axis / np.linalg.norm(axis) * np.radians(turn_deg)) @ pose.rotation,
        pose.translation + way / np.linalg.norm(way) * shift_mm,
    )
