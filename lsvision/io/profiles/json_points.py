"""Points in JSON: lists under names, pairs, objects, matrices of OpenCV, ROS LaserScan."""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.files.json_text import NestedTooDeep, parse_json
from lsvision.geometry import FloatArray
from lsvision.io.profiles.column_roles import column_role, has_known_role
from lsvision.io.profiles.columns import profiles_from_table
from lsvision.io.profiles.laser_scan import is_laser_scan, profiles_from_scans
from lsvision.io.profiles.matrix import is_monotonic, profiles_from_matrix
from lsvision.io.profiles.named_columns import profiles_from_named
from lsvision.io.profiles.number_rows import POINT_NUMBER, is_missing
from lsvision.io.profiles.opencv_matrix import TRIPLES, matrix_of_node, table_of_points
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.stated_units import common_unit, require_known_unit
from lsvision.io.profiles.text_table import TextTable, decode_text
from lsvision.io.profiles.unit_statements import (
    UnitStatement,
    find_lost_values,
    find_unit_statements,
)
from lsvision.io.profiles.units import split_label

MAX_DEPTH = 4
"""Number of levels of objects and lists that are searched for points."""
MIN_PAIRS, MIN_TRIPLES = 3, 5
"""Smallest number of rows of a list of points; a shorter list is a matrix or a size."""
# Keys of flat lists of points; keys of the columns' names; keys that may hold points, best first.
_FLAT_KEYS = ("points", "profile", TRIPLES, "line")
_NAME_KEYS = ("columns", "names", "header", "fields", "labels")
_POINT_KEYS = ("points", "profile", TRIPLES, "line", "data", "profiles", "scans")
_OPENCV_NUMBER = re.compile(
    r"(?<![\w.\"])([-+]?)\.(nan|inf)\b|(?<=[0-9])\.(?=[\s,\]}e])", re.IGNORECASE
)
_LINES_OF_OBJECTS = re.compile(r"\}[^\S\n]*\n\s*\{")
_EXPECTED_KEYS = 'expected {"x": [...], "z": [...]} or {"points": [[x, z], ...]}'


