"""Make the example: data of a camera with a laser line on a robot, as a person would record it.

``python calibration/example/make.py [FOLDER]`` writes

boards/, lines/             images of a board, and of the laser line on it, 14 poses, 640 x 480 px
sphere/, sphere_poses.csv   profiles of a sphere of radius 20 mm, and poses of the flange (KUKA)
pipe/, pipe_poses.csv       profiles of a pipe of radius 15 mm, to try the calibration on
truth.json                  true values of camera, laser plane, hand-eye pose, sphere and pipe

The images are rendered here pixel by pixel, with OpenCV's picture of the board and the
simulator's camera; no code of the calibration is used.
"""

import argparse
import json
import math
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from lsvision.geometry import Cylinder, Pose
from lsvision.profile import Profile
from lsvision.sensors.profile_sensor import ProfileSensor
from lsvision.simulate import Scene, SectionSettings, Tube, simulate_section
from lsvision.simulate.hand_eye import (
    SectionView,
    TargetMotion,
    draw_section_poses_about,
    perturb_pose,
    rotation_from_vector,
    simulate_sphere_profile,
)
from lsvision.simulate.imaging_rig import ImagingRig
from lsvision.simulate.solids import Rays

HERE = Path(__file__).parent
SEED = 20
RIG = ImagingRig.triangulating(
    focal_length=900.0, size=(640, 480), stand_off=300.0, distortion=(-0.09, 0.06)
)
BOARD = (11, 8, 15.0, 11.0, "DICT_4X4_100")
"""Squares in a row and a column, edges of square and marker in mm: the default target."""
DOTS_PER_MM, BORDER = 20, 8.0
"""Resolution of the board's picture, and width of its white border in mm."""
BOARDS = 14
"""Number of board poses."""
SAMPLES_PER_PIXEL = 3
"""Number of rendered samples per pixel along each side."""
SHEET, BLUR, NOISE = 0.25, 0.6, 1.5
"""Standard deviations of the sheet of light (mm), the lens's blur (px) and the pixels (DN)."""

FLANGE_FROM_SECTION = Pose(rotation_from_vector(np.array([0.35, -0.2, 1.4])), (35.0, -60.0, 210.0))
SPHERE, RADIUS = np.array([820.0, 110.0, 250.0]), 20.0
"""Centre in the base frame, and radius of the sphere. Units: mm."""
PIPE = Cylinder((800.0, 60.0, 240.0), (0.35, 0.9, 0.12), 15.0)
"""Pipe in the base frame. Units: mm."""
ROBOT_STD = (0.02, math.radians(0.005))
"""Standard deviation of the robot's position (mm) and orientation (rad) in each axis."""
WORKING_Y = -260.0
"""Y of the measured object in the section frame. Units: mm."""


def board_picture() -> np.ndarray:
    """Return the printed board with its border: (height, width), 0 (black) to 1 (white)."""
    columns, rows, square, marker, name = BOARD
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    board = cv2.aruco.CharucoBoard((columns, rows), square, marker, dictionary)
    border = round(BORDER * DOTS_PER_MM)
    size = [round(count * square * DOTS_PER_MM) + 2 * border for count in (columns, rows)]
    return board.generateImage(tuple(size), marginSize=border).astype(np.float32) / 255


