"""Commands that read profiles take the same options for reading."""

import json
from dataclasses import fields

import numpy as np
import pytest
from typer.main import get_command

from lsvision.cli.app import app
from lsvision.cli.profile_options import ReadingOptions
from lsvision.inspection.job import Job

READING = {field.name for field in fields(ReadingOptions)}
READERS_OF_PROFILES = {
    "measure", "batch", "inspect", "scan", "job new", "study repeat",
    "calibrate hand-eye sphere", "calibrate hand-eye plane",
}  # fmt: skip
OTHERS = {
    "calibrate camera", "calibrate capture", "calibrate hand-eye board",
    "calibrate hand-eye poses", "calibrate laser-plane", "calibrate target", "demo", "job check",
    "job schema", "line", "paper", "plan", "simulate", "study grr",
}  # fmt: skip


def commands(group, path=()):
    """Yield the words of each command, and the names of its parameters."""
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if hasattr(command, "list_commands"):
            yield from commands(command, (*path, name))
        else:
            yield " ".join((*path, name)), {parameter.name for parameter in command.params}


def test_each_command_is_listed_here():
    assert {name for name, _ in commands(get_command(app))} == READERS_OF_PROFILES | OTHERS


def test_commands_that_read_profiles_and_no_others_take_every_option_for_reading():
    taking = {name for name, parameters in commands(get_command(app)) if parameters >= READING}
    assert taking == READERS_OF_PROFILES


@pytest.fixture
def ranges_in_um(tmp_path, pipe):
    """Four files of a pipe: time, range away from the sensor and x, in um; -5 marks lost points."""
    folder = tmp_path / "ranges"
    folder.mkdir()
    for number in range(4):
        rng = np.random.default_rng(number)
        x, y = 1e3 * (pipe + rng.normal(0, 0.03, pipe.shape)).T
        rows = np.column_stack([np.arange(len(x)), -y, x])
        rows[::40, 1:] = -5
        np.savetxt(folder / f"{number}.txt", rows, fmt="%.1f", delimiter=" ")
    return folder


OPTIONS = ("--units", "um", "--columns", "2,1", "--flip", "--lost", "-5")


def test_study_repeat_reads_files_as_its_options_say(run, ranges_in_um, tmp_path):
    out = tmp_path / "out.json"
    done = run("study", "repeat", ranges_in_um, "--reference", 19, *OPTIONS, "--json", out)
    assert done.exit_code == 0, done.output
    record = json.loads(out.read_text())
    assert record["count"] == 4
    # Within the error of one file: the noise of `pipe`, 0.03 mm, is common to all four.
    assert np.mean(record["bias_interval"]) == pytest.approx(0, abs=0.2)


def test_job_new_reads_its_profile_as_its_options_say(run, ranges_in_um, tmp_path):
    out = tmp_path / "job.toml"
    done = run("job", "new", ranges_in_um / "0.txt", "--radius", "10:30", *OPTIONS, "-o", out)
    assert done.exit_code == 0, done.output
    assert Job.load(out).part("part 1").radius_mm.middle == pytest.approx(19, abs=1)
    assert run("inspect", out, ranges_in_um / "0.txt", *OPTIONS).exit_code in (0, 4)


def test_height_maps_of_a_folder_count_for_study_repeat(run, tmp_path):
    cv2 = pytest.importorskip("cv2")
    x = np.arange(-15, 15, 0.2)
    heights = np.sqrt(19.0**2 - x**2) - 400
    rng = np.random.default_rng(5)
    rows = heights + rng.normal(0, 0.03, (5, x.size))
    (tmp_path / "maps").mkdir()
    cv2.imwrite(str(tmp_path / "maps" / "rows.tiff"), rows.astype(np.float32))
    words = ("study", "repeat", tmp_path / "maps", "--reference", 19)
    done = run(*words, "--x0", x[0], "--dx", 0.2, "--z-unit", "mm")
    assert done.exit_code == 0, done.output
    assert "5 values, mean" in done.stdout
    assert "no profile in this folder" in run(*words).stderr


def test_a_height_map_is_inspected_without_a_rig(run, tmp_path):
    cv2 = pytest.importorskip("cv2")
    x = np.arange(-15, 15, 0.2)
    heights = np.sqrt(19.0**2 - x**2) - 400
    rows = heights + np.random.default_rng(6).normal(0, 0.01, (2, x.size))
    cv2.imwrite(str(tmp_path / "rows.tiff"), rows.astype(np.float32))
    job = tmp_path / "job.toml"
    job.write_text('name = "a"\n[[part]]\nname = "b"\norder = 1\nradius_mm = { max = 25 }')
    words = ("inspect", job, tmp_path / "rows.tiff")
    done = run(*words, "--x0", x[0], "--dx", 0.2, "--z-unit", "mm")
    assert done.exit_code == 0, done.output
    assert "2 judged: 2 OK" in done.stdout
    assert "an image needs the rig" in run(*words).stderr


@pytest.mark.parametrize("words", [("job", "new"), ("study", "repeat", "--reference", "19")])
def test_an_unknown_unit_is_a_usage_error_before_files_are_read(run, words):
    done = run(*words, "absent.csv", "--units", "furlong")
    assert done.exit_code == 2
    assert "furlong" in done.stderr


def test_study_repeat_overwrites_no_profile(run, ranges_in_um):
    path = ranges_in_um / "0.txt"
    before = path.read_text()
    done = run("study", "repeat", ranges_in_um, "--reference", 19, *OPTIONS, "--json", path)
    assert done.exit_code == 2
    assert path.read_text() == before
