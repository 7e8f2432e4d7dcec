"""`lsvision calibrate`: results on the example, and error messages with file and remedy."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lsvision.calibration.target import ChArUco, find_target
from lsvision.cli.calibrate_inputs import add_file_names
from lsvision.cli.target_options import TargetOptions
from lsvision.geometry import Plane, Pose
from lsvision.io.hand_eye_file import load_hand_eye
from lsvision.io.images import read_image
from lsvision.io.robot_poses import read_robot_poses
from lsvision.sensors.light_section import LightSection
from lsvision.simulate.hand_eye import (
    SectionView,
    TargetMotion,
    draw_section_poses_about,
    rotation_from_vector,
    simulate_plane_profile,
)
from tests.scripts import import_script

EXAMPLE = Path(__file__).parents[2] / "calibration" / "example"
BOARDS, LINES, SPHERE = EXAMPLE / "boards", EXAMPLE / "lines", EXAMPLE / "sphere"
POSES = EXAMPLE / "sphere_poses.csv"
SMALL_MM, SMALL_RAD = 0.3, 2e-3  # corners of 0.07 px at 300 mm, or lines of 0.02 mm; robot exact


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out.json"


@pytest.fixture
def boards(tmp_path):
    """Six images of the example's board in a folder of their own."""
    folder = tmp_path / "shots"
    folder.mkdir()
    for path in sorted(BOARDS.iterdir())[:6]:
        shutil.copy(path, folder)
    return folder


@pytest.fixture
def camera_json(tmp_path):
    truth = json.loads((EXAMPLE / "truth.json").read_text())
    rows = [", ".join(map(str, row)) for row in truth["camera_matrix"]]
    lens = ", ".join(map(str, [*truth["distortion"], 0, 0, 0]))
    path = tmp_path / "camera.yaml"
    path.write_text(f"image_width: 640\nimage_height: 480\nK: [{', '.join(rows)}]\nD: [{lens}]\n")
    return path


def sphere_words(out, poses=POSES, convention="kuka"):
    return ("calibrate", "hand-eye", "sphere", SPHERE, "--poses", poses,
            "--convention", convention, "--out", out)  # fmt: skip


def error_text(result, out, code=1):
    """The one line on stderr of a command that wrote nothing."""
    assert result.exit_code == code, result.output
    assert not out.exists()
    assert not list(out.parent.glob(".*.part"))
    return result.stderr


def test_help_shows_an_example_of_every_calibration(run):
    for words in (["camera"], ["laser-plane"], ["target"], ["hand-eye", "sphere"],
                  ["hand-eye", "plane"], ["hand-eye", "board"], ["hand-eye", "poses"]):  # fmt: skip
        result = run("calibrate", *words, "--help")
        assert result.exit_code == 0
        assert f"lsvision calibrate {' '.join(words)}" in result.stdout


def test_printed_target_is_the_one_that_is_looked_for(run, tmp_path):
    for name in ("board.svg", "board.pdf"):
        assert run("calibrate", "target", "--out", tmp_path / name).exit_code == 0
        assert (tmp_path / name).stat().st_size > 10_000
    picture = ChArUco().board.generateImage((660, 480), marginSize=20)
    assert len(find_target(picture, TargetOptions().parse()).points)


