"""Batches of files: results, resume, other jobs, failures."""

import errno
import json
import re
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import lsvision as lsv
from lsvision.batch import manifest
from lsvision.batch.manifest import (
    MANIFEST,
    SCHEMA,
    find_changed_results,
    format_summary,
    read_status,
)
from lsvision.batch.measure_file import TEMPORARY_PREFIX, BatchJob, FileOutcome, measure_file
from lsvision.batch.run import plan_tasks, run_batch
from lsvision.errors import LsvisionError, UnreadableFile, UnwritableFile
from lsvision.measure import measure_profiles
from tests.batch.sources import profiles, write_parquet
from tests.batch.tasks import Killer
from tests.tolerances import CONVERGED


@pytest.fixture
def folder(tmp_path):
    """Two Parquet files and a text."""
    source = tmp_path / "in"
    (source / "sub").mkdir(parents=True)
    write_parquet(source / "part-1.parquet")
    write_parquet(source / "sub" / "part-2.parquet", 3, first_id=7)
    np.savetxt(source / "a.csv", profiles(1)[0], delimiter=",")
    return tmp_path


def tasks_of(folder, job=BatchJob()):
    sources = sorted(path for path in (folder / "in").rglob("*") if path.is_file())
    return plan_tasks(sources, folder / "in", folder / "out", job)


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.parquet")}


def test_each_file_has_its_results_with_the_columns_of_the_input(folder):
    status = run_batch(tasks_of(folder), folder / "out")
    names = ["a.csv.parquet", "part-1.parquet", "sub/part-2.parquet"]
    assert sorted(files(folder / "out")) == names
    rows = pq.read_table(folder / "out" / "part-1.parquet").to_pylist()
    points = profiles(5)
    wanted = [lsv.measure_cylinders(p).cylinders if k != 2 else () for k, p in enumerate(points)]
    found = [(row["profile"], row["cylinder"], row["radius_mm"]) for row in rows]
    assert [place for place in found if place[1] is not None] == [
        (k, number, pytest.approx(each.radius, abs=CONVERGED))
        for k, cylinders in enumerate(wanted)
        for number, each in enumerate(cylinders)
    ]
    assert [row["part_id"] for row in rows] == [10**15 + row["profile"] for row in rows]
    assert {row["station"] for row in rows if row["profile"] == 1} == {"line 1"}
    (empty,) = [row for row in rows if row["profile"] == 2]
    assert (empty["radius_mm"], empty["reason"]) == (None, "no valid point")
    low, high = wanted[0][0].interval("phi")
    assert rows[0]["phi_low_95_deg"] == pytest.approx(np.degrees(low))
    assert rows[0]["phi_high_95_deg"] == pytest.approx(np.degrees(high))
    assert len(status.done) == 3
    assert format_summary(status) == (
        f"3 of 3 files done, 0 failed, 0 left: 9 profiles, "
        f"{sum(outcome.cylinders for outcome in status.done)} cylinders"
    )


def test_any_number_of_processes_writes_the_same_bytes(folder):
    run_batch(tasks_of(folder), folder / "out")
    alone = files(folder / "out")
    (folder / "out").rename(folder / "first")
    run_batch(tasks_of(folder), folder / "out", jobs=2)
    assert files(folder / "out") == alone


def test_what_is_done_is_not_done_again_and_what_changed_is(folder):
    run_batch(tasks_of(folder), folder / "out")
    seen = []
    run_batch(tasks_of(folder), folder / "out", report=lambda outcome, _: seen.append(outcome))
    assert seen == []
    write_parquet(folder / "in" / "part-1.parquet", 4)
    (folder / "out" / "a.csv.parquet").unlink()
    run_batch(tasks_of(folder), folder / "out", report=lambda outcome, _: seen.append(outcome))
    assert sorted(outcome.name for outcome in seen) == ["a.csv", "part-1.parquet"]
    assert {outcome.notes[0] for outcome in seen} == {
        "measured again: it has changed",
        "measured again: its results were changed or deleted",
    }


