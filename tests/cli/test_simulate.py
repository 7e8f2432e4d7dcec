"""`lsvision simulate`: files, truth, and error messages."""

import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from lsvision.cli.simulate import simulate
from lsvision.errors import DegenerateGeometry, UnwritableFile
from lsvision.simulate import random_section

USAGE = 2


@pytest.fixture
def run(tmp_path):
    app = typer.Typer()
    app.command()(simulate)
    return lambda *words: CliRunner().invoke(
        app, [*words, "--out", str(tmp_path)], env={"COLUMNS": "200", "NO_COLOR": "1"}
    )


def test_it_writes_each_scene_with_its_truth(run, tmp_path):
    result = run("single", "--seed", "3", "--count", "2")
    assert result.exit_code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "single_0003.csv",
        "single_0003.truth.json",
        "single_0004.csv",
        "single_0004.truth.json",
    ]
    points = np.loadtxt(tmp_path / "single_0004.csv", delimiter=",", skiprows=4)
    np.testing.assert_allclose(points, random_section("single", 4).profile.points, atol=1e-9)


def test_options_reach_the_scene(run, tmp_path):
    tube = ("--radius", "19", "--theta-deg", "30", "--phi-deg", "20")
    errors = ("--noise-mm", "0.03", "--lost", "0", "--jumps", "0")
    assert run("single", *tube, *errors).exit_code == 0
    truth = json.loads((tmp_path / "single_0000.truth.json").read_text())
    (tube,) = truth["tubes"]
    assert tube["radius_mm"] == 19.0
    assert np.degrees([tube["theta_rad"], tube["phi_rad"]]) == pytest.approx([30, 20], abs=1e-4)
    assert truth["sensor"]["range_std_mm"] == 0.03
    assert truth["settings"]["lost_fraction"] == truth["settings"]["jump_fraction"] == 0


def test_the_command_in_the_truth_writes_the_same_bytes(run, tmp_path):
    done = run("welded_pair", "--seed", "5", "--radius", "12:30.5", "--lost", "0.1")
    assert "welded_pair_0005.csv with its .truth.json" in done.stdout
    before = (tmp_path / "welded_pair_0005.csv").read_bytes()
    truth = (tmp_path / "welded_pair_0005.truth.json").read_bytes()
    command = json.loads(truth)["command"].split()
    assert command[:2] == ["lsvision", "simulate"]
    run(*command[2:])
    assert (tmp_path / "welded_pair_0005.csv").read_bytes() == before
    assert (tmp_path / "welded_pair_0005.truth.json").read_bytes() == truth


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["double"], "expected one of single"),
        (["single", "--radius", "ten"], "expected a number or min:max for --radius"),
        (["single", "--radius", "1:2:3"], "expected a number or min:max for --radius"),
        (["single", "--radius", "40:10"], "expected radius min:max above 0 mm, got 40 to 10"),
        (["single", "--phi-deg", "89"], "expected phi within 0 to 80 deg, got 89 to 89"),
        (["single", "--noise-mm", "0"], "expected --noise-mm above 0"),
        (["single", "--noise-mm", "1e200"], "from 1e-6 to 1000, got 1e+200"),
        (["single", "--count", "0"], "--count"),
    ],
)
def test_a_slip_of_the_user_is_a_usage_error(run, tmp_path, words, message):
    result = run(*words)
    assert result.exit_code == USAGE
    assert message in " ".join(result.output.replace("│", " ").split())
    assert not list(tmp_path.iterdir())


def test_what_the_world_rejects_is_an_lsvision_error(tmp_path):
    with pytest.raises(UnwritableFile, match="nowhere"):
        simulate("single", tmp_path / "nowhere")
    with pytest.raises(DegenerateGeometry, match="ask for radii of about 10 to 40 mm"):
        simulate("single", tmp_path, radius="900")
