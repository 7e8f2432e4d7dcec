"""``lsvision batch``: files in, Parquet out, status, interrupts and error messages."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest

from lsvision.batch.manifest import read_status
from lsvision.batch.measure_file import FileOutcome
from lsvision.batch.process_pool import IN_FLIGHT_PER_JOB
from lsvision.cli.batch import _Report

REPOSITORY = Path(__file__).parents[2]


def shifted(points, distance):
    return points + np.array([distance, 0.0])


@pytest.fixture
def folder(tmp_path, written, pipe):
    written(pipe, "in/a.csv")
    written(shifted(pipe, 30.0), "in/b.csv")
    return tmp_path


def test_a_folder_becomes_a_folder_of_results(run, folder):
    out = folder / "out"
    done = run("batch", folder / "in", "--out", out, "--jobs", 1, "--range-std", 0.03)
    assert done.exit_code == 0, done.stderr
    assert done.stdout == "2 of 2 files done, 0 failed, 0 left: 2 profiles, 2 cylinders\n"
    assert run("batch", "--status", out).stdout == done.stdout
    (row,) = pq.read_table(out / "b.csv.parquet").to_pylist()
    assert row["source"] == "b.csv"
    assert row["radius_low_95_mm"] < 19.0 < row["radius_high_95_mm"]
    other = run("batch", folder / "in", "--out", out, "--jobs", 1)
    assert other.exit_code == 1
    assert "results of another job (sensor" in other.stderr


def test_a_broken_file_and_a_missing_one_are_reported_and_the_rest_is_done(run, folder):
    (folder / "in" / "b.csv").write_text("no numbers\n")
    out = folder / "out"
    done = run("batch", folder / "in", folder / "none.csv", "--out", out, "--jobs", 1)
    assert done.exit_code == 1
    assert done.stdout.startswith("1 of 3 files done, 2 failed, 0 left")
    assert "in/b.csv: expected x and height" in done.stderr
    assert "none.csv: no such file" in done.stderr
    assert "in/b.csv: expected x and height" in run("batch", "--status", out).stdout


def test_results_that_were_spoilt_are_in_the_status_and_are_measured_again(run, folder):
    out = folder / "out"
    words = ("batch", folder / "in", "--out", out, "--jobs", 1)
    whole = run(*words).stdout
    (out / "b.csv.parquet").write_bytes(b"")
    status = run("batch", "--status", out)
    assert status.stdout.startswith("1 of 2 files done, 0 failed, 1 left (1 of them again): ")
    assert f"{out / 'b.csv.parquet'}: changed or deleted after it was written (0 bytes" in (
        status.stdout
    )
    again = run(*words)
    assert again.stdout == whole
    assert "b.csv: note: measured again: its results were changed or deleted\n" in again.stderr
    assert run("batch", "--status", out).stdout == whole


def test_the_time_left_counts_the_files_that_are_left(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    now = iter([0.0, 10.0])
    clock = SimpleNamespace(monotonic=lambda: next(now))
    monkeypatch.setattr(sys.modules["lsvision.cli.batch"], "time", clock)
    _Report(100)(FileOutcome("a.csv", profiles=5), 3)  # 96 files are of an earlier run
    assert "97/100 files, 5 profiles, 0/s, 0 min 30 s left" in capsys.readouterr().err


def test_processes_of_this_machine_and_a_cluster_exclude_each_other(run, folder):
    words = ("batch", folder / "in", "--out", folder / "out", "--scheduler", "tcp://127.0.0.1:1")
    done = run(*words, "--jobs", 2)
    assert done.exit_code == 2
    assert "expected --jobs or --scheduler, got both" in done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="names without control characters")
def test_a_name_in_the_status_has_no_control_characters(run, folder):
    (folder / "in" / "\x1b[31m.csv").write_text("no numbers")
    run("batch", folder / "in", "--out", folder / "out", "--jobs", 1)
    status = run("batch", "--status", folder / "out")
    assert r"in/\x1b[31m.csv: expected x and height" in status.stdout


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["a.csv"],
        ["--out", "x"],
        ["--out", "x", "--status", "x"],
        ["--status", "x", "--radius", "19"],
    ],
)
def test_usage_is_reported(run, words):
    result = run("batch", *words)
    assert result.exit_code == 2
    assert "expected files and --out DIR, or --status DIR" in result.stderr


def test_standard_input_is_no_file_of_a_batch(run, tmp_path):
    result = run("batch", "-", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "expected files on a disk, got - for standard input" in result.stderr
    assert not (tmp_path / "out").exists()


def test_the_failure_of_another_file_in_an_earlier_run_does_not_count(run, folder):
    (folder / "in" / "bad.csv").write_text("no numbers")
    out = folder / "out"
    assert run("batch", folder / "in", "--out", out, "--jobs", 1).exit_code == 1
    done = run("batch", folder / "in" / "b.csv", "--out", out, "--jobs", 1)
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("1 of 1 files done, 0 failed, 0 left")
    assert run("batch", "--status", out).stdout.startswith("2 of 3 files done, 1 failed, 0 left")


def test_files_in_a_new_folder_do_not_rename_the_results_of_others(run, folder, written, pipe):
    out, pattern = folder / "out", folder / "in" / "**" / "*.csv"
    for path in (folder / "in").iterdir():
        path.unlink()
    written(pipe, "in/monday/a.csv")
    assert run("batch", pattern, "--out", out, "--jobs", 1).exit_code == 0
    written(pipe, "in/tuesday/a.csv")
    done = run("batch", pattern, "--out", out, "--jobs", 1)
    assert done.stdout.startswith("2 of 2 files done")
    assert [str(path.relative_to(out)) for path in sorted(out.rglob("*.parquet"))] == [
        "monday/a.csv.parquet",
        "tuesday/a.csv.parquet",
    ]


def test_results_of_a_folder_above_lie_in_the_folder_of_results(run, folder, monkeypatch):
    (folder / "in" / "sub").mkdir()
    (folder / "in" / "b.csv").rename(folder / "in" / "sub" / "b.csv")
    monkeypatch.chdir(folder / "in" / "sub")
    assert run("batch", "b.csv", "../a.csv", "--out", folder / "out", "--jobs", 1).exit_code == 0
    results = (folder / "out").rglob("*.parquet")
    assert sorted(str(path.relative_to(folder / "out")) for path in results) == [
        "a.csv.parquet",
        "sub/b.csv.parquet",
    ]


def test_what_a_folder_or_a_pattern_leaves_out_is_named(run, folder, written, pipe):
    source, out = folder / "in", folder / "in" / "out"
    for name in ("monday", "tuesday"):
        written(pipe, f"in/{name}/a.csv")
    (source / "notes.ods").touch()
    (source / ".hidden").touch()
    (source / "gone.csv").symlink_to("none.csv")
    words = ("--out", out, "--jobs", 1)
    for _ in range(2):  # in the second run the folder of the results is there
        done = run("batch", source, *words)
        assert done.exit_code == 0, done.stderr
        assert (
            f"{source}: note: 2 folders (monday, tuesday) in it not searched: '{source}/**/*.csv'"
        ) in done.stderr
        assert f"{source}: note: 2 files (gone.csv, notes.ods) left out: name each" in done.stderr
    done = run("batch", source / "*", "--out", folder / "out", "--jobs", 1)
    assert f"{source}/*: note: 3 folders (monday, out, tuesday) not searched:" in done.stderr
    done = run("batch", source / "*day" / "**" / "*", "--out", folder / "days", "--jobs", 1)
    assert (done.exit_code, "left out" in done.stderr) == (0, False)
    assert done.stdout.startswith("2 of 2 files done")


def test_a_folder_of_folders_alone_says_so(run, folder, written, pipe):
    written(pipe, "days/monday/a.csv")
    done = run("batch", folder / "days", "--out", folder / "out", "--jobs", 1)
    assert done.exit_code == 1
    assert f"no profile in this folder: name another folder, its subfolders by '{folder}" in (
        done.stderr
    )
    assert not (folder / "out").exists()


def test_a_folder_without_a_batch_has_no_status(run, tmp_path):
    result = run("batch", "--status", tmp_path)
    assert result.exit_code == 1
    assert "_manifest.jsonl: no such file: name the --out of a batch" in result.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_an_interrupted_batch_goes_on_from_there(run, folder, pipe, written):
    for number in range(30):
        written(shifted(pipe, number), f"in/{number}.csv")
    out = folder / "out"
    words = ["batch", folder / "in", "--out", out, "--jobs", 2]
    process = subprocess.Popen(
        [sys.executable, "-m", "lsvision", *map(str, words)],
        stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # noqa: PLW1509
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and len(list(out.glob("*.parquet"))) < 8:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert b"the same command continues from there" in errors
    assert b"note: units taken as mm" in errors
    before = {path.name: path.stat().st_mtime_ns for path in out.glob("*.parquet")}
    assert 0 < len(before) < 32
    recorded = [f"{outcome.name}.parquet" for outcome in read_status(out).done]
    # Files that the processes had written when they were ended, but not reported yet.
    assert len(before) - len(recorded) <= 2 * IN_FLIGHT_PER_JOB
    assert run(*words[:-1], 1).exit_code == 0
    after = {path.name: path.stat().st_mtime_ns for path in out.glob("*.parquet")}
    assert len(after) == 32
    assert recorded
    assert all(after[name] == before[name] for name in recorded)


def test_the_columns_of_a_table_come_along(run, tmp_path, pipe):
    rows = [f"{part},{x:.4f},{z:.4f}" for part in (7, 8) for x, z in pipe]
    (tmp_path / "a.csv").write_text("\n".join(["part_id,x,z", *rows]))
    out = tmp_path / "out"
    assert run("batch", tmp_path / "a.csv", "--out", out, "--jobs", 1).exit_code == 0
    found = pq.read_table(out / "a.csv.parquet").to_pylist()
    assert [(row["profile"], row["part_id"]) for row in found] == [(0, 7), (1, 8)]
    assert np.allclose([row["radius_mm"] for row in found], 19.0, atol=0.5)


def test_a_job_judges_each_profile(run, folder):
    (folder / "job.toml").write_text(
        """
