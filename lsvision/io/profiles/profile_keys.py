"""Columns of a table of points that separate, number or describe profiles."""

from collections.abc import Mapping, Sequence

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray, IntArray
from lsvision.io.profiles.column_roles import (
    HEIGHT_ROLES,
    find_role,
    has_known_role,
    identifies_profiles,
    is_part_name,
    select_by_role,
)
from lsvision.io.profiles.number_table import NumberTable
from lsvision.io.profiles.point_order import MIN_POINTS_PER_PROFILE, find_restarts
from lsvision.io.profiles.spelled_cells import MAX_EXACT_NUMBER

_TIME_NAMES = frozenset(["t", "time", "timestamp", "zeit", "temps", "tiempo", "tempo", "время"])
"""Names of columns of times, which are no x."""


def reject_rounded_keys(table: NumberTable) -> None:
    """Raise UnreadableFile if numbers of profiles or parts are so large that they are rounded.

    Different profiles could then have the same number.
    """
    for column, name in enumerate(table.names):
        is_key = identifies_profiles(name) and _get_cells(table, column) is None
        if is_key and np.any(np.abs(table.values[:, column]) >= MAX_EXACT_NUMBER):
            raise UnreadableFile(
                f"{name}: numbers above 2^53 would be rounded, and different ones become equal: "
                "write them as text, with a letter in front"
            )


def note_rounded_attributes(
    attributes: Sequence[Mapping[str, float | str]],
) -> tuple[str, ...]:
    """Return a note for each attribute with numbers so large that they are rounded."""
    rounded = dict.fromkeys(
        label
        for profile in attributes
        for label, value in profile.items()
        if isinstance(value, float) and abs(value) >= MAX_EXACT_NUMBER
    )
    return tuple(f"{label}: numbers above 2^53 are rounded" for label in rounded)


def separate_profiles(
    table: NumberTable, key: int, coordinates: Sequence[int], *, is_travel: bool
) -> tuple[list[IntArray], tuple[float, ...] | None]:
    """Return the rows of each profile, and the value of the key of each if it is a position.

    The profiles are in the order in which they begin. The key is combined with other columns of
    profiles and parts, because its numbers may start again for each part; a position along the
    travel is not. `coordinates` are the columns of the points.
    """
    if not is_travel:
        codes = _without_gaps(table, key, coordinates)
        return _split_by(_build_composite_key(table, key, coordinates, codes)), None
    if key in table.texts:
        return _split_by(_without_gaps(table, key, coordinates)), None
    codes = _fill_gaps(table.values[:, key])
    rows = _split_by(codes)
    return rows, tuple(float(codes[r[0]]) for r in rows)


def find_scan_key(table: NumberTable, coordinates: Sequence[int]) -> int | None:
    """Return the column of the profile's number if it separates profiles; else None."""
    scan = select_by_role(table.names, table.texts).get("scan")
    if scan is None or scan in coordinates or not _separates_profiles(table, scan):
        return None
    return scan


def find_key(table: NumberTable, coordinates: Sequence[int]) -> int | None:
    """Return the column of the profile's number, or else that of parts, sensors or runs.

    The latter must have one run of points for each value; a column of another name, too, and a
    run must begin where x starts again.
    """
    scan = find_scan_key(table, coordinates)
    if scan is not None:
        return scan
    for column, name in enumerate(table.names):
        if is_part_name(name):
            codes = _without_gaps(table, column, coordinates)
            if len(np.unique(codes)) > 1 and is_profile_key(codes):
                return column
    return _find_key_by_restarts(table, coordinates)


def _find_key_by_restarts(table: NumberTable, coordinates: Sequence[int]) -> int | None:
    """Return the first column of any name that changes exactly where x starts again; else None."""
    x = table.values[:, coordinates[0]]
    rows = np.flatnonzero(np.isfinite(x))
    restarts = rows[find_restarts(x[rows])]
    for column, name in enumerate(table.names) if len(restarts) else ():
        if column in coordinates or not name or has_known_role(name):
            continue
        codes = _fill_gaps(_encode_column(table, column))
        starts = np.searchsorted(rows, np.flatnonzero(np.diff(codes)) + 1)
        if np.array_equal(rows[starts[starts < len(rows)]], restarts) and is_profile_key(codes):
            return column
    return None


def note_keys(table: NumberTable, key: int | None, *, is_travel: bool) -> tuple[str, ...]:
    """Return a note if a column of another name separates profiles, or one of parts does not."""
    if key is not None:
        label = table.label(key)
        is_known = is_travel or has_known_role(label) or is_part_name(label)
        return () if is_known else (f"{label} changes where x starts again: it separates profiles",)
    mixed = [c for c, name in enumerate(table.names) if is_part_name(name) and _varies(table, c)]
    return tuple(
        f"{table.label(column)} has several values and separates no profiles: sort the points by "
        "it, and number the profiles in a column scan"
        for column in mixed
    )


