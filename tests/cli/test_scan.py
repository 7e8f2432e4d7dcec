"""``lsvision scan``: from files to numbers, pictures and clouds; rejected input."""

import csv
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from lsvision.cli.scan import MAX_FEED_STD_DEG, MAX_POSE_STD_MM, scan
from lsvision.scan import PoseErrors

FIXTURES = Path(__file__).parents[2] / "fixtures"
PAIR = FIXTURES / "scan_welded_pair"
MOTION = ("--feed", "0,0,1", "--step", "1")


@pytest.fixture
def run():
    """Runs ``lsvision scan WORDS...`` by the frame of the real program."""
    frame = sys.modules.get("lsvision.cli.app") or __import__("lsvision.cli.app", fromlist=["app"])
    app = typer.Typer(cls=frame._OneLineErrors, rich_markup_mode=None)
    app.callback()(frame._global_options)
    app.command()(scan)
    return lambda *words: CliRunner().invoke(
        app, ["scan", *map(str, words)], env={"COLUMNS": "200", "NO_COLOR": "1"}
    )


def test_a_folder_of_sections_gives_a_table(run) -> None:
    result = run(PAIR, *MOTION, "--range-std", 0.05)
    assert result.exit_code == 0, result.output
    assert "20 profiles, base frame, one sigma" in result.stdout
    assert "2: ovality" in result.stdout
    assert "0-19" in result.stdout


def test_all_outputs_are_written(run, tmp_path) -> None:
    names = {"--json": "a.json", "--plot": "a.png", "--points": "p.ply", "--surfaces": "s.ply"}
    words = [word for option, name in names.items() for word in (option, tmp_path / name)]
    assert run(PAIR, *MOTION, *words).exit_code == 0
    document = json.loads((tmp_path / "a.json").read_text())
    assert document["schema"] == "lsvision.scan/1"
    assert [round(c["radius_mm"]) for c in document["cylinders"]] == [19, 15]
    assert document["cylinders"][0]["shape"]["bow_p_value"] > 0.001
    assert len(document["sources"]) == 20
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    for name in ("p.ply", "s.ply"):
        assert (tmp_path / name).read_bytes().startswith(b"ply\n")


def write_poses(path: Path, count: int) -> Path:
    np.savetxt(path, [[0, 0, 100.0 + k, 0, 0, 0] for k in range(count)], delimiter=",")
    return path


def test_robot_poses_say_where_the_sections_are(run, tmp_path) -> None:
    poses = write_poses(tmp_path / "poses.csv", 20)
    result = run(PAIR, "--poses", poses, "--convention", "kuka", "--json", tmp_path / "a.json")
    assert result.exit_code == 0, result.output
    document = json.loads((tmp_path / "a.json").read_text())
    np.testing.assert_allclose(
        document["cylinders"][0]["direction"], [0.321, 0.117, 0.940], rtol=0, atol=0.002
    )


def test_one_section_tells_of_its_twin(run) -> None:
    result = run(PAIR / "section_00.csv", *MOTION)
    assert result.exit_code == 0
    assert result.stdout.count("its twin (") == 2


def test_sections_closer_than_the_noise_have_no_shape(run) -> None:
    result = run(PAIR, "--feed", "0,0,1", "--step", 0.0001)
    assert result.exit_code == 0, result.output
    assert "ovality" not in result.stdout


def test_a_scan_without_cylinders_says_so(run) -> None:
    result = run(FIXTURES / "empty.csv", *MOTION)
    assert result.exit_code == 0
    assert "1 profile: no cylinder found" in result.stdout


