"""Mistakes in a job file, each with its line and the remedy.

`tomllib` keeps no positions, so that the line of a key is looked up in the text: keys are at the
beginning of a line, below the header of their table. A style-preserving parser (tomlkit) would be
one more dependency, and does not give line numbers either.
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

_HEADER = re.compile(r"\s*(\[\[?)\s*([^\[\]#]+?)\s*\]")
_KEY = re.compile(r"\s*([A-Za-z0-9_.\"'-]+(?:\s*\.\s*[A-Za-z0-9_\"'-]+)*)\s*=")
_POSITION = re.compile(r"\s*\(at line (\d+), column \d+\)")
_VARIANT = re.compile(r"(float|int|str|Limits|constrained.*|tuple\[.*)$")
_MAX_SHOWN_CHARACTERS = 60


@dataclass(frozen=True)
class Mistake:
    """Mistake in a job file.

    Parameters
    ----------
    line : int or None
        Line of the mistake, from 1; None if something is missing.
    message : str
        What was expected, what was found, and the remedy.
    """

    line: int | None
    message: str

    def __str__(self) -> str:
        return self.message if self.line is None else f"line {self.line}: {self.message}"


class MistakesError(ValueError):
    """Mistakes in several tables, each with its location.

    Parameters
    ----------
    mistakes : sequence of (location, message)
        Location as pydantic's: keys and indices from the root.
    """

    def __init__(self, mistakes: Sequence[tuple[Location, str]]) -> None:
        super().__init__("; ".join(message for _, message in mistakes))
        self.mistakes = mistakes


def syntax_mistake(error: tomllib.TOMLDecodeError) -> Mistake:
    """Return the mistake of a text that is not TOML."""
    message = str(error)
    position = _POSITION.search(message)
    words = _POSITION.sub("", message)
    return Mistake(
        int(position[1]) if position else None, f"not TOML: {words[:1].lower()}{words[1:]}"
    )


def describe_mistakes(error: ValidationError, text: str, model: type[BaseModel]) -> list[Mistake]:
    """Return all mistakes of a job, in the order of its lines.

    Parameters
    ----------
    error : ValidationError
        Error from the validation of the job's model.
    text : str
        The file.
    model : type
        Model of the job, for the known keys.
    """
    lines = _lines_of_keys(text)
    mistakes: list[Mistake] = []
    details = error.errors()
    if len(details) > 1:  # invalid parts are not counted, so that "too short" may be wrong
        details = [detail for detail in details if detail["type"] != "too_short"]
    for detail in details:
        cause = detail.get("ctx", {}).get("error")
        if isinstance(cause, MistakesError):
            mistakes += [Mistake(_line(where, lines), message) for where, message in cause.mistakes]
        else:
            where = _without_variants(detail["loc"])
            mistakes.append(Mistake(_line(where, lines), _message(where, detail, model)))
    return sorted(dict.fromkeys(mistakes), key=lambda mistake: mistake.line or 0)


def line_of(where: Location, text: str) -> int | None:
    r"""Return the line number of a key, or of the nearest table around it; None without either.

    Examples
    --------
    >>> line_of(("part", 1, "x_mm"), "[[part]]\nx_mm = 1\n[[part]]\nx_mm = 2")
    4
    """
    return _line(where, _lines_of_keys(text))


def _line(where: Location, lines: dict[Location, int]) -> int | None:
    for length in range(len(where), 0, -1):
        if where[:length] in lines:
            return lines[where[:length]]
    return None


def _lines_of_keys(text: str) -> dict[Location, int]:
    """Return the line number of every table and key."""
    lines: dict[Location, int] = {}
    table: Location = ()
    counts: dict[Location, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        header, key = _HEADER.match(line), _KEY.match(line)
        if header and not key:
            table = _names(header[2])
            if header[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = (*table, counts[table])
            lines.setdefault(table, number)
        elif key:
            lines.setdefault((*table, *_names(key[1])), number)
    return lines


def _names(dotted: str) -> Location:
    return tuple(name.strip().strip("\"'") for name in dotted.split("."))


def _without_variants(where: Location) -> Location:
    """Return a location without the names that pydantic gives to variants of a union."""
    return tuple(part for part in where if not (isinstance(part, str) and _VARIANT.match(part)))


def _message(where: Location, detail: Any, model: type[BaseModel]) -> str:
    """Return what was expected, what was found, and the remedy, in the words of the job file."""
    key = next((str(part) for part in reversed(where) if isinstance(part, str)), "the job")
    kind, got = detail["type"], _format_value(detail["input"])
    if kind == "missing":
        return f"{_path(where)} is missing: add it"
    if kind == "too_short":
        return f"expected at least one [[{_path(where)}]], got none: add it"
    if kind == "extra_forbidden":
        return _unknown_key(key, where, known_keys(where, model))
    if kind == "value_error":
        return f"{_path(where)}: {detail['ctx']['error']}"
    words = detail["msg"].removeprefix("Input should be ").removeprefix("a valid ")
    return f"{_path(where)}: expected {words}, got {got}"


def _path(where: Location) -> str:
    """Return a location as text, such as ``part 1, radius_mm``; tables of a list count from 1."""
    words: list[str] = []
    for part in where:
        if isinstance(part, int) and words:
            words[-1] += f" {part + 1}"
        else:
            words.append(str(part))
    return ", ".join(words) or "the job"


def _unknown_key(key: str, where: Location, known: list[str]) -> str:
    with_unit = [name for name in known if name in {f"{key}_{unit}" for unit in UNITS}]
    if with_unit:
        return f"{_path(where)}: the unit is missing: write {' or '.join(with_unit)}"
    near = difflib.get_close_matches(key, known, n=1)
    remedy = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
    return f"{_path(where)}: unknown key: {remedy}"


def known_keys(where: Location, model: type[BaseModel]) -> list[str]:
    """Return the keys that are allowed in the table around a location."""
    for part in where[:-1]:
        if isinstance(part, str):
            field = next(
                (f for name, f in model.model_fields.items() if part in (name, f.alias)), None
            )
            inner = None if field is None else _model_in(field.annotation)
            if inner is None:
                return []
            model = inner
    return [field.alias or name for name, field in model.model_fields.items()]


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """Return the table class in ``Table | None`` or ``tuple[Table, ...]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for part in getattr(annotation, "__args__", ()):
        found = _model_in(part)
        if found is not None:
            return found
    return None


def _format_value(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _MAX_SHOWN_CHARACTERS else f"{text[:_MAX_SHOWN_CHARACTERS]}..."
