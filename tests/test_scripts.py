"""The scripts of `calibration/` run on the shipped example, and find its truth."""

import json
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lsvision.geometry import Pose
from lsvision.io.camera_file import read_camera
from lsvision.io.hand_eye_file import load_hand_eye
from lsvision.sensors.light_section import LightSection
from tests.calibration.hand_eye_scenes import pose_errors
from tests.printed import differing
from tests.scripts import import_script

CALIBRATION = Path(__file__).parents[1] / "calibration"
EXAMPLE = CALIBRATION / "example"
TRUTH = json.loads((EXAMPLE / "truth.json").read_text())
SIGMAS = 5.0  # of a few numbers under one fixed seed none is further out
MAX_BYTES = 1_500_000


def script(name, *words):
    return subprocess.run(
        [sys.executable, CALIBRATION / f"{name}.py", *map(str, words)],
        capture_output=True, text=True, timeout=120, check=False, cwd=CALIBRATION,
    )  # fmt: skip


ONE_AFTER_THE_OTHER = """
import runpy, sys
folder, *names = sys.argv[1:]
for name in names:
    print(f"== {name}")
    sys.argv = [f"{name}.py", "--results", folder]
    try:
        runpy.run_path(sys.argv[0], run_name="__main__")
    except SystemExit as ended:
        assert not ended.code, name
"""
"""Scripts in one process: each would import for longer than some of them calculate."""


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of all three steps on the example, and what they print."""
    folder = tmp_path_factory.mktemp("results")
    names = ("camera", "laser_plane", "sensor_to_robot")
    done = subprocess.run(
        [sys.executable, "-c", ONE_AFTER_THE_OTHER, folder, *names],
        capture_output=True, text=True, timeout=300, check=False, cwd=CALIBRATION,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    texts = re.split(r"^== \w+\n", done.stdout, flags=re.MULTILINE)
    return folder, dict(zip(names, texts[1:], strict=True))


def test_camera_of_the_example_is_found_within_its_sigmas(results):
    folder, printed = results
    camera, std = (
        read_camera(folder / "camera.json"),
        json.loads((folder / "camera.json").read_text())["std"],
    )
    truth = np.array(TRUTH["camera_matrix"])
    for name, place in (("fx", (0, 0)), ("fy", (1, 1)), ("cx", (0, 2)), ("cy", (1, 2))):
        assert abs(camera.matrix[place] - truth[place]) < SIGMAS * std[name], name
    assert "14 of 14 images" in printed["camera"]


def test_laser_plane_of_the_example_is_found_within_its_covariance(results):
    rig = LightSection.load(results[0] / "rig.json")
    covariance = np.array(json.loads((results[0] / "laser_plane.json").read_text())["covariance"])
    x_axis, y_axis, _ = rig.camera_from_section.rotation.T
    normal, distance = np.array(TRUTH["laser_plane"]["normal"]), TRUTH["laser_plane"]["distance"]
    normal = normal * np.sign(normal @ rig.laser_plane.normal)
    error = [normal @ y_axis, -(normal @ x_axis), rig.laser_plane.distance - distance]
    assert error @ np.linalg.solve(covariance, error) < SIGMAS**2
    assert rig.provenance["inputs_sha256"]


def test_sensor_on_the_flange_is_found_within_its_covariance(results):
    found = load_hand_eye(results[0] / "hand_eye.json")
    truth = Pose.from_matrix(TRUTH["flange_from_section"])
    error = pose_errors(found.flange_from_section, truth)
    assert error @ np.linalg.solve(found.covariance, error) < SIGMAS**2
    assert found.rejected == ()


def test_each_step_leaves_its_files_and_a_page_that_stands_alone(results):
    made = {path.name for path in results[0].iterdir()}
    assert made == {
        *("camera.json", "camera.yaml", "camera.html", "rig.json", "laser_plane.json"),
        *("rig.html", "hand_eye.json", "hand_eye.yaml", "hand_eye.html"),
    }
    for page in results[0].glob("*.html"):
        text = page.read_text()
        assert text.count("<svg") == 2 + (14 if page.stem in ("camera", "rig") else 0)
        assert "<script" not in text
        assert 'src="http' not in text


def test_figures_of_the_readme_are_what_the_scripts_print(results):
    printed = {line.strip() for text in results[1].values() for line in text.splitlines()}
    blocks = re.findall(r"```text\n(.*?)```", (CALIBRATION / "README.md").read_text(), re.DOTALL)
    shown = [line.strip() for block in blocks for line in block.splitlines()]
    assert len(shown) == 7
    missing = [s for s in shown if all(differing([line], [s]) for line in printed)]
    assert missing == []


def test_a_folder_of_ones_own_is_taken_and_a_missing_one_is_named(tmp_path):
    done = script("camera", tmp_path / "nowhere")
    assert done.returncode == 1
    assert "nowhere" in done.stderr
    assert not (tmp_path / "nowhere").exists()


@pytest.fixture
def command_of(monkeypatch):
    """The words of the command that a script runs, which is not run."""
    monkeypatch.syspath_prepend(CALIBRATION)
    commands = []
    monkeypatch.setattr("lsvision.cli.main", lambda: commands.append(list(sys.argv)))

    def words(name, *given):
        monkeypatch.setattr(sys, "argv", [f"{name}.py", *map(str, given)])
        runpy.run_path(str(CALIBRATION / f"{name}.py"), run_name="__main__")
        return commands.pop()

    yield words
    sys.modules.pop("steps", None)


def test_a_missing_folder_of_results_is_made(command_of, tmp_path):
    results = tmp_path / "new" / "results"
    words = command_of("camera", "--results", results)
    assert results.is_dir()
    assert words[:4] == ["lsvision", "calibrate", "camera", str(EXAMPLE / "boards")]
    assert words[words.index("--out") + 1] == str(results / "camera.json")


def test_the_value_of_an_option_is_no_folder(command_of, tmp_path):
    words = command_of("sensor_to_robot", "--convention", "ros", "--results", tmp_path)
    assert words[words.index("sphere") + 1] == str(EXAMPLE / "sphere")
    assert words[-2:] == ["--convention", "ros"]  # the last one counts


def test_poses_of_ones_own_need_their_convention(tmp_path):
    done = script("sensor_to_robot", tmp_path)
    assert done.returncode == 2
    assert "--convention" in done.stderr


def test_the_example_is_small():
    shipped = [path for path in EXAMPLE.rglob("*") if "results" not in path.parts]
    sizes = [path.stat().st_size for path in shipped if path.is_file()]
    assert sum(sizes) < MAX_BYTES


def test_the_recipe_makes_profiles_poses_and_truth_bit_for_bit(tmp_path):
    recipe = import_script(EXAMPLE / "make.py")
    recipe.write_sphere(tmp_path, np.random.default_rng(recipe.SEED + 1))
    recipe.write_pipe(tmp_path, np.random.default_rng(recipe.SEED + 2))
    recipe.write_truth(tmp_path)
    made = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(made) == 12 + 6 + 2 + 1
    for path in made:
        shipped = EXAMPLE / path.relative_to(tmp_path)
        assert shipped.read_bytes() == path.read_bytes(), shipped
