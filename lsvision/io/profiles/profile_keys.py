"""Keys of profiles: columns of a table of points whose values separate the profiles."""

from collections.abc import Sequence

import numpy as np

from lsvision.geometry import FloatArray, IntArray
from lsvision.io.profiles.column_roles import column_role, columns_by_role, is_part_name
from lsvision.io.profiles.number_table import NumberTable

MIN_POINTS_PER_PROFILE = 5
"""Smallest mean number of points of the profiles of a key: fewer do not determine an ellipse."""


def separate_profiles(
    table: NumberTable, key: int, coordinates: Sequence[int], *, is_travel: bool
) -> tuple[list[IntArray], tuple[float, ...] | None]:
    """Return the rows of each profile, and the positions of the profiles.

    Parameters
    ----------
    table : NumberTable
        One point per row.
    key : int
        Column that separates the profiles; combined with other columns of profiles and parts,
        because its numbers may start again for each part.
    coordinates : sequence of int
        Columns of the points.
    is_travel : bool
        Whether the key is a position along the travel, which is never combined.

    Returns
    -------
    rows : list of (n,) ndarray
        In the order in which the profiles begin.
    positions : tuple of float, optional
        Value of the key of each profile if it is a position.
    """
    codes = _without_gaps(_codes(table, key))
    if not is_travel:
        return _split_by(_composite_key(table, key, coordinates, codes)), None
    rows = _split_by(codes)
    if key in table.texts:
        return rows, None
    return rows, tuple(float(codes[r[0]]) for r in rows)


def find_scan_key(table: NumberTable, coordinates: Sequence[int]) -> int | None:
    """Return the column of the profile's number if it separates profiles; else None."""
    scan = columns_by_role(table.names, table.texts).get("scan")
    if scan is None or scan in coordinates or not _separates_profiles(table, scan):
        return None
    return scan


def find_key(table: NumberTable, coordinates: Sequence[int]) -> int | None:
    """Return the column of the profile's number, or else that of parts, sensors or runs.

    The latter must have one run of points for each value.
    """
    scan = find_scan_key(table, coordinates)
    if scan is not None:
        return scan
    for column, name in enumerate(table.names):
        if is_part_name(name):
            codes = _codes(table, column)
            if len(np.unique(codes[np.isfinite(codes)])) > 1 and is_profile_key(codes):
                return column
    return None


def is_profile_key(column: FloatArray) -> bool:
    """Return whether each value occupies one run of points, on average enough for a profile."""
    key = _without_gaps(column)
    runs = 1 + np.count_nonzero(np.diff(key))
    return bool(runs == len(np.unique(key)) and runs * MIN_POINTS_PER_PROFILE <= len(key))


def _separates_profiles(table: NumberTable, column: int) -> bool:
    """Return whether a column may separate profiles: not if two or more numbers all differ."""
    codes = _codes(table, column)
    finite = codes[np.isfinite(codes)]
    return len(finite) < 2 or len(np.unique(finite)) < len(finite)


def _codes(table: NumberTable, column: int) -> FloatArray:
    """Return the numbers of a column, or a number for each of its texts."""
    texts: Sequence[str] | None = table.texts.get(column)
    if texts is None:
        return table.values[:, column]
    numbers = {text: float(code) for code, text in enumerate(dict.fromkeys(texts))}
    return np.array([numbers[text] for text in texts])


def _composite_key(
    table: NumberTable, key: int, coordinates: Sequence[int], codes: FloatArray
) -> FloatArray:
    """Return the codes of a key combined with other columns of profiles, parts, sensors or runs.

    The number of a profile may start again for each part. A column with which each point would be a
    profile numbers the points and is not used.
    """
    for column, name in enumerate(table.names):
        if column == key or column in coordinates:
            continue
        is_scan = column_role(name) == "scan" and _separates_profiles(table, column)
        if is_scan or is_part_name(name):
            pairs = np.column_stack([codes, _without_gaps(_codes(table, column))])
            keys, combined = np.unique(pairs, axis=0, return_inverse=True)
            if len(keys) < len(codes):
                codes = combined.ravel().astype(np.float64)
    return codes


def _split_by(key: FloatArray) -> list[IntArray]:
    """Return the rows of each profile, in the order in which profiles begin."""
    _, starts, group = np.unique(key, return_index=True, return_inverse=True)
    order = np.argsort(starts, kind="stable")
    by_group = np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])
    return [by_group[g] for g in order]


def _without_gaps(key: FloatArray) -> FloatArray:
    """Return the key in which a row without one gets that of the row before it.

    The first rows get the first key; all rows get 0 if there is none.
    """
    known = np.isfinite(key)
    rows = np.where(known, np.arange(len(key)), np.argmax(known))
    return np.where(known.any(), key[np.maximum.accumulate(rows)], 0.0)
