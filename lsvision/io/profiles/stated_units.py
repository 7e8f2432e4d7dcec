"""Units of x and height from all statements in a file."""

import re
from collections.abc import Iterable
from dataclasses import replace

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.column_roles import find_role
from lsvision.io.profiles.number_table import NumberTable
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.unit_statements import (
    UnitStatement,
    find_unit_mentions,
    find_unit_statements,
)
from lsvision.io.profiles.units import StatedUnit, find_mm_per_unit

_REMEDY = "state it, as --units um or --units 0.1mm"
"""Remedy for a unit that is not known."""


def resolve_units(
    table: NumberTable, x: int, height: int, settings: ReadSettings
) -> tuple[str | None, str | None]:
    """Return the units of two columns of a table, x and height.

    They are None where the file states none, or the user states one of all coordinates; with a size
    of counts (`z_unit`) that is the unit of the height, and that of x is mm if none is stated.

    Raises
    ------
    UnreadableFile
        If a unit is stated and not understood, or two are stated that differ, or ``z_in`` beside
        ``z_out`` may be no inches.
    """
    if settings.count_unit is not None:  # of the height, whatever the file states on it
        x_unit = settings.units or _find_stated_unit(table, x, "x")
        return x_unit or "mm", settings.count_unit
    if settings.units is not None:
        return None, None
    beside = find_unit_statements(table.iterate_lines_of_constants({x, height}))
    table = replace(table, statements=table.statements + beside)
    for column in (x, height):
        _reject_in_beside_out(table, column)
        _reject_power_of_ten(table, column)
    units = _find_stated_unit(table, x, "x"), _find_stated_unit(table, height, "height")
    require_known_unit(units, table.mentions, settings)
    return units


def _reject_in_beside_out(table: NumberTable, column: int) -> None:
    """Raise UnreadableFile if the unit "in" of a column is a direction: a column "out" has it."""
    stated = table.units[column] if table.units else None
    if stated is None or stated.text != "in":
        return
    name = table.names[column]
    pair = [other for other in table.names if re.fullmatch(rf"{re.escape(name)}[ _-]?out", other)]
    if pair:
        raise UnreadableFile(
            f"{name}_in beside {pair[0]}: this may be a direction or inches: state the unit, as "
            "--units mm or --units in"
        )


def _reject_power_of_ten(table: NumberTable, column: int) -> None:
    """Raise UnreadableFile if a name such as ``z_10_um`` may state a unit of 10 um."""
    stated = table.units[column] if table.units else None
    number = re.fullmatch(r"\D+?[ _-]?(10+)", table.names[column]) if table.names else None
    if number is not None and stated is not None:
        raise UnreadableFile(
            f"{table.names[column]} in {stated.text}: this may be a unit of {number[1]} "
            f"{stated.text}, or the number of a column: state the unit, as --units "
            f"{number[1]}{stated.text} or --units {stated.text}"
        )


def require_known_unit(
    units: tuple[str | None, str | None], lines: Iterable[str], settings: ReadSettings
) -> None:
    """Raise an error if a file does not state a known unit but mentions one in other words.

    Raises
    ------
    UnreadableFile
        With the first line that mentions one.
    """
    mentions = find_unit_mentions(lines) if units == (None, None) and settings.units is None else ()
    if mentions:
        raise UnreadableFile(
            f"the line {mentions[0].strip()[:80]!r} mentions a unit that is not understood: "
            f"{_REMEDY}"
        )


def _find_stated_unit(table: NumberTable, column: int, axis: str) -> str | None:
    """Return the unit of a column that header and comments state; None if there is none.

    Comments are about the axis that its name names, else about `axis`, ``"x"`` or ``"height"``.
    """
    header_unit = table.units[column] if table.units else None
    role = find_role(table.names[column]) if table.names else ""
    return find_common_unit(header_unit, _select_about(table.statements, role, axis))


def find_common_unit(
    header_unit: StatedUnit | None, statements: Iterable[UnitStatement] = ()
) -> str | None:
    """Return the unit that all statements about a column agree on; None without a statement.

    Raises
    ------
    UnreadableFile
        If one is not understood, or they differ.
    """
    stated = [header_unit] if header_unit is not None else []
    stated += [statement.unit for statement in statements]
    for unit in stated:
        if unit.unit is None:
            others = (
                ", --z-unit 0.5um for heights alone, or choose other columns, --columns x,z"
                if unit is header_unit
                else ""
            )
            raise UnreadableFile(
                f"the unit {unit.text!r} is stated in it and not understood: {_REMEDY}{others}"
            )
    sizes = {find_mm_per_unit(unit.unit): unit for unit in stated if unit.unit is not None}
    if len(sizes) > 1:
        texts = " and ".join(repr(unit.text) for unit in sizes.values())
        raise UnreadableFile(f"it states two units for the same numbers, {texts}: {_REMEDY}")
    return next(iter(sizes.values())).unit if sizes else None


def add_units(
    profiles: RawProfiles, statements: Iterable[UnitStatement], settings: ReadSettings
) -> RawProfiles:
    """Return the profiles with the units that statements beside them give where they have none.

    Raises
    ------
    UnreadableFile
        As `find_common_unit`.
    """
    if settings.units is not None:
        return profiles
    statements = tuple(statements)
    x_unit, height_unit = profiles.units
    x_unit = x_unit or find_common_unit(None, select_for_axis(statements, "x"))
    height_unit = height_unit or find_common_unit(None, select_for_axis(statements, "height"))
    return replace(profiles, units=(x_unit, height_unit))


def _select_about(
    statements: Iterable[UnitStatement], role: str, default: str
) -> list[UnitStatement]:
    """Return the statements about all lengths, or about the axis of a column.

    The axis is that of its role; `default` if the role is not that of a coordinate.
    """
    axis = {"range": "height"}.get(role, role) if role in ("x", "y", "height", "range") else default
    return select_for_axis(statements, axis)


def select_for_axis(statements: Iterable[UnitStatement], axis: str) -> list[UnitStatement]:
    """Return the statements about all lengths, or about ``"x"``, ``"y"`` or ``"height"``."""
    return [s for s in statements if s.axis in (None, axis)]