def read_json(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of a JSON file, or of one with one object per line.

    Raises
    ------
    UnreadableFile
        If it is not JSON, or no points are found in it; the error names the keys found.
    """
    return profiles_from_document(_parse(decode_text(content)), settings, "JSON")


def profiles_from_document(document: Any, settings: ReadSettings, kind: str) -> RawProfiles:
    """Return the profiles in the content of a JSON or YAML file.

    Parameters
    ----------
    document : mapping or list
        Result of `parse_json`.
    settings : ReadSettings
        Reading options.
    kind : str
        Kind of file, for messages.

    Raises
    ------
    UnreadableFile
        If no points are found; the error names the keys found.
    """
    profiles = _find_profiles(document, settings, depth=0)
    if profiles is None:
        raise UnreadableFile(
            f"{kind} without a list of points ({_describe_contents(document)}): {_EXPECTED_KEYS}"
        )
    if isinstance(document, Mapping):
        require_known_unit(profiles.units, _statement_lines(document), settings)
        stated = find_lost_values(
            f"{key}: {value}" for key, value in document.items() if isinstance(value, int | float)
        )
        profiles = replace(profiles, lost=profiles.lost + stated)
    return profiles


def _parse(text: str) -> Any:
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
    try:  # cv2.FileStorage writes .Nan and 1. into its JSON
        return parse_json(_OPENCV_NUMBER.sub(_plain_number, text), allow_nan=True)
    except ValueError:
        raise UnreadableFile(
            f"JSON that cannot be parsed ({reason[:80]}): write it again"
        ) from None


def _plain_number(match: re.Match[str]) -> str:
    """Return a number of OpenCV's JSON as JSON has it."""
    if match[2] is None:
        return ".0"
    return "NaN" if match[2].lower() == "nan" else f"{match[1].replace('+', '')}Infinity"


def _find_profiles(document: Any, settings: ReadSettings, depth: int) -> RawProfiles | None:
    """Return the profiles in an object or a list at a nesting depth; None if there are none."""
    if depth > MAX_DEPTH:
        return None
    if isinstance(document, Mapping):
        return _from_object(document, settings, depth)
    if isinstance(document, list) and document:
        return _from_list(document, settings, depth)
    return None


def _from_object(
    document: Mapping[str, Any], settings: ReadSettings, depth: int
) -> RawProfiles | None:
    if is_laser_scan(document):
        return profiles_from_scans([document])
    statements = find_unit_statements(_statement_lines(document))
    columns = {key: values for key, value in document.items() if (values := _column(value))}
    roles = {column_role(split_label(key)[0]) for key in columns}
    if "x" in roles and roles & {"height", "range", "y"}:
        named = {k: v for k, v in columns.items() if has_known_role(split_label(k)[0])}
        arrays = {key: _arrays(value) for key, value in named.items()}
        return profiles_from_named(arrays, settings, statements)
    if settings.dx is not None and len(columns) == 1 and roles & {"height", "range"}:
        rows = _floats(next(iter(columns.values())))
        return profiles_from_matrix(TextTable(np.atleast_2d(rows), statements=statements), settings)
    table = _named_rows(document, statements) or _opencv_matrix(document, statements)
    if table is not None:
        return profiles_from_table(table, settings)
    lists = {k: v for k, v in document.items() if isinstance(v, list | Mapping)}
    for key in sorted(lists, key=_key_rank):
        profiles = _from_named_list(key, lists[key], settings, statements, depth)
        if profiles is not None:
            return profiles
    return None


def _from_named_list(
    key: str,
    value: Any,
    settings: ReadSettings,
    statements: tuple[UnitStatement, ...],
    depth: int,
) -> RawProfiles | None:
    """Return the profiles under a key; of a flat list only if the key is a name of points."""
    if isinstance(value, list) and _column(value) and not isinstance(value[0], list):
        if key.lower() not in _FLAT_KEYS:
            return None
        return _from_flat(key.lower(), _floats(value), settings, statements)
    profiles = _find_profiles(value, settings, depth + 1)
    if profiles is None or profiles.units != (None, None) or settings.units is not None:
        return profiles
    unit = common_unit(None, [s for s in statements if s.axis is None])
    return replace(profiles, units=(unit, unit))


def _from_list(document: list[Any], settings: ReadSettings, depth: int) -> RawProfiles | None:
    if all(isinstance(item, Mapping) for item in document):
        return _from_objects(document, settings, depth)
    widths = {len(item) for item in document if _is_pair(item)}
    if len(widths) == 1 and all(map(_is_pair, document)):
        if len(document) < (MIN_TRIPLES if widths == {3} else MIN_PAIRS):
            return None
        return _from_rows(_floats(document), settings, ())
    if len(document) == 2 and _column(document) and _are_x_and_height(document):
        return _from_rows(_floats(document).T, settings, ())
    if all(isinstance(item, list) and item for item in document):
        item_profiles = [_find_profiles(item, settings, depth + 1) for item in document]
        return _join_profiles(item_profiles)
    return None


def _are_x_and_height(document: list[Any]) -> bool:
    """Return whether two lists of numbers have equal length, and the first is monotonic."""
    first, second = document
    if not isinstance(first, list) or len(first) != len(second) or len(first) <= MIN_PAIRS:
        return False
    return is_monotonic(_floats(first))


def _from_objects(
    document: Sequence[Mapping[str, Any]], settings: ReadSettings, depth: int
) -> RawProfiles | None:
    """Return profiles of a list of points as objects, or of profiles as objects."""
    if all(map(is_laser_scan, document)):
        return profiles_from_scans(document)
    keys = list(document[0])
    scalar = [
        key for key in keys if not any(isinstance(i.get(key), list | Mapping) for i in document)
    ]
    roles = {column_role(split_label(key)[0]) for key in scalar}
    if "x" in roles and roles & {"height", "range", "y"}:
        table = _table_of_objects(document, scalar)
        return profiles_from_table(table, settings)
    item_profiles = [_find_profiles(item, settings, depth + 1) for item in document]
    profiles = _join_profiles(item_profiles)
    if profiles is None:
        return None
    attributes = [
        {key: item[key] for key in keys if isinstance(item.get(key), str | int | float)}
        for item in document
    ]
    one_profile_per_object = len(profiles.sections) == len(document) and any(attributes)
    return replace(profiles, attributes=tuple(attributes)) if one_profile_per_object else profiles


def _table_of_objects(document: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> TextTable:
    labels = [split_label(key) for key in keys]
    texts: dict[int, list[str]] = {}
    values = np.full((len(document), len(keys)), np.nan)
    for column, key in enumerate(keys):
        cells = [item.get(key) for item in document]
        if not all(map(_is_scalar, cells)):
            texts[column] = [str(cell) for cell in cells]
        else:
            values[:, column] = _floats(cells)
    return TextTable(
        values, tuple(name for name, _ in labels), tuple(unit for _, unit in labels), texts=texts
    )


def _join_profiles(items: Sequence[RawProfiles | None]) -> RawProfiles | None:
    """Return all profiles in one; None if one is missing, or units or directions differ."""
    profiles = [item for item in items if item is not None]
    if len(profiles) < len(items) or len({(item.units, item.away) for item in profiles}) != 1:
        return None
    return replace(profiles[0], sections=[xz for item in profiles for xz in item.sections])


def _from_flat(
    key: str, values: FloatArray, settings: ReadSettings, statements: tuple[UnitStatement, ...]
) -> RawProfiles:
    """Return the points of a flat list; with ``dx`` it has only heights."""
    table = TextTable(values.reshape(1, -1), statements=statements)
    if settings.dx is not None:
        return profiles_from_matrix(table, settings)
    width = flat_width(key, values)
    if width is None:
        raise UnreadableFile(
            f"{values.size} numbers under {key!r} are neither pairs x, z nor triples x, y, z with "
            f"rising x: {_EXPECTED_KEYS}, or for heights alone give --x0 and --dx"
        )
    return _from_rows(values.reshape(-1, width), settings, statements)


def flat_width(key: str, values: FloatArray) -> int | None:
    """Return how many numbers of a flat list are one point; None if it has no points.

    Parameters
    ----------
    key : str
        Key of the matrix; ``scan_line`` holds triples.
    values : (n,) ndarray
        The numbers.
    """
    if key == TRIPLES and values.size % 3 == 0:
        return 3
    for width in (3, 2):
        if values.size % width == 0 and values.size >= 3 * width:
            rows = values.reshape(-1, width)
            flat = width == 2 or len(np.unique(rows[np.isfinite(rows[:, 1]), 1])) <= 1
            if flat and is_monotonic(rows[:, 0]):
                return width
    return None


def _from_rows(
    rows: FloatArray, settings: ReadSettings, statements: tuple[UnitStatement, ...]
) -> RawProfiles:
    return profiles_from_table(_table_of_rows(rows, statements), settings)


def _table_of_rows(rows: FloatArray, statements: tuple[UnitStatement, ...]) -> TextTable:
    """Return rows of two or three numbers, or two or three rows, under their usual names."""
    if rows.shape[1] > rows.shape[0] and rows.shape[0] in (2, 3):
        rows = rows.T
    names = {2: ("x", "z"), 3: ("x", "y", "z")}.get(rows.shape[1], ())
    return TextTable(rows, names, (None,) * rows.shape[1], statements)


def _named_rows(
    document: Mapping[str, Any], statements: tuple[UnitStatement, ...]
) -> TextTable | None:
    """Return rows of numbers with a list of their columns' names."""
    for key, labels in document.items():
        if key.lower() not in _NAME_KEYS or not isinstance(labels, list) or len(labels) < 2:
            continue
        parsed = [split_label(str(label)) for label in labels]
        for value in document.values():
            if value is labels or not (rows := _column(value)) or not isinstance(rows[0], list):
                continue
            if all(len(row) == len(labels) for row in rows):
                names, units = zip(*parsed, strict=True)
                return TextTable(_floats(rows), names, units, statements)
    return None


def _opencv_matrix(
    document: Mapping[str, Any], statements: tuple[UnitStatement, ...]
) -> TextTable | None:
    if document.get("type_id") not in ("opencv-matrix", "opencv-nd-matrix"):
        return None
    return replace(
        table_of_points("", np.squeeze(matrix_of_node("", document))), statements=statements
    )


def _statement_lines(document: Mapping[str, Any]) -> Iterator[str]:
    for key, value in document.items():
        if isinstance(value, str):
            yield f"{key}: {value}"
        elif isinstance(value, Mapping) and "unit" in key.lower():
            yield from (f"unit_{axis}: {unit}" for axis, unit in value.items())
        elif isinstance(value, Mapping):
            yield from (f"{name}: {text}" for name, text in value.items() if isinstance(text, str))
            yield from (
                line
                for name, inner in value.items()
                if isinstance(inner, Mapping) and "unit" in name.lower()
                for line in _statement_lines({name: inner})
            )
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{key}: {value}"
        elif isinstance(value, list) and "unit" in key.lower():
            yield f"{key}: {', '.join(map(str, value))}"


def _column(value: Any) -> Any:
    """Return the value if it is a list of numbers, or of lists of numbers; else None.

    An object with the keys 0, 1, 2, ... is a list: pandas writes columns like that.
    """
    if isinstance(value, Mapping) and list(value) == [str(k) for k in range(len(value))]:
        value = list(value.values())
    if not isinstance(value, list) or not value:
        return None
    if all(_is_scalar(item) for item in value):
        return value
    lists = all(isinstance(v, list) and v and all(_is_scalar(c) for c in v) for v in value)
    return value if lists else None


def _arrays(value: Any) -> Any:
    return [_floats(row) for row in value] if isinstance(value[0], list) else _floats(value)


def _floats(value: Any) -> FloatArray:
    try:
        array = np.array(_with_nan(value), dtype=np.float64)
    except (ValueError, TypeError, OverflowError):
        raise UnreadableFile("a list of points with text in it: write numbers, or null") from None
    array[np.isinf(array)] = np.nan
    return array


def _with_nan(value: Any) -> Any:
    if isinstance(value, list):
        return [_with_nan(item) for item in value]
    if value is None or (isinstance(value, str) and is_missing(value)):
        return float("nan")
    return value


def _is_scalar(value: Any) -> bool:
    if isinstance(value, str):
        return is_missing(value) or bool(POINT_NUMBER.fullmatch(value.strip()))
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def _is_pair(value: Any) -> bool:
    return isinstance(value, list) and len(value) in (2, 3) and all(map(_is_scalar, value))


def _key_rank(key: str) -> int:
    word = key.lower()
    return _POINT_KEYS.index(word) if word in _POINT_KEYS else len(_POINT_KEYS)


def _describe_contents(document: Any) -> str:
    if isinstance(document, Mapping):
        keys = ", ".join(map(str, list(document)[:12]))
        return f"its keys are {keys or 'none'}"
    kind = type(document).__name__
    return f"a {kind} of {len(document)}" if isinstance(document, list) else f"a {kind}"
