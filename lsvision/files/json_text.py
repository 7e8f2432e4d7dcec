"""Untrusted JSON: limited depth, errors in one line, NaN and infinity only on request."""

import json
from typing import Any, NoReturn

MAX_DEPTH = 64
"""Deepest nesting in JSON, YAML and XML: a limit against abuse, far below that of the recursion of
Python. The package's own files need 7."""

MAX_DIGITS = 300
"""Largest number of digits of an integer, so that it fits into a float (up to 1.8e308)."""


class NestedTooDeep(ValueError):
    """Error of a text with more than `MAX_DEPTH` levels of nesting."""

    def __init__(self) -> None:
        super().__init__(f"expected at most {MAX_DEPTH} levels of nesting, got more")


def parse_json(text: str, *, allow_nan: bool = False) -> Any:
    """Return the value of a JSON text, in which every integer fits into a float.

    `allow_nan` accepts ``NaN`` and ``Infinity``, as measured points may contain.

    Raises
    ------
    NestedTooDeep
        If the text nests deeper than `MAX_DEPTH`.
    ValueError
        If the text is not JSON, or contains a key twice in one object, an integer of more than
        `MAX_DIGITS` digits, a number beyond the range of a double, or, without `allow_nan`,
        ``NaN`` or ``Infinity``.

    Examples
    --------
    >>> parse_json('{"x": [1, 2.5]}')
    {'x': [1, 2.5]}
    """
    try:
        value = json.loads(
            text,
            parse_constant=float if allow_nan else _reject_constant,
            parse_int=_parse_integer,
            parse_float=_parse_number,
            object_pairs_hook=_build_mapping,
        )
        _check_depth(value)
    except RecursionError:
        raise NestedTooDeep from None
    return value


def _check_depth(value: Any) -> None:
    """Raise NestedTooDeep if a value has more than `MAX_DEPTH` levels of lists and mappings."""
    containers = [value] if isinstance(value, dict | list) else []
    for _ in range(MAX_DEPTH):
        containers = [
            child
            for parent in containers
            for child in (parent.values() if isinstance(parent, dict) else parent)
            if isinstance(child, dict | list)
        ]
    if containers:
        raise NestedTooDeep


def _build_mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the pairs of an object as a dict; raise ValueError if a key occurs twice."""
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        keys = [key for key, _ in pairs]
        repeated_key = next(key for key in mapping if keys.count(key) > 1)
        raise ValueError(f"expected each key once, got {repeated_key[:40]!r} twice in one object")
    return mapping


def _reject_constant(constant: str) -> NoReturn:
    raise ValueError(f"expected finite numbers, got {constant}")


def _parse_number(digits: str) -> float:
    number = float(digits)
    if number in (float("inf"), float("-inf")):
        raise ValueError(f"expected numbers below 1.8e308, got {digits[:20]}")
    return number


def _parse_integer(text: str) -> int:
    count = len(text.removeprefix("-"))
    if count > MAX_DIGITS:
        raise ValueError(f"expected integers of at most {MAX_DIGITS} digits, got one of {count}")
    return int(text)