def test_circle_grid_and_chessboard_need_counts_and_square(run, tmp_path):
    out = tmp_path / "board.svg"
    words = ("calibrate", "target", "--out", out, "--target", "chessboard")
    assert "--counts NxM and --square MM" in error_text(run(*words), out, 2)
    assert run(*words, "--counts", "9x6", "--square", "20").exit_code == 0


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("--target", "checkers"), "expected --target charuco, chessboard"),
        (("--counts", "eleven"), "expected --counts NxM up to 999x999, such as 11x8, got 'eleven'"),
        (("--square", "10", "--marker", "12"), "expected 0 < marker < square 10 mm, got 12"),
        (
            ("--target", "chessboard", "--counts", "9x6", "--square", "20", "--marker", "5"),
            "expected --marker with markers or discs, got a chessboard",
        ),
        (
            ("--target", "circles", "--counts", "9x6", "--square", "20", "--dictionary", "DICT_X"),
            "expected --dictionary with --target charuco, got circles",
        ),
        (("--dictionary", "DICT_NONE"), "expected a dictionary of cv2.aruco, got 'DICT_NONE'"),
    ],
)
def test_target_that_is_none_is_a_usage_error(run, tmp_path, words, error):
    out = tmp_path / "board.svg"
    assert error in error_text(run("calibrate", "target", "--out", out, *words), out, 2)


def test_image_without_board_is_left_out_by_name(run, boards, out):
    cv2.imwrite(str(boards / "board_03.jpg"), np.full((480, 640), 99, np.uint8))
    page = out.with_suffix(".html")
    result = run("calibrate", "camera", boards, "--out", out, "--report", page)
    assert result.exit_code == 0
    assert "left out: image 3 (board_03.jpg): no ChArUco" in result.stdout
    assert "5 of 6 images" in result.stdout
    assert "left out: image 3 (board_03.jpg)" in page.read_text()
    assert json.loads(out.read_text())["rejected"][0]["image"] == 3


def test_fewer_views_than_needed_are_counted_and_named(run, boards, out):
    for path in sorted(boards.iterdir())[2:]:
        cv2.imwrite(str(path), np.full((480, 640), 99, np.uint8))
    error = error_text(run("calibrate", "camera", boards, "--out", out), out)
    assert "2 views show the target and 3 are needed" in error
    names = ", ".join(f"image {k} (board_0{k}.jpg)" for k in range(2, 6))
    assert f"{names}: no ChArUco board" in error
    assert error.count("no ChArUco board") == 1


def test_images_of_mixed_sizes_are_named(run, boards, out):
    cv2.imwrite(str(boards / "board_02.jpg"), np.full((240, 320), 99, np.uint8))
    error = error_text(run("calibrate", "camera", boards, "--out", out), out)
    assert "image 2 (board_02.jpg) is 320 x 240 px and image 0 (board_00.jpg) 640 x 480" in error


def test_files_that_are_no_images_are_named(run, boards, out):
    (boards / "board_04.jpg").write_bytes(b"not an image")
    error = error_text(run("calibrate", "camera", boards, "--out", out), out)
    assert "board_04.jpg is not an image of 8 or 16 bit" in error
    (boards / "board_04.jpg").write_bytes(b"")
    assert "board_04.jpg" in error_text(run("calibrate", "camera", boards, "--out", out), out)


def test_what_does_not_exist_is_named(run, boards, out, tmp_path):
    missing = tmp_path / "missing.png"
    assert "missing.png: no such file" in error_text(
        run("calibrate", "camera", missing, "--out", out), out
    )
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "no image in this folder" in error_text(
        run("calibrate", "camera", empty, "--out", out), out
    )
    words = ("laser-plane", "--boards", boards, "--lines", boards, "--camera", missing)
    assert "missing.png: no such file" in error_text(run("calibrate", *words, "--out", out), out)


@pytest.mark.parametrize("margin", ["-1", "21", "inf"])
def test_a_margin_that_no_board_has_is_a_usage_error(run, margin):
    words = ("--boards", "b.png", "--lines", "l.png", "--camera", "c.json", "--margin", margin)
    result = run("calibrate", "laser-plane", *words)
    assert result.exit_code == 2
    assert "--margin" in result.stderr


@pytest.fixture
def laser_plane_error(run, boards, camera_json, out):
    """The error of `calibrate laser-plane` for `boards` and a folder of line images."""
    words = ("calibrate", "laser-plane", "--boards", boards, "--camera", camera_json, "--out", out)
    return lambda lines: error_text(run(*words, "--lines", lines), out)


