"""Profiles in a table of points: the choice of the columns of x and height."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.column_roles import find_role, is_encoder, select_by_role
from lsvision.io.profiles.number_table import NumberTable, holds_number
from lsvision.io.profiles.point_order import note_order
from lsvision.io.profiles.pose_tables import reject_pose_names, reject_poses
from lsvision.io.profiles.profile_keys import (
    find_key,
    find_profile_attributes,
    find_scan_key,
    is_profile_key,
    note_keys,
    note_rounded_attributes,
    numbers_points,
    reject_rounded_keys,
    require_x,
    separate_profiles,
)
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.stated_heights import note_resolution, resolve_direction
from lsvision.io.profiles.stated_units import find_common_unit, resolve_units, select_for_axis
from lsvision.io.profiles.units import split_label
from lsvision.io.profiles.validity import lose_invalid_points

_MAX_CONSTANT_RATIO = 1e-6  # extent of a column that does not vary, relative to the largest extent


@dataclass(frozen=True)
class _Columns:
    """Columns of the coordinates, and the column that identifies profiles (the key), if any."""

    x: int
    height: int
    key: int | None = None
    away: bool = False  # heights grow away from the sensor
    travel: bool = True  # the key is a position along the travel, not a number of the profile
    notes: tuple[str, ...] = ()
    considered: tuple[int, ...] = ()  # as coordinates: not attributes
    y: int | None = None  # of points in space

    @property
    def coordinates(self) -> tuple[int, ...]:
        """Columns of the points."""
        return (self.x, self.height) if self.y is None else (self.x, self.y, self.height)


def profiles_from_table(table: NumberTable, settings: ReadSettings) -> RawProfiles:
    """Return the profiles in a table of points, one point per row.

    Columns are those that the user requests, else those with known names, else chosen by position.
    By position, two columns are x and height. Of three or more, the first is x and the third the
    height; the second is ignored if it is constant, and separates the profiles if each of its
    values occurs in one run of points. The second is the height instead if the third is constant or
    consists of whole numbers (a label). Named columns that number the points are left out. Columns
    that do not vary within a profile become its attributes. If a plane is to be fitted, the points
    are x, y and z.

    Raises
    ------
    UnreadableFile
        If the columns of x and height are ambiguous, requested ones are missing, or a unit is not
        understood.
    """
    reject_rounded_keys(table)
    choice = _choose_columns(table, settings)
    _check_numbers(table, choice)
    rows, positions, position_unit = [np.arange(len(table.values))], None, None
    if choice.key is not None:
        rows, positions = separate_profiles(
            table, choice.key, choice.coordinates, is_travel=choice.travel
        )
    if choice.key is not None and positions is not None and settings.units is None:
        position_unit, note = _find_travel_unit(table, choice.key)
        if note:
            positions, choice = None, replace(choice, notes=(*choice.notes, note))
    points, validity_notes = lose_invalid_points(table, choice.coordinates, rows)
    sections = [points] if len(rows) == 1 else [points[r] for r in rows]
    if settings.columns is None:
        reject_pose_names(table, sections, rows)
    attributes, ignored = find_profile_attributes(
        table, rows, points=choice.coordinates, key=choice.key, excluded=choice.considered
    )
    lines = (*table.mentions, *table.iterate_lines_of_constants(choice.coordinates))
    away, height_notes = resolve_direction(lines, settings, is_range=choice.away)
    units = _resolve_all_units(table, choice, settings)
    notes = table.notes + choice.notes + validity_notes + height_notes
    notes += note_resolution(lines, units, settings)
    notes += note_keys(table, choice.key, is_travel=choice.travel)
    return RawProfiles(
        sections=sections,
        units=units,
        away=away,
        positions=positions,
        position_unit=position_unit,
        notes=notes + note_order(sections) + note_rounded_attributes(attributes),
        lost=table.lost,
        limits=table.limits,
        attributes=attributes,
        ignored=ignored,
    )


def profiles_from_rows_of_points(
    points: NumberTable, count: int, settings: ReadSettings
) -> RawProfiles:
    """Return the profiles of `count` equal parts of a table; see `profiles_from_table`."""
    part = np.repeat(np.arange(float(count)), len(points.values) // count)
    numbered = replace(
        points,
        values=np.column_stack([points.values, part]),
        names=(*points.names, "scan"),
        units=(*points.units, None),
    )
    raw = profiles_from_table(numbered, settings)
    # The number of a part is no data of the file.
    attributes = [{k: v for k, v in row.items() if k != "scan"} for row in raw.attributes]
    return replace(
        raw,
        attributes=tuple(attributes) if any(attributes) else (),
        ignored=tuple(label for label in raw.ignored if label != "scan"),
    )


def _choose_columns(table: NumberTable, settings: ReadSettings) -> _Columns:
    """Return the columns that the user requests, or that names or positions suggest."""
    if table.values.shape[1] - len(table.texts) < 2 and settings.columns is None:
        _raise_one_column(table)
    if settings.plane is not None:
        return _choose_spatial_columns(table, settings)
    if settings.columns is not None:
        return _find_requested_columns(table, settings.columns)
    return _choose_by_name(table) or _choose_by_position(table)


def _choose_spatial_columns(table: NumberTable, settings: ReadSettings) -> _Columns:
    """Return the columns of x, y and z: requested, so named, or the first three of numbers.

    Raises
    ------
    UnreadableFile
        If they are not there.
    """
    notes: tuple[str, ...] = ()
    by_role = select_by_role(table.names, table.texts)
    depth = "height" if "height" in by_role else "range"
    columns = [by_role[role] for role in ("x", "y", depth) if role in by_role]
    if settings.columns is not None:
        columns = [_find_column_index(table, column) for column in settings.columns]
    elif not columns and len(numbers := _list_number_columns(table)) >= 3:
        columns = numbers[:3]
        listed = ", ".join(str(column) for column in columns)
        notes = (f"no column is named: columns {listed} read as x, y and z",)
    if len(columns) != 3:
        labels = ", ".join(table.label(column) for column in columns) or "none of them"
        raise UnreadableFile(
            f"--plane fit needs x, y and z of each point, got {labels}: name three columns with "
            "--columns, or leave --plane out where the points are x and height"
        )
    x, y, z = columns
    return _Columns(x, z, key=find_key(table, columns), travel=False, notes=notes, y=y)


def _resolve_all_units(
    table: NumberTable, choice: _Columns, settings: ReadSettings
) -> tuple[str | None, str | None]:
    """Return the units of x and height; of points in space all three must agree.

    Raises
    ------
    UnreadableFile
        As `resolve_units`, or if x is an encoder without a unit, which counts steps.
    """
    units = resolve_units(table, choice.x, choice.height, settings)
    if units[0] is None and settings.units is None and is_encoder(table.label(choice.x)):
        raise UnreadableFile(
            f"{table.label(choice.x)} without a unit of length would be x: state one, as --units "
            "mm, or convert its steps"
        )
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


def _find_travel_unit(table: NumberTable, column: int) -> tuple[str | None, str]:
    """Return the stated unit of the positions along the travel; or a note if it is no length.

    An encoder without a unit counts steps.
    """
    label, stated = table.label(column), table.units[column] if table.units else None
    if stated is not None and stated.unit is None:
        return None, f"{label} in {stated.text!r}: positions left out"
    unit = find_common_unit(stated, select_for_axis(table.statements, "y"))
    if unit is None and is_encoder(label):
        return None, f"{label} without a unit of length: positions left out"
    return unit, ""


def _find_requested_columns(table: NumberTable, columns: Sequence[int | str]) -> _Columns:
    """Return the columns that the user requests: x and height, or x, travel and height."""
    x, *travel, height = [_find_column_index(table, column) for column in columns]
    away = _is_range(table, height)
    if travel:
        return _Columns(x, height, key=travel[0], away=away)
    key = find_scan_key(table, (x, height))
    return _Columns(x, height, key=key, away=away, travel=False)


def _is_range(table: NumberTable, column: int) -> bool:
    """Return whether a column is named as a range, which grows away from the sensor."""
    name = table.names[column].rstrip("0123456789") if table.names else ""
    return find_role(name) == "range"  # "distance1" is the first of several


def _find_column_index(table: NumberTable, column: int | str) -> int:
    """Return the index of a column from its index or its name."""
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


def _choose_by_name(table: NumberTable) -> _Columns | None:
    """Return the columns with known names, with a note if a name occurs twice; else None."""
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


def _choose_by_role(table: NumberTable) -> _Columns | None:
    """Return the columns of x and height and the key by their roles; None if one is missing.

    Without a column of heights or ranges, y is the height; without x, y is x. With x, y and height,
    y is the travel. An encoder is a y.
    """
    by_role = select_by_role(table.names, table.texts)
    away = "range" in by_role and "height" not in by_role
    in_order = [
        by_role[role] for role in ("x", "y", "range" if away else "height") if role in by_role
    ]
    if "angle" in by_role and "x" not in by_role:
        raise UnreadableFile("an angle and no x in its columns: convert it to x and height")
    if len(in_order) < 2:
        return None
    key = find_key(table, in_order)
    if len(in_order) == 2 or key is not None:
        return _Columns(in_order[0], in_order[-1], key=key, away=away, travel=False)
    in_plane = _choose_in_plane(table, in_order)
    if in_plane:
        return replace(in_plane, away=away)
    x, y, height = in_order
    is_key = is_profile_key(table.values[:, y])
    if not is_key and not is_encoder(table.names[y]):  # an encoder may run on within a profile
        _raise_no_key(table, y)
    return _Columns(x, height, key=y if is_key else None, away=away)


def _choose_by_position(table: NumberTable) -> _Columns:
    """Return the columns by their order; see `profiles_from_table`."""
    _reject_numbers_in_text(table)
    columns = _list_number_columns(table)
    reject_poses(table, columns)
    if table.names:
        numbering = [c for c in columns if numbers_points(table, c)]
        others = [c for c in columns if c not in numbering]
        require_x(table, others, numbering)
        columns = others if len(others) > 1 else columns
    if len(columns) < 2:  # the rest is empty or text, which a message then names
        columns = list(range(table.values.shape[1]))
    if len(columns) == 2:
        labels = " and ".join(table.names[c] if table.names else f"column {c}" for c in columns)
        noted = bool(table.names or table.texts)
        x, height = columns
        notes = (f"{labels} read as x and height",) if noted else ()
        return _Columns(x, height, away=_is_range(table, height), notes=notes)
    first, second, third = columns[:3]
    labels = f"{first}, {second} and {third} of {table.values.shape[1]}"
    notes = (f"no columns are named as x and height: columns {labels} considered",)
    in_plane = _choose_in_plane(table, columns[:3])
    if in_plane:
        away = _is_range(table, in_plane.height)
        return replace(in_plane, away=away, notes=notes + in_plane.notes)
    if is_profile_key(table.values[:, second]):
        return _Columns(first, third, key=second, away=_is_range(table, third), notes=notes)
    if not _is_whole(table.values[:, third]) or _is_whole(table.values[:, second]):
        _raise_no_key(table, second)
    note, away = f"column {third} has whole numbers: read as a label", _is_range(table, second)
    considered = (first, second, third)
    return _Columns(first, second, away=away, notes=(*notes, note), considered=considered)


def _list_number_columns(table: NumberTable) -> list[int]:
    """Return the columns of numbers that are not empty."""
    filled = {*np.flatnonzero(np.isfinite(table.values).any(axis=0)), *table.invalid_cells}
    return [c for c in range(table.values.shape[1]) if c in filled and c not in table.texts]


def _choose_in_plane(table: NumberTable, xyz: Sequence[int]) -> _Columns | None:
    """Return the choice among three columns if the second, or else the third, does not vary."""
    x, y, z = xyz
    extents = [_measure_extent(table.values[:, column]) for column in xyz]
    if extents[1] <= _MAX_CONSTANT_RATIO * max(extents):
        return _Columns(x, z, considered=(x, y, z))
    if extents[2] <= _MAX_CONSTANT_RATIO * max(extents):
        note = "z does not vary: x and y read as the profile"
        return _Columns(x, y, notes=(note,), considered=(x, y, z))
    return None


def _check_numbers(table: NumberTable, choice: _Columns) -> None:
    """Raise an error that names the first cell of a coordinate that is not a number."""
    for column in choice.coordinates:
        if column in table.invalid_cells:
            cell = table.invalid_cells[column]
            named = f"column {table.label(column)} holds text: " if column in table.texts else ""
            raise UnreadableFile(f"line {cell.row}: {named}{cell.text[:40]!r} {cell.reason}")


def _reject_numbers_in_text(table: NumberTable) -> None:
    """Raise an error for a column of text with decimal numbers, which may be coordinates."""
    for column, cells in table.texts.items():
        cell = next(filter(holds_number, cells), None)
        if cell is not None:
            raise UnreadableFile(
                f"column {table.label(column)} holds numbers with other text ({cell[:40]!r}): "
                "write the numbers alone, or name the columns of x and height with --columns"
            )


def _raise_one_column(table: NumberTable) -> NoReturn:
    """Raise the error of a table with less than two columns of numbers, with what prevents more."""
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


def _raise_no_key(table: NumberTable, key: int) -> NoReturn:
    reject_pose_names(table, (), ())
    values = len(np.unique(table.values[:, key]))
    raise UnreadableFile(
        f"column {table.label(key)} does not separate profiles ({values} values in "
        f"{len(table.values)} points): name the columns of x and height with --columns"
    )


def _measure_extent(column: FloatArray) -> float:
    finite = column[np.isfinite(column)]
    with np.errstate(over="ignore"):
        return float(finite.max() - finite.min()) if len(finite) else 0.0


def _is_whole(column: FloatArray) -> bool:
    finite = column[np.isfinite(column)]
    return bool(np.all(finite == np.round(finite)))