@pytest.mark.parametrize("content", [None, b"", b"PAR1", "overwritten", "cut off"])
def test_results_that_were_changed_or_deleted_are_measured_again(folder, content):
    before = run_batch(tasks_of(folder), folder / "out")
    output = folder / "out" / "part-1.parquet"
    whole = output.read_bytes()
    if content is None:
        output.unlink()
    elif isinstance(content, bytes):
        output.write_bytes(content)
    else:
        output.write_bytes(whole[:-1] + (b"?" if content == "overwritten" else b""))
    (name,) = find_changed_results(folder / "out", before)
    assert name == "part-1.parquet"
    assert "2 of 3 files done, 0 failed, 1 left (1 of them again)" in format_summary(
        before, changed=[name]
    )
    seen = []
    run_batch(tasks_of(folder), folder / "out", report=lambda outcome, _: seen.append(outcome))
    assert [outcome.name for outcome in seen] == ["part-1.parquet"]
    assert seen[0].notes[0] == "measured again: its results were changed or deleted"
    assert output.read_bytes() == whole


def test_a_copy_of_the_results_is_as_good_as_they_are(folder):
    run_batch(tasks_of(folder), folder / "out")
    (folder / "out").rename(folder / "first")
    shutil.copytree(folder / "first", folder / "out", copy_function=shutil.copyfile)
    status = read_status(folder / "out")
    assert all(map(status.is_done, tasks_of(folder)))
    assert find_changed_results(folder / "out", status) == {}


def test_results_of_another_version_are_rejected(folder, monkeypatch):
    monkeypatch.setattr(manifest, "__version__", "0.0.7")
    run_batch(tasks_of(folder), folder / "out")
    monkeypatch.undo()
    with pytest.raises(
        LsvisionError,
        match=rf"results of lsvision 0\.0\.7, this is {re.escape(lsv.__version__)}: name another",
    ):
        run_batch(tasks_of(folder), folder / "out")


def test_a_worker_of_another_version_measures_nothing(folder):
    task = replace(tasks_of(folder)[0], lsvision_version="0.0.7")
    with pytest.raises(LsvisionError, match=r"this worker has lsvision .*, the command 0\.0\.7"):
        measure_file(task)
    assert not task.output.exists()


def test_a_file_that_was_set_aside_is_tried_again_once_it_changes(folder):
    np.savetxt(folder / "in" / "a.csv", profiles(1)[0][100:223], delimiter=",")
    (folder / "marks").mkdir()
    job = BatchJob(partial(Killer(folder / "marks", 123, 99)))
    assert run_batch(tasks_of(folder, job), folder / "out", jobs=2).set_aside == {"a.csv"}
    np.savetxt(folder / "in" / "a.csv", profiles(1)[0][100:224], delimiter=",")
    status = run_batch(tasks_of(folder, job), folder / "out", jobs=2)
    assert (len(status.done), status.set_aside) == (3, set())


def test_a_run_that_goes_on_tells_how_many_files_are_left(folder):
    run_batch(tasks_of(folder), folder / "out")
    for name in ("a.csv", "part-1.parquet"):
        (folder / "in" / name).touch()
    left = []
    run_batch(tasks_of(folder), folder / "out", report=lambda _, count: left.append(count))
    assert left == [1, 0]


def test_a_manifest_that_was_cut_off_costs_one_file(folder):
    run_batch(tasks_of(folder), folder / "out")
    path = folder / "out" / MANIFEST
    path.write_text(path.read_text()[:-20])
    leftover = folder / "out" / "sub" / f"{TEMPORARY_PREFIX}00.part"
    leftover.touch()
    seen = []
    status = run_batch(
        tasks_of(folder), folder / "out", report=lambda outcome, _: seen.append(outcome)
    )
    assert len(seen) == 1
    assert (status.files, len(status.done)) == (3, 3)
    assert not leftover.exists()


def test_a_run_with_some_of_the_files_counts_these(folder):
    (folder / "in" / "part-1.parquet").write_bytes(b"PAR1")
    tasks = tasks_of(folder)
    run_batch(tasks, folder / "out")
    status = run_batch(tasks[:1], folder / "out")
    assert tasks[0].name == "a.csv"
    assert format_summary(status, ["a.csv"]).startswith(
        "1 of 1 files done, 0 failed, 0 left: 1 profile,"
    )
    assert format_summary(status).startswith("2 of 3 files done, 1 failed, 0 left: 4 profiles,")


