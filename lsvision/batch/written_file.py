"""Files of results: their mark, and their state, by which a later change is recognised."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyarrow as pa

VERSION_KEY = b"lsvision.version"
"""Key of the metadata of a Parquet file by which results of a batch are recognised."""


@dataclass(frozen=True)
class WrittenFile:
    """State of a file after it was written.

    `size` in bytes, `modified_ns` the time of the last change in ns, and the hash of the content.
    """

    size: int
    modified_ns: int
    sha256: str


def read_state(path: Path) -> WrittenFile:
    """Return the state of a file.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    status = path.stat()
    return WrittenFile(status.st_size, status.st_mtime_ns, _hash_file(path))


def describe_change(path: Path, written: WrittenFile) -> str | None:
    """Return how a file differs from the one that was written; None if it is the same.

    Its content is compared only if its time differs, as that of a copy does. A change that keeps
    size and time is not recognised.
    """
    try:
        status = path.stat()
        if status.st_size != written.size:
            return f"{status.st_size} bytes instead of {written.size}"
        if status.st_mtime_ns != written.modified_ns and _hash_file(path) != written.sha256:
            return "other content"
    except FileNotFoundError:
        return "no such file"
    except OSError as error:
        return str(error.strerror)
    return None


def mark_schema(schema: "pa.Schema", version: str, job_hash: str) -> "pa.Schema":
    """Return the schema of results with the version of lsvision and the hash of the job in it."""
    return schema.with_metadata({VERSION_KEY: version, b"lsvision.job_hash": job_hash})


def has_mark(path: Path) -> bool:
    """Return whether a file holds results of a batch, by the mark in its schema."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        return VERSION_KEY in (parquet.read_schema(path).metadata or {})
    except (pa.ArrowException, OSError):
        return False


def _hash_file(path: Path) -> str:
    """Return the SHA-256 of the content of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
