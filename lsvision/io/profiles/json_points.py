"""Points in JSON: lists under names, pairs, objects, matrices of OpenCV, ROS LaserScan."""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.files.json_text import NestedTooDeep, parse_json
from lsvision.geometry import FloatArray
from lsvision.io.profiles.column_roles import find_role, is_coordinate, names_section
from lsvision.io.profiles.columns import profiles_from_table
from lsvision.io.profiles.joined_profiles import add_attributes, build_empty_profile, join_profiles
from lsvision.io.profiles.json_values import (
    as_list,
    as_list_of_numbers,
    find_attributes,
    format_cell,
    holds_text,
    is_column,
    is_point,
    is_scalar,
    iterate_lines_of_objects,
    iterate_lines_of_scalars,
    iterate_lines_on_direction,
    iterate_lines_on_units,
    to_arrays,
    to_floats,
)
from lsvision.io.profiles.laser_scan import is_laser_scan, profiles_from_scans
from lsvision.io.profiles.matrix import is_monotonic, profiles_from_matrix
from lsvision.io.profiles.named_columns import profiles_from_named
from lsvision.io.profiles.number_table import NumberTable
from lsvision.io.profiles.opencv_storage import (
    MIN_PAIRS,
    TRIPLES,
    find_flat_width,
    matrix_from_node,
    parse_opencv_json,
    table_from_points,
)
from lsvision.io.profiles.pose_documents import reject_pose_document
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.stated_heights import add_direction
from lsvision.io.profiles.stated_positions import read_with_stated_positions
from lsvision.io.profiles.stated_units import add_units, require_known_unit
from lsvision.io.profiles.text_encoding import decode_text
from lsvision.io.profiles.unit_statements import (
    UnitStatement,
    find_lost_values,
    find_unit_statements,
)
from lsvision.io.profiles.units import split_label
from lsvision.io.profiles.validity import note_unused_flags

MIN_TRIPLES = 5
"""Smallest number of rows x, y, z of a list of points; a shorter list of threes is a matrix, such
as a rotation (3, 3) or the (4, 3) of three directions and a position."""
_FLAT_KEYS = ("points", "profile", TRIPLES, "line")
"""Keys whose flat list of numbers is a list of points."""
_POINT_KEYS = (*_FLAT_KEYS, "data", "profiles", "scans")
"""Keys that are searched first for points, best first."""
_NAME_KEYS = ("columns", "names", "header", "fields", "labels")
"""Keys of the columns' names."""
_LINES_OF_OBJECTS = re.compile(r"\}[^\S\n]*\n\s*\{")
"""End of an object and start of the next: JSON with one object per line."""
_EXPECTED_KEYS = 'expected {"x": [...], "z": [...]} or {"points": [[x, z], ...]}'
"""What an error message asks for."""


