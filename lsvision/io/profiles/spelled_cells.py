"""Columns of ids whose cells are more than their numbers: 007, 1e5, 0A1 among 7 and 8."""

import re
from collections.abc import Callable, Sequence

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.io.profiles.column_roles import find_role, identifies_profiles
from lsvision.io.profiles.number_table import NumberTable, is_missing

MAX_EXACT_NUMBER = 2.0**53
"""Number from which on whole numbers are rounded in double precision."""
_MEASURED_ROLES = frozenset(["x", "y", "height", "range", "angle"])
"""Roles of columns that are numbers, however they are written."""
# Leading zeros, and exponents as programs do not write them: 1e5 instead of 1e+05 or 1.0E5.
_NO_PLAIN_NUMBER = re.compile(r"[-+]?0[0-9]+(?:\.0*)?|[-+]?[0-9]+[eEdD][0-9]+")


def find_spellings(
    table: NumberTable, names: Sequence[str], read_column: Callable[[int], Sequence[str]]
) -> dict[int, Sequence[str]]:
    """Return the cells of the columns of numbers whose numbers do not tell how they are written.

    Parameters
    ----------
    table : NumberTable
        Numbers, and the cells that are none.
    names : sequence of str
        Lower-case names of its columns; a column without one is no id.
    read_column : callable
        Function that returns the cells of a column, one per row; it is called for few columns.
    """
    spellings = {}
    for column, name in enumerate(names):
        if not name or column in table.texts or find_role(name) in _MEASURED_ROLES:
            continue
        values = table.values[:, column]
        has_text = column in table.invalid_cells
        if has_text or identifies_profiles(name) or _may_be_id(values):
            cells = read_column(column)
            if has_text or _differ_from_numbers(cells, values):
                spellings[column] = cells
    return spellings


def _may_be_id(values: FloatArray) -> bool:
    """Return whether most numbers are repeated in the next row, and all are whole."""
    known = values[np.isfinite(values)]
    is_whole = bool(np.all(known == np.round(known)))
    return is_whole and bool(2 * np.count_nonzero(np.diff(known)) <= len(known))


def _differ_from_numbers(cells: Sequence[str], values: FloatArray) -> bool:
    """Return whether a cell is no plain number, or two cells differ and their numbers do not."""
    if np.any(np.abs(values) >= MAX_EXACT_NUMBER):
        return True
    known = {cell for cell in set(cells) if not is_missing(cell)}
    numbers = np.unique(values[np.isfinite(values)])
    return len(known) > len(numbers) or any(map(_NO_PLAIN_NUMBER.fullmatch, known))
