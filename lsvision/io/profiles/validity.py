"""Columns that say of each point whether it is valid, and columns that may say so."""

from collections.abc import Sequence

import numpy as np

from lsvision.geometry import BoolArray, FloatArray
from lsvision.io.profiles.column_words import fold_accents
from lsvision.io.profiles.number_table import NumberTable

_VALID_NAMES = frozenset(
    "valid validity isvalid validflag pointvalid valido gultig gueltig giltig".split()  # noqa: SIM905
)
"""Names, without blanks and accents, of columns of 1 (valid) and 0."""
_FLAG_NAMES = frozenset(
    "quality status state error flag flags mask invalid confidence qualitat qualitaet "  # noqa: SIM905
    "zustand fehler".split()
)
"""Names of columns that may mark lost points, in a code that differs between sensors."""
_TRUE, _FALSE = frozenset(["true", "yes", "1", "ok"]), frozenset(["false", "no", "0"])
"""Words and digits of a flag that is true, and of one that is false."""


def lose_invalid_points(
    table: NumberTable, points: FloatArray
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the points, (n, k), NaN where a column of the table says that they are not valid.

    And notes: on that, or on a column of flags whose meaning is not known, so that it is not used.
    """
    notes: list[str] = []
    for column, name in enumerate(table.names):
        word = fold_accents(name).translate(str.maketrans("", "", " _-."))
        if word in _VALID_NAMES:
            valid = _validity(table, column)
            if valid is not None and not valid.all():
                points = np.where(valid[:, np.newaxis], points, np.nan)
                count = np.count_nonzero(~valid)
                notes.append(f"{name} is 0 in {count} points: read as lost points")
        elif word in _FLAG_NAMES and _varies(table, column):
            notes.append(
                f"{name} varies and is not used: if it marks lost points, write nan as their height"
            )
    return points, tuple(notes)


def _validity(table: NumberTable, column: int) -> BoolArray | None:
    """Return whether each point is valid; None if the cells are not those of such a column."""
    cells: Sequence[str] | None = table.texts.get(column)
    if cells is not None:
        words = [cell.lower() for cell in cells]
        return np.isin(words, list(_TRUE)) if set(words) <= _TRUE | _FALSE else None
    values = table.values[:, column]
    return values == 1 if np.isin(values, (0, 1)).all() else None


def _varies(table: NumberTable, column: int) -> bool:
    if column in table.texts:
        return len(set(table.texts[column])) > 1
    values = table.values[:, column]
    return bool(np.unique(values[np.isfinite(values)]).size > 1)
