"""Mistakes in a job file, each with its line and the remedy.

`tomllib` does not return positions; therefore the line of a key is searched in the text: a key is
at the beginning of a line, below the header of its table. A style-preserving parser (tomlkit) would
be one more dependency, and does not return line numbers either.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ValidationError

from lsvision.inspection.limits import UNITS

Location = tuple[str | int, ...]
"""Keys and indices from the root of the job to a value, as pydantic reports them."""

# Header of a table or of a table in a list, and "key =", each at the beginning of a line; position
# in a message of tomllib.
_HEADER = re.compile(r"\s*(\[\[?)\s*([^\[\]#]+?)\s*\]")
_KEY = re.compile(r"\s*([A-Za-z0-9_.\"'-]+(?:\s*\.\s*[A-Za-z0-9_\"'-]+)*)\s*=")
_POSITION = re.compile(r"\s*\(at line (\d+), column \d+\)")
_VARIANT = re.compile(r"(float|int|str|Limits|constrained.*|tuple\[.*)$")
"""Names that pydantic inserts into a location for the variants of a union."""
_MAX_SHOWN_CHARACTERS = 60
"""Largest number of characters of a wrong value that a message shows."""


@dataclass(frozen=True)
class Mistake:
    """Mistake in a job file: what was expected, what was found, and the remedy.

    The line is counted from 1; None if something is missing.
    """

    line: int | None
    message: str

    def __str__(self) -> str:
        return self.message if self.line is None else f"line {self.line}: {self.message}"


class MistakesError(ValueError):
    """Mistakes in several tables, each with its `Location`."""

    def __init__(self, mistakes: Sequence[tuple[Location, str]]) -> None:
        super().__init__("; ".join(message for _, message in mistakes))
        self.mistakes = mistakes


def parse_syntax_mistake(error: tomllib.TOMLDecodeError) -> Mistake:
    """Return the mistake of a text that is not TOML."""
    message = str(error)
    position = _POSITION.search(message)
    text = _POSITION.sub("", message)
    return Mistake(
        int(position[1]) if position else None, f"not TOML: {text[:1].lower()}{text[1:]}"
    )


def describe_mistakes(error: ValidationError, text: str, model: type[BaseModel]) -> list[Mistake]:
    """Return all mistakes of a job, in the order of its lines.

    The error is that of the job's model, which has the known keys; the text is that of the file.
    """
    lines = _find_lines_of_keys(text)
    mistakes: list[Mistake] = []
    details = error.errors()
    if len(details) > 1:  # invalid parts are not counted, so that "too short" may be wrong
        details = [detail for detail in details if detail["type"] != "too_short"]
    details = [detail for detail in details if _is_of_right_variant(detail)]
    for detail in details:
        cause = detail.get("ctx", {}).get("error")
        if isinstance(cause, MistakesError):
            mistakes += [
                Mistake(_find_nearest_line(location, lines), message)
                for location, message in cause.mistakes
            ]
        else:
            location = _without_variants(detail["loc"])
            mistakes.append(
                Mistake(
                    _find_nearest_line(location, lines), _describe_mistake(location, detail, model)
                )
            )
    return sorted(dict.fromkeys(mistakes), key=lambda mistake: mistake.line or 0)


def find_line(location: Location, text: str) -> int | None:
    r"""Return the line of a key, counted from 1, or else of the innermost table around it, or None.

    Examples
    --------
    >>> find_line(("part", 1, "x_mm"), "[[part]]\nx_mm = 1\n[[part]]\nx_mm = 2")
    4
    """
    return _find_nearest_line(location, _find_lines_of_keys(text))


def _find_nearest_line(location: Location, lines: dict[Location, int]) -> int | None:
    """Return the line of a location, or else of the innermost table around it, or None."""
    for length in range(len(location), 0, -1):
        if location[:length] in lines:
            return lines[location[:length]]
    return None


def _find_lines_of_keys(text: str) -> dict[Location, int]:
    """Return the line of every table and key, counted from 1; the first line of each."""
    lines: dict[Location, int] = {}
    table: Location = ()
    counts: dict[Location, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        header, key = _HEADER.match(line), _KEY.match(line)
        if header and not key:
            table = _split_key(header[2])
            if header[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = (*table, counts[table])
            lines.setdefault(table, number)
        elif key:
            lines.setdefault((*table, *_split_key(key[1])), number)
    return lines


def _split_key(dotted: str) -> Location:
    """Return the names in a dotted key of TOML, without quotes."""
    return tuple(name.strip().strip("\"'") for name in dotted.split("."))


def _is_of_right_variant(detail: Any) -> bool:
    """Return False for the error that a list is no number, or a number no list, in their union."""
    if detail["loc"] == _without_variants(detail["loc"]):
        return True
    is_list = isinstance(detail["input"], list | tuple)
    return bool(detail["type"] != ("float_type" if is_list else "tuple_type"))


def _without_variants(location: Location) -> Location:
    """Return a location without the names that pydantic gives to variants of a union."""
    return tuple(key for key in location if not (isinstance(key, str) and _VARIANT.match(key)))


def _describe_mistake(location: Location, detail: Any, model: type[BaseModel]) -> str:
    """Return what was expected, what was found, and the remedy, with the keys of the job file."""
    key = next((name for name in reversed(location) if isinstance(name, str)), "the job")
    kind, got = detail["type"], _format_value(detail["input"])
    if kind == "missing" and isinstance(location[-1], int):
        return f"{_format_location(location[:-1])}: value {location[-1] + 1} is missing: add it"
    if kind == "missing":
        return f"{_format_location(location)} is missing: add it"
    if kind == "too_short":
        return f"expected at least one [[{_format_location(location)}]], got none: add it"
    if kind == "extra_forbidden":
        return _describe_unknown_key(key, location, _list_known_keys(location, model))
    if kind == "value_error":
        return f"{_format_location(location)}: {detail['ctx']['error']}"
    return (
        f"{_format_location(location)}: expected {_describe_expected(location, detail)}, got {got}"
    )


def _describe_expected(location: Location, detail: Any) -> str:
    """Return what was expected, in the words of TOML."""
    kind, limits = detail["type"], detail.get("ctx", {})
    if kind == "tuple_type":
        return "a list" if len(location) > 1 else f"tables [[{location[0]}]]"
    if kind in ("model_type", "dict_type"):
        return "a table"
    if kind == "too_long":
        return f"{limits['max_length']} values"
    if kind == "string_too_short":
        return f"a text of at least {limits['min_length']} character"
    if kind == "string_too_long":
        return f"a text of at most {limits['max_length']} characters"
    message: str = detail["msg"]
    return message.removeprefix("Input should be ").removeprefix("a valid ")


def _format_location(location: Location) -> str:
    """Return a location as text, such as ``part 1, radius_mm``; tables of a list count from 1."""
    keys: list[str] = []
    for key in location:
        if isinstance(key, int) and keys:
            keys[-1] += f" {key + 1}"
        else:
            keys.append(str(key))
    return ", ".join(keys) or "the job"


def _describe_unknown_key(key: str, location: Location, known: list[str]) -> str:
    """Return the message of an unknown key: the key with its unit, a similar one, or all known."""
    with_unit = [name for name in known if name in {f"{key}_{unit}" for unit in UNITS}]
    if with_unit:
        return f"{_format_location(location)}: the unit is missing: write {' or '.join(with_unit)}"
    near = difflib.get_close_matches(key, known, n=1)
    remedy = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
    return f"{_format_location(location)}: unknown key: {remedy}"


def _list_known_keys(location: Location, model: type[BaseModel]) -> list[str]:
    """Return the keys that are allowed in the table around a location; none if it is no table."""
    for key in location[:-1]:
        if isinstance(key, str):
            field = next(
                (f for name, f in model.model_fields.items() if key in (name, f.alias)), None
            )
            inner = None if field is None else _find_table_class(field.annotation)
            if inner is None:
                return []
            model = inner
    return [field.alias or name for name, field in model.model_fields.items()]


def _find_table_class(annotation: Any) -> type[BaseModel] | None:
    """Return the table class in ``Table | None`` or ``tuple[Table, ...]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in getattr(annotation, "__args__", ()):
        table = _find_table_class(argument)
        if table is not None:
            return table
    return None


def _format_value(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _MAX_SHOWN_CHARACTERS else f"{text[:_MAX_SHOWN_CHARACTERS]}..."
