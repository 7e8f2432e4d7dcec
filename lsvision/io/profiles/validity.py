"""Columns that say of each point whether it is valid, and columns that may say so."""

import re
from collections.abc import Iterable, Sequence

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.io.profiles.column_roles import has_known_role
from lsvision.io.profiles.column_words import fold_accents
from lsvision.io.profiles.number_table import NumberTable

_VERDICT = "ok|good|bad|pass|passed"
_VALID = f"valid|validity|valido|gultig|gueltig|giltig|{_VERDICT.replace('bad|', '')}"
_LOST = "invalid|notvalid|lost|missing|dropout|nodata|outofrange|bad|ungultig|ungueltig"
_FLAG = (
    "quality|status|state|errors?|err|masked|mask|confidence|qualitat|qualitaet|calidad|zustand|etat"
    "|estado|stato|fehler|erreur|outliers?|saturated|saturation|used|flags?"
)
_BESIDE = "is|b|points?|pts?|pixel|px|data|sample|value|measurement|profile|code|flags?|x|y|z|bit"
_NAME = re.compile(
    rf"(?:{_BESIDE})*(?:(?P<valid>{_VALID})|(?P<lost>{_LOST})|(?P<flag>{_FLAG}))"
    rf"(?:{_BESIDE}|mask|(?P<list>ind(?:ex|ices|exes)|idx))*"
)
"""Name, without blanks and accents, of a column that is true where a point is valid, or where it is
lost, or that may mark lost points, in a code that differs between sensors."""
_TRUE = frozenset(["true", "t", "yes", "y", "ja", "j", "oui", "si", "wahr", "vrai", "1"])
_FALSE = frozenset(["false", "f", "no", "n", "nein", "non", "falsch", "faux", "0"])
"""Words of a flag that is true, and of one that is false."""
_REMEDY = "if it marks lost points, write a column valid of 1 and 0, or nan as their height"
"""What to do with a column of flags that is not used."""
_GOOD = frozenset(["ok", "okay", "valid", "good", "pass", "passed", "gut", "gultig", "io"])
_BAD = frozenset(
    "nok notok ng invalid bad fail failed error err lost missing dropout nodata schlecht "  # noqa: SIM905
    "ungultig nio".split()
)
"""Words that a point is valid, and that it is not, whatever the name of their column is."""


def lose_invalid_points(
    table: NumberTable, coordinates: Sequence[int], rows: Sequence[IntArray]
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the points, (n, k), NaN where a column of the table says that they are not valid.

    And notes: on that, or on a column of flags whose meaning is not known, so that it is not used.
    `coordinates` are the k columns of the points, `rows` those of each profile: a status with one
    value in each is no statement on points.
    """
    points, notes = table.values, list[str]()
    if tuple(coordinates) != tuple(range(points.shape[1])):  # a copy takes time for 10^6 points
        points = points[:, coordinates]
    for column, name in enumerate(table.names):
        if column in coordinates:
            continue
        kind, may_be_verdict = _classify_name(name)
        if not kind and not has_known_role(name) and _has_two_values(table, column):
            kind, may_be_verdict = "flag", True
        if not kind or (may_be_verdict and not _varies(table, column, rows)):
            continue
        valid = _find_validity(table, column, kind)
        if valid is None:
            if kind == "flag" or _may_be_code(table, column):
                notes.append(f"{name} varies and is not used: {_REMEDY}")
        elif not valid.all():
            points = np.where(valid[:, np.newaxis], points, np.nan)
            shown = _describe_cells(table, column, ~valid)
            count = np.count_nonzero(~valid)
            notes.append(f"{name} is {shown} in {count} points: read as lost points")
    return points, tuple(notes)


def _classify_name(name: str) -> tuple[str, bool]:
    """Return what a column of this name says, and whether it may say it of a part.

    It is ``"valid"``, ``"lost"``, ``"flag"``, or empty for other columns.

    Examples
    --------
    >>> names = "Is_Valid", "point status", "ok", "date of validation"
    >>> tuple(map(_classify_name, names))
    (('valid', False), ('flag', True), ('valid', True), ('', False))
    """
    match = _NAME.fullmatch(re.sub(r"[\W\d_]+", "", fold_accents(name.lower())))
    if match is None:
        return "", False
    kind = "valid" if match["valid"] else "lost" if match["lost"] else "flag"
    may_be_verdict = kind == "flag" or re.fullmatch(_VERDICT, match[kind]) is not None
    return kind, may_be_verdict


def note_unused_flags(labels: Iterable[str]) -> tuple[str, ...]:
    """Return notes on entries beside the points whose names say that they mark lost ones.

    Examples
    --------
    >>> [note[:38] for note in note_unused_flags(["valid_indices", "roi"])]
    ['valid_indices is not used: if it marks']
    """
    return tuple(f"{label} is not used: {_REMEDY}" for label in labels if _classify_name(label)[0])


def _find_validity(table: NumberTable, column: int, kind: str) -> BoolArray | None:
    """Return whether each point is valid; None if the cells do not say so.

    Words such as ok and nok do in any column; true and false, and 0 and one other number, where the
    name of the column says what is true.
    """
    cells: Sequence[str] | None = table.texts.get(column)
    if cells is None:
        values = table.values[:, column]
        others = set(np.unique(values[values != 0]).tolist())
        is_flag = kind != "flag" and len(others) <= 1 and all(value > 0 for value in others)
        return np.equal(values != 0, kind != "lost") if is_flag else None
    words = [re.sub(r"[\W_]+", "", fold_accents(cell.lower())) for cell in cells]
    if set(words) <= _GOOD | _BAD:
        return np.array([word in _GOOD for word in words])
    if kind != "flag" and set(words) <= _TRUE | _FALSE:
        return np.array([(word in _TRUE) != (kind == "lost") for word in words])
    return None


def _describe_cells(table: NumberTable, column: int, rows: BoolArray) -> str:
    """Return the texts, or the number, of the cells of some rows."""
    if column in table.texts:
        return " or ".join(dict.fromkeys(np.array(table.texts[column])[rows].tolist()))
    return f"{table.values[rows, column][0]:g}"


def _has_two_values(table: NumberTable, column: int) -> bool:
    """Return whether a column of any name holds 0 and one other number, or yes and no, alone."""
    texts = table.texts.get(column)
    if texts is not None:
        return len(set(texts)) == 2 and {text.lower() for text in texts} <= _TRUE | _FALSE
    values = np.unique(table.values[:, column])
    return len(values) == 2 and 0.0 in values


def _may_be_code(table: NumberTable, column: int) -> bool:
    """Return whether the cells of a column differ, and are not as many numbers as points."""
    if column in table.texts:
        return len(set(table.texts[column])) > 1
    return 1 < np.unique(table.values[:, column]).size <= max(2, len(table.values) // 2)


def _varies(table: NumberTable, column: int, rows: Sequence[IntArray]) -> bool:
    """Return whether the cells, or numbers, of a column differ within a profile, of these rows."""
    texts = table.texts.get(column)
    if texts is not None:
        return any(len({texts[row] for row in profile.tolist()}) > 1 for profile in rows)
    values = table.values[:, column]
    return any(np.unique(values[profile]).size > 1 for profile in rows)
