"""Columns of x and height in a table, and columns that identify profiles."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NoReturn

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray, IntArray
from lsvision.io.profiles.column_roles import column_role, is_part_name
from lsvision.io.profiles.profile_attributes import find_profile_attributes
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.stated_units import resolve_units
from lsvision.io.profiles.text_table import TextTable
from lsvision.io.profiles.units import split_label

_MIN_POINTS_PER_PROFILE = 5  # fewer points do not determine an ellipse: not a key of profiles
_CONSTANT = 1e-6  # spread of a column that does not vary, relative to that of the widest


@dataclass(frozen=True)
class _Columns:
    """Columns of the coordinates, and the column that identifies profiles (the key), if any."""

    x: int
    height: int
    key: int | None = None
    away: bool = False  # heights grow away from the sensor
    travel: bool = True  # the key is a position along the travel, not a number of the profile
    notes: tuple[str, ...] = ()
    considered: tuple[int, ...] = field(default=())  # as coordinates: not attributes
    y: int | None = None  # of points in space

    @property
    def coordinates(self) -> tuple[int, ...]:
        """Columns of the points."""
        return (self.x, self.height) if self.y is None else (self.x, self.y, self.height)


def profiles_from_table(table: TextTable, settings: ReadSettings) -> RawProfiles:
    """Return the profiles in a table of points, one point per row.

    Named columns are chosen by their names, unnamed ones by position. Two unnamed columns are x and
    height. Of three or more, the second is ignored if it is constant, and separates the profiles if
    each of its values occurs in one run of points; otherwise the third must be whole numbers (a
    label). Columns that do not vary within a profile become its attributes. If a plane is to be
    fitted, the points are x, y and z.

    Raises
    ------
    UnreadableFile
        If the columns of x and height are ambiguous, requested ones are missing, or a unit is not
        understood.
    """
    if table.values.shape[1] - len(table.texts) < 2 and settings.columns is None:
        _raise_one_column(table)
    if settings.plane is not None:
        choice = _choose_spatial_columns(table, settings)
    else:
        named = _requested_columns(table, settings) or _choose_by_name(table)
        choice = named or _choose_by_position(table)
    _check_numbers(table, choice)
    points = table.values
    if choice.coordinates != tuple(range(points.shape[1])):
        points = points[:, choice.coordinates]
    sections: Sequence[FloatArray] = [points]
    positions = None
    rows = [np.arange(len(points))]
    if choice.key is not None:
        key = _without_gaps(_codes(table, choice.key))
        if not choice.travel:
            key = _composite_key(table, choice, key)
        rows = _split_by(key)
        sections = [points[r] for r in rows]
        if choice.travel and choice.key not in table.texts:
            numbers = _without_gaps(table.values[:, choice.key])
            positions = tuple(float(numbers[r][0]) for r in rows)
    attributes, ignored = find_profile_attributes(
        table, rows, points=choice.coordinates, key=choice.key, excluded=choice.considered
    )
    return RawProfiles(
        sections=sections,
        units=_resolve_all_units(table, choice, settings),
        away=choice.away,
        positions=positions,
        notes=table.notes + choice.notes + _note_restarts(sections),
        lost=table.lost,
        limits=table.limits,
        attributes=attributes,
        ignored=ignored,
    )


def _note_restarts(sections: Sequence[FloatArray]) -> tuple[str, ...]:
    """Return a note if x repeats its range: probably several profiles one after the other."""
    if len(sections) != 1 or sections[0].shape[1] != 2:
        return ()
    x = sections[0][np.isfinite(sections[0][:, 0]), 0]
    with np.errstate(over="ignore", invalid="ignore"):  # numbers near the largest float
        steps, span = np.diff(x), np.ptp(x) if len(x) else 0.0
    if len(steps) < 2 * _MIN_POINTS_PER_PROFILE:
        return ()
    rising, falling = np.count_nonzero(steps > 0), np.count_nonzero(steps < 0)
    if not (rising and falling):
        return ()
    jumps = steps < -0.5 * span if rising >= falling else steps > 0.5 * span
    restarts = np.flatnonzero(jumps)
    if len(restarts) == 0 or np.diff([-1, *restarts, len(x) - 1]).min() < _MIN_POINTS_PER_PROFILE:
        return ()
    return (
        f"x starts again {len(restarts)} times: if these are several profiles, add a column of "
        "their numbers, or write one per file",
    )


def _choose_spatial_columns(table: TextTable, settings: ReadSettings) -> _Columns:
    """Return the columns of x, y and z: the requested or so named ones, or the first three numeric.

    Raises
    ------
    UnreadableFile
        If they are not there.
    """
    by_role, notes = _columns_by_role(table), tuple[str, ...]()
    depth = "height" if "height" in by_role else "range"
    columns = [by_role[role] for role in ("x", "y", depth) if role in by_role]
    if settings.columns is not None:
        columns = [_column_index(table, column) for column in settings.columns]
    elif not columns and len(numbers := _number_columns(table)) >= 3:
        columns = numbers[:3]
        listed = ", ".join(str(column) for column in columns)
        notes = (f"no column is named: columns {listed} read as x, y and z",)
    if len(columns) != 3:
        labels = ", ".join(table.label(column) for column in columns) or "none of them"
        raise UnreadableFile(
            f"--plane fit needs x, y and z of each point, got {labels}: name three columns with "
            "--columns, or leave --plane out where the points are x and height"
        )
    key = by_role.get("scan")
    if key is None or key in columns or not _separates_profiles(table, key):
        key = _find_part_key(table)
    x, y, z = columns
    return _Columns(x, z, key, travel=False, notes=notes, y=y)


def _resolve_all_units(
    table: TextTable, choice: _Columns, settings: ReadSettings
) -> tuple[str | None, str | None]:
    """Return the units of x and height; of points in space all three must agree."""
    units = resolve_units(table, choice.x, choice.height, settings)
    if choice.y is None:
        return units
    stated = dict.fromkeys((*units, *resolve_units(table, choice.x, choice.y, settings)))
    if len(stated) > 1:
        listed = ", ".join(unit or "none" for unit in stated)
        raise UnreadableFile(
            f"x, y and z have different units ({listed}): state one with --units, or write all in "
            "the same"
        )
    return units


def _requested_columns(table: TextTable, settings: ReadSettings) -> _Columns | None:
    if settings.columns is None:
        return None
    indices = [_column_index(table, column) for column in settings.columns]
    away = bool(table.names) and column_role(table.names[indices[-1]]) == "range"
    if len(indices) == 3:
        return _Columns(indices[0], indices[-1], indices[1], away)
    scan = _columns_by_role(table).get("scan")
    separates = scan is not None and scan not in indices and _separates_profiles(table, scan)
    return _Columns(indices[0], indices[-1], scan if separates else None, away, travel=False)


def _column_index(table: TextTable, column: int | str) -> int:
    width = table.values.shape[1]
    if isinstance(column, int):
        if column < width:
            return column
        raise UnreadableFile(f"no column {column} in it: expected 0 to {width - 1}, see --columns")
    for name in (column.strip().lower(), split_label(column)[0]):
        if name in table.names:
            return table.names.index(name)
    names = ", ".join(table.names) or "no names"
    raise UnreadableFile(f"no column named {column!r} in it (it has {names}): see --columns")


def _columns_by_role(table: TextTable) -> dict[str, int]:
    """Return the first column in each role: numbers, or also text if it identifies profiles."""
    by_role: dict[str, int] = {}
    for index, name in enumerate(table.names):
        role = column_role(name)
        if index not in table.texts or role == "scan":
            by_role.setdefault(role, index)
    return by_role


def _choose_by_name(table: TextTable) -> _Columns | None:
    choice = _choose_by_role(table)
    if choice is None:
        return None
    repeated = [
        table.names[c] for c in (choice.x, choice.height) if table.names.count(table.names[c]) > 1
    ]
    if not repeated:
        return choice
    note = (
        f"{' and '.join(repeated)} occur twice in the header: the first is used, "
        "choose others with --columns"
    )
    return replace(choice, notes=(*choice.notes, note))


def _choose_by_role(table: TextTable) -> _Columns | None:
    by_role = _columns_by_role(table)
    away = "range" in by_role and "height" not in by_role
    in_order = [
        by_role[role] for role in ("x", "y", "range" if away else "height") if role in by_role
    ]
    if "angle" in by_role and "x" not in by_role:
        raise UnreadableFile("an angle and no x in its columns: convert it to x and height")
    if len(in_order) < 2:
        return None
    scan = by_role.get("scan")
    if scan is not None and not _separates_profiles(table, scan):
        scan = None
    if scan is None:
        scan = _find_part_key(table)
    if len(in_order) == 2 or scan is not None:
        return _Columns(in_order[0], in_order[-1], scan, away, travel=False)
    x, y, height = in_order
    values = table.values[:, in_order]
    in_plane = _choose_in_plane(values)
    if in_plane:
        height = in_order[in_plane.height]
        return _Columns(x, height, away=away, notes=in_plane.notes, considered=tuple(in_order))
    if not _is_profile_key(table.values[:, y]):
        _raise_no_key(table, y)
    return _Columns(x, height, y, away)


def _choose_by_position(table: TextTable) -> _Columns:
    columns = _number_columns(table)
    if len(columns) < 2:
        columns = list(range(table.values.shape[1]))
    values = table.values[:, columns]
    width = len(columns)
    if width == 2:
        labels = " and ".join(table.names[c] if table.names else f"column {c}" for c in columns)
        noted = bool(table.names or table.texts)
        x, height = columns
        return _Columns(x, height, notes=(f"{labels} read as x and height",) if noted else ())
    first, second, third = columns[:3]
    notes = (
        f"no column is named: columns {first}, {second} and {third} of "
        f"{table.values.shape[1]} considered",
    )
    considered = (first, second, third)
    in_plane = _choose_in_plane(values[:, :3])
    if in_plane:
        return _Columns(
            first, columns[in_plane.height], notes=notes + in_plane.notes, considered=considered
        )
    if (
        _is_whole(values[:, 2])
        and not _is_whole(values[:, 1])
        and not _is_profile_key(values[:, 1])
    ):
        note = f"column {third} has whole numbers: read as a label"
        return _Columns(first, second, notes=(*notes, note), considered=considered)
    if not _is_profile_key(values[:, 1]):
        _raise_no_key(table, second)
    return _Columns(first, third, second, notes=notes)


def _number_columns(table: TextTable) -> list[int]:
    """Return the columns of numbers that are not empty."""
    filled = {*np.flatnonzero(np.isfinite(table.values).any(axis=0)), *table.invalid_cells}
    return [c for c in range(table.values.shape[1]) if c in filled and c not in table.texts]


def _choose_in_plane(xyz: FloatArray) -> _Columns | None:
    """Return the choice if y, or else z, is the same for all points."""
    extents = [_extent(column) for column in xyz.T]
    if extents[1] <= _CONSTANT * max(extents):
        return _Columns(0, 2)
    if extents[2] <= _CONSTANT * max(extents):
        return _Columns(0, 1, notes=("z does not vary: x and y read as the profile",))
    return None


def _check_numbers(table: TextTable, choice: _Columns) -> None:
    for column in choice.coordinates:
        if column in table.invalid_cells:
            cell = table.invalid_cells[column]
            named = f"column {table.label(column)} holds text: " if column in table.texts else ""
            raise UnreadableFile(f"line {cell.row}: {named}{cell.text[:40]!r} {cell.reason}")


def _raise_one_column(table: TextTable) -> NoReturn:
    cell = next(iter(table.invalid_cells.values()), None)
    if cell is not None and not table.texts:
        raise UnreadableFile(f"line {cell.row}: {cell.text[:40]!r} {cell.reason}")
    for column, cells in table.texts.items():
        text, count = Counter(cells).most_common(1)[0]
        if count > 1:
            raise UnreadableFile(
                f"column {table.label(column)} holds text ({text[:40]!r} in {count} lines): use "
                f"--lost {text[:20]} if that marks lost points, or name the columns of x and "
                "height with --columns"
            )
    raise UnreadableFile(
        "one column in it: expected x and height, or state the positions of the heights with --x0 "
        "and --dx"
    )


def _raise_no_key(table: TextTable, key: int) -> NoReturn:
    values = len(np.unique(table.values[:, key]))
    raise UnreadableFile(
        f"column {table.label(key)} does not separate profiles ({values} values in "
        f"{len(table.values)} points): name the columns of x and height with --columns"
    )


def _extent(column: FloatArray) -> float:
    finite = column[np.isfinite(column)]
    with np.errstate(over="ignore"):
        return float(finite.max() - finite.min()) if len(finite) else 0.0


def _is_whole(column: FloatArray) -> bool:
    finite = column[np.isfinite(column)]
    return bool(np.all(finite == np.round(finite)))


def _separates_profiles(table: TextTable, column: int) -> bool:
    """Return whether a column may separate profiles; a running number, all different, does not."""
    codes = _codes(table, column)
    finite = codes[np.isfinite(codes)]
    return len(finite) < 2 or len(np.unique(finite)) < len(finite)


def _find_part_key(table: TextTable) -> int | None:
    """Return the first column of parts, sensors or runs that has a run of points for each value."""
    for column, name in enumerate(table.names):
        if is_part_name(name):
            codes = _codes(table, column)
            if len(np.unique(codes[np.isfinite(codes)])) > 1 and _is_profile_key(codes):
                return column
    return None


def _is_profile_key(column: FloatArray) -> bool:
    """Return whether each value occupies one run of points, long enough for a profile."""
    key = _without_gaps(column)
    runs = 1 + np.count_nonzero(np.diff(key))
    return bool(runs == len(np.unique(key)) and runs * _MIN_POINTS_PER_PROFILE <= len(key))


def _codes(table: TextTable, column: int) -> FloatArray:
    """Return the numbers of a column, or a number for each of its texts."""
    texts: Sequence[str] | None = table.texts.get(column)
    if texts is None:
        return table.values[:, column]
    numbers = {text: float(code) for code, text in enumerate(dict.fromkeys(texts))}
    return np.array([numbers[text] for text in texts])


def _composite_key(table: TextTable, choice: _Columns, key: FloatArray) -> FloatArray:
    """Return the key refined by columns of parts, sensors or runs in which it restarts."""
    for column, name in enumerate(table.names):
        if column == choice.key or column in choice.coordinates:
            continue
        if is_part_name(name) or (column_role(name) == "scan"):
            codes = _without_gaps(_codes(table, column))
            if column_role(name) == "scan" and not _separates_profiles(table, column):
                continue
            pairs = np.column_stack([key, codes])
            _, combined = np.unique(pairs, axis=0, return_inverse=True)
            key = combined.ravel().astype(np.float64)
    return key


def _split_by(key: FloatArray) -> list[IntArray]:
    """Return the rows of each profile, in the order in which profiles begin."""
    _, starts, group = np.unique(key, return_index=True, return_inverse=True)
    order = np.argsort(starts, kind="stable")
    by_group = np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])
    return [by_group[g] for g in order]


def _without_gaps(key: FloatArray) -> FloatArray:
    """Return the key in which a lost point without a key gets that of the previous point."""
    known = np.isfinite(key)
    rows = np.where(known, np.arange(len(key)), np.argmax(known))
    return np.where(known.any(), key[np.maximum.accumulate(rows)], 0.0)
