"""Columns of a table that hold one value per profile: the attributes of the profiles."""

from collections.abc import Mapping, Sequence

import numpy as np

from lsvision.geometry import IntArray
from lsvision.io.profiles.number_table import NumberTable


def find_profile_attributes(
    table: NumberTable,
    rows: Sequence[IntArray],
    *,
    points: Sequence[int],
    key: int | None,
    excluded: Sequence[int],
) -> tuple[tuple[Mapping[str, float | str], ...], tuple[str, ...]]:
    """Return the attributes of each profile, and the labels of the columns that are not used.

    An attribute is a column, also the key, that has one value in each profile.

    Parameters
    ----------
    table : NumberTable
        One point per row; without names it gives no attributes.
    rows : sequence of ndarray
        Rows of each profile.
    points : sequence of int
        Columns of the coordinates.
    key : int or None
        Column that identifies profiles.
    excluded : sequence of int
        Columns that are never attributes.
    """
    other_columns = [c for c in range(table.values.shape[1]) if c not in points]
    by_profile: list[dict[str, float | str]] = [{} for _ in rows]
    ignored = []
    for column in other_columns:
        values = [_common_value(table, column, r) for r in rows] if table.names else [None]
        if all(value is not None for value in values) and column not in excluded:
            for attributes, value in zip(by_profile, values, strict=True):
                if value is not None:
                    attributes[table.label(column)] = value
        elif column != key:
            ignored.append(table.label(column))
    has_attributes = any(by_profile)
    return tuple(by_profile) if has_attributes else (), tuple(ignored)


def _common_value(table: NumberTable, column: int, rows: IntArray) -> float | str | None:
    """Return the common value of all points of a profile; None if they differ or are all NaN."""
    if column in table.texts:
        texts = {table.texts[column][r] for r in rows.tolist()}
        return texts.pop() if len(texts) == 1 else None
    values = table.values[rows, column]
    values = values[np.isfinite(values)]
    return float(values[0]) if len(values) and bool(np.all(values == values[0])) else None
