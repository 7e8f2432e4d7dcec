"""Entries of a JSON or YAML object: statements on units and lost points, and attributes."""

from collections.abc import Iterator, Mapping
from typing import Any

from lsvision.io.profiles.unit_statements import find_lost_values, states_unit


def lines_on_units(document: Mapping[str, Any]) -> Iterator[str]:
    """Yield lines ``key: value`` that may state a unit, from the entries and their sub-entries."""
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
                for line in lines_on_units({name: inner})
            )
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{key}: {value}"
        elif isinstance(value, list) and "unit" in key.lower():
            yield f"{key}: {', '.join(map(str, value))}"


def lines_of_scalars(document: Mapping[str, Any]) -> Iterator[str]:
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
