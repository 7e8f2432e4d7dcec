"""Append-only files: one JSON record per line, each with the hash of the line before it.

A change of any line but the last is detected: no later line has the hash of the last one.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence

from lsvision.errors import UnreadableFile
from lsvision.files.atomic_files import write_atomic
from lsvision.files.file_kinds import exists
from lsvision.files.json_text import parse_json
from lsvision.files.limited_reading import read_text
from lsvision.results.quantities import Record

FIRST_HASH = "0" * 64
"""Hash that stands in the first line, which has no line before it."""


def read_records(path: str | os.PathLike[str]) -> list[Record]:
    """Return the records of a file, the oldest first; an empty list if there is no file.

    Raises
    ------
    UnreadableFile
        If a line is not a record, or does not have the hash of the line before it, because that
        was changed or removed.
    """
    return _parse_records(_read_lines(path), path)


def _read_lines(path: str | os.PathLike[str]) -> list[str]:
    """Return the lines of a file; an empty list if there is no file."""
    return read_text(path).splitlines() if exists(path) else []


def _parse_records(lines: Sequence[str], path: str | os.PathLike[str]) -> list[Record]:
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
        records.append(record)
        previous = _hash_line(line)
    return records


def _hash_line(line: str) -> str:
    return hashlib.sha256(line.encode()).hexdigest()


def append_record(path: str | os.PathLike[str], record: Record) -> None:
    """Append a record to a file, after checking the earlier ones; create the file if there is none.

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
    >>> append_record(path, {"revision": 1}), append_record(path, {"revision": 2})
    (None, None)
    >>> read_records(path)
    [{'revision': 1}, {'revision': 2}]
    """
    lines = _read_lines(path)
    _parse_records(lines, path)
    previous = _hash_line(lines[-1]) if lines else FIRST_HASH
    lines.append(json.dumps(record | {"previous": previous}, allow_nan=False))
    write_atomic(path, "\n".join(lines) + "\n")
