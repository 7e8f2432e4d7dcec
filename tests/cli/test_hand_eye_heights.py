"""`lsvision calibrate hand-eye` on matrices of heights, one profile per row."""

import cv2
import numpy as np
import pytest

from lsvision.geometry import Pose
from lsvision.io.hand_eye_file import load_hand_eye
from lsvision.simulate.hand_eye import TargetMotion, draw_section_poses_about, rotation_from_vector

RADIUS, CENTRE = 20.0, np.array([700.0, 50.0, 250.0])
MOUNT = Pose(rotation_from_vector(np.array([0.1, -0.2, 1.0])), np.array([30.0, -12.0, 90.0]))
X0, DX, COLUMNS, NOISE = -60.0, 0.25, 480, 0.02
COUNT_MM = 0.005  # a height map of 16 bit counts ranges of 5 um
SMALL_MM, SMALL_RAD = 0.15, 2e-3


@pytest.fixture
def sphere(tmp_path):
    """Heights (n, columns) of twelve sections of a sphere, and the file of their poses."""
    rng = np.random.default_rng(11)
    motion = TargetMotion(working_y=-170.0)
    sections = draw_section_poses_about(CENTRE, 12, motion, rng)
    x = X0 + DX * np.arange(COLUMNS)
    heights = np.full((len(sections), COLUMNS), np.nan)
    for row, pose in zip(heights, sections, strict=True):
        across, up, beside = pose.inverse().apply(CENTRE[None])[0]
        cut = RADIUS**2 - beside**2
        inside = np.abs(x - across) < 0.95 * np.sqrt(cut)
        row[inside] = up + np.sqrt(cut - (x[inside] - across) ** 2)
    heights += rng.normal(0, NOISE, heights.shape)
    poses = tmp_path / "poses.csv"
    matrices = [(pose @ MOUNT.inverse()).matrix.ravel() for pose in sections]
    np.savetxt(poses, matrices, delimiter=",")
    return heights, poses


def npy(folder, heights):
    np.save(folder / "rows.npy", heights)
    return folder / "rows.npy", ()


def text(folder, heights):
    np.savetxt(folder / "rows.csv", heights, delimiter=",", fmt="%.4f")
    return folder / "rows.csv", ()


def columns(folder, heights):
    np.savetxt(folder / "columns.csv", heights.T * 1000, delimiter=";", fmt="%.0f")
    return folder / "columns.csv", ("--transpose", "--z-unit", "um")


def tiff_of_floats(folder, heights):
    cv2.imwrite(str(folder / "rows.tiff"), heights.astype(np.float32))
    return folder / "rows.tiff", ()


def tiff_of_ranges(folder, heights):
    counts = np.where(np.isnan(heights), 0, np.round(-heights / COUNT_MM)).astype(np.uint16)
    cv2.imwrite(str(folder / "rows.tif"), counts)
    return folder / "rows.tif", ("--flip", "--z-unit", "5um")


def folder_of_tiffs(folder, heights):
    made = folder / "maps"
    made.mkdir()
    for k, rows in enumerate(np.split(heights, 3)):
        cv2.imwrite(str(made / f"{k}.tiff"), rows.astype(np.float32))
    return made, ()


@pytest.mark.parametrize(
    "write", [npy, text, columns, tiff_of_floats, tiff_of_ranges, folder_of_tiffs]
)
def test_a_matrix_of_heights_calibrates_on_a_sphere(run, sphere, tmp_path, write) -> None:
    heights, poses = sphere
    path, options = write(tmp_path, heights)
    out = tmp_path / "out.json"
    words = ("--radius", RADIUS, "--x0", X0, "--dx", DX, *options, "--out", out)
    result = run("calibrate", "hand-eye", "sphere", path, "--poses", poses, "--convention",
                 "matrix", *words)  # fmt: skip
    assert result.exit_code == 0, result.output
    found = load_hand_eye(out).flange_from_section
    error = MOUNT.inverse() @ found
    assert np.abs(error.translation).max() < SMALL_MM
    assert np.abs(error.rotation - np.eye(3)).max() < SMALL_RAD


def test_a_matrix_without_its_spacing_says_what_to_give(run, sphere, tmp_path) -> None:
    heights, poses = sphere
    path, _ = npy(tmp_path, heights)
    out = tmp_path / "out.json"
    result = run("calibrate", "hand-eye", "sphere", path, "--poses", poses, "--convention",
                 "matrix", "--out", out)  # fmt: skip
    assert result.exit_code == 1
    assert "--x0 and --dx" in result.stderr
    assert not out.exists()