def test_laser_plane_wants_a_line_image_for_each_board(laser_plane_error):
    error = laser_plane_error(LINES)
    assert (
        "expected a line image for each of 6 board images (board_00.jpg to board_05.jpg)" in error
    )
    assert "got 14 (line_00.jpg to line_13.jpg)" in error


def test_shuffled_pair_of_board_and_line_is_left_out_by_name(run, camera_json, out, tmp_path):
    for name in ("board", "line"):
        (tmp_path / f"{name}s").mkdir()
        for number in range(7):
            shutil.copy(EXAMPLE / f"{name}s" / f"{name}_{number:02d}.jpg", tmp_path / f"{name}s")
    one, other = (tmp_path / "lines" / f"line_{number}.jpg" for number in ("01", "04"))
    first = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(first)
    words = ("--boards", tmp_path / "boards", "--lines", tmp_path / "lines")
    result = run("calibrate", "laser-plane", *words, "--camera", camera_json, "--out", out)
    assert result.exit_code == 0, result.output
    assert "left out: image 4 (board_04.jpg): its laser line lies" in result.stdout
    assert "left out: image 1 (board_01.jpg): its laser line lies" in result.stdout


def test_line_images_all_shuffled_are_rejected(laser_plane_error, tmp_path):
    lines = tmp_path / "lines"
    lines.mkdir()
    for number, other in enumerate((3, 0, 5, 1, 2, 4)):
        shutil.copy(LINES / f"line_{other:02d}.jpg", lines / f"line_{number:02d}.jpg")
    assert "check the order of board and line images" in laser_plane_error(lines)


def test_line_image_of_another_size_is_named(laser_plane_error, tmp_path):
    lines = tmp_path / "lines"
    lines.mkdir()
    for number in range(6):
        size = (240, 320) if number == 2 else (480, 640)
        cv2.imwrite(str(lines / f"line_{number}.png"), np.full(size, 3, np.uint8))
    message = "line image 2 (line_2.png) is 320 x 240 px and the camera 640 x 480 px"
    assert message in laser_plane_error(lines)


def test_line_images_without_a_line_are_rejected(laser_plane_error, tmp_path):
    dark = tmp_path / "dark"
    dark.mkdir()
    for number in range(6):
        cv2.imwrite(str(dark / f"line_{number}.png"), np.full((480, 640), 3, np.uint8))
    message = "0 views show the board with the laser line on it and 2 are needed"
    assert message in laser_plane_error(dark)


def test_raw_images_of_a_colour_camera_use_the_lasers_own_pixels(run, camera_json, out):
    """Of white boards under a white laser: the same plane from every fourth pixel."""
    words = ("calibrate", "laser-plane", "--boards", BOARDS / "board_0[0-5].jpg", "--lines",
             LINES / "line_0[0-5].jpg", "--camera", camera_json, "--out", out)  # fmt: skip
    found = run(*words, "--laser", "red", "--bayer", "RGGB")
    assert found.exit_code == 0, found.output
    plane = LightSection.load(out).laser_plane
    truth = json.loads((EXAMPLE / "truth.json").read_text())["laser_plane"]
    assert plane.distance == pytest.approx(truth["distance"], abs=SMALL_MM)
    assert np.linalg.norm(plane.normal - truth["normal"]) < SMALL_RAD


def test_colour_of_the_laser_is_asked_for(run, boards, camera_json, out, tmp_path):
    words = ("calibrate", "laser-plane", "--boards", boards, "--lines", boards,
             "--camera", camera_json, "--out", out)  # fmt: skip
    assert "expected --laser among grey, red," in error_text(run(*words, "--laser", "pink"), out, 2)
    assert "expected --bayer among RGGB," in error_text(run(*words, "--bayer", "RGBG"), out, 2)
    assert "board_00.jpg has no colours: leave --laser green out" in error_text(
        run(*words, "--laser", "green"), out
    )
    colour = np.full((480, 640, 3), (9, 200, 9), np.uint8)
    cv2.imwrite(str(boards / "board_02.jpg"), colour)
    assert "board_02.jpg has colours: name the laser's colour" in error_text(run(*words), out)