def read_json(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of a JSON file, or of one with one object per line.

    Raises
    ------
    UnreadableFile
        If it is not JSON, or no points are found in it; the error names the keys found.
    """
    return profiles_from_document(_parse(decode_text(content)), settings, "JSON")


def profiles_from_document(document: Any, settings: ReadSettings, kind: str) -> RawProfiles:
    """Return the profiles in the parsed content of a JSON or YAML file; `kind` is for messages.

    Raises
    ------
    UnreadableFile
        If no points are found; the error names the keys found.
    """
    items = document if isinstance(document, list) else [document]
    lines = partial(iterate_lines_of_objects, items)
    profiles = read_with_stated_positions(
        partial(_require_profiles, document, kind), lines, settings
    )
    require_known_unit(profiles.units, lines(), settings)
    return profiles


def _require_profiles(document: Any, kind: str, settings: ReadSettings) -> RawProfiles:
    profiles = _find_profiles(document, settings)
    if profiles is None:
        reject_pose_document(document)
        raise UnreadableFile(
            f"{kind} without a list of points ({_describe_contents(document)}): {_EXPECTED_KEYS}"
        )
    return profiles


def _parse(text: str) -> Any:
    """Return the content of a text: JSON, one object per line, or JSON as OpenCV writes it."""
    text = text.strip()
    if _LINES_OF_OBJECTS.search(text) and text.startswith("{"):
        lines = [line for line in text.splitlines() if line.strip()]
        with suppress(ValueError):
            return [parse_json(line, allow_nan=True) for line in lines]
    try:
        return parse_json(text, allow_nan=True)
    except NestedTooDeep as error:
        raise UnreadableFile(
            f"JSON nested too deep for points ({error}): {_EXPECTED_KEYS}"
        ) from None
    except ValueError as error:
        reason = str(error)
    try:
        return parse_opencv_json(text)
    except ValueError:
        raise UnreadableFile(
            f"JSON that cannot be parsed ({reason[:80]}): write it again"
        ) from None


def _find_profiles(document: Any, settings: ReadSettings) -> RawProfiles | None:
    """Return the profiles in an object or a list; None if there are none.

    The parsers limit the depth of nesting (`MAX_DEPTH`).
    """
    if isinstance(document, Mapping):
        profiles = _from_object(document, settings)
        if profiles is None:
            return None
        lost = find_lost_values(iterate_lines_of_scalars(document))
        profiles = add_direction(profiles, iterate_lines_on_direction(document), settings)
        profiles = replace(profiles, lost=profiles.lost + lost)
        is_format = is_laser_scan(document) or "type_id" in document  # numbers on the points
        return profiles if is_format else add_attributes(profiles, find_attributes(document))
    if isinstance(document, list) and document:
        return _from_list(document, settings)
    return None


def _from_object(document: Mapping[str, Any], settings: ReadSettings) -> RawProfiles | None:
    """Return the profiles of an object; None if it has none.

    An object is a LaserScan, columns with known names, a list of heights if ``settings.dx`` gives
    their spacing, rows with a list of the columns' names, or a matrix of OpenCV; otherwise its
    entries are searched, those with `_POINT_KEYS` first.
    """
    if is_laser_scan(document):
        return profiles_from_scans([document])
    statements = find_unit_statements(iterate_lines_on_units(document))
    columns = {
        key: values for key, value in document.items() if (values := as_list_of_numbers(value))
    }
    names = [split_label(key)[0] for key in columns]
    if names_section(names):
        return _from_columns(document, columns, settings, statements)
    lengths = {name: key for name, key in zip(names, columns, strict=True) if is_coordinate(name)}
    if settings.dx is not None and len(lengths) == 1 and "x" not in map(find_role, lengths):
        (key,) = lengths.values()
        rows = np.atleast_2d(to_floats(columns[key]))
        heights = profiles_from_matrix(NumberTable.of_heights(rows, key, statements), settings)
        return replace(heights, ignored=tuple(column for column in columns if column != key))
    table = _read_named_rows(document, statements) or _read_opencv_matrix(document, statements)
    if table is not None:
        return profiles_from_table(table, settings)
    lists = {k: v for k, v in document.items() if isinstance(v, list | Mapping)}
    keys = sorted(lists, key=_rank_key)
    for index, key in enumerate(keys):
        profiles = _from_named_list(key, lists[key], settings, statements)
        if profiles is not None:
            others = [k for k in keys[index + 1 :] if _has_points(lists[k], settings)]
            note = f"points under {key} read, those under {', '.join(others)} left out"
            return replace(profiles, notes=(*profiles.notes, note)) if others else profiles
    return None


def _has_points(value: Any, settings: ReadSettings) -> bool:
    """Return whether profiles are found in a list or an object."""
    with suppress(UnreadableFile):
        return _find_profiles(value, settings) is not None
    return False


def _from_columns(
    document: Mapping[str, Any],
    columns: Mapping[str, Any],
    settings: ReadSettings,
    statements: tuple[UnitStatement, ...],
) -> RawProfiles:
    """Return the profiles of lists of coordinates, and of lists that are as long as these."""
    document = {key: as_list(value) for key, value in document.items()}
    known = {key: values for key, values in columns.items() if is_coordinate(split_label(key)[0])}
    columns = {k: v for k, v in columns.items() if k in known or not holds_text(v)}
    lengths = set(map(len, known.values()))
    arrays = {k: to_arrays(v) for k, v in columns.items() if k in known or len(v) in lengths}
    # Flags, such as of valid points, and texts: they are no numbers of `columns`.
    others = {k: v for k, v in document.items() if k not in columns and is_column(v, lengths)}
    flags = {k: v for k, v in others.items() if all(isinstance(item, bool) for item in v)}
    arrays |= {key: to_floats(value) for key, value in flags.items()}
    texts = {key: list(map(format_cell, others[key])) for key in others if key not in flags}
    profiles = profiles_from_named(arrays, settings, statements, texts)
    lists = {key for key, value in document.items() if isinstance(value, list)}
    notes = note_unused_flags(sorted(lists - arrays.keys() - texts.keys()))
    return replace(profiles, notes=profiles.notes + notes)


def _from_named_list(
    key: str,
    value: Any,
    settings: ReadSettings,
    statements: tuple[UnitStatement, ...],
) -> RawProfiles | None:
    """Return the profiles under a key; of a flat list only if the key is a name of points."""
    if isinstance(value, list) and as_list_of_numbers(value) and not isinstance(value[0], list):
        if key.lower() not in _FLAT_KEYS:
            return None
        return _from_flat(key.lower(), to_floats(value), settings, statements)
    profiles = _find_profiles(value, settings)
    return None if profiles is None else add_units(profiles, statements, settings)


def _from_list(document: list[Any], settings: ReadSettings) -> RawProfiles | None:
    """Return the profiles of a list; None if it has none.

    A list holds objects, points of two or three numbers, one list of x and one of heights, or
    profiles.
    """
    if all(isinstance(item, Mapping) for item in document):
        return _from_objects(document, settings)
    widths = {len(item) for item in document if is_point(item)}
    if len(widths) == 1 and all(map(is_point, document)):
        if len(document) < (MIN_TRIPLES if widths == {3} else MIN_PAIRS):
            return None
        return _from_rows(to_floats(document), settings, ())
    if len(document) == 2 and as_list_of_numbers(document) and _are_x_and_height(document):
        return _from_rows(to_floats(document).T, settings, ())
    if all(item is None or isinstance(item, list | Mapping) for item in document):
        return _profiles_from_items(document, settings)
    return None


def _are_x_and_height(document: list[Any]) -> bool:
    """Return whether two lists of numbers have equal length, and the first is monotonic."""
    first, second = document
    return isinstance(first, list) and len(first) == len(second) and is_monotonic(to_floats(first))


def _from_objects(
    document: Sequence[Mapping[str, Any]], settings: ReadSettings
) -> RawProfiles | None:
    """Return profiles of a list of points as objects, or of profiles as objects."""
    if all(map(is_laser_scan, document)):
        return profiles_from_scans(document)
    keys = list(dict.fromkeys(chain(*document)))
    scalar_keys = [
        key
        for key in keys
        if not any(isinstance(item.get(key), list | Mapping) for item in document)
    ]
    if names_section(split_label(key)[0] for key in scalar_keys):
        nested = [key for key in keys if key not in scalar_keys]
        flat = [{**item, **_list_flags(item, nested)} for item in document] if nested else document
        flags = [key for key in dict.fromkeys(chain(*flat)) if key not in keys]
        return profiles_from_table(_table_from_objects(flat, [*scalar_keys, *flags]), settings)
    return _profiles_from_items(document, settings)


def _list_flags(item: Mapping[str, Any], keys: Sequence[str]) -> dict[str, Any]:
    """Return the numbers, texts and flags in the objects under some keys of a point."""
    return {
        f"{key} {name}": value
        for key in keys
        if isinstance(item.get(key), Mapping)
        for name, value in item[key].items()
        if not isinstance(value, list | Mapping)
    }


def _table_from_objects(document: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> NumberTable:
    """Return the table of a list of points, each an object with the keys as its columns."""
    labels = [split_label(key) for key in keys]
    texts: dict[int, list[str]] = {}
    values = np.full((len(document), len(keys)), np.nan)
    for column, key in enumerate(keys):
        cells = [item.get(key) for item in document]
        is_id = holds_text(cells) and not is_coordinate(labels[column][0])
        if is_id or not all(map(is_scalar, cells)):
            texts[column] = list(map(format_cell, cells))
        else:
            values[:, column] = to_floats(cells)
    return NumberTable(
        values, tuple(name for name, _ in labels), tuple(unit for _, unit in labels), texts=texts
    )


def _profiles_from_items(items: Sequence[Any], settings: ReadSettings) -> RawProfiles | None:
    """Return the profiles of all items of a list; None if one has none: it is no list of profiles.

    An item with empty lists, or null, in place of its points is a profile without points.
    """
    parts = []
    for item in items:
        profiles = _find_profiles(item, settings)
        if profiles is None and not _is_without_points(item):
            return None
        attributes = find_attributes(item) if isinstance(item, Mapping) else {}
        parts.append(profiles or add_attributes(build_empty_profile(), attributes))
    return None if all(map(_is_without_points, items)) else join_profiles(parts)


def _is_without_points(item: Any) -> bool:
    """Return whether an item is null or empty, or an object whose x and heights are."""
    if not isinstance(item, Mapping):
        return item is None or item == []
    empty = [key for key, value in item.items() if value is None or value == []]
    return names_section(split_label(key)[0] for key in empty) or any(
        key.lower() in _FLAT_KEYS for key in empty
    )


def _from_flat(
    key: str, values: FloatArray, settings: ReadSettings, statements: tuple[UnitStatement, ...]
) -> RawProfiles:
    """Return the profile of a flat list of points, or of heights alone if ``dx`` is given."""
    table = NumberTable(values.reshape(1, -1), statements=statements)
    if settings.dx is not None:
        return profiles_from_matrix(table, settings)
    width = find_flat_width(key, values)
    if width is None:
        raise UnreadableFile(
            f"{values.size} numbers under {key!r} are neither pairs x, z nor triples x, y, z with "
            f"rising x: {_EXPECTED_KEYS}, or for heights alone give --x0 and --dx"
        )
    return _from_rows(values.reshape(-1, width), settings, statements)


def _from_rows(
    rows: FloatArray, settings: ReadSettings, statements: tuple[UnitStatement, ...]
) -> RawProfiles:
    """Return the profiles of rows (n, 2) x, z or (n, 3) x, y, z."""
    return profiles_from_table(NumberTable.of_points(rows, statements), settings)


def _read_named_rows(
    document: Mapping[str, Any], statements: tuple[UnitStatement, ...]
) -> NumberTable | None:
    """Return the table of a list of rows of numbers and a list of their names; else None."""
    for key, labels in document.items():
        if key.lower() not in _NAME_KEYS or not isinstance(labels, list) or len(labels) < 2:
            continue
        for value in document.values():
            rows = value if isinstance(value, list) and value is not labels else []
            if rows and all(isinstance(r, list) and len(r) == len(labels) for r in rows):
                names = list(map(str, labels))
                objects = [dict(zip(names, row, strict=True)) for row in rows]
                return replace(_table_from_objects(objects, names), statements=statements)
    return None


def _read_opencv_matrix(
    document: Mapping[str, Any], statements: tuple[UnitStatement, ...]
) -> NumberTable | None:
    if document.get("type_id") not in ("opencv-matrix", "opencv-nd-matrix"):
        return None
    return replace(
        table_from_points("", np.squeeze(matrix_from_node("", document))), statements=statements
    )


def _rank_key(key: str) -> int:
    """Return the rank of a key in the search for points; `_POINT_KEYS` come first."""
    word = key.lower()
    return _POINT_KEYS.index(word) if word in _POINT_KEYS else len(_POINT_KEYS)


def _describe_contents(document: Any) -> str:
    if isinstance(document, Mapping):
        keys = ", ".join(map(str, list(document)[:12]))
        return f"its keys are {keys or 'none'}"
    kind = type(document).__name__
    return f"a {kind} of {len(document)}" if isinstance(document, list) else f"a {kind}"