def test_arcs_that_do_not_meet_ask_for_the_poses(run) -> None:
    result = run(PAIR, "--feed", "0,0,1", "--step", 1000, "-v")
    assert (
        "20 sections show an arc, and no two of them lie on one cylinder: check that"
        in result.stdout
    )
    assert "one section allows two directions, and no other section shows the arc" in result.stdout


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ([PAIR], 2, "expected --feed X,Y,Z and --step MM, or --poses F and --convention NAME"),
        ([PAIR, "--feed", "0,0,1"], 2, "expected --feed X,Y,Z and --step MM"),
        ([PAIR, "--feed", "0,1", "--step", 1], 2, "expected --feed X,Y,Z such as 0,0,1, got '0,1'"),
        ([PAIR, "--feed", "0,0,0", "--step", 1], 2, "expected --feed of a finite length above 0"),
        ([PAIR, "--feed", "0,0,inf", "--step", 1], 2, "expected --feed of a finite length above 0"),
        ([PAIR, "--feed", "0,0,1", "--step", 0], 2, "expected --step in mm other than 0"),
        ([PAIR, "--feed", "0,0,1", "--step", 1e12], 2, "at most 100000, got 1e+12"),
        ([PAIR, *MOTION, "--poses", "p.csv"], 2, "or --poses, got both"),
        ([PAIR, *MOTION, "--convention", "ur"], 2, "expected --poses with --convention"),
        ([PAIR, "--poses", "p.csv"], 2, "expected --convention ur, kuka"),
        ([PAIR, "--poses", "p.csv", "--convention", "euler"], 2, "got euler"),
        ([PAIR, *MOTION, "--plot", "a.bmp"], 2, "expected --plot F.png or F.svg"),
        ([PAIR, *MOTION, "--feed-std-deg", 80], 2, "Invalid value for '--feed-std-deg': "),
        (["nowhere.csv", *MOTION], 1, "nowhere.csv"),
        ([PAIR, "--feed", "1,0,0", "--step", 1], 1, "all 20 sections lie in one plane"),
    ],
)
def test_slips_are_reported_in_one_line(run, words, code: int, message: str) -> None:
    result = run(*words)
    assert result.exit_code == code
    assert message in " ".join(result.stderr.split())
    assert "Traceback" not in result.stderr


def test_limits_of_the_poses_errors_are_those_of_a_scan() -> None:
    assert PoseErrors(pose_std=MAX_POSE_STD_MM, feed_std=np.radians(MAX_FEED_STD_DEG))
    with pytest.raises(ValueError, match="pose_std"):
        PoseErrors(pose_std=MAX_POSE_STD_MM + 1)
    with pytest.raises(ValueError, match="feed_std"):
        PoseErrors(feed_std=np.radians(MAX_FEED_STD_DEG + 1))


def test_an_error_of_the_feed_without_a_feed_is_a_usage_error(run, tmp_path) -> None:
    there_and_back = np.array([np.eye(4)] * 3)
    there_and_back[1, 2, 3] = 5.0
    poses = tmp_path / "poses.csv"
    np.savetxt(poses, there_and_back.reshape(3, 16), delimiter=",")
    sections = [PAIR / f"section_{number:02}.csv" for number in range(3)]
    robot = ("--poses", poses, "--convention", "matrix")
    result = run(*sections, *robot, "--feed-std-deg", 1)
    assert result.exit_code == 2
    assert "expected --feed-std-deg with a feed" in result.stderr


def test_the_length_of_the_feed_does_not_matter(run) -> None:
    sections = [PAIR / f"section_0{number}.csv" for number in range(4)]
    unit, short = (run(*sections, "--feed", f, "--step", 1) for f in ("0,0,1", "0,0,1e-300"))
    assert unit.exit_code == short.exit_code == 0, short.output
    assert unit.stdout == short.stdout


def test_poses_must_be_as_many_as_profiles(run, tmp_path) -> None:
    poses = write_poses(tmp_path / "poses.csv", 7)
    result = run(PAIR, "--poses", poses, "--convention", "kuka")
    assert result.exit_code == 1
    assert "expected 20 poses, one for each profile, got 7" in result.stderr


