"""The golden data is what its recipe makes, and what a reader sees in it is true."""

import json
import math
import runpy
from pathlib import Path

import numpy as np
import pytest

from lsvision.geometry import Ellipse, orthogonal_residuals
from tests.scripts import import_script

FIXTURES = Path(__file__).parents[1] / "fixtures"
SECTIONS = sorted(path.name.removesuffix(".truth.json") for path in FIXTURES.glob("*.truth.json"))
SCANS = sorted(path.name for path in FIXTURES.glob("scan_*"))
MAX_CSV_BYTES = 20_000  # bytes
SIX_SIGMA = 6.0  # of some 1500 points none is further out


@pytest.fixture(scope="module")
def rebuilt(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fixtures")
    recipe = import_script(FIXTURES / "make.py")
    recipe.main(folder)
    return folder


def read_points(path):
    return np.loadtxt(path, delimiter=",", comments="#", skiprows=4)


def made_files(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_the_recipe_makes_every_file_bit_for_bit(rebuilt):
    made = made_files(rebuilt)
    assert len(made) == 7 * 2 + 3 * 21
    for name, content in made.items():
        assert (FIXTURES / name).read_bytes() == content, name


@pytest.mark.parametrize("script", ["fixtures", "fixtures/images", "calibration/example"])
def test_the_help_of_a_recipe_makes_no_folder(script, tmp_path, monkeypatch, capsys):
    path = str(FIXTURES.parent / script / "make.py")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [path, "--help"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(path, run_name="__main__")
    assert ended.value.code == 0
    assert "usage: make.py" in capsys.readouterr().out
    assert not [*tmp_path.iterdir()]


def test_there_are_seven_sections_and_three_scans():
    kinds = "complex empty planar single three_stacked welded_complex welded_pair"
    assert kinds.split() == SECTIONS
    assert SCANS == ["scan_bent_pipe", "scan_crossing_pair", "scan_welded_pair"]


@pytest.mark.parametrize("name", SECTIONS)
def test_a_section_is_small_and_its_truth_names_seed_and_command(name):
    assert (FIXTURES / f"{name}.csv").stat().st_size < MAX_CSV_BYTES
    truth = json.loads((FIXTURES / f"{name}.truth.json").read_text())
    assert truth["schema"] == "lsvision.simulated_section/1"
    assert truth["kind"] == name
    assert (truth["seed"] >= 0, truth["command"]) == (True, "python fixtures/make.py")


def assert_labels_are_true(points, labels, tubes, sensor):
    assert len(points) == len(labels) == sensor["columns"]
    for tube in tubes:
        phi = tube["phi_rad"]
        radius = tube["radius_mm"]
        ellipse = Ellipse(
            tuple(tube["centre_mm"]), radius / math.cos(phi), radius, tube["theta_rad"]
        )
        mine = points[labels == tube["label"]]
        assert len(mine) == tube["points"]
        sigma = sensor["range_std_mm"] * np.max(np.sum(mine**2, axis=1), initial=0) / 400.0**2
        off = np.abs(orthogonal_residuals(mine, ellipse)) if len(mine) else np.zeros(1)
        assert off.max() < SIX_SIGMA * sigma + sensor["quantum_mm"]
    assert np.isfinite(points[labels >= 0]).all()


@pytest.mark.parametrize("name", SECTIONS)
def test_labelled_points_lie_on_their_tube(name):
    truth = json.loads((FIXTURES / f"{name}.truth.json").read_text())
    points = read_points(FIXTURES / f"{name}.csv")
    assert_labels_are_true(points, np.array(truth["labels"]), truth["tubes"], truth["sensor"])


@pytest.mark.parametrize("name", ["scan_crossing_pair", "scan_welded_pair"])
def test_labelled_points_of_a_scan_lie_on_their_tubes(name):
    truth = json.loads((FIXTURES / name / "scan.truth.json").read_text())
    assert truth["schema"] == "lsvision.simulated_scan/1"
    for number in range(20):
        points = read_points(FIXTURES / name / f"section_{number:02d}.csv")
        labels = np.array(truth["labels_by_section"][number])
        tubes = truth["tubes_by_section"][number]
        assert_labels_are_true(points, labels, tubes, truth["sensor"])


def test_the_bent_pipe_is_bent_and_seen_as_such():
    truth = json.loads((FIXTURES / "scan_bent_pipe" / "scan.truth.json").read_text())
    (pipe,) = truth["tubes_in_base"]
    centre, normal = np.array(pipe["bend_centre_mm"]), np.array(pipe["bend_normal"])
    for number in range(20):
        points = read_points(FIXTURES / "scan_bent_pipe" / f"section_{number:02d}.csv")
        mine = points[np.array(truth["labels_by_section"][number]) == 1]
        pose = np.array(truth["base_from_sections"][number])
        relative = mine @ pose[:3, :2].T + pose[:3, 3] - centre
        height = relative @ normal
        spoke = np.sqrt((relative**2).sum(axis=1) - height**2)
        off = np.hypot(spoke - pipe["bend_radius_mm"], height) - pipe["radius_mm"]
        assert np.abs(off).max() < SIX_SIGMA * 0.06 + 0.01


def test_the_crossing_scan_ends_without_the_tube_that_ends():
    truth = json.loads((FIXTURES / "scan_crossing_pair" / "scan.truth.json").read_text())
    seen = [sorted({tube["label"] for tube in tubes}) for tubes in truth["tubes_by_section"]]
    assert seen[0] == [1, 2]
    assert seen[-1] == [1]
