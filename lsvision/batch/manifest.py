"""Manifest of a batch: one line of JSON for each finished file."""

import json
import os
import time
from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TextIO

from lsvision import __version__
from lsvision.batch.measure_file import (
    TEMPORARY_PREFIX,
    BatchJob,
    FileOutcome,
    FileTask,
    read_file_version,
)
from lsvision.batch.written_file import WrittenFile, describe_change
from lsvision.errors import LsvisionError, UnreadableFile, UnwritableFile
from lsvision.results.summaries import format_count

MANIFEST = "_manifest.jsonl"
"""Name of the manifest in the folder of the results. Programs that read a folder of Parquet files
as one table skip names that begin like this."""
SCHEMA = "lsvision.batch/2"
"""Name and version of the manifest's format."""


@dataclass(frozen=True)
class Status:
    """State of a batch, with the settings of its job and their hash, and the version of lsvision.

    `files` is the number of files of the last run, `outcomes` the last outcome of each by its name
    in the results, `outputs` the file of its results, relative to the folder of the batch;
    `set_aside` names the files whose measurement ended its process twice (out of memory, a crash),
    which are not measured again until they change.
    """

    job_hash: str
    settings: dict[str, Any]
    version: str
    files: int
    outcomes: dict[str, FileOutcome] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    set_aside: frozenset[str] = frozenset()

    @property
    def done(self) -> list[FileOutcome]:
        """Outcomes of the files that are measured."""
        return [outcome for outcome in self.outcomes.values() if not outcome.error]

    @property
    def failed(self) -> list[FileOutcome]:
        """Outcomes of the files that could not be measured, also of those set aside."""
        return [outcome for outcome in self.outcomes.values() if outcome.error]

    def is_done(self, task: FileTask) -> bool:
        """Return whether a file need not be measured; see `find_reason_to_measure`."""
        return self.find_reason_to_measure(task) is None

    def find_reason_to_measure(self, task: FileTask) -> str | None:
        """Return why a file must be measured, again or for the first time; None if it need not.

        It need not if it was measured, or is set aside, has not changed since, and its results are
        as they were written. The reason is empty for a file that has no results yet.
        """
        outcome = self.outcomes.get(task.name)
        if outcome is None or (outcome.error and task.name not in self.set_aside):
            return ""
        if not task.source.exists():  # reported by measuring it
            return ""
        if outcome.version != read_file_version(task.source):
            return "measured again: it has changed"
        if outcome.written is None:  # set aside
            return None
        if describe_change(task.output, outcome.written) is not None:
            return "measured again: its results were changed or deleted"
        return None


def find_changed_results(folder: Path, status: Status) -> dict[str, str]:
    """Return how results in the folder of a batch differ from what was written, by file names."""
    changes = {
        outcome.name: describe_change(folder / status.outputs[outcome.name], outcome.written)
        for outcome in status.done
        if outcome.written is not None
    }
    return {name: change for name, change in changes.items() if change is not None}


def read_status(folder: Path) -> Status | None:
    """Return the state of the batch whose results are in a folder; None if there is none.

    Raises
    ------
    UnreadableFile
        If the manifest cannot be read, or is not one of this version.
    """
    path = folder / MANIFEST
    text = _read_text(path)
    if text is None:
        return None
    records = [record for record in map(_parse_record, text.splitlines()) if record is not None]
    if not records and "\n" not in text:  # interrupted while the first line was written
        return None
    if not records or records[0].get("schema") != SCHEMA:
        raise UnreadableFile(
            f"{path}: expected a manifest of {SCHEMA}, got another file: name another folder"
        )
    try:
        return _status_from_records(records[0], records[1:])
    except (KeyError, TypeError, ValueError) as error:
        raise UnreadableFile(
            f"{path}: a record lacks a value or has one of another type ({error}): name another "
            "folder"
        ) from None


