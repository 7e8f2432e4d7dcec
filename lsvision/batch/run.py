"""Run a batch: write one Parquet file of results per file of profiles, and a manifest."""

import hashlib
import importlib.util
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from lsvision.batch.cluster import run_on_cluster
from lsvision.batch.manifest import Manifest, Status, read_status
from lsvision.batch.measure_file import (
    BatchJob,
    FileOutcome,
    FileTask,
    measure_file,
    read_file_version,
)
from lsvision.batch.process_pool import EndedProcess, run_tasks
from lsvision.batch.written_file import has_mark
from lsvision.errors import LsvisionError, UnwritableFile
from lsvision.files.file_kinds import exists
from lsvision.files.limited_reading import get_size_limit
from lsvision.files.printable import escape_name

MAX_NAME_BYTES, KEPT_NAME_BYTES = 255, 200
"""Longest name of a file on the usual file systems, and the part of a longer name that is kept in
front of its hash and suffix, which take 25 more. Units: bytes."""
Report = Callable[[FileOutcome, int], None]
"""Type of a function that is called with the outcome of each file that was measured, and the number
of files that are left."""


def plan_tasks(sources: Sequence[Path], root: Path, folder: Path, job: BatchJob) -> list[FileTask]:
    """Return the tasks of a batch, each with the file that its results are written to.

    Parameters
    ----------
    sources : sequence of Path
        Files of profiles.
    root : Path
        Absolute folder that holds all sources; their names in the results are relative to it.
    folder : Path
        Folder of the results, which gets the subfolders of `root`: the results of ``part.parquet``
        are written to ``part.parquet``, the results of ``a.csv`` to ``a.csv.parquet``; a name too
        long for the file system ends in a hash.
    job : BatchJob
        Settings with which the files are read and measured.

    Raises
    ------
    LsvisionError
        If a source lies in the folder of the results, or the results of two sources would be
        written to the same file.
    ValueError
        If a source is not below `root`.
    """
    tasks: dict[Path, FileTask] = {}
    folder = folder.absolute()
    for source in map(Path.absolute, sources):
        # Without "..", which would name a file outside of the folder of the results.
        relative_path = Path(os.path.abspath(source)).relative_to(root)  # noqa: PTH100
        output = folder / relative_path.with_name(_build_output_name(relative_path.name))
        if source.resolve().is_relative_to(folder.resolve()):
            raise LsvisionError(
                f"{source}: it lies in the folder of the results: give another folder as --out"
            )
        if output in tasks:
            raise LsvisionError(
                f"{source} and {tasks[output].source}: the results of both would be written to "
                f"{output}: rename one of the two"
            )
        name = escape_name(relative_path)
        tasks[output] = FileTask(source, output, name, job, get_size_limit())
    return list(tasks.values())


def _build_output_name(name: str) -> str:
    """Return the name of the file with the results of the file `name`."""
    output = name if name.lower().endswith(".parquet") else f"{name}.parquet"
    encoded = os.fsencode(name)
    if len(os.fsencode(output)) <= MAX_NAME_BYTES:
        return output
    start = encoded[:KEPT_NAME_BYTES].decode(errors="ignore")
    return f"{start}.{hashlib.sha256(encoded).hexdigest()[:16]}.parquet"


def run_batch(
    tasks: Sequence[FileTask],
    folder: Path,
    *,
    jobs: int = 1,
    isolated: bool = False,
    scheduler: str | None = None,
    report: Report = lambda *_: None,
) -> Status:
    """Measure the files that have no valid results yet, and record the outcome of each.

    Files that failed in an earlier run are measured again, except those that ended their process
    twice, which are set aside until they change. A file that has changed since it was measured, or
    whose results were changed or deleted, is measured again, with a note. `jobs` is the number of
    processes on this machine: one is the calling process, which a file may end, or if `isolated`
    another one. `scheduler` is the address of a Dask scheduler whose workers measure the files
    instead; `report` is called as soon as the outcome of a file is in the manifest. Return the
    state after the run.

    Raises
    ------
    LsvisionError
        If the folder holds results of another job or of another version of lsvision, or in the
        place of results a file that is none; if it cannot be written, a worker has another version,
        or the connection to the scheduler is lost. Results of finished files are kept.
    ValueError
        If there are no tasks.
    """
    if not tasks:
        raise ValueError("expected at least one file, got none")
    if importlib.util.find_spec("pyarrow") is None:
        raise LsvisionError("a batch needs pyarrow: pip install 'lsvision[batch]'")
    with Manifest(folder, tasks[0].job) as manifest:
        status = read_status(folder)
        reasons = _find_reasons(tasks, status)
        remaining_tasks = [task for task in tasks if task.name in reasons]
        _check_outputs(remaining_tasks, status)
        manifest.begin(len(tasks))
        for task in remaining_tasks:
            _make_folder(task.output.parent)
        left = len(remaining_tasks)
        if scheduler is None:
            finished = run_tasks(
                measure_file, remaining_tasks, jobs, ordered=False, isolated=isolated
            )
        else:
            finished = run_on_cluster(measure_file, remaining_tasks, scheduler)
        for task, value in finished:
            is_set_aside = isinstance(value, EndedProcess)
            outcome = (
                value if isinstance(value, FileOutcome) else _build_outcome_of_ended_process(task)
            )
            # The results, if there are any, are those of an earlier version of the file: they are
            # deleted. Those of a file that was removed since are still right, and stay.
            if outcome.error and exists(task.source):
                task.output.unlink(missing_ok=True)
            if reasons[task.name]:
                outcome = replace(outcome, notes=(reasons[task.name], *outcome.notes))
            manifest.add(outcome, task.output, set_aside=is_set_aside)
            left -= 1
            report(outcome, left)
    status = read_status(folder)
    if status is None:
        raise LsvisionError(
            f"{folder}: the manifest was removed during the run: run the batch again"
        )
    return status


def _find_reasons(tasks: Sequence[FileTask], status: Status | None) -> dict[str, str]:
    """Return why files must be measured, by name, without those that need not be."""
    reasons = {
        task.name: "" if status is None else status.find_reason_to_measure(task) for task in tasks
    }
    return {name: reason for name, reason in reasons.items() if reason is not None}


def _check_outputs(tasks: Sequence[FileTask], status: Status | None) -> None:
    """Raise `UnwritableFile` if an output exists that is not a result of a batch.

    Results that are not in the manifest are those of a run that was interrupted before it recorded
    them.
    """
    for task in tasks:
        is_recorded = status is not None and task.name in status.outputs
        if not is_recorded and exists(task.output) and not has_mark(task.output):
            raise UnwritableFile(
                f"{task.output}: it exists, and is no result of a batch: name another folder as "
                "--out, or move the file"
            )


def _make_folder(folder: Path) -> None:
    """Make a folder and those above it, unless it exists; raise `UnwritableFile` if it fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UnwritableFile(
            f"{folder}: cannot be made ({error.strerror}): remove a file of this name, or name "
            "another folder for the results"
        ) from None


def _build_outcome_of_ended_process(task: FileTask) -> FileOutcome:
    """Return the outcome of a file whose measurement ended its process twice."""
    return FileOutcome(
        task.name,
        version=read_file_version(task.source) if exists(task.source) else (0, 0),
        error=f"{task.source}: it ended its process twice (out of memory, or a crash): set aside, "
        "and not tried again until it changes; with another --out it is",
    )