def test_sphere_gives_files_for_scan_and_ros(run, out, tmp_path):
    yaml, plan = tmp_path / "he.yaml", tmp_path / "next.csv"
    result = run(*sphere_words(out), "--easy-handeye", yaml, "--frames", "flange:laser",
                 "--plan-poses", 2, "--plan-out", plan)  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "flange_from_section X" in result.stdout
    assert 'robot_effector_frame: "flange"' in yaml.read_text()
    assert len(read_robot_poses(plan, "matrix")) == 2
    provenance = json.loads(out.read_text())["provenance"]
    assert "sphere_poses.csv" in provenance["inputs"]


def test_wrong_convention_is_rejected_and_nothing_written(run, out):
    error = error_text(run(*sphere_words(out, convention="fanuc")), out)
    assert "not w p r of convention 'fanuc'" in error
    assert "expected --convention ur, kuka" in error_text(
        run(*sphere_words(out, convention="kukka")), out, 2
    )


def test_poses_of_another_count_are_rejected(run, out, tmp_path):
    fewer = tmp_path / "poses.csv"
    fewer.write_text("\n".join(POSES.read_text().splitlines()[:-1]))
    error = error_text(run(*sphere_words(out, fewer)), out)
    expected = (
        "expected 12 poses, one for each profile (pose_00.csv to pose_11.csv), got 11: leave out "
        "each pose without a profile, and each profile without a pose"
    )
    assert f"poses.csv: {expected}" in " ".join(error.split())


POSE_ROWS = POSES.read_text().splitlines()[1:]
SPOILT_POSES = {
    "shuffled": (
        [POSE_ROWS[i] for i in (5, 2, 8, 0, 11, 3, 9, 1, 7, 10, 4, 6)],
        "the order of the pairs",
    ),
    "reversed": (POSE_ROWS[::-1], "the poses are in reverse order"),
    "lost": ([POSE_ROWS[0].replace(POSE_ROWS[0].split(",")[0], "nan"), *POSE_ROWS[1:]], "finite"),
    "none": ([], "no row with numbers"),
    "words": (["home"] * 12, "expected a number under each name"),
}


@pytest.mark.parametrize("case", SPOILT_POSES)
def test_spoilt_poses_are_rejected_with_what_is_wrong(run, out, tmp_path, case):
    rows, message = SPOILT_POSES[case]
    poses = tmp_path / "poses.csv"
    poses.write_text("\n".join(["x,y,z,a,b,c", *rows]) + "\n")
    error = error_text(run(*sphere_words(out, poses)), out)
    assert message in error
    assert len(error.strip().splitlines()) == 1


def test_files_of_poses_and_profiles_that_are_missing_are_named(run, out, tmp_path):
    assert "gone.csv" in error_text(run(*sphere_words(out, tmp_path / "gone.csv")), out)
    words = list(map(str, sphere_words(out)))
    words[words.index(str(SPHERE))] = str(tmp_path / "profiles")
    assert "profiles: no such file" in error_text(run(*words), out)


def test_poses_shifted_against_their_profiles_are_reported(run, out, tmp_path):
    head, *rows = POSES.read_text().splitlines()
    shifted = tmp_path / "poses.csv"
    shifted.write_text("\n".join([head, *rows[1:], rows[0]]))
    error = error_text(run(*sphere_words(out, shifted)), out)
    assert "each profile belongs to the pose before: pairs shifted" in error


