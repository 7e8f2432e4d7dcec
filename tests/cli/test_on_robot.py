"""`measure` and `scan` with a sensor on a robot: the example's pipe, and error messages."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from lsvision.calibration.hand_eye_result import HandEye
from lsvision.geometry import Pose
from lsvision.io.hand_eye_file import save_hand_eye

EXAMPLE = Path(__file__).parents[2] / "calibration" / "example"
PIPE, POSES = EXAMPLE / "pipe", EXAMPLE / "pipe_poses.csv"
TRUTH = json.loads((EXAMPLE / "truth.json").read_text())
SIGMAS = 4.0  # one wrong alarm in 16 000 for each number
NUMBERS = 6 * 2  # sections, coordinates across the axis
MEAN_SQUARE = (0.2, 2.6)  # chi^2 of NUMBERS over NUMBERS, at 99.8 %
FAR_TOO_MUCH = 5.0  # what the mean square exceeds where the errors are left out


def calibration(mounting="eye_in_hand", sensor="section"):
    """The example's truth, with the errors that its robot and such a calibration have."""
    return HandEye(
        mount_from_sensor=Pose.from_matrix(TRUTH["flange_from_section"]),
        covariance=np.diag([0.01**2] * 3 + [2e-5**2] * 3), residuals=[0.1],
        leave_one_out_residuals=[0.1], rejected=(), target=Pose(), working_point=(0, -260, 0),
        robot_std=(0.02, 8.7e-5),
        ambiguity_ratio=9.0, least_determined_std=0.1, least_determined_direction="none",
        mounting=mounting, sensor=sensor,
    )  # fmt: skip


@pytest.fixture
def hand_eye(tmp_path):
    save_hand_eye(calibration(), tmp_path / "hand_eye.json")
    return tmp_path / "hand_eye.json"


@pytest.fixture
def on_robot(run, hand_eye):
    """Runs a command on the example's pipe, its poses and the hand-eye file."""
    options = ("--poses", POSES, "--convention", "kuka", "--radius", 15)
    return lambda name, *more: run(name, PIPE, *options, "--flange-from-section", hand_eye, *more)


def misses(path, frame="base_frame"):
    """Of each section, how far its point lies from the true axis: mm across it, and sigmas."""
    point, axis = np.array(TRUTH["pipe"]["point"]), np.array(TRUTH["pipe"]["direction"])
    for record in json.loads(path.read_text())["measurements"]:
        (cylinder,) = record["cylinders"]
        placed = cylinder[frame]
        away = np.array(placed["point_mm"]) - point
        across = np.linalg.svd(axis[None])[2][1:]
        covariance = across @ np.array(placed["twins"][0]["covariance"])[:3, :3] @ across.T
        miss = across @ away
        yield miss @ np.linalg.solve(covariance, miss)


def test_measured_points_lie_on_the_axis_within_their_errors(on_robot, tmp_path):
    result = on_robot("measure", "--known-radius", 15, "--json", tmp_path / "m.json")
    assert result.exit_code == 0, result.output
    assert result.stdout.count("base frame, one sigma, with the calibration's and the robot's") == 6
    low, high = MEAN_SQUARE
    assert low < sum(misses(tmp_path / "m.json")) / NUMBERS < high


def test_one_of_both_directions_is_the_pipes(on_robot, tmp_path):
    assert on_robot("measure", "--known-radius", 15, "--json", tmp_path / "m.json").exit_code == 0
    for record in json.loads((tmp_path / "m.json").read_text())["measurements"]:
        twins = record["cylinders"][0]["base_frame"]["twins"]
        sines = [
            np.linalg.norm(np.cross(twin["direction"], TRUTH["pipe"]["direction"]))
            / np.radians(twin["direction_std_deg"])
            for twin in twins
        ]
        assert min(sines) < SIGMAS


def test_csv_has_columns_of_the_base_frame(on_robot, tmp_path):
    words = ("--csv", tmp_path / "m.csv", "--json", tmp_path / "m.json")
    assert on_robot("measure", *words).exit_code == 0
    rows = list(csv.DictReader((tmp_path / "m.csv").read_text().splitlines()))
    records = json.loads((tmp_path / "m.json").read_text())["measurements"]
    for row, record in zip(rows, records, strict=True):
        placed = record["cylinders"][0]["base_frame"]
        assert [float(row[f"base_point_{axis}_mm"]) for axis in "xyz"] == placed["point_mm"]
        minus = placed["twins"][1]
        assert [float(row[f"base_direction_minus_{a}"]) for a in "xyz"] == minus["direction"]
        assert float(row["base_direction_minus_std_deg"]) == minus["direction_std_deg"]
        assert row["includes_calibration"] == "True"


def test_without_poses_the_table_is_in_the_flange_frame(run, hand_eye, tmp_path):
    words = ("--flange-from-section", hand_eye, "--json", tmp_path / "m.json")
    result = run("measure", PIPE / "pipe_4.csv", *words, "--radius", 15)
    assert result.exit_code == 0, result.output
    assert "flange frame, one sigma, with the calibration's error" in result.stdout
    (record,) = json.loads((tmp_path / "m.json").read_text())["measurements"]
    assert {"flange_frame"} == {key for key in record["cylinders"][0] if key.endswith("_frame")}


