"""Read the profiles of a file of any size in chunks, so that the memory does not grow with it."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.files.file_kinds import STDIN, is_regular
from lsvision.files.limited_reading import check_readable
from lsvision.io.profiles.matrix import are_heights
from lsvision.io.profiles.numpy_arrays import NPY_MAGIC, open_npy, profiles_from_array
from lsvision.io.profiles.parquet import PARQUET_MAGIC, holds_lists, iterate_tables
from lsvision.io.profiles.parquet import profiles_from_table as profiles_from_parquet
from lsvision.io.profiles.reading import (
    ProfileFile,
    convert_to_section_frame,
    inspect_profiles,
    require_points,
)
from lsvision.io.profiles.settings import RawProfiles, ReadOptions, ReadSettings

if TYPE_CHECKING:
    import pyarrow as pa

PROFILES_PER_CHUNK = 256
"""Largest number of profiles of a chunk, by default: 256 of 4096 points take 17 MB."""
MAX_MARKERS = 8
"""Largest number of markers of lost points, found in the chunks read so far, that are applied to
the next chunks: each is compared with all points, which takes time."""


@dataclass(frozen=True, eq=False)
class ProfileChunk:
    """Consecutive profiles of a file; `first` is the index of its first one in the file, from 0.

    `columns` are those of a Parquet file other than the points, with their types, one row per
    profile; `point_columns` are the names of those left out because they hold a value for each
    point, such as its intensity.
    """

    first: int
    file: ProfileFile
    columns: "pa.Table | None" = None
    point_columns: tuple[str, ...] = ()


def iterate_profiles(
    path: str | os.PathLike[str],
    at_once: int | None = None,
    **options: Unpack[ReadOptions],
) -> Iterator[ProfileChunk]:
    r"""Read the profiles of a file in chunks.

    Parquet with one profile per row and NPY arrays of several profiles are read chunk by chunk; any
    other file is one chunk.

    Parameters
    ----------
    path : path
        The file.
    at_once : int, optional
        Largest number of profiles of a chunk; by default `PROFILES_PER_CHUNK`.
    **options
        Fields of `ReadSettings`, as for `read_profile`.

    Yields
    ------
    ProfileChunk
        Chunks in the order of the file. A value that was recognised as a marker of lost points in
        one chunk marks them in all later chunks, too.

    Raises
    ------
    UnreadableFile
        If the file or a chunk of it cannot be read (the message has the index of the chunk's first
        profile), or all points are lost.
    ValueError, TypeError
        If `at_once` is below 1, or as `read_profile`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "profiles.npy"
    >>> np.save(path, np.random.default_rng(0).normal(size=(5, 40, 2)))
    >>> [len(chunk.file.profiles) for chunk in iterate_profiles(path, at_once=2)]
    [2, 2, 1]
    """
    settings, file = ReadSettings(**options), Path(path)
    at_once = PROFILES_PER_CHUNK if at_once is None else at_once
    if at_once < 1:
        raise ValueError(f"expected at_once of at least 1, got {at_once}")
    file_format = _detect_streamed_format(file, settings)
    if file_format is None:
        yield ProfileChunk(0, inspect_profiles(file, **options))
        return
    read_chunks = _iterate_parquet_chunks if file_format == "parquet" else _iterate_npy_chunks
    first, valid_points, marker_values = 0, 0, tuple[float, ...]()
    try:
        for raw, columns, point_columns in read_chunks(file, settings, at_once):
            raw_chunk = replace(raw, lost=(*raw.lost, *marker_values))
            chunk = convert_to_section_frame(file, file_format, raw_chunk, settings)
            if first == 0 and len(chunk.profiles) < at_once:  # this chunk is the whole file
                require_points(chunk.profiles)
            valid_points += sum(map(len, chunk.profiles)) - chunk.lost
            yield ProfileChunk(first, chunk, columns, point_columns)
            first += len(chunk.profiles)
            if settings.lost is None:  # markers of a pair of coordinates, "0, 0", are found again
                chunk_values = [
                    float(m.text) for m in chunk.markers if not (m.interrupts or "," in m.text)
                ]
                marker_values = tuple(dict.fromkeys((*marker_values, *chunk_values)))[:MAX_MARKERS]
        if valid_points == 0:
            raise UnreadableFile(f"all points of its {first} profiles are lost: check exposure")
    except UnreadableFile as error:
        location = f"from profile {first} on: " if first and valid_points else ""
        raise UnreadableFile(f"{file}: {location}{error}") from None


def _detect_streamed_format(file: Path, settings: ReadSettings) -> str | None:
    """Return the format of a file whose chunks can be read independently, else None."""
    if settings.plane is not None:  # the plane is fitted to all profiles together
        return None
    if str(file) == STDIN or not is_regular(file):
        return None
    check_readable(file)
    with file.open("rb") as stream:
        start = stream.read(len(NPY_MAGIC))
    if start.startswith(PARQUET_MAGIC) and settings.format in (None, "parquet"):
        return "parquet"
    if start == NPY_MAGIC and settings.format in (None, "npy") and not settings.transpose:
        return "npy"
    return None


def _iterate_parquet_chunks(
    file: Path, settings: ReadSettings, at_once: int
) -> "Iterator[tuple[RawProfiles, pa.Table | None, tuple[str, ...]]]":
    """Yield the profiles of each chunk of a table, and if a profile is one row, its other columns.

    The last value has the names of the columns with a value for each point, which the first chunk
    decides.
    """
    point_columns: tuple[str, ...] | None = None
    for table in iterate_tables(file, at_once):
        raw = profiles_from_parquet(table, settings)
        if not raw.row_coordinates:
            yield raw, None, ()
            continue
        if point_columns is None:
            point_columns = _list_point_columns(table, raw)
        other_columns = [
            name
            for name in table.column_names
            if name not in raw.row_coordinates and name not in point_columns
        ]
        yield raw, table.select(other_columns), point_columns


def _list_point_columns(table: "pa.Table", raw: RawProfiles) -> tuple[str, ...]:
    """Return the names of columns, other than the coordinates, of one number for each point."""
    counts = [len(section) for section in raw.sections]
    return tuple(
        name
        for name in table.column_names
        if name not in raw.row_coordinates and holds_lists(table[name], counts)
    )


def _iterate_npy_chunks(
    file: Path, settings: ReadSettings, at_once: int
) -> Iterator[tuple[RawProfiles, None, tuple[str, ...]]]:
    """Yield the profiles of each chunk of an array; the array as one chunk if it is one profile."""
    array = open_npy(file)
    is_stack = array.ndim == 3 or (
        array.ndim == 2
        and settings.columns is None
        and settings.dx is not None  # without it, the first row may be x
        and array.shape[1] > 1  # one column is one profile
        and are_heights(array.shape[1], settings)
    )
    for start in range(0, len(array), at_once) if is_stack and len(array) else (0,):
        chunk = array[start : start + at_once] if is_stack else array
        yield profiles_from_array(np.array(chunk), settings), None, ()  # read from the file here
