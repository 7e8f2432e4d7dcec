"""Read the profiles of a file of any size in parts, so that the memory does not grow with it."""

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

PROFILES_PER_PART = 256
"""Largest number of profiles of a part, by default: 256 of 4096 points take 17 MB."""
MAX_MARKERS = 8
"""Largest number of markers of lost points, found in the parts read so far, that are applied to the
next parts: each is compared with all points, which takes time."""


@dataclass(frozen=True, eq=False)
class ProfilePart:
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
) -> Iterator[ProfilePart]:
    r"""Read the profiles of a file in parts.

    Parquet with one profile per row and NPY arrays of several profiles are read part by part; any
    other file is one part.

    Parameters
    ----------
    path : path
        The file.
    at_once : int, optional
        Largest number of profiles of a part; by default `PROFILES_PER_PART`.
    **options
        Fields of `ReadSettings`, as for `read_profile`.

    Yields
    ------
    ProfilePart
        Parts in the order of the file. A value that was recognised as a marker of lost points in
        one part marks them in all later parts, too.

    Raises
    ------
    UnreadableFile
        If the file or a part of it cannot be read (the message has the index of the part's first
        profile), or all points are lost.
    ValueError, TypeError
        If `at_once` is below 1, or as `read_profile`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "profiles.npy"
    >>> np.save(path, np.random.default_rng(0).normal(size=(5, 40, 2)))
    >>> [len(part.file.profiles) for part in iterate_profiles(path, at_once=2)]
    [2, 2, 1]
    """
    settings, file = ReadSettings(**options), Path(path)
    at_once = PROFILES_PER_PART if at_once is None else at_once
    if at_once < 1:
        raise ValueError(f"expected at_once of at least 1, got {at_once}")
    file_format = _streamed_format(file, settings)
    if file_format is None:
        yield ProfilePart(0, inspect_profiles(file, **options))
        return
    read_parts = _parquet_parts if file_format == "parquet" else _npy_parts
    first, valid_points, marker_values = 0, 0, tuple[float, ...]()
    try:
        for raw, columns, point_columns in read_parts(file, settings, at_once):
            raw_part = replace(raw, lost=(*raw.lost, *marker_values))
            part = convert_to_section_frame(file, file_format, raw_part, settings)
            if first == 0 and len(part.profiles) < at_once:  # this part is the whole file
                require_points(part.profiles)
            valid_points += sum(map(len, part.profiles)) - part.lost
            yield ProfilePart(first, part, columns, point_columns)
            first += len(part.profiles)
            if settings.lost is None:  # markers of a pair of coordinates, "0, 0", are found again
                part_values = [
                    float(m.text) for m in part.markers if not (m.interrupts or "," in m.text)
                ]
                marker_values = tuple(dict.fromkeys((*marker_values, *part_values)))[:MAX_MARKERS]
        if valid_points == 0:
            raise UnreadableFile(f"all points of its {first} profiles are lost: check exposure")
    except UnreadableFile as error:
        location = f"from profile {first} on: " if first and valid_points else ""
        raise UnreadableFile(f"{file}: {location}{error}") from None


def _streamed_format(file: Path, settings: ReadSettings) -> str | None:
    """Return the format of a file whose parts can be read independently, else None."""
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


def _parquet_parts(
    file: Path, settings: ReadSettings, at_once: int
) -> "Iterator[tuple[RawProfiles, pa.Table | None, tuple[str, ...]]]":
    """Yield the profiles of each part of a table, and if a profile is one row, its other columns.

    The last value has the names of the columns with a value for each point, which the first part
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


def _npy_parts(
    file: Path, settings: ReadSettings, at_once: int
) -> Iterator[tuple[RawProfiles, None, tuple[str, ...]]]:
    """Yield the profiles of each part of an array; the array as one part if it is one profile."""
    array = open_npy(file)
    is_stack = array.ndim == 3 or (
        array.ndim == 2
        and settings.columns is None
        and settings.dx is not None  # without it, the first row may be x
        and array.shape[1] > 1  # one column is one profile
        and are_heights(array.shape[1], settings)
    )
    for start in range(0, len(array), at_once) if is_stack and len(array) else (0,):
        part = array[start : start + at_once] if is_stack else array
        yield profiles_from_array(np.array(part), settings), None, ()  # read from the file here