def test_without_a_calibration_its_errors_are_said_to_be_left_out(run, tmp_path):
    sections = tmp_path / "sections.txt"
    flange_from_section = Pose.from_matrix(TRUTH["flange_from_section"])
    from lsvision.io.robot_poses import read_robot_poses

    poses = [pose @ flange_from_section for pose in read_robot_poses(POSES, "kuka")]
    np.savetxt(sections, [pose.matrix.ravel() for pose in poses])
    words = (PIPE, "--poses", sections, "--convention", "matrix", "--known-radius", 15)
    result = run("measure", *words, "--json", tmp_path / "m.json")
    assert result.stdout.count("the sensor's pose on the robot taken as exact") == 6
    assert sum(misses(tmp_path / "m.json")) / NUMBERS > FAR_TOO_MUCH


def test_a_scan_has_the_errors_of_robot_and_calibration(on_robot, run, tmp_path):
    result = on_robot("scan", "--json", tmp_path / "s.json")
    assert result.exit_code == 0, result.output
    assert (
        "6 profiles, base frame, one sigma, with the calibration's and the robot's" in result.stdout
    )
    (pipe,) = json.loads((tmp_path / "s.json").read_text())["cylinders"]
    sine = np.linalg.norm(np.cross(pipe["direction"], TRUTH["pipe"]["direction"]))
    away = np.array(pipe["point_mm"]) - TRUTH["pipe"]["point"]
    miss = np.linalg.norm(np.cross(away, TRUTH["pipe"]["direction"]))
    assert pipe["includes_calibration"]
    assert sine < SIGMAS * np.radians(pipe["direction_std_deg"])
    assert miss < SIGMAS * pipe["position_std_mm"]
    assert abs(pipe["radius_mm"] - 15) < SIGMAS * pipe["radius_std_mm"]


def camera_file(folder):
    save_hand_eye(calibration(sensor="camera"), folder / "camera.json")
    return folder / "camera.json"


def standing_file(folder):
    save_hand_eye(calibration(mounting="eye_to_hand"), folder / "standing.json")
    return folder / "standing.json"


def rig_file(folder):
    return shutil.copy(EXAMPLE / "truth.json", folder / "rig.json")


@pytest.mark.parametrize("command", ["measure", "scan"])
@pytest.mark.parametrize(
    ("file", "message"),
    [
        (
            camera_file,
            "camera.json: expected a calibration of a section, eye in hand, got one of a cam",
        ),
        (
            standing_file,
            "standing.json: expected a calibration of a section, eye in hand, got one of a",
        ),
        (
            rig_file,
            "rig.json: expected schema 'lsvision/hand-eye/1', got None: check that it is a "
            "hand-eye file",
        ),
        (lambda folder: folder / "none.json", "none.json: no such file: check the name"),
    ],
    ids=["camera", "standing", "schema", "missing"],
)
def test_another_file_is_no_hand_eye_file(run, tmp_path, command, file, message):
    words = ("--poses", POSES, "--convention", "kuka", "--flange-from-section", file(tmp_path))
    result = run(command, PIPE, *words)
    assert result.exit_code == 1
    assert message in " ".join(result.stderr.split())
    assert result.stdout == ""


@pytest.mark.parametrize("command", ["measure", "scan"])
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--poses", POSES], "expected --convention ur, kuka"),
        (["--poses", POSES, "--convention", "euler"], "got euler"),
        (["--convention", "kuka"], "expected --poses with --convention, got none"),
    ],
)
def test_poses_are_never_guessed(run, command, words, message):
    result = run(command, PIPE, *words)
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())


def test_a_scan_needs_poses_beside_the_hand_eye_file(run, hand_eye):
    result = run("scan", PIPE, "--flange-from-section", hand_eye, "--feed", "0,0,1", "--step", 1)
    assert result.exit_code == 2
    assert "expected --poses with --flange-from-section, got none" in result.stderr


@pytest.mark.parametrize("command", ["measure", "scan"])
def test_poses_must_be_as_many_as_profiles(run, hand_eye, command):
    words = ("--poses", POSES, "--convention", "kuka", "--flange-from-section", hand_eye)
    result = run(command, PIPE / "pipe_0.csv", *words)
    assert result.exit_code == 1
    assert "expected 1 pose, one for each profile, got 6: leave out" in result.stderr
    assert result.stdout == ""


@pytest.mark.parametrize("bad", ["gone.csv", "gone-*.csv", "bad.csv"])
def test_a_profile_that_cannot_be_read_leaves_every_pose_open(run, hand_eye, tmp_path, bad):
    (tmp_path / "bad.csv").write_text("no numbers\n")
    words = ("--poses", POSES, "--convention", "kuka", "--flange-from-section", hand_eye)
    files = [PIPE / f"pipe_{number}.csv" for number in range(5)]
    result = run("measure", *files, tmp_path / bad, *words)
    assert result.exit_code == 1
    assert bad in result.stderr
    assert result.stdout == ""


def test_no_output_overwrites_the_hand_eye_file(on_robot, hand_eye):
    before = hand_eye.read_bytes()
    assert "it is also an input" in on_robot("measure", "--json", hand_eye).stderr
    assert hand_eye.read_bytes() == before


@pytest.mark.parametrize("command", ["measure", "scan"])
def test_no_output_overwrites_one_of_several_pose_files(run, tmp_path, command):
    head, *rows = POSES.read_text().splitlines()
    for number, row in enumerate(rows):
        (tmp_path / f"{number}.csv").write_text(f"{head}\n{row}\n")
    path = tmp_path / "3.csv"
    words = ("--poses", tmp_path, "--convention", "kuka", "--csv", path)
    result = run(command, PIPE, *words)
    assert (result.exit_code, "it is also an input" in result.stderr) == (2, True), result.output
    assert path.read_text() == f"{head}\n{rows[3]}\n"
