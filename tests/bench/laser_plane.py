"""Laser-plane calibrations beside goals G9 and G10: ``python -m tests.bench.laser_plane [RUNS]``.

With ``images N`` instead, from N sets of images rendered like the example in the repository (JPEG,
black squares, markers), each with other poses and noise; 15 s a set.
"""

import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from lsvision.calibration.bundle_adjustment_problem import LaserView
from lsvision.calibration.intrinsics import calibrate_camera, fit_camera
from lsvision.calibration.laser_plane import calibrate_laser_plane, fit_laser_plane
from lsvision.calibration.target import ChArUco, TargetView
from lsvision.simulate.boards import BoardScene, simulate_boards
from tests.scripts import import_script

BOARDS = 15
"""Number of board poses of a calibration."""
SCENES = {
    "G9  flat board": BoardScene(),
    "G10 bow 0.1, 0 mm": BoardScene(bow=(0.1, 0.0)),
    "    bow 0.06, -0.05 mm": BoardScene(bow=(0.06, -0.05)),
    "    twist 0.2 mm": BoardScene(twist=0.2),
}


def calibrated(scene, seed):
    """Return a calibration of camera and laser plane from the same boards, and its time (s)."""
    boards = simulate_boards(scene, BOARDS, rng=np.random.default_rng(seed))
    camera = fit_camera([TargetView(b.points, b.pixels, scene.size) for b in boards]).camera
    std = np.full(scene.line_points, scene.line_std)
    views = [LaserView(b.points, b.pixels, b.line_pixels, std) for b in boards]
    begin = time.perf_counter()
    return fit_laser_plane(camera, views), time.perf_counter() - begin


def errors(scene, found):
    """Return the RMS errors of points of the laser plane: absolute, and after rigid alignment.

    The latter is the error of shape. The points fill the field of view. Units: mm.
    """
    depth = scene.distance * (1 + np.linspace(-0.13, 0.13, 7))
    x, z = np.meshgrid(np.linspace(-0.2, 0.2, 9) * scene.distance, depth)
    normal = scene.plane.normal
    y = (scene.plane.distance - normal[0] * x - normal[2] * z) / normal[1]
    truth = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    zero = np.zeros(3)
    pixels, _ = cv2.projectPoints(truth, zero, zero, scene.matrix, scene.distortion)
    section = found.light_section
    seen = section.camera_from_section.apply(section.points_from_pixels(pixels.reshape(-1, 2)))
    a, b = seen - seen.mean(axis=0), truth - truth.mean(axis=0)
    left, _, right = np.linalg.svd(a.T @ b)
    aligned = a @ left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    return [np.sqrt(np.mean(np.sum(error**2, axis=1))) for error in (seen - truth, aligned - b)]


def plane_error(found, truth):
    """Return the errors of the plane: tilt about the section's X and Y (rad), distance (mm)."""
    x_axis, y_axis, z_axis = found.light_section.camera_from_section.rotation.T
    normal = truth.normal * np.sign(z_axis @ truth.normal)
    return np.array([normal @ y_axis, -(normal @ x_axis), found.plane.distance - truth.distance])


def normalised(found, error):
    """Return error' covariance^-1 error / 3 (NEES/3), 1 on average for a valid covariance."""
    return error @ np.linalg.solve(found.covariance, error) / 3


def recipe():
    """Return the script that made the example in the repository, as a module."""
    path = Path(__file__).parents[2] / "calibration" / "example" / "make.py"
    return import_script(path)


def from_images(make, seed):
    """Return the calibration from one set of images."""
    with tempfile.TemporaryDirectory() as folder:
        make.write_boards(Path(folder), np.random.default_rng([4, seed]))
        boards, lines = (
            [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted(place.iterdir())]
            for place in (Path(folder) / "boards", Path(folder) / "lines")
        )
    camera = calibrate_camera(boards, ChArUco()).camera
    return calibrate_laser_plane(camera, ChArUco(), boards, lines)


def main_images(runs):
    """Print errors and predicted standard deviations of calibrations from images."""
    make = recipe()
    found = [from_images(make, seed) for seed in range(runs)]
    rows = np.array([plane_error(each, make.RIG.laser_plane) for each in found])
    predicted = np.sqrt(np.mean([np.diag(each.covariance) for each in found], axis=0))
    rms = np.sqrt(np.mean(rows**2, axis=0))
    nees = [normalised(each, row) for each, row in zip(found, rows, strict=True)]
    scale = np.array([np.degrees(1), np.degrees(1), 1.0])
    print(
        f"{runs} sets of images: rms (deg, deg, mm) {np.round(rms * scale, 4)}  predicted "
        f"{np.round(predicted * scale, 4)}  NEES/3 {np.mean(nees):.2f} | goal 0.7-1.4"
    )


def main(runs):
    """Print the errors of so many calibrations of each scene below the goals."""
    print("goals: shape <= 3.5 um, absolute <= 100 um, line <= 0.11 px, bow +/- 5 um")
    for name, scene in SCENES.items():
        rows, bows, nees = [], [], []
        for seed in range(runs):
            found, seconds = calibrated(scene, seed)
            rows.append([*errors(scene, found), found.line_rms, seconds])
            bows.append(found.board_bow - (*scene.bow, scene.twist))
            nees.append(normalised(found, plane_error(found, scene.plane)))
        rms = np.sqrt(np.mean(np.square(rows), axis=0))
        worst = 1e3 * np.abs(bows).max()
        print(
            f"{name:24s} shape {1e3 * rms[1]:5.2f} um  absolute {1e3 * rms[0]:6.1f} um  line "
            f"{rms[2]:.4f} px  bow error {1e3 * np.sqrt(np.mean(np.square(bows))):.2f} um rms, "
            f"{worst:.2f} worst  NEES/3 {np.mean(nees):.2f}  {rms[3]:.2f} s"
        )


if __name__ == "__main__":
    if sys.argv[1:2] == ["images"]:
        main_images(int(sys.argv[2]) if len(sys.argv) > 2 else 40)
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
