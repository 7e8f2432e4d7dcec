"""Append-only files of JSON records, and the history of a job, which is one of them.

Each line has the hash of the line before it: a change of any line but the last is detected.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path

from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.files.atomic_files import write_atomic
from lsvision.files.file_kinds import exists
from lsvision.files.json_text import parse_json
from lsvision.files.limited_reading import read_text
from lsvision.inspection.job import Job
from lsvision.results.quantities import Record

FIRST_HASH = "0" * 64
"""Hash that stands in the first line, which has no line before it."""
HISTORY_SUFFIX = ".history.jsonl"
"""Suffix of the history's name, after that of the job file."""


def read_records(path: str | os.PathLike[str], key: str) -> list[Record]:
    """Return the records of a file, the oldest first; an empty list if there is no file.

    Raises
    ------
    UnreadableFile
        If a line is not a record with that key, or does not have the hash of the line before it,
        because that was changed or removed.
    """
    return _parse_records(_read_lines(path), path, key)


def _read_lines(path: str | os.PathLike[str]) -> list[str]:
    """Return the lines of a file; an empty list if there is no file."""
    return read_text(path).splitlines() if exists(path) else []


def _parse_records(lines: Sequence[str], path: str | os.PathLike[str], key: str) -> list[Record]:
    """Return the records in the lines of a file, after checking their hashes."""
    records, previous = [], FIRST_HASH
    for number, line in enumerate(lines, 1):
        try:
            record = parse_json(line)
            stated_hash = record.pop("previous")
        except (ValueError, KeyError, AttributeError, TypeError):
            raise UnreadableFile(
                f"{os.fspath(path)}, line {number}: expected a record with the hash of the line "
                "before, got something else: restore the file from a backup"
            ) from None
        if stated_hash != previous:
            raise UnreadableFile(
                f"{os.fspath(path)}, line {number}: the line before it was changed or removed: "
                "restore the file from a backup"
            )
        if key not in record:  # as of a golden part's log that is named as a history
            raise UnreadableFile(
                f"{os.fspath(path)}, line {number}: expected a record with {key!r}, "
                "got one without: name another file"
            )
        records.append(record)
        previous = _hash_line(line)
    return records


def _hash_line(line: str) -> str:
    return hashlib.sha256(line.encode()).hexdigest()


def append_record(path: str | os.PathLike[str], record: Record, key: str) -> None:
    """Append a record with a key to a file, after checking the earlier ones, or to a new file.

    Raises
    ------
    UnreadableFile
        See `read_records`.
    UnwritableFile
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> path = Path(tempfile.mkdtemp()) / "history.jsonl"
    >>> for number in (1, 2):
    ...     append_record(path, {"revision": number}, "revision")
    >>> read_records(path, "revision")
    [{'revision': 1}, {'revision': 2}]
    """
    lines = _read_lines(path)
    _parse_records(lines, path, key)
    previous = _hash_line(lines[-1]) if lines else FIRST_HASH
    lines.append(json.dumps(record | {"previous": previous}, allow_nan=False))
    write_atomic(path, "\n".join(lines) + "\n")


def build_history_path(job_path: Path) -> Path:
    """Return the path of the history of a job file, which is beside it."""
    return job_path.with_name(job_path.name + HISTORY_SUFFIX)


def record_revision(job: Job, job_path: Path, now: datetime.datetime) -> bool:
    """Record a job in its history, and return True; return False if it is already recorded.

    Raises
    ------
    LsvisionError
        If its revision, or a higher one, is recorded with another content; if the history cannot
        be read or written.
    """
    path = build_history_path(job_path)
    for entry in read_records(path, "revision"):
        if entry["hash"] == job.hash:
            return False
        if entry["revision"] >= job.revision:
            raise LsvisionError(
                f"{job_path}: revision {entry['revision']} is recorded with another content: "
                f"expected a revision above it, got {job.revision}: increase it"
            )
    entry = {
        "revision": job.revision,
        "hash": job.hash,
        "name": job.name,
        "time": now.isoformat(timespec="seconds"),
        "job": job.model_dump(mode="json", by_alias=True),
    }
    append_record(path, entry, "revision")
    return True


def describe_unrecorded_change(job: Job, job_path: Path) -> str | None:
    """Return a message if a job differs from its history; None if it is recorded or has none."""
    entries = read_records(build_history_path(job_path), "revision")
    if not entries or any(entry["hash"] == job.hash for entry in entries):
        return None
    return (
        f"this content of the job is not in its history (last recorded: revision "
        f"{entries[-1]['revision']}): lsvision job check --record {job_path}"
    )
