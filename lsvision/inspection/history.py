"""Revisions of a job: hash of the content for each revision number."""

from __future__ import annotations

import datetime
from pathlib import Path

from lsvision.errors import LsvisionError
from lsvision.inspection.append_only import append_record, read_records
from lsvision.inspection.job import Job

SUFFIX = ".history.jsonl"
"""Suffix of the history's name, after that of the job file."""


def history_path(job_path: Path) -> Path:
    """Return the path of the history of a job file, which is beside it."""
    return job_path.with_name(job_path.name + SUFFIX)


def record_revision(job: Job, job_path: Path, now: datetime.datetime) -> bool:
    """Record a job in its history, and return True; return False if it is already recorded.

    Raises
    ------
    LsvisionError
        If its revision, or a higher one, is recorded with another content; if the history cannot
        be read or written.
    """
    path = history_path(job_path)
    for entry in read_records(path):
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
    append_record(path, entry)
    return True


def describe_unrecorded_change(job: Job, job_path: Path) -> str | None:
    """Return a message if a job differs from its history; None if it is recorded or has none."""
    entries = read_records(history_path(job_path))
    if not entries or any(entry["hash"] == job.hash for entry in entries):
        return None
    return (
        f"this content of the job is not in its history (last recorded: revision "
        f"{entries[-1]['revision']}): lsvision job check --record {job_path}"
    )
