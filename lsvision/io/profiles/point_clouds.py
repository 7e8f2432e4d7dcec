"""Point clouds in PLY and PCD, ascii and binary; points of one y, or of one row, are a profile."""

import re
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.columns import profiles_from_rows_of_points, profiles_from_table
from lsvision.io.profiles.number_table import NumberTable, floats_from, numbers_from_cells
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.unit_statements import find_lost_values, find_unit_statements

_PLY_TYPES = {
    **dict.fromkeys(["char", "int8"], "i1"),
    **dict.fromkeys(["uchar", "uint8"], "u1"),
    **dict.fromkeys(["short", "int16"], "i2"),
    **dict.fromkeys(["ushort", "uint16"], "u2"),
    **dict.fromkeys(["int", "int32"], "i4"),
    **dict.fromkeys(["uint", "uint32"], "u4"),
    **dict.fromkeys(["float", "float32"], "f4"),
    **dict.fromkeys(["double", "float64"], "f8"),
}
"""NumPy's name of each data type of PLY."""
_PLY_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
"""Byte order of each format of PLY."""
_MAX_COUNT = 4096  # numbers in one field of a point, such as a histogram
_PCD_TYPES = {"I": "i", "U": "u", "F": "f"}
"""NumPy's letter of each kind of number of PCD."""


def read_ply(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of the vertices of a PLY file.

    Raises
    ------
    UnreadableFile
        If its header is broken, or its vertices are missing, not first, or truncated.
    """
    head, end, body = content.partition(b"end_header")
    lines = [line.split() for line in head.decode("latin-1").splitlines()]
    order = next((line[1] for line in lines if line[:1] == ["format"] and len(line) > 1), "")
    if not end or order not in _PLY_ORDERS:
        raise UnreadableFile("a PLY file with a broken header: export it again")
    body = body.partition(b"\n")[2]
    layout = _parse_ply_layout(lines, _PLY_ORDERS[order])
    table = _parse_points(body, layout, ascii_=order == "ascii")
    return profiles_from_table(_with_comments(table, head, "comment"), settings)


def read_pcd(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of a PCD file; an organised cloud (HEIGHT above 1) holds one in each row.

    Raises
    ------
    UnreadableFile
        If its header is broken, its data are compressed, or they are truncated.
    """
    match = re.search(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", content, re.MULTILINE)
    if match is None or match[1] not in (b"ascii", b"binary"):
        raise UnreadableFile(
            "expected PCD with DATA ascii or binary: convert it with pcl_convert_pcd_ascii_binary"
        )
    lines = content[: match.start()].decode("latin-1").splitlines()
    header = {words[0]: words[1:] for words in map(str.split, lines) if words}
    layout, rows = _parse_pcd_layout(header)
    table = _parse_points(content[match.end() :], layout, ascii_=match[1] == b"ascii")
    table = _with_comments(table, content[: match.start()], "#")
    if rows > 1:
        return profiles_from_rows_of_points(table, rows, settings)
    return profiles_from_table(table, settings)


def _with_comments(table: NumberTable, head: bytes, mark: str) -> NumberTable:
    """Return the table with the units and lost markers that the comments of a header state."""
    lines = [line.strip() for line in head.decode("latin-1").splitlines()]
    texts = [line.removeprefix(mark).strip() for line in lines if line.startswith(mark)]
    comments = tuple(f"# {line}" for line in texts)
    return replace(
        table,
        statements=find_unit_statements(comments),
        lost=find_lost_values(comments),
        mentions=comments,
    )


@dataclass(frozen=True)
class _Layout:
    """Layout of the points in the body of a cloud."""

    dtype: npt.DTypeLike  # of a point
    count: int  # number of points


def _parse_ply_layout(lines: list[list[str]], order: str) -> _Layout:
    """Return the types of a vertex's numbers, from a PLY header whose vertices come first."""
    elements = [k for k, line in enumerate(lines) if line[:1] == ["element"]]
    try:
        _, name, count = lines[elements[0]]
        stop = elements[1] if len(elements) > 1 else len(lines)
        properties = [line for line in lines[elements[0] + 1 : stop] if line[:1] == ["property"]]
        fields = [(label, order + _PLY_TYPES[kind]) for _, kind, label in properties]
        layout = _Layout(np.dtype(fields), int(count))
    except (IndexError, ValueError, KeyError):
        raise UnreadableFile(
            "a PLY header whose vertices are not plain numbers: export x, y, z only"
        ) from None
    if name != "vertex" or layout.count < 1:
        raise UnreadableFile(f"a PLY file that begins with {count} {name}: expected vertices first")
    return layout


def _parse_pcd_layout(header: dict[str, list[str]]) -> tuple[_Layout, int]:
    """Return the types of a point's numbers with the number of points, and the number of rows."""
    try:
        counts = [int(count) for count in header.get("COUNT", ["1"] * len(header["FIELDS"]))]
        if not all(1 <= count <= _MAX_COUNT for count in counts):
            raise ValueError(f"COUNT {counts}")
        columns = zip(header["FIELDS"], header["TYPE"], header["SIZE"], counts, strict=True)
        fields = [
            (name if name != "_" else f"_{k}", f"<{_PCD_TYPES[kind]}{size}", (count,))
            for k, (name, kind, size, count) in enumerate(columns)
        ]
        rows, width = int(header.get("HEIGHT", ["1"])[0]), int(header["WIDTH"][0])
        layout = _Layout(np.dtype(fields), rows * width)
    except (KeyError, IndexError, ValueError, TypeError, OverflowError):
        raise UnreadableFile("a PCD file with a broken header: export it again") from None
    if rows < 1 or width < 1:
        raise UnreadableFile("a PCD file without points: check its export")
    return layout, rows


def _parse_points(body: bytes, layout: _Layout, *, ascii_: bool) -> NumberTable:
    """Return x, y and z of the points as a table; of a field with several numbers, the first."""
    dtype = np.dtype(layout.dtype)
    names = dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise UnreadableFile(
            f"expected points with x, y and z, got {', '.join(names) or 'nothing'}: "
            "export the cloud with its coordinates"
        )
    if ascii_:
        columns = _parse_ascii_columns(body, dtype, layout.count)
    elif len(body) < layout.count * dtype.itemsize:
        raise UnreadableFile(
            f"truncated: its header announces {layout.count} points: export it again"
        )
    else:
        records = np.frombuffer(body, dtype, layout.count)
        columns = [floats_from(records[axis]).reshape(layout.count, -1)[:, 0] for axis in "xyz"]
    return NumberTable.of_points(np.column_stack(columns))


def _parse_ascii_columns(body: bytes, dtype: np.dtype[np.void], count: int) -> list[FloatArray]:
    """Return the columns x, y and z of points that are written as text."""
    widths = [int(np.prod(dtype[name].shape, dtype=int)) for name in dtype.names or ()]
    starts = dict(zip(dtype.names or (), np.cumsum([0, *widths]), strict=False))
    cells = body.decode("latin-1").split()
    total = sum(widths)
    if len(cells) < count * total:
        raise UnreadableFile(f"truncated: its header announces {count} points: export it again")
    rows = numbers_from_cells(cells[: count * total]).reshape(count, total)
    return [rows[:, starts[axis]] for axis in "xyz"]