def _read_text(path: Path) -> str | None:
    """Return the text of a manifest; None if there is no such file."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    except NotADirectoryError:
        folder = path.parent
        raise UnreadableFile(f"{folder}: a file: name a folder, the --out of a batch") from None
    except OSError as error:
        raise UnreadableFile(f"{path}: {error.strerror}: check its owner and mode") from None
    except UnicodeDecodeError:
        raise UnreadableFile(f"{path}: no text, so no manifest: name another folder") from None


def _status_from_records(head: dict[str, Any], records: Sequence[dict[str, Any]]) -> Status:
    """Return the state of a batch from the first and the other records of its manifest."""
    outcomes: dict[str, FileOutcome] = {}
    outputs: dict[str, str] = {}
    set_aside: set[str] = set()
    files = 0
    for record in records:
        if "files" in record:  # the start of a run
            files = int(record["files"])
            continue
        is_set_aside = bool(record.pop("set_aside", False))
        output = str(record.pop("output"))
        tuples = {name: tuple(record[name]) for name in ("version", "notes")}  # lists in JSON
        state = record.pop("written")
        written = None if state is None else WrittenFile(**state)
        outcome = FileOutcome(**record | tuples, written=written)
        outcomes[outcome.name], outputs[outcome.name] = outcome, output
        if is_set_aside:
            set_aside.add(outcome.name)
        else:
            set_aside.discard(outcome.name)
    return Status(
        head["job_hash"], head["job"], head["version"], files, outcomes, outputs,
        frozenset(set_aside),
    )  # fmt: skip


def _parse_record(line: str) -> dict[str, Any] | None:
    """Return the record of a line; None if an interruption left the line incomplete."""
    try:
        record = json.loads(line)
    except ValueError:
        return None
    return record if isinstance(record, dict) else None


class Manifest:
    """Manifest in the folder of the results, a context manager: open and locked within its block.

    The folder is created.
    """

    def __init__(self, folder: Path, job: BatchJob) -> None:
        self._folder, self._job = folder, job
        self._file: TextIO | None = None

    def __enter__(self) -> "Manifest":
        """Open and lock the manifest, and remove what an interrupted run left.

        Raises
        ------
        LsvisionError
            If the folder holds results of another job or version, another run writes into it, or
            it cannot be written.
        """
        path = self._folder / MANIFEST
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._file = path.open("a+", encoding="utf-8")
        except OSError as error:
            where = (
                f"{self._folder}: a file" if self._folder.is_file() else f"{path}: {error.strerror}"
            )
            raise UnwritableFile(f"{where}: name a folder that can be written") from None
        try:
            _lock_file(self._file, self._folder)
            status = read_status(self._folder)  # once locked: another run may have begun it
            self._end_cut_line()
            self._check_job(status)
        except LsvisionError:
            self._file.close()
            raise
        for leftover in self._folder.rglob(f"{TEMPORARY_PREFIX}*.part"):
            leftover.unlink(missing_ok=True)
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def begin(self, files: int) -> None:
        """Record the start of a run and its number of files."""
        now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        self._append({"files": files, "started": now, "version": __version__})

    def add(self, outcome: FileOutcome, output: Path, *, set_aside: bool = False) -> None:
        """Record the outcome of a file, and the file of its results.

        Raises
        ------
        UnwritableFile
            If the disk is full.
        """
        record = asdict(outcome) | {"output": os.path.relpath(output, self._folder)}
        self._append(record | ({"set_aside": True} if set_aside else {}))

    def _end_cut_line(self) -> None:
        """End a line that an interruption left incomplete, so that the next one is whole."""
        if self._file is not None and self._file.tell() > 0:
            self._file.seek(0)
            if not self._file.read().endswith("\n"):
                self._file.write("\n")

    def _check_job(self, status: Status | None) -> None:
        """Write the job into a new manifest; raise an error if it has another job or version."""
        if status is None:
            head = {"schema": SCHEMA, "job_hash": self._job.hash, "job": self._job.settings}
            self._append(head | {"version": __version__})
        elif status.version != __version__:
            raise LsvisionError(
                f"{self._folder}: it holds results of lsvision {status.version}, this is "
                f"{__version__}: name another folder, or continue with the version of the results "
                f"(pip install lsvision=={status.version})"
            )
        elif status.job_hash != self._job.hash:
            difference = _describe_difference(status, self._job)
            raise LsvisionError(
                f"{self._folder}: it holds results of another job ({difference}): name another "
                "folder, or give the same options"
            )

    def _append(self, record: dict[str, Any]) -> None:
        """Write a record as one line, so that it is on the disk when this returns."""
        if self._file is None:
            raise ValueError("expected an open manifest: use it in a with statement")
        try:
            self._file.write(json.dumps(record, allow_nan=False) + "\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise UnwritableFile(
                f"{self._folder / MANIFEST}: {error.strerror}: free disk space, then run again"
            ) from None


def _describe_difference(status: Status, job: BatchJob) -> str:
    """Return the settings that differ between a manifest and a job, for an error message."""
    # The options for reading are a mapping under one name.
    before, now = (
        {name: value for name, value in settings.items() if name != "reading"}
        | settings.get("reading", {})
        for settings in (status.settings, job.settings)
    )
    changed = [
        f"{name} {before.get(name, 'default')}, now {now.get(name, 'default')}"
        for name in sorted({*before, *now})
        if before.get(name) != now.get(name)
    ]
    return "; ".join(changed)


def _lock_file(file: TextIO, folder: Path) -> None:
    """Lock a manifest until it is closed, except on Windows.

    Raises
    ------
    LsvisionError
        If it is locked, or its file system has no locks.
    """
    try:
        import fcntl
    except ModuleNotFoundError:  # Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise LsvisionError(
            f"{folder}: another run writes into it: wait for it, or name another folder"
        ) from None
    except OSError as error:
        raise LsvisionError(
            f"{folder}: no file in it can be locked ({error.strerror}), so two runs could write "
            "into it: name a folder of another file system, or mount this one with locks (flock)"
        ) from None


def format_summary(status: Status, names: Iterable[str] = (), changed: Collection[str] = ()) -> str:
    """Return the counts of a batch in one line.

    They are those of the files `names`, or else of all files of the batch: those of the last run,
    and those that earlier runs have finished. The files `changed`, whose results were changed or
    deleted, are left to be measured.
    """
    counted_names = set(names)
    outcomes = [
        outcome
        for outcome in status.outcomes.values()
        if not counted_names or outcome.name in counted_names
    ]
    done = [outcome for outcome in outcomes if not outcome.error and outcome.name not in changed]
    failed = sum(bool(outcome.error) for outcome in outcomes)
    total = len(counted_names) or max(status.files, len(outcomes))
    profiles = sum(outcome.profiles for outcome in done)
    cylinders = sum(outcome.cylinders for outcome in done)
    aside = sum(outcome.name in status.set_aside for outcome in outcomes)
    set_aside = f" ({aside} set aside)" if aside else ""
    again = f" ({len(changed)} of them again)" if changed else ""
    return (
        f"{len(done)} of {total} files done, {failed} failed{set_aside}, "
        f"{total - len(done) - failed} left{again}: "
        f"{format_count(profiles, 'profile')}, {format_count(cylinders, 'cylinder')}"
    )
