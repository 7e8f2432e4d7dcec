"""CSV of LMI Gocator sensors: the sections of a recording, and lists of points.

Layout: Gocator Line Profile Sensors, User Manual, "CSV Format" (sections Info to Surface Section).
Z grows towards the sensor; an empty cell is a lost point; all lengths are in mm.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.number_rows import numbers_from_cells
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.text_table import decode_text

_UNITS = ("mm", "mm")


def read_gocator(content: bytes, _: ReadSettings) -> RawProfiles:
    """Return the profiles of the sections Part (one profile per row), Profile and RawProfile.

    Raises
    ------
    UnreadableFile
        If the recording holds none of these sections.
    """
    sections: list[FloatArray] = []
    positions: list[float] = []
    titles = []
    for title, lines in _blocks(decode_text(content).splitlines()):
        titles.append(title)
        if title in _SECTIONS:
            for y, points in _SECTIONS[title](lines):
                sections.append(points)
                positions.append(y)
    if not sections:
        raise UnreadableFile(
            f"a Gocator recording without profiles (it has {', '.join(titles) or 'no sections'}): "
            "export it in profile mode or as a uniform surface"
        )
    return RawProfiles(sections=sections, units=_UNITS, positions=tuple(positions))


def read_gocator_points(content: bytes, _: ReadSettings) -> RawProfiles:
    """Return the profiles of a list with columns x0, z0, x1, z1, ..., one profile per row."""
    lines = [line for line in decode_text(content).splitlines() if line.strip()]
    names = [name.strip().lower() for name in lines[0].split(",")] if lines else []
    if "x0" not in names:
        raise UnreadableFile("no column x0 in its first line: name another --format")
    first = names.index("x0")
    pairs = [numbers_from_cells(line.split(",")[first:]) for line in lines[1:]]
    if not pairs:
        raise UnreadableFile("a header without a profile: export the recording again")
    return RawProfiles(
        sections=[row[: len(row) // 2 * 2].reshape(-1, 2) for row in pairs], units=_UNITS
    )


def _blocks(lines: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    block: list[str] = []
    for line in lines:
        text = line.strip()
        if text == "End" and block:
            yield block[0], block[1:]
            block = []
        elif text:
            block.append(text)
    if block:  # truncated while it was written: the complete part is used
        yield block[0], block[1:]


def _surface(lines: Sequence[str]) -> Iterator[tuple[float, FloatArray]]:
    x = np.empty(0)
    for line in lines:
        head, *cells = line.split(",")
        if "\\" in head:  # Y\X: the row of x
            x = numbers_from_cells(cells)
        elif len(x) and len(cells) == len(x):
            yield (
                float(numbers_from_cells([head])[0]),
                np.column_stack([x, numbers_from_cells(cells)]),
            )


def _profiles(lines: Sequence[str]) -> Iterator[tuple[float, FloatArray]]:
    """Return rows marked X, Z or I in the column Axis; without a row X the header states x."""
    axis = -1
    x = np.empty(0)
    for line in lines:
        cells = line.split(",")
        if "Axis" in cells:
            axis = cells.index("Axis")
            x = numbers_from_cells(cells[axis + 1 :])
        elif 0 <= axis < len(cells) and cells[axis] in ("X", "Z"):
            row = numbers_from_cells(cells[axis + 1 :])
            if cells[axis] == "X":
                x = row
            elif len(row) == len(x):
                y = numbers_from_cells(cells[axis - 1 : axis])
                yield (float(y[0]) if len(y) else 0.0), np.column_stack([x, row])


_SECTIONS = {"Part": _surface, "Surface": _surface, "Profile": _profiles, "RawProfile": _profiles}
