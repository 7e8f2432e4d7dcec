"""`lsvision calibrate hand-eye board` on boards that look the same after a turn, and its page."""

import cv2
import numpy as np
import pytest

from lsvision.geometry import Pose
from lsvision.io.hand_eye_file import load_hand_eye
from lsvision.simulate.hand_eye import rotation_from_vector
from tests.calibration.boards import chessboard_picture, photographed, rotation

MOUNT = Pose(rotation_from_vector(np.array([0.2, -0.1, 1.0])), (20.0, 30.0, 120.0))
BASE_FROM_TARGET = Pose(rotation_from_vector(np.array([0.1, 0.2, 0.3])), (700.0, 50.0, 200.0))
COUNTS, SQUARE, DEPTH = (9, 7), 10.0, 300.0
TURNS = [(0.4, 0.0, 0.1), (-0.3, 0.3, 0.2), (0.0, -0.4, 3.0), (0.2, 0.3, -0.2), (-0.4, 0.1, 2.9),
         (0.3, -0.3, 0.0)]  # fmt: skip
TURNED = 2, 4
SMALL_MM, SMALL_RAD = 0.5, 2e-3  # corners of 0.03 px at 300 mm; robot exact


def tilted(turn):
    """A tilt of the board after a spin about its normal."""
    tilt = rotation((*turn[:2], 0.0)) @ rotation((0.0, 0.0, turn[2]))
    return cv2.Rodrigues(tilt)[0].ravel()


@pytest.fixture(scope="module")
def shots(tmp_path_factory):
    """Photos, camera and exact poses of the robot in one folder."""
    folder = tmp_path_factory.mktemp("shots")
    middle, flanges = np.array([*np.subtract(COUNTS, 1), 0]) * SQUARE / 2, []
    for index, turn in enumerate(TURNS):
        picture, _ = chessboard_picture(tilted(turn), counts=COUNTS, square=SQUARE, depth=DEPTH)
        image = photographed(picture, np.random.default_rng(index))
        cv2.imwrite(str(folder / f"shot_{index}.png"), image)
        R = rotation(tilted(turn))
        seen = Pose(R, np.array([0, 0, DEPTH]) - R @ middle)
        flanges.append(BASE_FROM_TARGET @ seen.inverse() @ MOUNT.inverse())
    rows = [",".join(map(str, pose.matrix.ravel())) for pose in flanges]
    (folder / "poses.csv").write_text("\n".join(rows))
    (folder / "camera.yaml").write_text(
        "image_width: 640\nimage_height: 480\nK: [1200, 0, 320, 0, 1200, 240, 0, 0, 1]\n"
        "D: [0, 0, 0, 0, 0]\n"
    )
    return folder


def words(shots, out, pattern="*.png"):
    return ("calibrate", "hand-eye", "board", shots / pattern, "--camera", shots / "camera.yaml",
            "--poses", shots / "poses.csv", "--convention", "matrix", "--target", "chessboard",
            "--counts", f"{COUNTS[0]}x{COUNTS[1]}", "--square", SQUARE, "--out", out)  # fmt: skip


def test_views_of_a_turned_board_are_found_and_told(run, shots, tmp_path):
    out, page = tmp_path / "out.json", tmp_path / "page.html"
    done = run(*words(shots, out), "--report", page)
    assert done.exit_code == 0, done.output
    found = load_hand_eye(out).flange_from_camera
    np.testing.assert_allclose(found.translation, MOUNT.translation, rtol=0, atol=SMALL_MM)
    np.testing.assert_allclose(found.rotation, MOUNT.rotation, rtol=0, atol=SMALL_RAD)
    (warning,) = (
        line for line in done.stdout.splitlines() if "looks the same after a turn" in line
    )
    named = [k for k in range(len(TURNS)) if f"shot_{k}.png" in warning]
    assert named == list(TURNED)
    assert "looks the same after a turn" in page.read_text()


def test_the_page_shows_each_photo_with_corners_and_residuals(run, shots, tmp_path):
    page = tmp_path / "page.html"
    assert run(*words(shots, tmp_path / "out.json"), "--report", page).exit_code == 0
    text = page.read_text()
    assert text.count('class="corners"') == text.count("data:image/jpeg") == len(TURNS)
    for index in range(len(TURNS)):
        assert f"shot_{index}.png: 63 corners, 0." in text