def test_one_wrong_pose_is_left_out_by_the_name_of_its_profile(run, out, tmp_path):
    head, *rows = POSES.read_text().splitlines()
    x, *rest = rows[7].split(",")
    rows[7] = ",".join([str(float(x) + 30.0), *rest])
    wrong = tmp_path / "poses.csv"
    wrong.write_text("\n".join([head, *rows]))
    result = run(*sphere_words(out, wrong))
    assert result.exit_code == 0
    assert "left out: pose_07.csv: " in result.stdout
    assert "11 of 12 poses" in result.stdout


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("--mounting", "on-the-wall"), "expected --mounting eye-in-hand or eye-to-hand"),
        (("--robot-std", "0.05"), "expected --robot-std MM:DEG above 0"),
        (("--robot-std", "1e200:1"), "from 1e-6 to 1000 mm and 1e-7 to 57 deg, got '1e200:1'"),
        (("--radius", "-3"), "expected --radius above 0 mm"),
        (("--frames", "tool0"), "expected --frames ROBOT:SENSOR"),
        (("--frames", "flange:laser"), "expected --easy-handeye F.yaml with --frames, got none"),
    ],
)
def test_slip_in_an_option_is_a_usage_error(run, out, words, error):
    assert error in error_text(run(*sphere_words(out), *words), out, 2)


def test_wrong_mounting_is_rejected(run, out):
    error = error_text(run(*sphere_words(out), "--mounting", "eye-to-hand"), out)
    assert "the mounting" in error


def test_output_that_cannot_be_written_costs_no_work(run, out, tmp_path):
    bad = tmp_path / "nowhere" / "page.html"
    assert "its folder does not exist" in error_text(run(*sphere_words(out), "--report", bad), out)
    words = ("calibrate", "camera", BOARDS, "--out", BOARDS / "board_00.jpg")
    assert "it is also an input" in run(*words).stderr


def test_numbers_in_an_error_message_get_the_names_of_files():
    names = {"image": ["a.png", "b.png"], "line_image": ["l.png", "m.png"]}
    assert (
        add_file_names("line image 1 and image 0", **names)
        == "line image 1 (m.png) and image 0 (a.png)"
    )
    assert add_file_names("image 7", **names) == "image 7"
    assert add_file_names("line image 1", image=["a.png", "b.png"]) == "line image 1"


def test_a_number_in_the_name_of_a_file_gets_no_name():
    names = {"image": ["a.png", "b.png"], "board_image": ["image 1.png"]}
    assert add_file_names("board image 0", **names) == "board image 0 (image 1.png)"


def test_image_keeps_its_depth_and_loses_transparency(tmp_path):
    deep, clear = tmp_path / "deep.png", tmp_path / "clear.png"
    cv2.imwrite(str(deep), np.full((4, 5), 4000, np.uint16))
    cv2.imwrite(str(clear), np.full((4, 5, 4), 9, np.uint8))
    assert read_image(deep).max() == 4000
    assert read_image(clear).shape == (4, 5, 3)


@pytest.fixture(scope="module")
def recipe():
    """The example's recipe, for the truth that its files do not hold."""
    return import_script(EXAMPLE / "make.py")


MOUNT = Pose(rotation_from_vector(np.array([0.2, -0.1, 1.0])), (20.0, 30.0, 120.0))
BASE_FROM_TARGET = Pose(rotation_from_vector(np.array([0.1, 0.2, 0.3])), (700.0, 50.0, 200.0))


def assert_found(found, truth):
    np.testing.assert_allclose(found.rotation, truth.rotation, rtol=0, atol=SMALL_RAD)
    np.testing.assert_allclose(found.translation, truth.translation, rtol=0, atol=SMALL_MM)


def write_flanges(path, flanges):
    path.write_text("\n".join(",".join(map(str, pose.matrix.ravel())) for pose in flanges))
    return path


