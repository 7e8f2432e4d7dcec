"""A task of a batch, with its settings: measures one file of profiles, and writes its cylinders."""

import hashlib
import json
import os
import platform
import secrets
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lsvision import __version__
from lsvision.batch.measure_group import measure_group, require_measurement
from lsvision.batch.result_table import build_result_table, name_file_columns
from lsvision.batch.written_file import WrittenFile, mark_schema, read_state
from lsvision.ellipse.section import precompute_intervals
from lsvision.errors import LsvisionError, UnreadableFile, UnwritableFile
from lsvision.files.limited_reading import MAX_FILE_BYTES, limit_file_size
from lsvision.io.profiles.plausibility import count_empty_profiles, note_empty_profiles
from lsvision.io.profiles.reading import ProfileFile, require_plausible_units
from lsvision.io.profiles.settings import ReadOptions, ReadSettings
from lsvision.io.profiles.streaming import ProfileChunk, iterate_profiles
from lsvision.measure import Measurement, measure_profiles
from lsvision.results.quantities import convert_to_plain

if TYPE_CHECKING:
    import pyarrow as pa

    from lsvision.inspection.job import Job
    from lsvision.measure import Measurement

_READING_DEFAULTS = {setting.name: setting.default for setting in fields(ReadSettings)}
"""Default of each setting of reading."""
TEMPORARY_PREFIX = ".lsvision."
"""Beginning of the name of an output that is being written."""