def test_a_file_in_the_place_of_a_folder_of_results_is_reported(folder):
    (folder / "out").mkdir()
    (folder / "out" / "sub").write_text("a file")
    with pytest.raises(UnwritableFile, match="sub: cannot be made"):
        run_batch(tasks_of(folder), folder / "out")


def test_results_of_another_job_are_rejected(folder):
    run_batch(tasks_of(folder), folder / "out")
    other = BatchJob(partial(measure_profiles, radius=19.0))
    with pytest.raises(LsvisionError, match=r"another job \(radius default, now 19\.0\)"):
        run_batch(tasks_of(folder, other), folder / "out")
    other = BatchJob(reading={"units": "um"})
    with pytest.raises(LsvisionError, match=r"another job \(units default, now um\)"):
        run_batch(tasks_of(folder, other), folder / "out")


def test_the_hash_of_a_job_tells_every_setting():
    jobs = [
        BatchJob(),
        BatchJob(partial(measure_profiles, radius=(10.0, 40.0))),
        BatchJob(partial(measure_profiles, sensor=lsv.LPS36)),
        BatchJob(partial(measure_profiles, sensor=lsv.LPS36HI)),
        BatchJob(reading={"units": "um"}),
        BatchJob(reading={"flip": True}),
        BatchJob(reading={"flip": False}),  # None: as the file states
        BatchJob(reading={"lost": 0.0}),
        BatchJob(reading={"dx": 0.5}),
        BatchJob(reading={"dx": 0.5, "x0": 0.0}),
    ]
    assert len({job.hash for job in jobs}) == len(jobs)
    assert BatchJob(reading={"units": None, "transpose": False}).hash == BatchJob().hash


def test_a_broken_file_is_reported_and_tried_again(folder):
    broken = folder / "in" / "part-1.parquet"
    content = broken.read_bytes()
    broken.write_bytes(content[:100])
    status = run_batch(tasks_of(folder), folder / "out", jobs=2)
    (failed,) = status.failed
    assert "part-1.parquet: pyarrow cannot read it" in failed.error
    assert not (folder / "out" / "part-1.parquet").exists()
    broken.write_bytes(content)
    assert not run_batch(tasks_of(folder), folder / "out").failed


def test_a_file_that_no_longer_can_be_measured_keeps_no_earlier_results(folder):
    run_batch(tasks_of(folder), folder / "out")
    (folder / "in" / "part-1.parquet").write_bytes(b"PAR1")
    assert len(run_batch(tasks_of(folder), folder / "out").failed) == 1
    assert sorted(files(folder / "out")) == ["a.csv.parquet", "sub/part-2.parquet"]


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize(("times", "aside"), [(1, False), (99, True)])
def test_a_process_that_ends_costs_nothing_and_a_file_that_ends_it_twice_is_set_aside(
    folder, times, aside, jobs
):
    np.savetxt(folder / "in" / "a.csv", profiles(1)[0][100:223], delimiter=",")
    marks = folder / "marks"
    marks.mkdir()
    job = BatchJob(partial(Killer(marks, 123, times)))
    status = run_batch(tasks_of(folder, job), folder / "out", jobs=jobs, isolated=True)
    assert len(status.done) == (2 if aside else 3)
    assert status.set_aside == ({"a.csv"} if aside else set())
    if aside:
        (failed,) = status.failed
        assert "a.csv: it ended its process twice" in failed.error
        assert "(1 set aside)" in format_summary(status)
        seen = []
        run_batch(
            tasks_of(folder, job),
            folder / "out",
            jobs=2,
            report=lambda outcome, _: seen.append(outcome),
        )
        assert seen == []


def test_a_file_that_grows_while_it_is_read_has_no_results(folder, monkeypatch):
    (task, *_) = tasks_of(folder)
    versions = iter([(1, 1), (2, 2)])
    monkeypatch.setattr("lsvision.batch.measure_file.read_file_version", lambda _: next(versions))
    task.output.parent.mkdir()
    outcome = measure_file(task)
    assert "it changed while it was read" in outcome.error
    assert not task.output.exists()


def test_a_folder_that_cannot_be_written_ends_the_batch(folder):
    (folder / "out").write_text("a file")
    with pytest.raises((UnwritableFile, UnreadableFile), match="out"):
        run_batch(tasks_of(folder), folder / "out")