@pytest.fixture
def calibrate_on_board(run, recipe, camera_json, out, tmp_path):
    """Calibrate by photos of the example's board, with the camera at MOUNT."""
    seen = recipe.board_poses(np.random.default_rng(recipe.SEED))
    flanges = [BASE_FROM_TARGET @ pose.inverse() @ MOUNT.inverse() for pose in seen]
    poses = write_flanges(tmp_path / "poses.csv", flanges)

    def calibrate(photos):
        result = run("calibrate", "hand-eye", "board", photos, "--camera", camera_json,
                     "--poses", poses, "--convention", "matrix", "--out", out)  # fmt: skip
        assert result.exit_code == 0, result.output
        return result.output

    return calibrate


def test_board_gives_the_camera_on_the_flange(calibrate_on_board, out):
    calibrate_on_board(BOARDS)
    assert_found(load_hand_eye(out).flange_from_camera, MOUNT)


def test_image_without_the_board_is_left_out_with_its_pose(calibrate_on_board, out, tmp_path):
    photos = shutil.copytree(BOARDS, tmp_path / "photos")
    hidden = sorted(photos.iterdir())[4]
    cv2.imwrite(str(hidden), np.full(cv2.imread(str(hidden)).shape[:2], 99, np.uint8))
    output = calibrate_on_board(photos)
    assert f"image and its robot pose left out: {hidden}: no ChArUco" in output.replace("\n", " ")
    assert_found(load_hand_eye(out).flange_from_camera, MOUNT)


@pytest.fixture
def hand_eye_error(run, boards, camera_json, out, tmp_path):
    """The error of `calibrate hand-eye board` for `boards`, which may be changed before."""
    flanges = [Pose.along((1, 0, 0), 100.0 * number) for number in range(6)]
    poses = write_flanges(tmp_path / "poses.csv", flanges)
    words = ("calibrate", "hand-eye", "board", boards, "--camera", camera_json,
             "--poses", poses, "--convention", "matrix", "--out", out)  # fmt: skip
    return lambda: error_text(run(*words), out)


def test_images_without_the_board_end_a_hand_eye_calibration(hand_eye_error, boards):
    for number in range(3):
        cv2.imwrite(str(boards / f"board_{number:02}.jpg"), np.full((480, 640), 99, np.uint8))
    error = hand_eye_error()
    assert "3 of 6 images show the board and 4 are needed" in error
    assert "board_00.jpg: no ChArUco" in error


@pytest.mark.parametrize("spoilt", ["image", "camera"])
def test_image_of_another_size_than_the_cameras_is_named(
    hand_eye_error, boards, camera_json, spoilt
):
    if spoilt == "image":
        cv2.imwrite(str(boards / "board_00.jpg"), np.full((240, 320), 99, np.uint8))
    else:
        camera_json.write_text(camera_json.read_text().replace("width: 640", "width: 641"))
    error = hand_eye_error()
    assert "board_00.jpg is " in error
    assert "take all images with one size" in error


@pytest.fixture
def plate_words(out, tmp_path):
    """Twelve profiles of a plate in a folder, their poses, and the command for them."""
    rng = np.random.default_rng(3)
    plate = Plane((0.1, -0.05, 1.0), 310.0)
    motion = TargetMotion(tilt=np.radians(40), working_y=-150.0, offset=0.0)
    sections = draw_section_poses_about(np.array([700.0, 50.0, 250.0]), 12, motion, rng)
    folder = tmp_path / "plate"
    folder.mkdir()
    for number, pose in enumerate(sections):
        profile = simulate_plane_profile(
            plate.transformed(pose.inverse()), SectionView(range_std=0.02), rng
        )
        np.savetxt(folder / f"p{number:02d}.csv", profile.points, delimiter=",", fmt="%.4f")
    poses = write_flanges(tmp_path / "poses.csv", [pose @ MOUNT.inverse() for pose in sections])
    return ("calibrate", "hand-eye", "plane", folder, "--poses", poses, "--convention",
            "matrix", "--out", out)  # fmt: skip


