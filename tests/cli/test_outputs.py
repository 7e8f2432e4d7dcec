"""Outputs: written as they come, never over another file, safe whatever the files are called."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

import lsvision.measure as measure_module
from lsvision.batch.process_pool import EndedProcess
from lsvision.cli.outputs import Pictures, check_outputs
from lsvision.io import result_files

REPOSITORY = Path(__file__).parents[2]
RIG = ("--light-section", REPOSITORY / "fixtures/images/rig.json")
FAILED, USAGE, INTERRUPTED = 1, 2, 130

needs_odd_names = pytest.mark.skipif(sys.platform in ("darwin", "win32"), reason="UTF-8 names only")


def rows_of(text):
    return list(csv.DictReader(text.splitlines()))


def shell(*words, stdin=None, env=None, **more):
    """The command in a process that heeds Ctrl-C, also where the tests run in the background."""
    return subprocess.Popen(
        [sys.executable, "-m", "lsvision", *map(str, words)],
        cwd=REPOSITORY, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, **(env or {})}, **more,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # noqa: PLW1509
    )  # fmt: skip


def test_csv_and_json_go_to_standard_output_and_the_table_to_stderr(run, written, pipe):
    path = written(pipe)
    as_csv, as_json = run("measure", path, "--csv", "-"), run("measure", path, "--json", "-")
    (row,) = rows_of(as_csv.stdout)
    assert float(row["radius_mm"]) == pytest.approx(19, abs=0.5)
    (record,) = json.loads(as_json.stdout)["measurements"]
    assert record["source"] == str(path)
    for result in (as_csv, as_json):
        assert "radius mm" in result.stderr
    both = run("measure", path, "--csv", "-", "--json", "-")
    assert both.exit_code == USAGE
    assert "expected one output to standard output (-), got two" in " ".join(both.stderr.split())


def test_standard_input_is_measured(run, pipe):
    text = "\n".join(f"{x},{y}" for x, y in pipe)
    code = "import sys; from lsvision.cli import main; main()"
    result = subprocess.run(
        [sys.executable, "-c", code, "measure", "-", "--csv", "-"],
        cwd=REPOSITORY, input=text, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert rows_of(result.stdout)[0]["source"] == "-"
    twice = run("measure", "-", "--poses", "-", "--convention", "kuka")
    assert twice.exit_code == USAGE
    assert "expected one input from standard input (-), got two" in " ".join(twice.stderr.split())


def test_a_file_above_the_limit_is_rejected_and_the_limit_can_be_raised(run, written, pipe):
    path = written(pipe)
    for jobs in (1, 2):
        outcome = run("measure", path, "--max-size", "1kB", "--jobs", jobs)
        assert outcome.exit_code == FAILED
        assert f"{path}: expected 1 kB at most" in outcome.stderr
    assert run("--max-size=1 MB", "measure", path).exit_code == 0
    for size in ("0", "-1", "much", "1e9", "²GB"):
        assert run("measure", path, "--max-size", size).exit_code == USAGE


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no such device here")
def test_a_device_costs_no_other_file(run, written, pipe):
    result = run("measure", "/dev/zero", written(pipe))
    assert result.exit_code == FAILED
    assert "lsvision: /dev/zero: a device or socket: name a file" in result.stderr
    assert "radius mm" in result.stdout


def test_a_profile_without_a_cylinder_has_a_row_and_a_reason(run, written, pipe, tmp_path):
    flat = np.column_stack([np.arange(200.0), np.full(200, -400.0)])
    paths = written(flat, "flat.csv"), written(pipe[::20], "few.csv"), written(pipe, "pipe.csv")
    profiles = np.stack([np.full_like(pipe, np.nan), pipe])
    np.save(tmp_path / "two.npy", profiles)
    result = run("measure", *paths, tmp_path / "two.npy", "--csv", tmp_path / "o.csv")
    assert result.exit_code == 0, result.output
    assert "no cylinder found: flat: " in result.stdout
    assert "no cylinder found: too few points: 8" in result.stdout
    rows = rows_of((tmp_path / "o.csv").read_text())
    reasons = [(Path(row["source"]).name, row["profile"], row["reason"][:8]) for row in rows]
    assert reasons == [
        ("flat.csv", "0", "flat: 0."),
        ("few.csv", "0", "too few "),
        ("pipe.csv", "0", ""),
        ("two.npy", "0", "no valid"),
        ("two.npy", "1", ""),
    ]
    assert [bool(row["radius_mm"]) for row in rows] == [False, False, True, False, True]


def test_files_are_whole_while_results_come(run, written, pipe, tmp_path, monkeypatch):
    monkeypatch.setattr(result_files, "CHECKPOINT_S", 0.0)
    monkeypatch.setattr(result_files, "MAX_WRITING_FRACTION", 1e9)
    seen = []

    def keep(path, chunks):
        text = b"".join(chunks).decode()
        Path(path).write_text(text)
        if Path(path).suffix == ".json":
            seen.append(len(json.loads(text)["measurements"]))
        else:
            seen.append(len(rows_of(text)))

    monkeypatch.setattr(result_files, "write_atomic", keep)
    paths = [written(pipe, f"{name}.csv") for name in "abc"]
    outputs = ("--json", tmp_path / "o.json", "--csv", tmp_path / "o.csv")
    assert run("measure", *paths, *outputs).exit_code == 0
    assert seen == [1, 1, 2, 2, 3, 3]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_keeps_what_was_measured(written, pipe, tmp_path, number):
    path = written(pipe)
    os.mkfifo(tmp_path / "never.csv")
    process = shell("measure", path, tmp_path / "never.csv", "--csv", tmp_path / "o.csv")
    process.stdout.readline()  # the first file is measured, the second waited for
    time.sleep(0.3)
    process.send_signal(number)
    _, stderr = process.communicate(timeout=30)
    assert process.returncode == INTERRUPTED
    assert stderr.decode() == "lsvision: interrupted: 1 of 2 were measured\n"
    assert len(rows_of((tmp_path / "o.csv").read_text())) == 1


def test_an_interrupted_file_keeps_its_measured_profiles(run, pipe, tmp_path, monkeypatch):
    """All but those that were to be computed together with the interrupted one."""
    for name, value in {"TASK_SIZE": 1, "MAX_SMALL_FILE_BYTES": 0}.items():
        monkeypatch.setattr(f"lsvision.cli.measure_files.{name}", value)
    np.save(tmp_path / "three.npy", np.stack([pipe, pipe, np.full_like(pipe, np.nan), pipe]))
    calls = []
    real = measure_module.measure_profiles

    def measure(profiles, **options):
        calls.append(profiles)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(profiles, **options)

    monkeypatch.setattr(measure_module, "measure_profiles", measure)
    result = run("measure", tmp_path / "three.npy", "--csv", tmp_path / "o.csv")
    assert result.exit_code == INTERRUPTED
    rows = rows_of((tmp_path / "o.csv").read_text())
    assert [(row["profile"], bool(row["radius_mm"])) for row in rows] == [
        ("0", True), ("1", True), ("2", False),
    ]  # fmt: skip


def test_a_reader_that_goes_costs_no_result(written, pipe, tmp_path):
    paths = [written(pipe, f"{k}.csv") for k in range(4)]
    process = shell("measure", *paths, "--csv", tmp_path / "o.csv")
    process.stdout.close()
    stderr = process.stderr.read().decode()
    process.wait(timeout=60)
    process.stderr.close()
    assert "Traceback" not in stderr
    assert len(rows_of((tmp_path / "o.csv").read_text())) >= 1


def test_a_picture_never_takes_the_name_of_an_input_or_output(tmp_path):
    names = ["a.png", "p-a.png", "p-b.png", "p-c.png"]
    for name in names:
        (tmp_path / name).write_bytes(b"input")
    plot, inputs = tmp_path / "p.png", [tmp_path / name for name in names]
    (tmp_path / "link.png").symlink_to(tmp_path / "p-d.png")
    taken = check_outputs((plot,), inputs, streams=(tmp_path / "link.png",))
    pictures = Pictures(plot, several=True, command_files=taken)
    sources = [tmp_path / name for name in ("a.png", "b.png", "e.png", "x/e.png", "d.png")]
    made = [pictures.assign_path(source, None).name for source in sources]
    assert made == ["p-a-2.png", "p-b-2.png", "p-e.png", "p-e-2.png", "p-d-2.png"]


@pytest.mark.skipif(not hasattr(os, "link"), reason="no hard links here")
def test_an_output_that_is_an_input_by_another_name_is_rejected(run, written, pipe, tmp_path):
    path = written(pipe)
    os.link(path, tmp_path / "hard.csv")
    (tmp_path / "soft.csv").symlink_to(path)
    for name in ("hard.csv", "soft.csv"):
        result = run("measure", path, "--csv", tmp_path / name)
        assert result.exit_code == USAGE
        assert "it is also an input" in " ".join(result.stderr.split())


def test_a_file_that_is_not_for_standard_output_is_not_called_minus(
    run, written, pipe, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    result = run("scan", written(pipe), "--feed", "0,0,1", "--step", "1", "--points", "-")
    assert result.exit_code == USAGE
    assert "expected the name of a file, got - for standard output" in result.stderr
    assert not Path("-").exists()


@pytest.mark.parametrize("option", ["--light-section", "--laser-off"])
def test_the_rig_and_the_laser_off_frame_are_inputs_too(run, written, pipe, option, tmp_path):
    other = tmp_path / "other.json"
    other.write_text("{}")
    result = run("measure", written(pipe), option, other, "--json", other)
    assert result.exit_code == USAGE
    assert other.read_text() == "{}"


def test_a_picture_that_cannot_be_written_costs_no_numbers(run, written, pipe, tmp_path):
    paths = written(pipe, "a.csv"), written(pipe, "b.csv")
    (tmp_path / "p-a.png").mkdir()
    words = ("--plot", tmp_path / "p.png", "--csv", tmp_path / "o.csv")
    result = run("measure", *paths, *words)
    assert result.exit_code == FAILED
    assert "p-a.png: a directory: name a file in it" in result.stderr
    assert "1 of 2 could not be measured or drawn" in result.stderr
    assert result.stdout.count("radius mm") == 2
    assert len(rows_of((tmp_path / "o.csv").read_text())) == 2
    assert (tmp_path / "p-b.png").stat().st_size > 10_000


def test_a_bug_of_a_picture_costs_no_numbers(run, written, pipe, tmp_path, monkeypatch):
    monkeypatch.setattr("lsvision.draw.draw_measurement", lambda *_, **__: 1 / 0)
    words = ("--plot", tmp_path / "p.png", "--json", tmp_path / "o.json")
    result = run("measure", written(pipe), *words)
    assert result.exit_code == FAILED
    assert "radius mm" in result.stdout
    assert len(json.loads((tmp_path / "o.json").read_text())["measurements"]) == 1


@needs_odd_names
def test_odd_names_are_safe_everywhere(run, written, pipe, tmp_path, monkeypatch):
    names = ["=1+1.csv", "-x.csv", "@a.csv", "+b.csv", "a\nb.csv", "\x1b[31m.csv", "\udcff.csv"]
    names += ["x,\"y'<b>.csv", "$\\frac{$.csv", "r\u202egnp.csv"]
    for name in names:
        written(pipe, name)
    monkeypatch.chdir(tmp_path)
    outputs = ("--csv", "o/o.csv", "--json", "o/o.json", "--plot", "o/p.svg")
    (tmp_path / "o").mkdir()
    result = run("measure", *outputs, ".")
    assert result.exit_code == 0, result.stderr
    shown = {"./=1+1.csv", "./-x.csv", "./@a.csv", "./+b.csv", r"a\nb.csv", r"\x1b[31m.csv"}
    shown |= {r"\xff.csv", "x,\"y'<b>.csv", "$\\frac{$.csv", r"r\u202egnp.csv"}
    table = (tmp_path / "o/o.csv").read_bytes().decode()
    assert {row["source"] for row in rows_of(table)} == shown
    document = json.loads((tmp_path / "o/o.json").read_bytes().decode())
    assert {record["source"] for record in document["measurements"]} == shown
    pictures = list((tmp_path / "o").glob("*.svg"))
    assert len(pictures) == len(names)
    for text in (result.output, table, *(path.read_bytes().decode() for path in pictures)):
        assert not set("\x1b\u202e\udcff") & set(text)


@needs_odd_names
def test_one_bad_name_is_one_failed_file(run, written, pipe, tmp_path):
    (tmp_path / "loop.csv").symlink_to(tmp_path / "loop.csv")
    for name in ("1²2.csv", "1²3.csv", "١.csv", "1.csv"):
        written(pipe, name)
    words = [tmp_path / "loop.csv", tmp_path / ("n" * 300), tmp_path / ("n" * 5000), "a\0b"]
    result = run("measure", *words, tmp_path)
    assert result.exit_code == FAILED
    loop, long, longer, null, count = result.stderr.splitlines()
    assert "loop.csv: a loop of symbolic links" in loop
    assert "the name is too long" in long
    assert "the name is too long" in longer
    assert "no file can have this name" in null
    assert count == "lsvision: 4 of 8 could not be measured"
    assert result.stdout.count("radius mm") == 4


@needs_odd_names
def test_outputs_of_odd_names_are_rejected_in_one_line(run, written, pipe, tmp_path):
    path = written(pipe)
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for name in ("loop", "n" * 300, "\x1b[31m/x"):
        result = run("measure", path, "--csv", tmp_path / name)
        assert result.exit_code == FAILED
        (line,) = result.stderr.splitlines()
        assert "\x1b" not in line


def test_an_output_that_cannot_be_made_is_reported_before_the_work(run, written, pipe, tmp_path):
    loop = tmp_path / "loop.json"
    loop.symlink_to(loop)
    for output, message in (
        (loop, "a loop of symbolic links: name another file"),
        (tmp_path / ("j" * 300), "name too long: name another file"),
    ):
        result = run("measure", written(pipe), "--json", output)
        assert (result.exit_code, result.stdout) == (FAILED, ""), result.output
        assert message in result.stderr


def test_the_line_of_an_image_from_standard_input(tmp_path):
    content = (REPOSITORY / "fixtures/images/pair.png").read_bytes()
    code = "from lsvision.cli import main; main()"
    for words in (["line", "-", "--csv", "-"], ["measure", "-", "--csv", "-", *map(str, RIG)]):
        result = subprocess.run(
            [sys.executable, "-c", code, *words],
            cwd=REPOSITORY, input=content, capture_output=True, timeout=60, check=False,
        )  # fmt: skip
        assert result.returncode == 0, result.stderr
        assert len(result.stdout.splitlines()) > 1


def test_an_image_of_another_run_is_no_output(run, tmp_path):
    image = np.full((40, 40), 9, np.uint8)
    cv2.imwrite(str(tmp_path / "i.png"), image)
    result = run("line", tmp_path / "i.png", "--plot", tmp_path / "i.png")
    assert result.exit_code == USAGE


def test_any_number_of_processes_prints_and_writes_the_same(run, written, pipe, tmp_path):
    paths = [written(pipe + np.array([k, 0.0]), f"in/{k}.csv") for k in range(5)]
    paths[2].write_text("no numbers\n")
    np.save(tmp_path / "in/many.npy", np.stack([pipe, np.full_like(pipe, np.nan)] * 10))
    found = []
    for jobs in (1, 2, 3):
        outputs = tmp_path / f"{jobs}.json", tmp_path / f"{jobs}.csv"
        words = ("--json", outputs[0], "--csv", outputs[1], "--jobs", jobs, "-v")
        result = run("measure", tmp_path / "in", *words)
        assert result.exit_code == FAILED
        found.append([result.stdout, result.stderr, *(path.read_bytes() for path in outputs)])
    assert found[0] == found[1] == found[2]
    assert b'"source": ' in found[0][2]
    alone = run("measure", tmp_path / "in/many.npy", "--jobs", 2)
    assert alone.stdout == run("measure", tmp_path / "in/many.npy").stdout
    assert "profile 18:" in alone.stdout


def test_a_large_array_is_reported_in_parts(run, pipe, tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", np.stack([pipe] * 5))
    monkeypatch.setattr("lsvision.io.profiles.streaming.PROFILES_PER_CHUNK", 2)
    lines = run("measure", tmp_path / "a.npy").stdout.splitlines()
    heads = [line for line in lines if "points lost" in line]
    path = str(tmp_path / "a.npy")
    assert [head.split(": ")[0] for head in heads] == [
        path, f"{path}, from profile 2 on", f"{path}, from profile 4 on",
    ]  # fmt: skip
    assert [line.strip() for line in lines if line.startswith("  profile")] == [
        f"profile {k}:" for k in range(5)
    ]


def test_of_several_small_files_the_one_that_ends_its_process_is_named(
    run, written, pipe, monkeypatch
):
    """Sixteen of them are one task; the others keep their results."""
    paths = [written(pipe, f"{k}.csv") for k in range(3)]

    def run_tasks(function, tasks, *_, **__):
        for task in tasks:
            ends = paths[1] in task.sources
            yield task, EndedProcess() if ends else function(task)

    monkeypatch.setattr("lsvision.batch.process_pool.run_tasks", run_tasks)
    result = run("measure", *paths)
    assert result.exit_code == FAILED
    assert f"{paths[1]}: it ended its process twice" in result.stderr
    heads = [line.split(": ")[0] for line in result.stdout.splitlines() if "points lost" in line]
    assert heads == [str(paths[0]), str(paths[2])]