def test_a_pose_file_in_another_convention_is_rejected(run, tmp_path) -> None:
    poses = write_poses(tmp_path / "poses.csv", 20)
    result = run(PAIR, "--poses", poses, "--convention", "ur")
    assert result.exit_code == 1
    assert "m" in result.stderr


def test_the_csv_holds_intervals_phi_and_theta(run, tmp_path) -> None:
    path = tmp_path / "a.csv"
    assert run(PAIR, *MOTION, "--csv", path).exit_code == 0
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert [round(float(row["radius_mm"])) for row in rows] == [19, 15]
    for row in rows:
        for name in ("radius", "point_x", "phi"):
            unit = "deg" if name == "phi" else "mm"
            value, low, high = (
                float(row[f"{name}{part}_{unit}"]) for part in ("", "_low_95", "_high_95")
            )
            assert low <= value <= high
        direction = np.array([float(row[f"direction_{axis}"]) for axis in "xyz"])
        phi, theta = np.radians(float(row["phi_deg"])), np.radians(float(row["theta_deg"]))
        expected = [np.sin(phi) * np.cos(theta), np.sin(phi) * np.sin(theta), np.cos(phi)]
        signs = {-1.0, 1.0}
        assert any(
            np.allclose(direction, np.array(expected) * [s, s, t], atol=1e-6)
            for s in signs
            for t in signs
        )


def test_a_matrix_of_heights_is_a_scan(run, tmp_path) -> None:
    x = -30 + 0.25 * np.arange(240)
    rng = np.random.default_rng(3)
    heights = -300 + np.sqrt(np.maximum(19.0**2 - x**2, 0)) + rng.normal(0, 0.03, (12, 240))
    heights[:, np.abs(x) > 17] = np.nan
    np.save(tmp_path / "rows.npy", heights)
    out = tmp_path / "out.json"
    found = run(tmp_path / "rows.npy", *MOTION, "--x0", -30, "--dx", 0.25, "--json", out)
    assert found.exit_code == 0, found.output
    assert "12 profiles" in found.stdout
    (radius,) = re.findall(r"(?m)^1 +([0-9.]+) ±", found.stdout)
    assert abs(float(radius) - 19) < 0.05
    assert "units taken as mm" in found.stderr
    inputs = json.loads(out.read_text())["inputs"]
    assert [record["units_assumed"] for record in inputs] == [True] * 12
    outcome = run(tmp_path / "rows.npy", *MOTION)
    assert outcome.exit_code == 1
    assert "--x0 and --dx" in outcome.stderr


@pytest.mark.parametrize("name", ["lost.csv", "lost.npy"])
def test_a_file_whose_points_are_all_lost_is_a_section_without_points(run, tmp_path, name) -> None:
    lost = tmp_path / name
    lost.write_text("x,z\n1,nan\n2,nan\n3,nan\n")
    if name.endswith("npy"):
        np.save(lost, np.full((1, 3, 2), np.nan))
    sections = sorted(PAIR.glob("*.csv"))
    outputs = ("--json", tmp_path / "a.json", "--plot", tmp_path / "a.png")
    result = run(*sections[:3], lost, *sections[4:7], *MOTION, *outputs)
    assert result.exit_code == 0, result.output
    assert f"{lost}: note: all points are lost: a section without points" in result.stderr
    assert "7 profiles" in result.stdout
    assert "0-2, 4-6" in result.stdout
    result = run(lost, *MOTION)
    assert result.exit_code == 1
    assert "all points of all sections (1) are lost" in result.stderr


def test_a_unit_that_cannot_be_mm_is_rejected_in_a_scan_too(run, tmp_path) -> None:
    for number in range(2):
        points = np.loadtxt(sorted(PAIR.glob("*.csv"))[number], delimiter=",", comments=["#", "x"])
        np.savetxt(tmp_path / f"{number}.csv", points[:, [0, -1]] * 1000, delimiter=",")
    outcome = run(tmp_path, *MOTION)
    assert outcome.exit_code == 1
    assert "--units um, or --units mm if it is correct" in outcome.stderr