def _varies(table: NumberTable, column: int) -> bool:
    codes = _encode_column(table, column)
    return len(np.unique(codes[np.isfinite(codes)])) > 1


def is_profile_key(column: FloatArray) -> bool:
    """Return whether each value occupies one run of points, on average enough for a profile."""
    key = _fill_gaps(column)
    runs = 1 + np.count_nonzero(np.diff(key))
    return bool(runs == len(np.unique(key)) and runs * MIN_POINTS_PER_PROFILE <= len(key))


def _separates_profiles(table: NumberTable, column: int) -> bool:
    """Return whether a column may separate profiles: not if two or more numbers all differ."""
    codes = _encode_column(table, column)
    finite = codes[np.isfinite(codes)]
    return len(finite) < 2 or len(np.unique(finite)) < len(finite)


def _encode_column(table: NumberTable, column: int) -> FloatArray:
    """Return the numbers of a column, or a number for each of its texts; NaN if there is none."""
    cells = _get_cells(table, column)
    if cells is None:
        return table.values[:, column]
    numbers = {text: float(code) for code, text in enumerate(dict.fromkeys(cells))}
    return np.array([np.nan if _is_blank(text) else numbers[text] for text in cells])


def _get_cells(table: NumberTable, column: int) -> Sequence[str] | None:
    """Return the cells of a column of text, or of numbers that do not tell them; else None."""
    return table.texts.get(column, table.spellings.get(column))


def _is_blank(cell: str) -> bool:
    """Return whether a text states nothing."""
    return cell.lower() in ("", "nan")


def _build_composite_key(
    table: NumberTable, key: int, coordinates: Sequence[int], codes: FloatArray
) -> FloatArray:
    """Return the codes of a key combined with other columns of profiles, parts, sensors or runs.

    The number of a profile may start again for each part. A column with which each point would be a
    profile numbers the points and is not used.
    """
    for column, name in enumerate(table.names):
        if column == key or column in coordinates:
            continue
        is_scan = find_role(name) == "scan" and _separates_profiles(table, column)
        if is_scan or is_part_name(name):
            others = _without_gaps(table, column, coordinates, codes)
            pairs = np.column_stack([codes, others])
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


def _without_gaps(
    table: NumberTable,
    column: int,
    coordinates: Sequence[int],
    profiles: FloatArray | None = None,
) -> FloatArray:
    """Return the codes of a column of ids; a row without one gets that of the row before it.

    Whole profiles without an id, if the codes `profiles` of another key tell them, get infinity.

    Raises
    ------
    UnreadableFile
        If points without an id are neither among rows with the same one, nor below the only row
        of their part that states it.
    """
    codes = _encode_column(table, column)
    known = np.isfinite(codes)
    filled = _fill_gaps(codes)
    if known.all() or not known.any():
        return filled
    has_point = np.isfinite(table.values[:, list(coordinates)]).all(axis=1)
    is_open = np.arange(len(codes)) < np.argmax(known)
    if np.any(known[1:] & known[:-1]):  # ids are not in the first rows of parts only
        is_open |= np.isnan(codes) & (filled != _fill_gaps(codes[::-1])[::-1])
        is_open[len(codes) - np.argmax(known[::-1]) :] = True
    rows = np.flatnonzero(is_open & has_point)
    if not len(rows):
        return filled
    if profiles is not None and not np.isin(profiles[rows], profiles[known]).any():
        return np.where(np.isin(profiles, profiles[rows]), np.inf, filled)
    raise UnreadableFile(
        f"{table.label(column)} is empty in {len(rows)} points that may belong to no part (row "
        f"{rows[0] + 1} of the table): state it in each row, or in the first row of each part only"
    )


def _fill_gaps(key: FloatArray) -> FloatArray:
    """Return the key in which a row without one gets that of the row before it.

    The first rows get the first key; all rows get 0 if there is none.
    """
    known = np.isfinite(key)
    rows = np.where(known, np.arange(len(key)), np.argmax(known))
    return np.where(known.any(), key[np.maximum.accumulate(rows)], 0.0)