def board_poses(rng: np.random.Generator) -> list[Pose]:
    """Return the poses ``camera_from_board``, tilted to all sides, near, far and in all corners."""
    columns, rows, square, *_ = BOARD
    middle = np.array([columns, rows, 0.0]) * square / 2
    poses = []
    for number in range(BOARDS):
        azimuth = 2 * np.pi * number / BOARDS * 3
        angle = math.radians(32 if number % 3 else 8)
        tilt = rotation_from_vector(angle * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
        spin = rotation_from_vector(np.array([0.0, 0.0, rng.uniform(-0.3, 0.3)]))
        depth = rng.uniform(275, 345)
        offset = 0.11 * depth * np.array([math.cos(2.4 * number), 0.55 * math.sin(2.4 * number)])
        rotation = tilt @ spin
        poses.append(Pose(rotation, np.array([*offset, depth]) - rotation @ middle))
    return poses


@cache
def fine_rays() -> Rays:
    """Return the rays of all samples of an image, row by row, section frame."""
    count = SAMPLES_PER_PIXEL
    samples = [(np.arange(length * count) - (count - 1) / 2) / count for length in RIG.size]
    u, v = np.meshgrid(*samples)
    return RIG.rays(np.column_stack([u.ravel(), v.ravel()]))


def render(pose: Pose, picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return images of the evenly lit board and of the laser line on it, in DN without noise."""
    rays = fine_rays()
    section_from_board = RIG.camera_from_section.inverse() @ pose
    normal, origin = section_from_board.rotation[:, 2], section_from_board.translation
    depth = (origin - rays.origins) @ normal / (rays.directions @ normal)
    points = rays.origins + depth[:, None] * rays.directions
    shape = tuple(SAMPLES_PER_PIXEL * length for length in RIG.size[::-1])
    on_board = section_from_board.inverse().apply(points)[:, :2]
    dots = ((on_board + BORDER) * DOTS_PER_MM - 0.5).astype(np.float32).reshape(*shape, 2)
    whiteness = cv2.remap(
        picture, dots[..., 0], dots[..., 1], cv2.INTER_LINEAR, borderValue=0.45
    ).astype(np.float64)
    glow = np.exp(-0.5 * (points[:, 2] / SHEET) ** 2).reshape(shape)
    reflectance = 0.12 + 0.88 * whiteness
    images = (25 + 190 * reflectance, 8 + 215 * reflectance * glow)
    small = [cv2.resize(image, RIG.size, interpolation=cv2.INTER_AREA) for image in images]
    return tuple(cv2.GaussianBlur(image, (0, 0), BLUR) for image in small)


def write_boards(folder: Path, rng: np.random.Generator) -> None:
    """Write both images of each pose as JPEG."""
    picture = board_picture()
    for name in ("boards", "lines"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for number, pose in enumerate(board_poses(rng)):
        for name, image in zip(("board", "line"), render(pose, picture), strict=True):
            noisy = np.clip(image + rng.normal(0, NOISE, image.shape), 0, 255).round()
            _, data = cv2.imencode(".jpg", noisy.astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 92])
            (folder / f"{name}s" / f"{name}_{number:02d}.jpg").write_bytes(data.tobytes())


def write_profile(path: Path, profile: Profile, title: str) -> None:
    """Write a profile as two columns, x and z in mm; z grows towards the sensor."""
    rows = [f"{x:.3f},{y:.3f}" for x, y in profile.points]
    path.write_text("\n".join([f"# {title}", "x [mm],z [mm]", *rows]) + "\n")


def write_poses(path: Path, poses: list[Pose]) -> None:
    """Write the poses as KUKA does: X Y Z A B C of the flange, mm and deg."""
    rows = ["x,y,z,a,b,c"]
    for pose in poses:
        angles = Rotation.from_matrix(pose.rotation).as_euler("ZYX", degrees=True)
        rows.append(",".join(f"{value:.4f}" for value in (*pose.translation, *angles)))
    path.write_text("\n".join(rows) + "\n")


def write_sphere(folder: Path, rng: np.random.Generator) -> None:
    """Write twelve profiles of the sphere from random poses, and the poses of the flange."""
    (folder / "sphere").mkdir(parents=True, exist_ok=True)
    motion = TargetMotion(sideways=25.0, depth=25.0, offset=0.75 * RADIUS, working_y=WORKING_Y)
    view = SectionView(columns=320, width=100.0, range_std=0.04)
    flanges, number = [], 0
    while number < 12:
        (section,) = draw_section_poses_about(SPHERE, 1, motion, rng)
        profile = simulate_sphere_profile(section.inverse().apply_one(SPHERE), RADIUS, view, rng)
        if len(profile) - profile.lost < 50:
            continue
        write_profile(folder / "sphere" / f"pose_{number:02d}.csv", profile, "sphere of 20 mm")
        flange = section @ FLANGE_FROM_SECTION.inverse()
        flanges.append(perturb_pose(flange, *ROBOT_STD, rng))
        number += 1
    write_poses(folder / "sphere_poses.csv", flanges)


def write_pipe(folder: Path, rng: np.random.Generator) -> None:
    """Write six profiles across the pipe, each from another pose, and the poses of the flange."""
    (folder / "pipe").mkdir(parents=True, exist_ok=True)
    sensor = ProfileSensor(
        name="example rig", range_std=0.04, reference_range=260.0, min_range=180.0,
        max_range=340.0, width_at_max_range=130.0, columns=320,
    )  # fmt: skip
    axis = PIPE.direction
    across = np.cross(axis, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    up = np.cross(across, axis)
    flanges = []
    for number in range(6):
        middle = PIPE.point + (number - 2.5) * 12.0 * axis
        rotation = rotation_from_vector(rng.uniform(-0.2, 0.2, 3)) @ np.column_stack(
            [across, up, np.cross(across, up)]
        )
        section = Pose(rotation, middle - rotation @ (0.0, WORKING_Y, 0.0))
        simulated = simulate_section(
            Scene((Tube(PIPE),)), sensor, SectionSettings(), rng=rng, base_from_section=section
        )
        write_profile(folder / "pipe" / f"pipe_{number}.csv", simulated.profile, "pipe of 15 mm")
        flanges.append(perturb_pose(section @ FLANGE_FROM_SECTION.inverse(), *ROBOT_STD, rng))
    write_poses(folder / "pipe_poses.csv", flanges)


def write_truth(folder: Path) -> None:
    """Write the true values of the calibrations and the scan; mm, px."""
    truth = {
        "units": {"length": "mm", "pixel": "px"},
        "seed": SEED,
        "camera_matrix": RIG.matrix.tolist(),
        "distortion": RIG.distortion.tolist(),
        "laser_plane": {
            "normal": RIG.laser_plane.normal.round(9).tolist(),
            "distance": round(RIG.laser_plane.distance, 6),
        },
        "flange_from_section": FLANGE_FROM_SECTION.matrix.round(9).tolist(),
        "sphere": {"centre": SPHERE.tolist(), "radius": RADIUS},
        "pipe": {
            "point": PIPE.point.tolist(),
            "direction": PIPE.direction.round(9).tolist(),
            "radius": PIPE.radius,
        },
    }
    (folder / "truth.json").write_text(json.dumps(truth, indent=2) + "\n")


def main(folder: Path = HERE) -> None:
    """Write the example to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for write, seed in ((write_boards, SEED), (write_sphere, SEED + 1), (write_pipe, SEED + 2)):
        write(folder, np.random.default_rng(seed))
    write_truth(folder)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Make every file of this folder again.")
    parser.add_argument("folder", nargs="?", type=Path, default=HERE)
    main(parser.parse_args().folder)
