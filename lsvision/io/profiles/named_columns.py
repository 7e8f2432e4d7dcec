"""Profiles in columns that have names: one point a row, or one profile a row."""

from collections.abc import Mapping, Sequence

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.columns import column_role, profiles_from_table
from lsvision.io.profiles.matrix import column_positions
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.text_table import TextTable, split_unit

_Column = FloatArray | Sequence[FloatArray]


def profiles_from_named(columns: Mapping[str, _Column], settings: ReadSettings) -> RawProfiles:
    """Profiles of named columns.

    Parameters
    ----------
    columns : mapping
        One array each: (n,) with a point a row; or, with a profile a row, (k, m) arrays or k
        arrays of any length, where x may also be the (m,) that all rows share.
    settings : ReadSettings
        What the user says of it.

    Raises
    ------
    UnreadableFile
        If no column is a height or a range, or lengths do not agree.
    """
    odd = [label for label, column in columns.items() if not _is_column(column)]
    if odd:
        raise UnreadableFile(
            f"{', '.join(odd)}: neither one number a point nor one row a profile: want arrays of "
            "shape (n,) or (k, n)"
        )
    labels = {label: split_unit(label) for label in columns}
    by_role = {column_role(name): label for label, (name, _) in reversed(labels.items())}
    height = by_role.get("height", by_role.get("range", by_role.get("y")))
    if height is None:
        raise UnreadableFile(
            f"no column of heights among {', '.join(columns) or 'none'}: want x and z"
        )
    if np.ndim(columns[height][0] if len(columns[height]) else 0.0) == 0:
        return _from_points(columns, labels, settings)
    x = by_role.get("x")
    rows = [np.asarray(row) for row in columns[height]]
    xs = _x_of_rows(rows, None if x is None else columns[x], settings)
    if any(a.shape != b.shape for a, b in zip(xs, rows, strict=True)):
        raise UnreadableFile(f"{x} and {height} differ in length: want an x for each height")
    return RawProfiles(
        sections=[np.column_stack(pair) for pair in zip(xs, rows, strict=True)],
        units=("mm" if x is None else labels[x][1], labels[height][1]),
        away="height" not in by_role and "range" in by_role,
        x_in_mm=x is None,
    )


def _is_column(column: _Column) -> bool:
    """True for numbers, and for rows of numbers."""
    if isinstance(column, np.ndarray):
        return column.ndim in (1, 2)
    return all(np.ndim(row) == 1 for row in column)


def _from_points(
    columns: Mapping[str, _Column],
    labels: Mapping[str, tuple[str, str | None]],
    settings: ReadSettings,
) -> RawProfiles:
    flat = [label for label in columns if np.ndim(columns[label]) == 1]
    lengths = {len(columns[label]) for label in flat}
    if len(lengths) != 1 or not lengths.pop():
        raise UnreadableFile(f"columns {', '.join(flat)} differ in length: want one row a point")
    table = TextTable(
        values=np.column_stack([np.asarray(columns[label]) for label in flat]),
        names=tuple(labels[label][0] for label in flat),
        units=tuple(labels[label][1] for label in flat),
    )
    return profiles_from_table(table, settings)


def _x_of_rows(
    rows: Sequence[FloatArray], x: _Column | None, settings: ReadSettings
) -> list[FloatArray]:
    if x is None:
        return [column_positions(len(row), len(rows), settings)[0] for row in rows]
    if np.ndim(x[0] if len(x) else 0.0) == 0:
        return [np.asarray(x)] * len(rows)
    if len(x) != len(rows):
        raise UnreadableFile(f"{len(x)} rows of x and {len(rows)} of heights: want as many")
    return [np.asarray(row) for row in x]
