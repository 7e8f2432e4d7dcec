"""Calibration files that a job names: their dates, and a check of their hashes."""

from __future__ import annotations

import datetime
import hashlib
from collections.abc import Mapping
from pathlib import Path

from lsvision.errors import LsvisionError
from lsvision.files.json_text import parse_json
from lsvision.files.limited_reading import read_bytes, read_text
from lsvision.inspection.job import Job
from lsvision.inspection.job_mistakes import find_line

CALIBRATION_KEYS = ("light_section", "flange_from_section")
"""Keys of ``[rig]`` that name calibration files."""


def check_calibration_files(job: Job, job_path: Path) -> dict[str, dict[str, str | None]]:
    """Return ``file``, ``date`` and ``sha256`` of each calibration file of a job, by its key.

    Paths in the job are relative to the folder of its file.

    Raises
    ------
    LsvisionError
        If a file cannot be read, or is not the one whose SHA-256 the job states; names the line.
    """
    provenances: dict[str, dict[str, str | None]] = {}
    for key in CALIBRATION_KEYS:
        name = getattr(job.rig, key)
        if name is None:
            continue
        path = job_path.parent / name
        content = read_bytes(path)
        digest = hashlib.sha256(content).hexdigest()
        stated = getattr(job.rig, f"{key}_sha256")
        if stated is not None and stated.lower() != digest:
            line = find_line(("rig", f"{key}_sha256"), read_text(job_path))
            raise LsvisionError(
                f"{job_path}, line {line}: expected {name} with SHA-256 {stated[:12]}..., "
                f"got {digest[:12]}...: if it was calibrated again, write "
                f'{key}_sha256 = "{digest}" and increase the revision'
            )
        provenances[key] = {"file": name, "date": _read_date(content), "sha256": digest}
    return provenances


def compute_calibration_age_days(
    files: Mapping[str, Mapping[str, str | None]], now: datetime.datetime
) -> float | None:
    """Return the age of the oldest calibration in days; None if no file has a date.

    The files are those of `check_calibration_files`; a date without a time zone is taken as UTC.
    The present time has a time zone.
    """
    dates = [
        datetime.datetime.fromisoformat(date)
        for file in files.values()
        if (date := file["date"]) is not None
    ]
    zoned = [date if date.tzinfo else date.replace(tzinfo=datetime.UTC) for date in dates]
    return max(((now - date).total_seconds() / 86400 for date in zoned), default=None)


def _read_date(content: bytes) -> str | None:
    """Return the ISO 8601 date in the provenance of a calibration file; None if there is none."""
    try:
        date = parse_json(content.decode())["provenance"]["date"]
        datetime.datetime.fromisoformat(date)
    except (ValueError, KeyError, TypeError):
        return None
    return str(date)