@dataclass(frozen=True, eq=False)
class BatchJob:
    """Settings of a batch; the same for each of its files.

    Parameters
    ----------
    measure : functools.partial
        Function that measures profiles, such as `measure_profiles`, with its keyword arguments.
    reading : ReadOptions
        Options for reading the files.
    inspection : Job, optional
        Job by which each profile is judged; `measure` then measures by this job.

    Examples
    --------
    >>> from functools import partial
    >>> BatchJob(partial(measure_profiles, radius=19.0)).settings["radius"]
    19.0
    """

    measure: partial[list[Measurement]] = field(default_factory=lambda: partial(measure_profiles))
    reading: ReadOptions = field(default_factory=ReadOptions)
    inspection: "Job | None" = None

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that determine the results, without unset ones, as plain numbers and text.

        Keys: ``measure``, the name of the function; its keyword arguments; ``reading``, the options
        that differ from their defaults; with an inspection ``job`` and ``job_hash``.
        """
        settings: dict[str, Any] = {"measure": self.measure.func.__name__}
        settings |= {name: convert_to_plain(value) for name, value in self.measure.keywords.items()}
        settings["reading"] = {
            name: convert_to_plain(value)
            for name, value in self.reading.items()
            if value != _READING_DEFAULTS[name]
        }
        if self.inspection is not None:
            settings |= {"job": self.inspection.name, "job_hash": self.inspection.hash}
        return {name: value for name, value in settings.items() if value is not None}

    @property
    def hash(self) -> str:
        """Hash of the settings (16 hex digits); all results in a folder have the same."""
        canonical = json.dumps(self.settings, sort_keys=True, allow_nan=False)
        return hashlib.sha256(canonical.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class FileTask:
    """A file of profiles to be measured, and the Parquet file of its cylinders.

    `name` is that of the source in the results and the manifest; larger files than `max_size`, in
    bytes, are not read. `lsvision_version` is that of the command.
    """

    source: Path
    output: Path
    name: str
    job: BatchJob
    max_size: int = MAX_FILE_BYTES
    lsvision_version: str = __version__


@dataclass(frozen=True)
class FileOutcome:
    """Outcome of a file; one that could not be measured has only its name and the error.

    `name` is that of the source in the results and the manifest, `seconds` the time that reading
    and measuring took, `version` that of `read_file_version`; `rejections` counts rejected arcs,
    `notes` are assumptions and omissions in reading the file, `written` is the state of its
    results.
    """

    name: str
    profiles: int = 0
    cylinders: int = 0
    rejections: int = 0
    seconds: float = 0.0
    version: tuple[int, int] = (0, 0)
    notes: tuple[str, ...] = ()
    error: str = ""
    written: WrittenFile | None = None


def measure_file(task: FileTask) -> FileOutcome:
    """Measure a file, and write its results completely or not at all; return counts and notes.

    The outcome of a file that cannot be read or measured is its error.

    Raises
    ------
    UnwritableFile
        If the results cannot be written: this concerns all files.
    LsvisionError
        If the process has another version of lsvision than the command.
    """
    _require_version(task.lsvision_version)
    start = time.monotonic()
    try:
        version = read_file_version(task.source)
        with limit_file_size(task.max_size):
            outcome = _write_results(task)
        if read_file_version(task.source) != version:
            task.output.unlink(missing_ok=True)
            raise UnreadableFile(f"{task.source}: it changed while it was read: run again")
    except UnwritableFile:
        raise
    except LsvisionError as error:
        return FileOutcome(task.name, error=str(error))
    except Exception as error:  # noqa: BLE001 - a bug in one file must not stop the batch
        reason = " ".join(str(error).split()) or "no message"
        return FileOutcome(task.name, error=f"{task.source}: {type(error).__name__}: {reason}")
    return replace(outcome, seconds=time.monotonic() - start, version=version)


def _require_version(wanted: str) -> None:
    """Raise an error in a process, on another machine, with another version of lsvision."""
    if wanted != __version__:
        raise LsvisionError(
            f"{platform.node()}: this worker has lsvision {__version__}, the command {wanted}: "
            "install the same version on all machines, and start the workers again"
        )


def read_file_version(path: Path) -> tuple[int, int]:
    """Return size in bytes and time of the last change in ns; either differs if the file changed.

    Raises
    ------
    UnreadableFile
        If there is no such file, or it is not accessible.
    """
    try:
        status = path.stat()
    except FileNotFoundError:
        raise UnreadableFile(f"{path}: no such file: check the name") from None
    except OSError as error:
        raise UnreadableFile(f"{path}: {error.strerror}: check the name and the folder") from None
    return status.st_size, status.st_mtime_ns


def _write_results(task: FileTask) -> FileOutcome:
    """Measure a file chunk by chunk, write its output, and return the counts and notes."""
    profiles = empty = cylinders = rejections = 0
    notes: dict[str, None] = {}  # in place of a set, which has no order
    temporary = task.output.with_name(f"{TEMPORARY_PREFIX}{secrets.token_hex(8)}.part")
    writer = None
    try:
        for chunk in iterate_profiles(task.source, **task.job.reading):
            require_plausible_units(chunk.file)
            notes |= dict.fromkeys(_list_notes_of_chunk(task, chunk))
            measured = _measure_chunk(task, chunk)
            table = build_result_table(task.name, chunk, measured, task.job.inspection)
            if writer is None:
                schema = mark_schema(table.schema, task.lsvision_version, task.job.hash)
                writer = _open_writer(temporary, schema)
            _write_table(writer, table, task.output)
            profiles += len(measured)
            empty += measured.count(None)
            cylinders += sum(len(m.cylinders) for m in measured if m is not None)
            rejections += sum(len(m.rejections) for m in measured if m is not None)
        if writer is None:
            raise UnreadableFile(f"{task.source}: it holds no profile: check its export")
        written = _finish_output(writer, temporary, task.output)
    finally:
        temporary.unlink(missing_ok=True)
    all_notes = (*notes, *note_empty_profiles(empty, profiles))
    return FileOutcome(task.name, profiles, cylinders, rejections, notes=all_notes, written=written)


def list_notes(file: ProfileFile) -> Iterator[str]:
    """Yield the assumptions and omissions in reading a file."""
    if file.units_assumed:
        yield f"units taken as {file.units}: state them with --units"
    yield from file.notes


def _list_notes_of_chunk(task: FileTask, chunk: ProfileChunk) -> Iterator[str]:
    """Yield the notes on a chunk, also on columns with another name in the results, or not there.

    Its empty profiles are left out, because those of the file are noted.
    """
    profiles = chunk.file.profiles
    counted = note_empty_profiles(count_empty_profiles(profiles), len(profiles))
    yield from (note for note in list_notes(chunk.file) if note not in counted)
    if chunk.point_columns:
        yield f"{', '.join(chunk.point_columns)}: one value per point, not repeated in the results"
    names = name_file_columns(chunk, judged=task.job.inspection is not None)
    for name, new_name in names.items():
        if new_name != name:
            yield f"{name} is a column of the results: that of the file is {new_name} there"


def _measure_chunk(task: FileTask, chunk: ProfileChunk) -> "list[Measurement | None]":
    """Measure the profiles of a chunk, with all intervals; None for one without a valid point."""
    profiles = chunk.file.profiles
    valid = [k for k, profile in enumerate(profiles) if profile.lost < len(profile)]
    measured: list[Measurement | None] = [None] * len(profiles)
    for k, result in zip(
        valid, measure_group(task.job.measure, [profiles[k] for k in valid]), strict=True
    ):
        measured[k] = require_measurement(result, task.source, chunk.first + k)
    precompute_intervals(c for m in measured if m is not None for c in m.cylinders)
    return measured


def _open_writer(path: Path, schema: "pa.Schema") -> "pa.parquet.ParquetWriter":
    """Return a writer of a new Parquet file."""
    from pyarrow import parquet

    try:
        return parquet.ParquetWriter(path, schema, compression="zstd")
    except OSError as error:
        raise _build_unwritable_error(path.parent, error) from None


def _write_table(writer: "pa.parquet.ParquetWriter", table: "pa.Table", output: Path) -> None:
    """Write a table with the column types of the first one."""
    try:
        writer.write_table(table.cast(writer.schema))
    except OSError as error:
        raise _build_unwritable_error(output, error) from None


def _finish_output(
    writer: "pa.parquet.ParquetWriter", temporary: Path, output: Path
) -> WrittenFile:
    """Close a temporary file, rename it to the output once it is on the disk; return its state."""
    try:
        writer.close()
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        written = read_state(temporary)
        temporary.replace(output)
    except OSError as error:
        raise _build_unwritable_error(output, error) from None
    return written


def _build_unwritable_error(path: Path, error: OSError) -> UnwritableFile:
    """Return the error that a file cannot be written."""
    reason = error.strerror or str(error)
    return UnwritableFile(
        f"{path}: {reason}: free disk space or choose another folder, then run again"
    )