def find_profile_attributes(
    table: NumberTable,
    rows: Sequence[IntArray],
    *,
    points: Sequence[int],
    key: int | None,
    excluded: Sequence[int],
) -> tuple[tuple[Mapping[str, float | str], ...], tuple[str, ...]]:
    """Return the attributes of each profile, and the labels of the columns that are not used.

    An attribute is a column, also the key, that has one value in each profile, or none in some;
    without names there are none. `rows` are those of each profile, `points` the columns of the
    coordinates, `key` the one that identifies profiles, `excluded` those that are never attributes.
    """
    other_columns = [c for c in range(table.values.shape[1]) if c not in points]
    by_profile: list[dict[str, float | str]] = [{} for _ in rows]
    ignored = []
    for column in other_columns:
        stated = _find_rows_that_state_ids(table, column) if table.names else None
        values = []
        if stated is not None:
            values = [_find_common_value(table, column, stated[r]) for r in rows]
        has_values = any(value is not None for value in values)
        if (
            has_values
            and column not in excluded
            and not _varies_in_one(table, column, rows, values)
        ):
            for attributes, value in zip(by_profile, values, strict=True):
                if value is not None:
                    attributes[table.label(column)] = value
        elif column != key:
            ignored.append(table.label(column))
    has_attributes = any(by_profile)
    return tuple(by_profile) if has_attributes else (), tuple(ignored)


def _find_rows_that_state_ids(table: NumberTable, column: int) -> IntArray:
    """Return for each row the one whose cell counts: the row itself, or that of an id above it.

    The latter where ids are in the first rows of parts only.
    """
    rows = np.arange(len(table.values))
    if not identifies_profiles(table.names[column]):
        return rows
    known = np.isfinite(_encode_column(table, column))
    if known.all() or np.any(known[1:] & known[:-1]):
        return rows
    return np.maximum.accumulate(np.where(known, rows, np.argmax(known)))


def _find_common_value(table: NumberTable, column: int, rows: IntArray) -> float | str | None:
    """Return the common value of all points of a profile; None if they differ or are all NaN."""
    texts = _find_texts(table, column, rows)
    if texts is not None:
        return texts.pop() if len(texts) == 1 else None
    values = table.values[rows, column]
    values = values[np.isfinite(values)]
    return float(values[0]) if len(values) and bool(np.all(values == values[0])) else None


def _find_texts(table: NumberTable, column: int, rows: IntArray) -> set[str] | None:
    """Return the different texts of a column in some rows; None for numbers.

    An empty text is none in a column of ids, and among numbers.
    """
    cells = _get_cells(table, column)
    if cells is None:
        return None
    texts = {cells[row] for row in rows.tolist()}
    if column in table.texts and not identifies_profiles(table.names[column]):
        return texts
    return {text for text in texts if not _is_blank(text)}


def _varies_in_one(
    table: NumberTable,
    column: int,
    rows: Sequence[IntArray],
    values: Sequence[float | str | None],
) -> bool:
    """Return whether a profile without a common value in a column has several, and not none."""
    without = [r for r, value in zip(rows, values, strict=True) if value is None]
    if _get_cells(table, column) is not None:
        return any(_find_texts(table, column, r) for r in without)
    return any(np.isfinite(table.values[r, column]).any() for r in without)


def numbers_points(table: NumberTable, column: int) -> bool:
    """Return whether a named column is no coordinate, but 0, 1, 2, ... or 1, 2, 3, ...."""
    unit = table.units[column]
    is_length = unit is not None and unit.unit is not None
    values = table.values[:, column]
    return (
        (find_role(table.names[column]) == "scan" or not has_known_role(table.names[column]))
        and not is_length
        and len(values) >= MIN_POINTS_PER_PROFILE
        and values[0] in (0, 1)
        and np.array_equal(values, values[0] + np.arange(len(values)))
    )


def require_x(table: NumberTable, columns: Sequence[int], numbering: Sequence[int]) -> None:
    """Raise an error if heights, or numbers of the points beside them, would be read as x.

    None or one of the names of the table is that of a coordinate. `columns` may be coordinates,
    `numbering` are those that number the points.
    """
    roles = [find_role(table.names[c]) for c in columns]
    if len(columns) == 1 and any(not table.names[c] or roles[0] in HEIGHT_ROLES for c in numbering):
        label = table.names[numbering[0]] or "without a name"
        problem = f"column {label} numbers the points"
    elif len(columns) == 2 and roles[0] == "height" and not has_known_role(roles[1]):
        problem = f"columns {' and '.join(table.names[c] for c in columns)}, and no x"
    elif len(columns) == 2 and any(table.names[c] in _TIME_NAMES for c in columns):
        problem = f"columns {' and '.join(table.names[c] for c in columns)}: a time and no x"
    else:
        return
    raise UnreadableFile(
        f"{problem}: name the columns of x and height with --columns, or state x of the heights "
        "with --x0 and --dx"
    )