def test_a_second_run_into_the_same_folder_is_rejected(folder):
    def again(*_):
        with pytest.raises(LsvisionError, match="another run writes into it"):
            run_batch(tasks_of(folder), folder / "out")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_batch(tasks_of(folder), folder / "out", report=again)
    status = run_batch(tasks_of(folder), folder / "out")
    assert len(status.done) == 3


def test_a_folder_without_locks_is_not_taken_for_one_of_another_run(folder, monkeypatch):
    fcntl = pytest.importorskip("fcntl")

    def no_lock(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", no_lock)
    with pytest.raises(LsvisionError, match=r"can be locked \(No locks available\), so two runs"):
        run_batch(tasks_of(folder), folder / "out")


def test_the_profiles_without_a_point_are_noted_once_for_all_parts_of_a_file(folder, monkeypatch):
    monkeypatch.setattr("lsvision.io.profiles.streaming.PROFILES_PER_CHUNK", 2)
    write_parquet(folder / "in" / "part-1.parquet", 5, empty=(2, 4))
    (task,) = [task for task in tasks_of(folder) if task.name == "part-1.parquet"]
    task.output.parent.mkdir()
    empty = [note for note in measure_file(task).notes if "no point" in note]
    assert empty == ["2 of 5 profiles hold no point"]


def test_a_run_that_began_and_ended_just_before_the_lock_is_known(folder, monkeypatch):
    lock = manifest._lock_file

    def lock_after_another_run(*arguments):
        monkeypatch.setattr(manifest, "_lock_file", lock)
        run_batch(tasks_of(folder), folder / "out")
        lock(*arguments)

    monkeypatch.setattr(manifest, "_lock_file", lock_after_another_run)
    assert len(run_batch(tasks_of(folder), folder / "out").done) == 3


def test_results_never_overwrite_a_source_or_each_other(folder):
    source = folder / "in"
    with pytest.raises(LsvisionError, match=r"part-1\.parquet: it lies in the folder of the res"):
        plan_tasks([source / "part-1.parquet"], source, source, BatchJob())
    same = [source / "a.csv", source / "a.csv.parquet"]
    with pytest.raises(LsvisionError, match=r"both would be written to .*a\.csv\.parquet: rename"):
        plan_tasks(same, source, folder / "out", BatchJob())


@pytest.mark.parametrize("content", [b"", b"notes", "parquet"])
def test_a_file_in_the_folder_of_results_that_is_no_result_is_kept(folder, content):
    other = folder / "out" / "part-1.parquet"
    other.parent.mkdir()
    if content == "parquet":
        write_parquet(other)
    else:
        other.write_bytes(content)
    before = other.read_bytes()
    with pytest.raises(UnwritableFile, match=r"part-1\.parquet: it exists, and is no result of a"):
        run_batch(tasks_of(folder), folder / "out")
    assert other.read_bytes() == before
    other.unlink()
    assert len(run_batch(tasks_of(folder), folder / "out").done) == 3


def test_the_folder_of_results_is_one_table_that_joins_the_input_by_id(folder):
    (folder / "in" / "a.csv").unlink()
    run_batch(tasks_of(folder), folder / "out")
    given, found = pq.read_table(folder / "in"), pq.read_table(folder / "out")
    joined = found.select(["part_id", "profile", "taken"]).join(
        given.select(["part_id", "taken"]), "part_id", right_suffix="_given"
    )
    assert len(joined) == len(found) == 8
    assert joined["taken"].to_pylist() == joined["taken_given"].to_pylist()


def test_results_state_the_version_and_the_job(folder):
    (task, *_) = tasks_of(folder)
    run_batch([task], folder / "out")
    assert pq.read_schema(task.output).metadata == {
        b"lsvision.version": lsv.__version__.encode(),
        b"lsvision.job_hash": task.job.hash.encode(),
    }


def test_the_results_of_a_file_with_a_long_name_have_a_shorter_one(folder):
    names = [letter * 251 + ".csv" for letter in "ab"] + ["ö" * 125 + ".csv"]
    for name in names:
        np.savetxt(folder / "in" / name, profiles(2)[1], delimiter=",")
    status = run_batch(tasks_of(folder), folder / "out")
    assert len(status.done) == 6
    assert not status.failed
    outputs = [task.output.name for task in tasks_of(folder) if task.name in names]
    assert [name[0] for name in sorted(outputs)] == ["a", "b", "ö"]
    assert all(len(name.encode()) <= 255 for name in outputs)
    assert all(map(status.is_done, tasks_of(folder)))


def test_files_of_one_name_in_two_folders_have_results_of_their_own(folder, monkeypatch):
    """Also if they are named relative to the current folder."""
    np.savetxt(folder / "in" / "sub" / "a.csv", profiles(2)[1], delimiter=",")
    monkeypatch.chdir(folder / "in")
    sources = [Path("a.csv"), Path("sub/a.csv")]
    tasks = plan_tasks(sources, folder / "in", Path("../out"), BatchJob())
    status = run_batch(tasks, folder / "out")
    assert sorted(status.outcomes) == ["a.csv", "sub/a.csv"]
    assert sorted(files(folder / "out")) == ["a.csv.parquet", "sub/a.csv.parquet"]


def test_implausible_units_are_an_error_and_assumed_ones_a_note(folder):
    np.savetxt(folder / "in" / "a.csv", 1000 * profiles(1)[0], delimiter=",")
    status = run_batch(tasks_of(folder), folder / "out")
    (failed,) = status.failed
    assert "a.csv: coordinates reach" in failed.error
    assert "--units" in failed.error
    assert all(
        "units taken as mm: state them with --units" in outcome.notes for outcome in status.done
    )


def test_a_bug_met_by_one_file_costs_no_other(folder):
    def measure(profiles):
        if 77 in map(len, profiles):
            raise ZeroDivisionError("a bug")
        return measure_profiles(profiles)

    np.savetxt(folder / "in" / "a.csv", profiles(1)[0][100:177], delimiter=",")
    status = run_batch(tasks_of(folder, BatchJob(partial(measure))), folder / "out")
    (failed,) = status.failed
    assert failed.error.endswith("a.csv: ZeroDivisionError: a bug")
    assert len(status.done) == 2


@pytest.mark.parametrize("kept", [0, 10])
def test_a_manifest_that_was_cut_off_in_its_first_line_begins_anew(folder, kept):
    run_batch(tasks_of(folder), folder / "out")
    path = folder / "out" / MANIFEST
    path.write_text(path.read_text()[:kept])
    assert len(run_batch(tasks_of(folder), folder / "out").done) == 3


def test_a_source_that_has_gone_is_one_failed_file(folder):
    tasks = tasks_of(folder)
    run_batch(tasks, folder / "out")
    (folder / "in" / "a.csv").unlink()
    status = run_batch(tasks, folder / "out")
    assert "a.csv: no such file" in status.failed[0].error
    assert (folder / "out" / "a.csv.parquet").exists()
    assert len(status.done) == 2


def test_without_pyarrow_the_extra_is_named(folder, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(LsvisionError, match=r"needs pyarrow: pip install 'lsvision\[batch\]'"):
        run_batch(tasks_of(folder), folder / "out")


def test_another_file_is_no_manifest(tmp_path):
    (tmp_path / MANIFEST).write_text(json.dumps({"schema": "other"}))
    with pytest.raises(UnreadableFile, match=r"expected a manifest of lsvision\.batch/2"):
        read_status(tmp_path)
    assert read_status(tmp_path / "none") is None


@pytest.mark.parametrize(
    "lines",
    [
        [{"schema": SCHEMA}],
        [{"schema": SCHEMA, "job_hash": "1", "job": {}}, {"name": "a.csv"}],
        [{"schema": SCHEMA, "job_hash": "1", "job": {}}, {"files": "many"}],
    ],
)
def test_a_manifest_with_other_records_is_rejected(tmp_path, lines):
    (tmp_path / MANIFEST).write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(UnreadableFile, match="a record lacks a value or has one of another type"):
        read_status(tmp_path)


def test_without_files_there_is_no_batch(tmp_path):
    with pytest.raises(ValueError, match="expected at least one file"):
        run_batch([], tmp_path)
    assert FileOutcome("a").error == ""
