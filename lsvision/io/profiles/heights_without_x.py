"""Tables of heights without x: columns that only number the points, and their heights."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.column_roles import column_role, has_known_role
from lsvision.io.profiles.number_table import NumberTable
from lsvision.io.profiles.profile_keys import MIN_POINTS_PER_PROFILE

_HEIGHTS = ("height", "range", "y")
"""Roles of a height; y is one if there is no other."""


def only_height(table: NumberTable) -> NumberTable | None:
    """Return the column of a table that is named as heights, ranges or y, if none is named x.

    None for another table, and if several columns are named as heights.
    """
    roles = list(map(column_role, table.names))
    named = [c for c, role in enumerate(roles) if role in _HEIGHTS]
    if len(named) != 1 or "x" in roles or named[0] in table.texts:
        return None
    (column,) = named
    return replace(
        table,
        values=table.values[:, [column]],
        names=(table.names[column],),
        units=(table.units[column],),
        texts={},
        invalid_cells={},
    )


def numbers_points(table: NumberTable, column: int) -> bool:
    """Return whether a named column is no coordinate, but 0, 1, 2, ... or 1, 2, 3, ...."""
    unit = table.units[column]
    is_length = unit is not None and unit.unit is not None
    values = table.values[:, column]
    return (
        (column_role(table.names[column]) == "scan" or not has_known_role(table.names[column]))
        and not is_length
        and len(values) >= MIN_POINTS_PER_PROFILE
        and values[0] in (0, 1)
        and np.array_equal(values, values[0] + np.arange(len(values)))
    )


def require_x(table: NumberTable, columns: Sequence[int], numbering: Sequence[int]) -> None:
    """Raise an error if heights, or numbers of the points beside them, would be read as x.

    Parameters
    ----------
    table : NumberTable
        Table with names, of which none or one is that of a coordinate.
    columns, numbering : sequence of int
        Columns that may be coordinates, and those that number the points.
    """
    roles = [column_role(table.names[c]) for c in columns]
    if len(columns) == 1 and any(not table.names[c] or roles[0] in _HEIGHTS for c in numbering):
        label = table.names[numbering[0]] or "without a name"
        problem = f"column {label} numbers the points"
    elif len(columns) == 2 and roles[0] == "height" and not has_known_role(roles[1]):
        problem = f"columns {' and '.join(table.names[c] for c in columns)}, and no x"
    else:
        return
    raise UnreadableFile(
        f"{problem}: name the columns of x and height with --columns, or state x of the heights "
        "with --x0 and --dx"
    )