name = "tube"
[measure]
range_std_mm = 0.03
[output]
results = "results"
[golden]
radius_mm = 19
tolerance_mm = 3
every_hours = 8
[[part]]
name = "left"
x_mm = [-5, 5]
radius_mm = { nominal = 19, upper = 3, lower = -3 }
"""
    )
    out = folder / "out"
    words = ("batch", folder / "in", "--out", out, "--jobs", 1, "--job", folder / "job.toml")
    done = run(*words)
    assert done.exit_code == 0, done.stderr
    (left,), (right,) = (
        pq.read_table(out / f"{name}.csv.parquet").to_pylist() for name in ("a", "b")
    )
    assert (left["decision"], right["decision"]) == ("OK", "NG")  # the other one lies at 30 mm
    notes = run(*words).stderr
    assert "job.toml: note: not used: [output] (" in notes
    assert "job.toml: note: batch does not check the golden part" in notes
    (folder / "job.toml").write_text((folder / "job.toml").read_text().replace("= 3", "= 2"))
    assert "results of another job (job_hash" in run(*words).stderr
    both = run(*words, "--radius", 19)
    assert both.exit_code == 2
    assert "expected --job or options of the measurement, got both" in both.stderr
    scan = run(
        "batch",
        folder / "in",
        "--out",
        out,
        "--job",
        REPOSITORY / "fixtures/jobs/scan_welded_pair.toml",
    )
    assert scan.exit_code == 1
    assert "got one for scans or images" in scan.stderr


def test_a_file_is_no_folder_of_results(run, folder):
    file = folder / "in" / "a.csv"
    status = run("batch", "--status", file)
    assert f"{file}: a file: name a folder, the --out of a batch" in status.stderr
    out = run("batch", folder / "in" / "b.csv", "--out", file, "--jobs", 1)
    assert (status.exit_code, out.exit_code) == (1, 1)
    assert f"{file}: a file: name a folder that can be written" in out.stderr


def test_a_job_that_limits_what_profiles_do_not_have_is_rejected_before_the_work(run, tmp_path):
    (tmp_path / "a.csv").write_text("x,z\n1,2\n")
    job = tmp_path / "job.toml"
    job.write_text('name = "a"\n[[part]]\nname = "b"\norder = 1\nbow_mm = { max = 1 }\n')
    done = run("batch", tmp_path / "a.csv", "--out", tmp_path / "out", "--job", job)
    assert done.exit_code == 1
    assert done.stderr == (
        f"lsvision: {job}: rejected by inspect: bow_mm of part 'b' (for scans: add [scan])\n"
    )
    assert not (tmp_path / "out").exists()