def test_plane_gives_the_sensor_on_the_flange(run, plate_words, out, tmp_path):
    page = tmp_path / "page.html"
    result = run(*plate_words, "--report", page)
    assert result.exit_code == 0, result.output
    assert "<svg" in page.read_text()
    assert_found(load_hand_eye(out).flange_from_section, MOUNT)


def test_plane_proposes_where_to_drive_next(run, plate_words, out, tmp_path):
    plan = tmp_path / "next.csv"
    result = run(*plate_words, "--plan-poses", 3, "--plan-out", plan)
    assert result.exit_code == 0, result.output
    assert "next pose" in result.stdout
    assert "4x4 rows, best first; check each for collisions" in result.stdout
    flanges = read_robot_poses(plan, "matrix")
    assert len(flanges) == 3
    heights = [(flange @ MOUNT).translation[2] for flange in flanges]
    assert min(heights) > 310.0  # above the plate, where the others were


@pytest.mark.parametrize("target", ["sphere", "plane"])
@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("--plan-out", "next.csv"), "expected --plan-poses N with --plan-out"),
        (
            ("--plan-poses", 2, "--mounting", "eye-to-hand"),
            "expected --plan-poses with --mounting eye-in-hand, got",
        ),
        (("--plan-poses", -1), "--plan-poses"),
    ],
)
def test_plan_that_cannot_be_made_is_a_usage_error(run, out, target, words, error):
    asked = [target if word == "sphere" else word for word in sphere_words(out)]
    assert error in error_text(run(*asked, *words), out, 2)


def test_sphere_that_was_bumped_half_way_is_reported(run, out, tmp_path):
    head, *rows = POSES.read_text().splitlines()
    # Robot and sphere moved together show the same profile: so these poses mean another sphere.
    cells = [row.split(",") for row in rows]
    late = [",".join([str(float(x) - 12.0), *rest]) for x, *rest in cells[6:]]
    poses = tmp_path / "poses.csv"
    poses.write_text("\n".join([head, *rows[:6], *late]))
    error = error_text(run(*sphere_words(out, poses)), out)
    assert "the target moved between pose 5 (pose_05.csv) and pose 6 (pose_06.csv)" in error


def target_samples(recipe):
    """Board poses before the camera of the example, and exact flanges, as 4x4 in m."""
    seen = recipe.board_poses(np.random.default_rng(recipe.SEED))
    flanges = [BASE_FROM_TARGET @ pose.inverse() @ MOUNT.inverse() for pose in seen]
    metres = np.diag([1000.0, 1000, 1000, 1])
    return [[np.linalg.inv(metres) @ pose.matrix @ metres for pose in poses]
            for poses in (flanges, seen)]  # fmt: skip


def transform(matrix):
    """A transform as ROS writes it."""
    x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat()
    tx, ty, tz = matrix[:3, 3]
    return {
        "translation": {"x": tx, "y": ty, "z": tz},
        "rotation": {"x": x, "y": y, "z": z, "w": w},
    }


def moveit(flanges, seen):
    return [
        {"effector_wrt_world": f.ravel().tolist(), "object_wrt_sensor": s.ravel().tolist()}
        for f, s in zip(flanges, seen, strict=True)
    ]


def easy_handeye2(flanges, seen):
    pairs = zip(flanges, seen, strict=True)
    return {"samples": [{"robot": transform(f), "tracking": transform(s)} for f, s in pairs]}


def easy_handeye(flanges, seen):
    return {
        "hand_world_samples": {"transforms": [transform(f) for f in flanges]},
        "camera_marker_samples": {"transforms": [transform(s) for s in seen]},
    }


@pytest.mark.parametrize("store", [moveit, easy_handeye2, easy_handeye])
def test_samples_of_ros_tools_give_the_camera_on_the_flange(run, recipe, store, out, tmp_path):
    samples = tmp_path / "samples.yaml"
    samples.write_text(json.dumps(store(*target_samples(recipe))))  # JSON is YAML
    result = run("calibrate", "hand-eye", "poses", samples, "--out", out)
    assert result.exit_code == 0, result.output
    assert_found(load_hand_eye(out).flange_from_camera, MOUNT)


