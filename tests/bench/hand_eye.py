"""Goals G11-G16 of sensor-to-robot calibration, measured: ``python -m tests.bench.hand_eye``.

A number of runs a row may follow, and the beginning of the names of the rows: ``20 G15``.
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
    noisy_pose,
    plane_profile,
    rotation_from_vector,
    section_poses_about,
    sphere_profile,
)
from tests.calibration.hand_eye_scenes import RADIUS, TARGET

WORK = np.array([0.0, -150.0, 0.0])  # 150 mm before the sensor's origin
CAMERA = Camera(
    [[2264.0, 0, 640], [0, 2264.0, 512], [0, 0, 1]], [-0.12, 0.1, 0, 0, 0], (1280, 1024)
)
BOARD = np.array([[12.0 * i, 12.0 * j, 0.0] for j in range(7) for i in range(9)])


@dataclass(frozen=True)
class Case:
    position: float  # mm, one sigma per axis
    rotation_deg: float
    range_std: float = 0.05
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
        """What the robot says; a standing sensor's target goes the inverse way."""
        stood = flange if self.mounting == "eye_in_hand" else flange.inverse()
        return noisy_pose(stood, self.position, np.radians(self.rotation_deg), rng)


def any_mount(rng):
    return Pose(
        rotation_from_vector(rng.normal(size=3) * 2), rng.uniform((-100, -100, 50), (100, 100, 250))
    )


def sphere_data(rng, case, motion=None):
    """Random recommended poses; truth, profiles, reported poses."""
    mount, view = any_mount(rng), case.view
    motion = motion or TargetMotion(offset=0.8 * RADIUS, standoff=WORK[1])
    profiles, poses = [], []
    while len(poses) < case.count:
        (section,) = section_poses_about(TARGET, 1, motion, rng)
        profile = sphere_profile(section.inverse().apply_one(TARGET), RADIUS, view, rng)
        if len(profile) - profile.lost >= 60:
            profiles.append(profile)
            poses.append(case.reported(section @ mount.inverse(), rng))
    return mount, profiles, poses


def plane_data(rng, case):
    """Tilts of 40 deg both ways before one plane; truth, profiles, reported poses."""
    mount = any_mount(rng)
    plane = Plane((0.1, -0.05, 1.0), 310.0)
    motion = TargetMotion(tilt=np.radians(40), standoff=WORK[1], offset=0.0)
    sections = section_poses_about(TARGET, case.count, motion, rng)
    profiles = [plane_profile(plane.transformed(s.inverse()), case.view, rng) for s in sections]
    return mount, profiles, [case.reported(s @ mount.inverse(), rng) for s in sections]


def planned_data(rng, case):
    """Poses chosen with a nominal mount that is 1 mm and 0.5 deg wrong per axis, as drawn."""
    mount = any_mount(rng)
    nominal = noisy_pose(mount, 1.0, np.radians(0.5), rng)
    plan = plan_hand_eye_poses(
        nominal,
        TARGET,
        RADIUS,
        settings=PosePlanSettings(standoff=WORK[1], seed=int(rng.integers(1 << 30))),
    )
    profiles, poses = [], []
    for flange in plan.base_from_flanges:
        section = flange @ mount
        profiles.append(sphere_profile(section.inverse().apply_one(TARGET), RADIUS, case.view, rng))
        poses.append(case.reported(flange, rng))
    return mount, profiles, poses


def turn_vector(rotation):
    """Small rotation's vector, written apart from the library's."""
    off = np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    return off / 2


def errors(found, truth, work=WORK):
    """Six errors, their lengths (mm, deg) and that at the working point (mm)."""
    shift = found.translation - truth.translation
    small = turn_vector(found.rotation @ truth.rotation.T)
    at_work = np.linalg.norm(found.apply_one(work) - truth.apply_one(work))
    return np.r_[shift, small], np.linalg.norm(shift), np.degrees(np.linalg.norm(small)), at_work


def section_runs(case, runs, data=sphere_data, seed=0, **settings):
    """Errors, NEES/6, times, poses left out, and a free sphere's radius error in sigmas."""
    solve = calibrate_hand_eye_plane if data is plane_data else calibrate_hand_eye_sphere
    rows, nees, seconds, radii, rejected_count = [], [], [], [], 0
    for run in range(runs):
        rng = np.random.default_rng([seed, run])
        truth, profiles, poses = data(rng, case)
        begin = time.perf_counter()
        found = solve(profiles, poses, mounting=case.mounting, settings=HandEyeSettings(**settings))
        seconds.append(time.perf_counter() - begin)
        error, *lengths = errors(found.mount_from_sensor, truth)
        if data is not plane_data:
            radii.append((found.sphere.radius - RADIUS) / found.sphere.radius_std)
        rows.append(lengths)
        nees.append(error @ np.linalg.solve(found.covariance, error) / 6)
        rejected_count += len(found.rejected)
    return np.array(rows), np.array(nees), max(seconds), np.array(radii), rejected_count


def report_section(name, case, goal, runs, data=sphere_data, **settings):
    rows, nees, seconds, radii, rejected_count = section_runs(case, runs, data, **settings)
    covered = f"radius in 95 % {np.mean(np.abs(radii) < 2.06):.2f} | " if len(radii) else ""
    rms, high = np.sqrt((rows**2).mean(axis=0)), np.quantile(rows, 0.95, axis=0)
    print(
        f"{name:34} RMS {rms[0]:.3f} mm {rms[1]:.3f} deg {rms[2]:.3f} mm at work | 95 % "
        f"{high[0]:.3f} {high[1]:.3f} {high[2]:.3f} | NEES/6 {nees.mean():.2f} | "
        f"{covered}{rejected_count} good poses left out of {runs * case.count} | {seconds:.2f} s | "
        f"goal {goal}",
        flush=True,
    )


