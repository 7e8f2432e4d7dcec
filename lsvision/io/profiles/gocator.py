"""CSV of LMI Gocator sensors: recordings with titled blocks, and lists of points.

Layout: Gocator Line Profile Sensors, User Manual, "CSV Format" (sections Info to Surface Section).
The manual calls the blocks sections. Z increases towards the sensor; an empty cell is a lost point;
all lengths are in mm.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.number_table import numbers_from_cells
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.text_encoding import decode_text

_UNITS = ("mm", "mm")
"""Units of x and height."""


def read_gocator(content: bytes, _: ReadSettings) -> RawProfiles:
    """Return the profiles of the blocks Part, Surface, Profile and RawProfile.

    Part and Surface hold one profile per row.

    Raises
    ------
    UnreadableFile
        If no such block holds a profile, or a cell of a profile holds text.
    """
    profiles: list[FloatArray] = []
    positions: list[float] = []
    titles = []
    for title, lines in _iterate_blocks(decode_text(content).splitlines()):
        titles.append(title)
        if title in _BLOCK_READERS:
            for y, points in _BLOCK_READERS[title](lines):
                profiles.append(points)
                positions.append(y)
    if not profiles:
        raise UnreadableFile(
            f"a Gocator recording without profiles (it has {', '.join(titles) or 'no sections'}): "
            "export it in profile mode or as a uniform surface"
        )
    return RawProfiles(sections=profiles, units=_UNITS, positions=tuple(positions))


def read_gocator_points(content: bytes, _: ReadSettings) -> RawProfiles:
    """Return the profiles of a list with columns x0, z0, x1, z1, ..., one profile per row.

    Columns before x0, such as the index of the frame, are left out.

    Raises
    ------
    UnreadableFile
        If the first line does not name x0, or other columns behind it; if no row follows it, or a
        cell holds text.
    """
    lines = [line for line in decode_text(content).splitlines() if line.strip()]
    names = [name.strip().lower() for name in lines[0].split(",")] if lines else []
    if "x0" not in names:
        raise UnreadableFile("no column x0 in its first line: name another --format")
    first_column = names.index("x0")
    for number, name in enumerate(names[first_column:]):
        if name and name != (expected := f"{'xz'[number % 2]}{number // 2}"):
            raise UnreadableFile(f"expected column {expected}, got {name}: export x and z alone")
    rows = [numbers_from_cells(line.split(",")[first_column:]) for line in lines[1:]]
    if not rows:
        raise UnreadableFile("a header without a profile: export the recording again")
    pairs = [row[: len(row) // 2 * 2].reshape(-1, 2) for row in rows]  # without a last, odd cell
    return RawProfiles(sections=pairs, units=_UNITS)


def _iterate_blocks(lines: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield the title (its first line) and the other non-empty lines of each block.

    A line ``End`` ends a block.
    """
    block: list[str] = []
    for line in lines:
        text = line.strip()
        if text == "End":
            if block:
                yield block[0], block[1:]
            block = []
        elif text:
            block.append(text)
    if block:  # the file is truncated: use the lines of its last block
        yield block[0], block[1:]


def _read_surface_block(lines: Sequence[str]) -> Iterator[tuple[float, FloatArray]]:
    r"""Yield y and points (x, z) of each row of a height map.

    The row that begins with ``Y\X`` holds the x; those above it are settings. A row of another
    length than x, such as the last of a truncated file, is left out.
    """
    x = np.empty(0)
    for line in lines:
        head, *cells = line.split(",")
        if "\\" in head:
            x = numbers_from_cells(cells)
        elif len(x) and len(cells) == len(x):
            yield (
                float(numbers_from_cells([head])[0]),
                np.column_stack([x, numbers_from_cells(cells)]),
            )


def _read_profile_block(lines: Sequence[str]) -> Iterator[tuple[float, FloatArray]]:
    """Yield y and points (x, z) of each row with Z in the column Axis.

    Their x are those of the last row with X in it (raw profiles), else the names of the columns
    behind Axis. Without a column Y, y is 0. A row of another length than x, such as the last of a
    truncated file, is left out.
    """
    axis, y_column = -1, -1
    x = np.empty(0)
    for line in lines:
        cells = line.split(",")
        if "Axis" in cells:
            axis = cells.index("Axis")
            y_column = cells.index("Y") if "Y" in cells[:axis] else -1
            x = numbers_from_cells(cells[axis + 1 :])
        elif 0 <= axis < len(cells) and cells[axis] in ("X", "Z"):
            row = numbers_from_cells(cells[axis + 1 :])
            if cells[axis] == "X":
                x = row
            elif len(row) == len(x):
                y = float(numbers_from_cells([cells[y_column]])[0]) if y_column >= 0 else 0.0
                yield y, np.column_stack([x, row])


_BLOCK_READERS = {
    "Part": _read_surface_block,
    "Surface": _read_surface_block,
    "Profile": _read_profile_block,
    "RawProfile": _read_profile_block,
}
"""Function that reads a block, by the title of the block."""