def test_easy_handeye_stores_inverse_flanges_of_a_camera_that_stands_still(
    run, recipe, out, tmp_path
):
    flanges, seen = target_samples(recipe)
    samples = tmp_path / "samples.samples"
    # Read as eye to hand, the inverse of each flange pose is a flange before a fixed camera.
    samples.write_text(json.dumps(easy_handeye2(flanges, seen)))
    result = run(
        "calibrate", "hand-eye", "poses", samples, "--mounting", "eye-to-hand", "--out", out
    )
    assert result.exit_code == 0, result.output
    assert_found(load_hand_eye(out).base_from_camera, MOUNT)


def test_poses_of_target_and_flange_in_two_files(run, recipe, out, tmp_path):
    flanges, seen = target_samples(recipe)
    for name, matrices in (("flanges.csv", flanges), ("targets.csv", seen)):
        rows = np.array(matrices)
        rows[:, :3, 3] *= 1000
        np.savetxt(tmp_path / name, rows.reshape(-1, 16), delimiter=",")
    words = ("calibrate", "hand-eye", "poses", tmp_path / "targets.csv", "--out", out)
    poses = ("--poses", tmp_path / "flanges.csv", "--convention", "matrix")
    assert run(*words, *poses).exit_code == 0
    assert_found(load_hand_eye(out).flange_from_camera, MOUNT)
    out.unlink()
    assert "expected --convention" in error_text(run(*words, *poses[:2]), out, 2)
    wrong = (*poses, "--target-convention", "mine")
    assert "expected --target-convention ur, kuka" in error_text(run(*words, *wrong), out, 2)
    wrong = (*poses, "--max-residual", "0")
    assert "expected --max-residual above 0, got 0" in error_text(run(*words, *wrong), out, 2)


def test_poses_of_target_and_flange_in_two_folders(run, recipe, out, tmp_path):
    for folder, matrices in zip(("flanges", "targets"), target_samples(recipe), strict=True):
        (tmp_path / folder).mkdir()
        for number, matrix in enumerate(matrices):
            matrix[:3, 3] *= 1000
            np.savetxt(tmp_path / folder / f"{number}.csv", matrix.reshape(1, 16), delimiter=",")
    words = ("calibrate", "hand-eye", "poses", tmp_path / "targets", "--convention", "matrix",
             "--poses", tmp_path / "flanges")  # fmt: skip
    inside = tmp_path / "flanges" / "3.csv"
    before = inside.read_bytes()
    result = run(*words, "--out", inside)
    assert (result.exit_code, "it is also an input" in result.stderr) == (2, True)
    assert inside.read_bytes() == before
    result = run(*words, "--out", out)
    assert result.exit_code == 0, result.output
    assert_found(load_hand_eye(out).flange_from_camera, MOUNT)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("[1, 2]", "samples of MoveIt, easy_handeye or easy_handeye2"),
        ("samples: [{robot: 1}]", "no 'tracking'"),
        ("[{effector_wrt_world: [1], object_wrt_sensor: [1]}]", "expected 16 numbers"),
        ("{hand_world_samples: {transforms: [1]}, camera_marker_samples: {transforms: []}}",
         "1 poses of the hand and 0 of the marker"),
        ("plain", "a str"),
    ],
)  # fmt: skip
def test_files_that_hold_no_samples_are_rejected(run, text, error, out, tmp_path):
    samples = tmp_path / "samples.yaml"
    samples.write_text(text)
    message = error_text(run("calibrate", "hand-eye", "poses", samples, "--out", out), out)
    assert "samples.yaml: expected samples of MoveIt" in message
    assert error in message
