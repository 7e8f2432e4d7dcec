"""Hand-eye calibrations beside goals G11 to G16: ``python -m tests.bench.hand_eye [RUNS [ROWS]]``.

RUNS is the number of simulated calibrations for each row, ROWS the beginning of the names of the
rows to measure, such as G15.
"""

import sys
import time
from dataclasses import dataclass
from functools import partial

import numpy as np

from lsvision.calibration.board_pose import estimate_board_pose
from lsvision.calibration.hand_eye import (
    HandEyeSettings,
    calibrate_hand_eye_board,
    calibrate_hand_eye_plane,
    calibrate_hand_eye_sphere,
)
from lsvision.calibration.pose_planning import PosePlanSettings, plan_hand_eye_poses
from lsvision.geometry import Plane, Pose
from lsvision.sensors.camera import Camera
from lsvision.simulate.hand_eye import (
    SectionView,
    TargetMotion,
    draw_section_poses_about,
    perturb_pose,
    rotation_from_vector,
    simulate_plane_profile,
    simulate_sphere_profile,
)
from tests.calibration.hand_eye_scenes import RADIUS, TARGET

WORK = np.array([0.0, -150.0, 0.0])
"""Working point in the section frame, at which errors are stated. Units: mm."""
T_QUANTILE = 2.06
"""97.5 % quantile of Student's t for 26 degrees of freedom: 12 poses with 3 residuals each, and 10
unknowns (mount, centre and radius of the sphere)."""
MIN_POINTS = 60
"""Smallest number of points of a simulated profile of the sphere."""
MIN_CORRECT_MM = 0.3
"""Error at the working point up to which a calibration with a wrong pose is correct in any case."""
CAMERA = Camera(
    [[2264.0, 0, 640], [0, 2264.0, 512], [0, 0, 1]], [-0.12, 0.1, 0, 0, 0], (1280, 1024)
)
BOARD = np.array([[12.0 * i, 12.0 * j, 0.0] for j in range(7) for i in range(9)])


@dataclass(frozen=True)
class Case:
    """Errors of robot and sensor, and number of poses of a simulated calibration."""

    position_std: float  # of the robot, mm per axis
    rotation_std_deg: float  # of the robot, per axis
    range_std: float = 0.05  # mm
    count: int = 12
    mounting: str = "eye_in_hand"
    correlation: float = 0.0
    height_scale: float = 1.0

    @property
    def view(self):
        return SectionView(
            range_std=self.range_std,
            correlation=self.correlation,
            height_scale=self.height_scale,
        )

    def reported(self, flange, rng):
        """Return a flange pose as the robot reports it, inverted for a stationary sensor."""
        pose = flange if self.mounting == "eye_in_hand" else flange.inverse()
        return perturb_pose(pose, self.position_std, np.radians(self.rotation_std_deg), rng)


def random_mount(rng):
    """Return a random pose of the sensor on the flange."""
    return Pose(
        rotation_from_vector(rng.normal(size=3) * 2), rng.uniform((-100, -100, 50), (100, 100, 250))
    )


def sphere_data(rng, case):
    """Return true mount, profiles of a sphere from random recommended poses, and reported poses."""
    mount, view = random_mount(rng), case.view
    motion = TargetMotion(offset=0.8 * RADIUS, working_y=WORK[1])
    profiles, poses = [], []
    while len(poses) < case.count:
        (section,) = draw_section_poses_about(TARGET, 1, motion, rng)
        profile = simulate_sphere_profile(section.inverse().apply_one(TARGET), RADIUS, view, rng)
        if len(profile) - profile.lost >= MIN_POINTS:
            profiles.append(profile)
            poses.append(case.reported(section @ mount.inverse(), rng))
    return mount, profiles, poses


def plane_data(rng, case):
    """Return the same for a plane, from poses tilted by up to 40 deg."""
    mount = random_mount(rng)
    plane = Plane((0.1, -0.05, 1.0), 310.0)
    motion = TargetMotion(tilt=np.radians(40), working_y=WORK[1], offset=0.0)
    sections = draw_section_poses_about(TARGET, case.count, motion, rng)
    profiles = [
        simulate_plane_profile(plane.transformed(s.inverse()), case.view, rng) for s in sections
    ]
    return mount, profiles, [case.reported(s @ mount.inverse(), rng) for s in sections]


def planned_data(rng, case):
    """Return the same for a sphere, from poses planned with a nominal mount.

    Its errors are 1 mm and 0.5 deg per axis (one sigma), as of a mount according to a drawing.
    """
    mount = random_mount(rng)
    nominal = perturb_pose(mount, 1.0, np.radians(0.5), rng)
    plan = plan_hand_eye_poses(
        nominal,
        TARGET,
        RADIUS,
        settings=PosePlanSettings(working_y=WORK[1], seed=int(rng.integers(1 << 30))),
    )
    profiles, poses = [], []
    for flange in plan.base_from_flanges:
        section = flange @ mount
        profiles.append(
            simulate_sphere_profile(section.inverse().apply_one(TARGET), RADIUS, case.view, rng)
        )
        poses.append(case.reported(flange, rng))
    return mount, profiles, poses


