"""Content of parsed JSON or YAML: numbers, statements on units and lost points, attributes."""

import re
from collections.abc import Container, Iterable, Iterator, Mapping
from itertools import chain
from typing import Any

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.number_table import POINT_NUMBER, is_missing
from lsvision.io.profiles.unit_statements import find_lost_values, states_unit
from lsvision.io.profiles.units import parse_unit

_AXES_AND_UNITS = frozenset(["x", "z", "height", "heights", "range", "unit", "units"])
"""Words of a key that say what the entries below it are about."""
_SMALL = re.compile(r"resol|accura|precis|noise|std|toler|pitch|spacing|step", re.IGNORECASE)
"""Key of small lengths below it, which are no units: ``{"resolution": {"z": "10 um"}}``."""
_MAX_AXES = 3
"""Largest number of items of a list that states something on each axis."""


def as_list_of_numbers(value: Any) -> Any:
    """Return the value if it is a list of numbers, or of lists of numbers; else None; see below."""
    value = as_list(value)
    if not isinstance(value, list) or not value:
        return None
    if all(is_scalar(item) for item in value):
        return value
    lists = all(isinstance(v, list) and v and all(is_scalar(c) for c in v) for v in value)
    return value if lists else None


def as_list(value: Any) -> Any:
    """Return an object with the keys 0, 1, 2, ..., as pandas writes columns, as a list."""
    if isinstance(value, Mapping) and list(value) == [str(k) for k in range(len(value))]:
        return list(value.values())
    return value


def to_arrays(value: Any) -> Any:
    """Return the array of a list of numbers, or the arrays of a list of lists."""
    return [to_floats(row) for row in value] if isinstance(value[0], list) else to_floats(value)


def to_floats(value: Any) -> FloatArray:
    """Return the array of a list of numbers or of lists of equal length; NaN where one is lost.

    Raises
    ------
    UnreadableFile
        If there is text in it, or its lists differ in length.
    """
    if isinstance(value, list) and value and isinstance(value[0], list):
        lengths = sorted({len(row) for row in value if isinstance(row, list)})
        if len(lengths) > 1:
            raise UnreadableFile(
                f"rows of {lengths[0]} to {lengths[-1]} numbers: write null for lost points"
            )
    try:
        array = np.array(_with_nan(value), dtype=np.float64)
    except (ValueError, TypeError, OverflowError):
        raise UnreadableFile("a list of points with text in it: write numbers, or null") from None
    array[np.isinf(array)] = np.nan
    return array


def _with_nan(value: Any) -> Any:
    """Return nested lists with NaN for null and for words for lost points, and texts as numbers."""
    if isinstance(value, list):
        return [_with_nan(item) for item in value]
    if value is None or (isinstance(value, str) and is_missing(value)):
        return float("nan")
    if isinstance(value, str) and POINT_NUMBER.fullmatch(value.strip()):
        return float(value.lower().replace("d", "e"))  # 1d3 is 1000 in Fortran
    return value


def is_scalar(value: Any) -> bool:
    """Return whether a value is a number, null, or text of a number or a word for a lost point."""
    if isinstance(value, str):
        return is_missing(value) or bool(POINT_NUMBER.fullmatch(value.strip()))
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def holds_text(values: Iterable[Any]) -> bool:
    """Return whether a text is among values: the ids "007" are no numbers."""
    return any(isinstance(value, str) for value in values)


def is_column(value: Any, lengths: Container[int]) -> bool:
    """Return whether a value is a list of texts, numbers, flags and null, of a length."""
    return (
        isinstance(value, list)
        and len(value) in lengths
        and all(item is None or isinstance(item, str | int | float) for item in value)
    )


def format_cell(value: Any) -> str:
    """Return the text of a value in a column of text; it is empty for null."""
    return "" if value is None else str(value)


def is_point(value: Any) -> bool:
    """Return whether a value is a list of two or three numbers."""
    return isinstance(value, list) and len(value) in (2, 3) and all(map(is_scalar, value))


def iterate_lines_on_units(document: Mapping[str, Any]) -> Iterator[str]:
    """Yield lines ``key: value`` that may state a unit, a scale, a direction or an offset.

    They are from the entries, also the items of short lists, and from those of objects below: texts
    and lists with their own key; numbers, units of no length, and what is below a key of units with
    all keys on the way.
    """
    for key, value in document.items():
        if isinstance(value, Mapping):
            if not as_list_of_numbers(value):
                yield from _iterate_lines_below(key, value)
        elif isinstance(value, list) and value and all(map(_is_description, value)):
            for item in value:
                described = {name: v for name, v in item.items() if name != "name"}
                yield from _iterate_lines_below(item["name"], described)
        elif isinstance(value, list) and "unit" in key.lower():
            yield f"{key}: {', '.join(map(str, value))}"
        elif isinstance(value, list) and _states_on_axes(key, value):
            yield from (f"{key}: {item}" for item in value)
        elif _is_statement(value):
            yield f"{key}: {value}"


def iterate_lines_on_direction(document: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of `iterate_lines_on_units`, and those of settings that are true or false."""
    yield from iterate_lines_on_units(document)
    below = [value.items() for value in document.values() if isinstance(value, Mapping)]
    for key, value in chain(document.items(), *below):
        if isinstance(value, bool):
            yield f"{key}: {str(value).lower()}"


def iterate_lines_of_objects(items: Iterable[Any]) -> Iterator[str]:
    """Yield the lines of `iterate_lines_on_units` of the items that are objects."""
    for item in items:
        if isinstance(item, Mapping):
            yield from iterate_lines_on_units(item)


def _iterate_lines_below(key: str, document: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of an object under a key; see `iterate_lines_on_units`."""
    for name, value in document.items():
        is_about_axis = not _AXES_AND_UNITS.isdisjoint(re.findall("[a-z]+", key.lower()))
        is_alone = isinstance(value, str | list) and not (is_about_axis or _SMALL.search(key))
        if "unit" in name.lower() and isinstance(value, str) and parse_unit(value) is None:
            is_alone = False  # "us" below "exposure"
        yield from iterate_lines_on_units({name if is_alone else f"{key} {name}": value})


def _is_description(value: Any) -> bool:
    """Return whether a value describes a column: an object with its name, and without lists."""
    return (
        isinstance(value, Mapping)
        and isinstance(value.get("name"), str)
        and not any(isinstance(v, list | Mapping) for v in value.values())
    )


def _states_on_axes(key: str, values: list[Any]) -> bool:
    """Return whether a list may state a number on each axis: an offset, or a scale with decimals.

    Whole numbers rather count or select.
    """
    return len(values) <= _MAX_AXES and all(
        isinstance(v, int | float) and ("offset" in key.lower() or v != round(v)) for v in values
    )


def _is_statement(value: Any) -> bool:
    return isinstance(value, str | int | float) and not isinstance(value, bool)


def iterate_lines_of_scalars(document: Mapping[str, Any]) -> Iterator[str]:
    """Yield lines ``key: value`` of the numbers and texts, and of the numbers in sub-objects."""
    for key, value in document.items():
        if isinstance(value, Mapping):
            yield from (f"{name}: {v}" for name, v in value.items() if isinstance(v, int | float))
        elif isinstance(value, str | int | float):
            yield f"{key}: {value}"


def find_attributes(document: Mapping[str, Any]) -> dict[str, float | str]:
    """Return the numbers and texts of an object that state neither a unit nor a lost point."""
    return {
        key: value
        for key, value in document.items()
        if isinstance(value, str | int | float)
        and not states_unit(line := f"{key}: {value}")
        and not find_lost_values([line])
    }