def report_wrong_pose(name, shift_mm, turn_deg, goal, runs, case=Case(0.05, 0.01)):
    right = named = 0
    for run in range(runs):
        rng = np.random.default_rng([7, run])
        truth, profiles, poses = sphere_data(rng, case)
        clean = calibrate_hand_eye_sphere(profiles, poses).flange_from_section
        bad = int(rng.integers(len(poses)))
        axis = rng.normal(size=3)
        direction = rng.normal(size=3)
        poses[bad] = Pose(
            rotation_from_vector(axis / np.linalg.norm(axis) * np.radians(turn_deg))
            @ poses[bad].rotation,
            poses[bad].translation + direction / np.linalg.norm(direction) * shift_mm,
        )
        found = calibrate_hand_eye_sphere(profiles, poses)
        named += bad in [pose.index for pose in found.rejected]
        limit = max(0.3, 2 * errors(clean, truth)[3])
        right += errors(found.flange_from_section, truth)[3] < limit
    print(f"{name:34} right {right}/{runs}, culprit named {named}/{runs} | goal {goal}", flush=True)


def report_board(name, goal, runs, case=Case(0.05, 0.01)):
    rows, nees = [], []
    for run in range(runs):
        truth, found = board_run(np.random.default_rng([3, run]), case)
        error, *lengths = errors(found.mount_from_sensor, truth, np.array([0, 0, 350.0]))
        rows.append(lengths)
        nees.append(error @ np.linalg.solve(found.covariance, error) / 6)
    rms = np.sqrt((np.array(rows) ** 2).mean(axis=0))
    print(
        f"{name:34} RMS {rms[0]:.3f} mm {rms[1]:.4f} deg {rms[2]:.3f} mm at 350 mm | NEES/6 "
        f"{np.mean(nees):.2f} | goal {goal}",
        flush=True,
    )


def board_run(rng, case, corner_std=0.1):
    """One simulated board calibration: truth and result."""
    mount = any_mount(rng)
    centre = BOARD.mean(axis=0)
    estimates, poses = [], []
    while len(poses) < case.count:
        lean = rotation_from_vector(rng.uniform(-1, 1, 3) * np.radians([35, 35, 180]))
        away = np.array([rng.uniform(-30, 30), rng.uniform(-30, 30), rng.uniform(300, 420)])
        flip = np.diag([1.0, -1.0, -1.0])
        camera_from_board = Pose(lean @ flip, away - lean @ flip @ centre)
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
    """Name and report of each row."""
    perfect, good, usual = Case(0, 0), Case(0.02, 0.005), Case(0.05, 0.01)
    given = {"robot_std": (0.02, np.radians(0.005))}
    section = partial(partial, report_section)
    for label, data in (("random poses", sphere_data), ("planned poses", planned_data)):
        for goal, robot, case, most in (
            ("G11", "perfect robot", perfect, "95 %: 0.05 0.025 0.015"),
            ("G12", "0.02/0.005", good, "0.15 0.075 0.04"),
            ("G13", "0.05/0.01", usual, "0.28 0.15 0.085"),
        ):
            name = f"{goal} {robot}, {label}"
            yield name, section(name, case, most, runs, data)
    name = "G12 robot stated"
    yield name, section(name, good, "0.15 0.075 0.04, NEES 0.7-1.4", runs, **given)
    name = "G13 20 poses"
    yield name, section(name, Case(0.05, 0.01, count=20), "0.20 0.11 0.065", runs)
    for name, shift, turn, most in (
        ("G15 one of 12, 30 mm and 5 deg", 30, 5, ">= 96 %"),
        ("    one of 12, 2 mm and 0.5 deg", 2, 0.5, ">= 90 %"),
        ("    one of 12, 2 mm only", 2, 0, ">= 90 %"),
    ):
        yield name, partial(report_wrong_pose, name, shift, turn, most, runs)
    name = "G16 board 12 poses"
    yield name, partial(report_board, name, "0.11 mm 0.018 deg", runs)
    yield from beside_the_goals(runs, section, given)


def beside_the_goals(runs, section, given):
    """The same with correlated noise, a standing sensor, and a plane as target."""
    for columns in (3, 10):
        for label, settings in (("found", {}), ("stated", given)):
            case = Case(0.02, 0.005, correlation=columns)
            name = f"    alike over {columns} columns, robot {label}"
            yield name, section(name, case, "NEES 0.7-1.4", runs, **settings)
    standing = Case(0.05, 0.01, mounting="eye_to_hand")
    name = "    sphere, sensor standing"
    yield name, section(name, standing, "0.28 0.15 0.085", runs)
    name = "    board, camera standing"
    yield name, partial(report_board, name, "0.11 mm 0.018 deg", runs, standing)
    # One plane tilted by 40 deg, goals: .45/.135/.28 and .29/.085/.18
    for count, goal in ((12, ".45 .135 .28"), (20, ".29 .085 .18")):
        for mounting in ("eye_in_hand", "eye_to_hand"):
            case = Case(0.05, 0.01, count=count, mounting=mounting)
            name = f"    plane {count} poses, {mounting}"
            yield name, section(name, case, goal, runs, plane_data)


def main(runs, only=""):
    for name, report in goals(runs):
        if name.strip().startswith(only):
            report()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50, *sys.argv[2:3])