def small_rotation_vector(rotation):
    """Return the rotation vector of a small rotation; shares no code with the library."""
    twice_the_vector = np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    return twice_the_vector / 2


def errors(found, truth, work=WORK):
    """Return the errors of a pose (6,), and their lengths (3,).

    The errors are translation (mm) and rotation (rad); the lengths are those of translation (mm),
    rotation (deg) and of the error at the point `work` (mm).
    """
    translation = found.translation - truth.translation
    rotation = small_rotation_vector(found.rotation @ truth.rotation.T)
    at_work = np.linalg.norm(found.apply_one(work) - truth.apply_one(work))
    lengths = np.linalg.norm(translation), np.degrees(np.linalg.norm(rotation)), at_work
    return np.r_[translation, rotation], np.array(lengths)


def normalised_squared_error(found, error):
    """Return error' covariance^-1 error / 6 (NEES/6), 1 on average for a valid covariance."""
    return error @ np.linalg.solve(found.covariance, error) / 6


@dataclass(frozen=True)
class SectionRuns:
    """Results of n calibrations.

    Lengths of the errors as of `errors` (n, 3), `normalised_squared_error` (n,), the longest time
    (s), errors of a sphere's radius over its std (n,), and the number of poses rejected.
    """

    lengths: np.ndarray
    nees: np.ndarray
    max_seconds: float
    radius_sigmas: np.ndarray
    rejected: int


def section_runs(case, runs, data=sphere_data, seed=0, **settings):
    """Return the results of so many calibrations; `settings` are those of `HandEyeSettings`."""
    solve = calibrate_hand_eye_plane if data is plane_data else calibrate_hand_eye_sphere
    rows, nees, seconds, radius_sigmas, rejected = [], [], [], [], 0
    for run in range(runs):
        rng = np.random.default_rng([seed, run])
        truth, profiles, poses = data(rng, case)
        begin = time.perf_counter()
        found = solve(profiles, poses, mounting=case.mounting, settings=HandEyeSettings(**settings))
        seconds.append(time.perf_counter() - begin)
        error, lengths = errors(found.mount_from_sensor, truth)
        if data is not plane_data:
            radius_sigmas.append((found.sphere.radius - RADIUS) / found.sphere.radius_std)
        rows.append(lengths)
        nees.append(normalised_squared_error(found, error))
        rejected += len(found.rejected)
    return SectionRuns(
        np.array(rows), np.array(nees), max(seconds), np.array(radius_sigmas), rejected
    )


def report_section(name, case, goal, runs, data=sphere_data, **settings):
    """Print the row of calibrations from profiles; `goal` is text."""
    result = section_runs(case, runs, data, **settings)
    sigmas = np.abs(result.radius_sigmas)
    coverage = f"95 % of radius {np.mean(sigmas < T_QUANTILE):.2f} | " if len(sigmas) else ""
    rms = np.sqrt((result.lengths**2).mean(axis=0))
    high = np.quantile(result.lengths, 0.95, axis=0)
    print(
        f"{name:34} RMS {rms[0]:.3f} mm {rms[1]:.3f} deg {rms[2]:.3f} mm at work | 95 % "
        f"{high[0]:.3f} {high[1]:.3f} {high[2]:.3f} | NEES/6 {result.nees.mean():.2f} | "
        f"{coverage}{result.rejected} of {runs * case.count} correct poses rejected | "
        f"{result.max_seconds:.2f} s | goal {goal}",
        flush=True,
    )


def report_wrong_pose(name, shift_mm, angle_deg, goal, runs, case=Case(0.05, 0.01)):
    """Print how often a calibration with one wrong pose is correct, and how often it is rejected.

    Correct: an error at the working point below `MIN_CORRECT_MM`, or twice that of the calibration
    without the wrong pose.
    """
    correct = rejected = 0
    for run in range(runs):
        rng = np.random.default_rng([7, run])
        truth, profiles, poses = sphere_data(rng, case)
        clean = calibrate_hand_eye_sphere(profiles, poses).flange_from_section
        bad = int(rng.integers(len(poses)))
        axis = rng.normal(size=3)
        direction = rng.normal(size=3)
        poses[bad] = Pose(
            rotation_from_vector(axis / np.linalg.norm(axis) * np.radians(angle_deg))
            @ poses[bad].rotation,
            poses[bad].translation + direction / np.linalg.norm(direction) * shift_mm,
        )
        found = calibrate_hand_eye_sphere(profiles, poses)
        rejected += bad in [pose.index for pose in found.rejected]
        limit = max(MIN_CORRECT_MM, 2 * errors(clean, truth)[1][2])
        correct += errors(found.flange_from_section, truth)[1][2] < limit
    print(
        f"{name:34} correct {correct}/{runs}, wrong pose rejected {rejected}/{runs} | goal {goal}",
        flush=True,
    )


