"""Sensor-to-robot calibration on other people's robots (../shared/real, never copied)."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lsvision.calibration.board_pose_estimation import estimate_board_pose
from lsvision.calibration.hand_eye import calibrate_hand_eye_board, calibrate_hand_eye_sphere
from lsvision.calibration.sphere_arc import find_sphere_arc
from lsvision.geometry import Pose
from lsvision.io.robot_poses import read_robot_poses
from lsvision.profile import Profile
from lsvision.sensors.camera import Camera

REAL = Path(__file__).parents[2] / "../shared/real"
pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="real data not on this machine")

RADIUS_TOLERANCE = 0.1  # mm, issue 5
# Their y axis is our -Z: their section frame is turned a quarter about X.
THEIRS_FROM_SECTION = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def profile_of(path):
    text = re.search(r"scan_line: \[(.*?)\]", path.read_text(), re.DOTALL).group(1)
    numbers = [float(word.replace(".Nan", "nan")) for word in text.split(",")]
    return Profile(np.array(numbers).reshape(-1, 3)[:, [0, 2]])


def sphere_set(name, pattern, count):
    folder = REAL / "sphere-robot" / name
    profiles = [profile_of(folder / pattern.format(i)) for i in range(1, count + 1)]
    flanges = read_robot_poses(folder / "RobPoses.rob", "fanuc")
    solution = json.loads((folder / "calibration.sec").read_text())["Solution"]["HTM"]
    theirs = np.array(solution)
    return profiles, flanges, Pose(theirs[:3, :3] @ THEIRS_FROM_SECTION, theirs[:3, 3])


def scatter(profiles, flanges, flange_from_section, radius):
    """RMS distance of the sphere's centres from their mean; each cut's side the nearer one."""
    centres = []
    for profile, flange in zip(profiles, flanges, strict=True):
        x, y, r = find_sphere_arc(profile).circle
        z = np.sqrt(max(radius**2 - r**2, 0))
        base_from_section = flange @ flange_from_section
        centres.append(base_from_section.apply([[x, y, z], [x, y, -z]]))
    centres = np.array(centres)
    mean = centres.mean(axis=(0, 1))
    for _ in range(30):
        side = np.linalg.norm(centres - mean, axis=2).argmin(axis=1)
        chosen = centres[np.arange(len(centres)), side]
        mean = chosen.mean(axis=0)
    return np.sqrt(((chosen - mean) ** 2).sum(axis=1).mean())


def test_a_fanucs_sphere_has_its_radius_and_scatters_less_than_published():
    profiles, flanges, published = sphere_set("main", "p{}.yml", 15)
    found = calibrate_hand_eye_sphere(profiles, flanges)
    assert found.sphere.radius == pytest.approx(40.0, abs=RADIUS_TOLERANCE)
    assert found.warnings == ()
    ours = scatter(profiles, flanges, found.flange_from_section, found.sphere.radius)
    assert ours <= scatter(profiles, flanges, published, found.sphere.radius)


def test_a_ball_in_scattered_points_scatters_less_than_published():
    profiles, flanges, published = sphere_set("ball", "{}_3C_line.yml", 10)
    found = calibrate_hand_eye_sphere(profiles, flanges, 12.7)
    ours = scatter(profiles, flanges, found.flange_from_section, 12.7)
    assert ours <= scatter(profiles, flanges, published, 12.7)


SIGMAS = 2.6  # of one radius; 99 %


def test_a_ball_measured_by_a_sensor_whose_heights_are_too_long_tells_so():
    profiles, flanges, _ = sphere_set("ball", "{}_3C_line.yml", 10)
    found = calibrate_hand_eye_sphere(profiles, flanges)
    factor, std = found.height_scale
    assert abs(found.sphere.radius - 12.7) < SIGMAS * found.sphere.radius_std
    assert factor < 1 - 5 * std
    assert "heights want to be multiplied by 0.93" in found.warnings[0]


RECOMPUTED_ARCS = {7: 10.72, 9: 9.69, 10: 9.04}
ARC_TOLERANCE = 0.2  # mm; the radius hangs on how much of the flank counts, 0.15 mm here


@pytest.mark.parametrize("number", RECOMPUTED_ARCS)
def test_the_ball_is_found_among_hundreds_of_scattered_points(number):
    arc = find_sphere_arc(profile_of(REAL / f"sphere-robot/ball/{number}_3C_line.yml"))
    assert arc.circle[2] == pytest.approx(RECOMPUTED_ARCS[number], abs=ARC_TOLERANCE)


BOARD = np.array([[10.0 * i, 10.0 * j, 0.0] for j in range(6) for i in range(7)])


def board_corners(path):
    """Corners of a dark board beside a bright stripe: clipped, stretched, blurred."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    clipped = np.minimum(image, np.percentile(image, 90))
    stretched = cv2.normalize(clipped, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    found, corners = cv2.findChessboardCorners(stretched, (7, 6))
    if not found:
        return None
    blurred = cv2.GaussianBlur(stretched, (0, 0), 2)
    corners = np.asarray(corners, np.float32).reshape(-1, 1, 2)
    until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-4)
    corners = cv2.cornerSubPix(blurred, corners, (15, 15), (-1, -1), until)
    return np.asarray(corners, np.float64).reshape(-1, 2)


def test_an_abbs_camera_is_found_where_it_was_published():
    folder = REAL / "etna/data_calib3"
    seen = {path: board_corners(path) for path in sorted(folder.glob("frame*.png"))}
    seen = {path: corners for path, corners in seen.items() if corners is not None}
    points = [BOARD.astype(np.float32)] * len(seen)
    pixels = [corners.astype(np.float32).reshape(-1, 1, 2) for corners in seen.values()]
    guess = np.array([[2400.0, 0, 639.5], [0, 2400, 511.5], [0, 0, 1]])
    flags = cv2.CALIB_USE_INTRINSIC_GUESS
    _, matrix, lens, *_ = cv2.calibrateCamera(
        points, pixels, (1280, 1024), guess, None, flags=flags
    )
    camera = Camera(matrix, np.asarray(lens).ravel()[:5], (1280, 1024))
    boards = [estimate_board_pose(corners, BOARD, camera) for corners in seen.values()]
    names = [path.with_name(path.name.replace("frame", "pose")) for path in seen]
    flanges = [read_robot_poses(name.with_suffix(".txt"), "ros")[0] for name in names]
    found = calibrate_hand_eye_board(
        [board.camera_from_board for board in boards],
        flanges,
        covariances=[board.covariance for board in boards],
    ).flange_from_camera
    # Published: xyz in m, rpy about fixed axes; issue 5 asks for 1 mm and 0.5 deg.
    published = Rotation.from_euler("xyz", (1.55420, 0.00225, 1.59185))
    turned = published.inv() * Rotation.from_matrix(found.rotation)
    assert np.linalg.norm(found.translation - (287.9, -39.9, 126.7)) < 1.0
    assert turned.magnitude() < np.radians(0.5)
