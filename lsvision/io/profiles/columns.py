"""Which columns of a table are x and height, and whether a third one tells profiles apart."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray, IntArray
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.text_table import TextTable

_ROLES = {
    **dict.fromkeys(["x", "xs", "px", "pos_x", "x_pos", "position", "lateral"], "x"),
    **dict.fromkeys(["y", "ys", "py", "travel", "encoder"], "y"),
    **dict.fromkeys(["z", "zs", "pz", "height", "heights", "elevation", "höhe"], "height"),
    **dict.fromkeys(["range", "ranges", "distance", "distances", "dist", "abstand"], "range"),
    **dict.fromkeys(["angle", "angles", "azimuth", "alpha", "theta", "phi"], "angle"),
    **dict.fromkeys(["scan", "profile", "frame", "scan_number", "profile_number"], "scan"),
}
_FEWEST_PER_PROFILE = 5  # points: fewer make no ellipse, so a key that splits finer is no key
_CONSTANT = 1e-6  # spread of a column that does not vary, relative to that of the widest


@dataclass(frozen=True)
class _Choice:
    """Columns of x, height and, where there is one, of what tells profiles apart."""

    x: int
    height: int
    key: int | None = None
    away: bool = False
    travel: bool = True  # the key is a place along the travel, not a number of the profile
    notes: tuple[str, ...] = ()


def profiles_from_table(table: TextTable, settings: ReadSettings) -> RawProfiles:
    """Profiles in a table of points, one point a row.

    Named columns are taken by their names; unnamed ones by position: two are x and height;
    of three or more the second is left out where it is constant and tells profiles apart where each
    of its values stands in one run of points; otherwise the third must be whole numbers (a label).

    Raises
    ------
    UnreadableFile
        If the columns cannot be told, or those asked for are not there.
    """
    choice = _requested_columns(table, settings) or _named(table) or _placed(table)
    points = table.values[:, [choice.x, choice.height]]
    units = table.units or (None,) * table.values.shape[1]
    sections: Sequence[FloatArray] = [points]
    positions = None
    if choice.key is not None:
        key = table.values[:, choice.key]
        key = _without_gaps(key)
        rows = _split_by(key)
        sections = [points[r] for r in rows]
        positions = tuple(float(key[r][0]) for r in rows) if choice.travel else None
    return RawProfiles(
        sections=sections,
        units=(units[choice.x], units[choice.height]),
        away=choice.away,
        positions=positions,
        notes=choice.notes,
    )


def column_role(name: str) -> str:
    """What a column of this name holds: x, y, height, range, scan, angle, or the name itself."""
    return _ROLES.get(name, name)


def _requested_columns(table: TextTable, settings: ReadSettings) -> _Choice | None:
    if settings.columns is None:
        return None
    indices = [_index(table, column) for column in settings.columns]
    away = bool(table.names) and _ROLES.get(table.names[indices[-1]]) == "range"
    key = indices[1] if len(indices) == 3 else None
    return _Choice(indices[0], indices[-1], key, away)


def _index(table: TextTable, column: int | str) -> int:
    width = table.values.shape[1]
    if isinstance(column, int):
        if column < width:
            return column
        raise UnreadableFile(f"no column {column} in it: want 0 to {width - 1}, see --columns")
    if column.lower() in table.names:
        return table.names.index(column.lower())
    has = ", ".join(table.names) or "no names"
    raise UnreadableFile(f"no column named {column!r} in it (it has {has}): see --columns")


def _named(table: TextTable) -> _Choice | None:
    place: dict[str, int] = {}
    for index, name in enumerate(table.names):
        place.setdefault(column_role(name), index)
    away = "range" in place and "height" not in place
    in_order = [place[role] for role in ("x", "y", "range" if away else "height") if role in place]
    if "angle" in place and "x" not in place:
        raise UnreadableFile("an angle and no x among its columns: convert it to x and height")
    if len(in_order) < 2:
        return None
    if len(in_order) == 2 or "scan" in place:
        return _Choice(in_order[0], in_order[-1], place.get("scan"), away, travel=False)
    x, y, height = in_order
    values = table.values[:, in_order]
    in_plane = _in_plane(values)
    if in_plane:
        return _Choice(x, in_order[in_plane.height], away=away, notes=in_plane.notes)
    if not _is_profile_key(table.values[:, y]):
        _refuse(table, y)
    return _Choice(x, height, y, away)


def _placed(table: TextTable) -> _Choice:
    values = table.values
    width = values.shape[1]
    if width == 1:
        raise UnreadableFile(
            "one column in it: want x and height, or say where the heights lie with --x0 and --dx"
        )
    if width == 2:
        said = " and ".join(table.names)
        return _Choice(0, 1, notes=(f"{said} taken for x and height",) if said else ())
    notes = (f"no column is named: columns 0, 1 and 2 of {width} looked at",)
    in_plane = _in_plane(values[:, :3])
    if in_plane:
        return _Choice(0, in_plane.height, notes=notes + in_plane.notes)
    if _whole(values[:, 2]) and not _whole(values[:, 1]) and not _is_profile_key(values[:, 1]):
        return _Choice(0, 1, notes=(*notes, "column 2 is whole numbers: taken for a label"))
    if not _is_profile_key(values[:, 1]):
        _refuse(table, 1)
    return _Choice(0, 2, 1, notes=notes)


def _in_plane(xyz: FloatArray) -> _Choice | None:
    """The choice where y, or else z, is the same for all points."""
    spread = [_spread(column) for column in xyz.T]
    if spread[1] <= _CONSTANT * max(spread):
        return _Choice(0, 2)
    if spread[2] <= _CONSTANT * max(spread):
        return _Choice(0, 1, notes=("z does not vary: x and y taken for the profile",))
    return None


def _refuse(table: TextTable, key: int) -> NoReturn:
    name = table.names[key] if table.names else str(key)
    values = len(np.unique(table.values[:, key]))
    raise UnreadableFile(
        f"column {name} tells no profiles apart ({values} values in {len(table.values)} points): "
        "say which columns are x and height with --columns"
    )


def _spread(column: FloatArray) -> float:
    known = column[np.isfinite(column)]
    return float(known.max() - known.min()) if len(known) else 0.0


def _whole(column: FloatArray) -> bool:
    known = column[np.isfinite(column)]
    return bool(np.all(known == np.round(known)))


def _is_profile_key(column: FloatArray) -> bool:
    """True where each value stands in one run of points, long enough for a profile."""
    key = _without_gaps(column)
    runs = 1 + np.count_nonzero(np.diff(key))
    return bool(runs == len(np.unique(key)) and runs * _FEWEST_PER_PROFILE <= len(key))


def _split_by(key: FloatArray) -> list[IntArray]:
    """Rows of each profile, in the order in which profiles begin."""
    _, starts, group = np.unique(key, return_index=True, return_inverse=True)
    order = np.argsort(starts)
    by_group = np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])
    return [by_group[g] for g in order]


def _without_gaps(key: FloatArray) -> FloatArray:
    """The key with that of the point before where a point is lost, key and all."""
    known = np.isfinite(key)
    rows = np.where(known, np.arange(len(key)), np.argmax(known))
    return np.where(known.any(), key[np.maximum.accumulate(rows)], 0.0)