def report_board(name, goal, runs, case=Case(0.05, 0.01)):
    """Print the row of calibrations on a board."""
    rows, nees = [], []
    for run in range(runs):
        truth, found = board_run(np.random.default_rng([3, run]), case)
        error, lengths = errors(found.mount_from_sensor, truth, np.array([0, 0, 350.0]))
        rows.append(lengths)
        nees.append(normalised_squared_error(found, error))
    rms = np.sqrt((np.array(rows) ** 2).mean(axis=0))
    print(
        f"{name:34} RMS {rms[0]:.3f} mm {rms[1]:.4f} deg {rms[2]:.3f} mm at 350 mm | NEES/6 "
        f"{np.mean(nees):.2f} | goal {goal}",
        flush=True,
    )


def board_run(rng, case, corner_std=0.1):
    """Return the true mount and the result of one calibration on a board."""
    mount = random_mount(rng)
    centre = BOARD.mean(axis=0)
    estimates, poses = [], []
    while len(poses) < case.count:
        tilt = rotation_from_vector(rng.uniform(-1, 1, 3) * np.radians([35, 35, 180]))
        position = np.array([rng.uniform(-30, 30), rng.uniform(-30, 30), rng.uniform(300, 420)])
        rotation = tilt @ np.diag([1.0, -1.0, -1.0])  # the board faces the camera
        camera_from_board = Pose(rotation, position - rotation @ centre)
        pixels = CAMERA.project(camera_from_board.apply(BOARD))
        if (pixels < 0).any() or (pixels > [1279, 1023]).any():
            continue
        noisy = pixels + rng.normal(0, corner_std, pixels.shape)
        estimates.append(estimate_board_pose(noisy, BOARD, CAMERA))
        base_from_board = Pose(rotation_from_vector(np.array([0.2, -0.1, 0.4])), TARGET)
        flange = base_from_board @ camera_from_board.inverse() @ mount.inverse()
        poses.append(case.reported(flange, rng))
    found = calibrate_hand_eye_board(
        [estimate.camera_from_board for estimate in estimates],
        poses,
        covariances=[estimate.covariance for estimate in estimates],
        mounting=case.mounting,
    )
    return mount, found


def goals(runs):
    """Yield name and function of each row; the functions measure and print it."""
    perfect, good, usual = Case(0, 0), Case(0.02, 0.005), Case(0.05, 0.01)
    given = {"robot_std": (0.02, np.radians(0.005))}
    for label, data in (("random poses", sphere_data), ("planned poses", planned_data)):
        for number, robot, case, goal in (
            ("G11", "perfect robot", perfect, "95 %: 0.05 0.025 0.015"),
            ("G12", "0.02/0.005", good, "0.15 0.075 0.04"),
            ("G13", "0.05/0.01", usual, "0.28 0.15 0.085"),
        ):
            name = f"{number} {robot}, {label}"
            yield name, partial(report_section, name, case, goal, runs, data)
    name = "G12 robot stated"
    goal = "0.15 0.075 0.04, NEES 0.7-1.4"
    yield name, partial(report_section, name, good, goal, runs, **given)
    name = "G13 20 poses"
    many = Case(0.05, 0.01, count=20)
    yield name, partial(report_section, name, many, "0.20 0.11 0.065", runs)
    for name, shift_mm, angle_deg, goal in (
        ("G15 one of 12, 30 mm and 5 deg", 30, 5, ">= 96 %"),
        ("    one of 12, 2 mm and 0.5 deg", 2, 0.5, ">= 90 %"),
        ("    one of 12, 2 mm only", 2, 0, ">= 90 %"),
    ):
        yield name, partial(report_wrong_pose, name, shift_mm, angle_deg, goal, runs)
    name = "G16 board 12 poses"
    yield name, partial(report_board, name, "0.11 mm 0.018 deg", runs)
    yield from further_rows(runs, given)


def further_rows(runs, given):
    """Yield the same for correlated noise, a stationary sensor, and a plane as target.

    `given` are the settings that state the errors of the robot.
    """
    for columns in (3, 10):
        for label, settings in (("estimated", {}), ("stated", given)):
            case = Case(0.02, 0.005, correlation=columns)
            name = f"    correlated {columns} columns, robot {label}"
            yield name, partial(report_section, name, case, "NEES 0.7-1.4", runs, **settings)
    stationary = Case(0.05, 0.01, mounting="eye_to_hand")
    name = "    sphere, stationary sensor"
    yield name, partial(report_section, name, stationary, "0.28 0.15 0.085", runs)
    name = "    board, stationary camera"
    yield name, partial(report_board, name, "0.11 mm 0.018 deg", runs, stationary)
    for count, goal in ((12, ".45 .135 .28"), (20, ".29 .085 .18")):
        for mounting in ("eye_in_hand", "eye_to_hand"):
            case = Case(0.05, 0.01, count=count, mounting=mounting)
            name = f"    plane {count} poses, {mounting}"
            yield name, partial(report_section, name, case, goal, runs, plane_data)


def main(runs, only=""):
    """Measure the rows whose names begin with `only`."""
    for name, report in goals(runs):
        if name.strip().startswith(only):
            report()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50, *sys.argv[2:3])
