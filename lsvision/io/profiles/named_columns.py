"""Profiles in columns that have names: one point per row, or one profile per row."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.column_roles import find_role
from lsvision.io.profiles.columns import profiles_from_table
from lsvision.io.profiles.matrix import (
    compute_column_positions,
    profiles_from_matrix,
    select_only_height,
)
from lsvision.io.profiles.number_table import NumberTable
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.stated_units import find_common_unit, select_for_axis
from lsvision.io.profiles.unit_statements import UnitStatement
from lsvision.io.profiles.units import split_label

_Column = FloatArray | Sequence[FloatArray]


def profiles_from_named(
    columns: Mapping[str, _Column],
    settings: ReadSettings,
    statements: tuple[UnitStatement, ...] = (),
    texts: Mapping[str, Sequence[str]] | None = None,
) -> RawProfiles:
    """Return the profiles of named columns.

    Parameters
    ----------
    columns : mapping
        Arrays by name: (n,) with one point per row; or, with one profile per row, (k, m) or k
        arrays of any length, where x may also be one (m,) array for all rows.
    settings, statements
        Reading options, and units that the file states beside the columns.
    texts : mapping, optional
        Columns of text, with one cell per row.

    Raises
    ------
    UnreadableFile
        If no column is a height or a range, or lengths do not agree.
    """
    unusable = [label for label, column in columns.items() if not _is_column(column)]
    if unusable:
        raise UnreadableFile(
            f"expected arrays of shape (n,), one number per point, or (k, n), one row per profile: "
            f"{', '.join(unusable)} is neither"
        )
    labels = {label: split_label(label) for label in columns}
    # Reversed, so that the first column in a role is kept.
    by_role = {find_role(name): label for label, (name, _) in reversed(labels.items())}
    height = by_role.get("height", by_role.get("range", by_role.get("y")))
    if height is None:
        raise UnreadableFile(
            f"no column of heights among {', '.join(columns) or 'none'}: expected x and z"
        )
    if _is_1d(columns[height]):
        return _from_points(columns, texts or {}, settings, statements)
    return _from_rows(columns, texts or {}, by_role.get("x"), height, settings, statements)


def _collect_row_attributes(
    columns: Mapping[str, _Column],
    texts: Mapping[str, Sequence[str]],
    coordinates: set[str | None],
    count: int,
) -> tuple[dict[str, float | str], ...]:
    """Return the columns with one value for each of `count` profiles as their attributes."""
    values_by_label: dict[str, Sequence[float | str]] = {
        label: np.asarray(values).tolist()
        for label, values in columns.items()
        if label not in coordinates and _is_1d(values) and len(values) == count
    }
    values_by_label |= {label: cells for label, cells in texts.items() if len(cells) == count}
    if not values_by_label:
        return ()
    return tuple(
        {label: cells[row] for label, cells in values_by_label.items()} for row in range(count)
    )


def _is_1d(values: _Column) -> bool:
    """Return whether a column has one number per row, and not a profile; True if it is empty."""
    return len(values) == 0 or np.ndim(values[0]) == 0


def _is_column(column: _Column) -> bool:
    """Return whether a column is a 1D or 2D array, or a sequence of 1D arrays."""
    if isinstance(column, np.ndarray):
        return column.ndim in (1, 2)
    return all(np.ndim(row) == 1 for row in column)


def _from_points(
    columns: Mapping[str, _Column],
    texts: Mapping[str, Sequence[str]],
    settings: ReadSettings,
    statements: tuple[UnitStatement, ...],
) -> RawProfiles:
    """Return the profiles of columns with one point per row, x of which `dx` may state."""
    number_labels = [label for label, column in columns.items() if _is_1d(column)]
    lengths = {label: len(columns[label]) for label in number_labels}
    count = max(lengths.values(), default=0)
    if not count or set(lengths.values()) != {count}:
        listed = ", ".join(f"{label} ({length})" for label, length in lengths.items())
        raise UnreadableFile(
            f"expected columns of equal length, not empty, got {listed}: write NaN for lost points"
        )
    text_labels = [label for label in texts if len(texts[label]) == count]
    labels = [split_label(label) for label in (*number_labels, *text_labels)]
    arrays = [np.asarray(columns[label]) for label in number_labels] + [
        np.full(count, np.nan)
    ] * len(text_labels)
    table = NumberTable(
        values=np.column_stack(arrays),
        names=tuple(name for name, _ in labels),
        units=tuple(unit for _, unit in labels),
        statements=statements,
        texts={len(number_labels) + k: texts[label] for k, label in enumerate(text_labels)},
    )
    heights = (
        select_only_height(table) if settings.dx is not None and settings.columns is None else None
    )
    if heights is not None:
        return profiles_from_matrix(heights, settings)
    raw = profiles_from_table(table, settings)
    used = {*number_labels, *text_labels}
    unused = tuple(label for label in (*columns, *texts) if label not in used)
    return replace(raw, ignored=raw.ignored + unused)


def _from_rows(
    columns: Mapping[str, _Column],
    texts: Mapping[str, Sequence[str]],
    x: str | None,
    height: str,
    settings: ReadSettings,
    statements: tuple[UnitStatement, ...],
) -> RawProfiles:
    """Return the profiles of columns with one profile per row, and x, if any, and height in two."""
    if settings.columns is not None:
        raise UnreadableFile("--columns is for files with one point per row: leave it out")
    rows = [np.asarray(row) for row in columns[height]]
    row_positions = _resolve_row_positions(rows, None if x is None else columns[x], settings)
    # A profile without heights, such as null in Parquet, has lost all points.
    rows = [
        row if len(row) else np.full(len(x_row), np.nan)
        for row, x_row in zip(rows, row_positions, strict=True)
    ]
    if any(a.shape != b.shape for a, b in zip(row_positions, rows, strict=True)):
        raise UnreadableFile(f"{x} and {height} differ in length: expected an x for each height")
    units: tuple[str | None, str | None] = (None, None)
    if settings.units is None:
        about_x, about_height = (select_for_axis(statements, a) for a in ("x", "height"))
        x_unit = "mm" if x is None else find_common_unit(split_label(x)[1], about_x)
        units = (
            x_unit,
            settings.count_unit or find_common_unit(split_label(height)[1], about_height),
        )
    if settings.count_unit is not None:
        units = settings.units or units[0] or "mm", settings.count_unit
    attributes = _collect_row_attributes(columns, texts, {x, height}, len(rows))
    used = {x, height, *(attributes[0] if attributes else ())}
    return RawProfiles(
        sections=[np.column_stack(pair) for pair in zip(row_positions, rows, strict=True)],
        units=units,
        away=find_role(split_label(height)[0]) == "range",
        x_in_mm=x is None,
        attributes=attributes,
        ignored=tuple(label for label in (*columns, *texts) if label not in used),
        row_coordinates=(height,) if x is None else (x, height),
    )


def _resolve_row_positions(
    rows: Sequence[FloatArray], x: _Column | None, settings: ReadSettings
) -> list[FloatArray]:
    """Return the x of each profile: its own, the x of all, or the positions of the columns."""
    if x is None:
        return [compute_column_positions(len(row), len(rows), settings)[0] for row in rows]
    if _is_1d(x):
        return [np.asarray(x)] * len(rows)
    if len(x) != len(rows):
        raise UnreadableFile(
            f"{len(x)} rows of x and {len(rows)} of heights: expected equal numbers"
        )
    return [np.asarray(row) for row in x]
