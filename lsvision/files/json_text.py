"""Untrusted JSON: limited depth, errors in one line, no NaN or infinity."""

import json
from typing import Any, NoReturn

MAX_DEPTH = 64
"""Deepest nesting of lists and mappings; the package's own files need 7."""


class NestedTooDeep(ValueError):
    """A text that nests deeper than `MAX_DEPTH`."""

    def __init__(self) -> None:
        super().__init__(f"expected at most {MAX_DEPTH} levels of nesting, got more")


def parse_json(text: str, *, allow_nan: bool = False) -> Any:
    """Return the value of a JSON text.

    Parameters
    ----------
    text : str
        The whole text.
    allow_nan : bool
        Accept ``NaN`` and ``Infinity``, as measured points may contain.

    Returns
    -------
    object
        Mappings, lists, strings, numbers, True, False and None. Every integer fits into a float.

    Raises
    ------
    NestedTooDeep
        If the text nests deeper than `MAX_DEPTH`.
    ValueError
        If the text is not JSON, or holds a key twice in one object, a number beyond double
        precision, ``NaN`` or ``Infinity``.

    Examples
    --------
    >>> parse_json('{"x": [1, 2.5]}')
    {'x': [1, 2.5]}
    """
    try:
        value = json.loads(
            text,
            parse_constant=float if allow_nan else _reject_constant,
            parse_int=_integer,
            parse_float=_number,
            object_pairs_hook=_mapping,
        )
        _check_depth(value)
    except RecursionError:
        raise NestedTooDeep from None
    return value


def _check_depth(value: Any) -> None:
    level = [value]
    for _ in range(MAX_DEPTH + 1):
        level = [
            child
            for parent in level
            if isinstance(parent, dict | list)
            for child in (parent.values() if isinstance(parent, dict) else parent)
        ]
        if not level:
            return
    raise NestedTooDeep


def _mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in mapping if keys.count(key) > 1)
        raise ValueError(f"expected each key once, got {twice[:40]!r} twice in one object")
    return mapping


def _reject_constant(word: str) -> NoReturn:
    raise ValueError(f"expected finite numbers, got {word}")


def _number(digits: str) -> float:
    number = float(digits)
    if number in (float("inf"), float("-inf")):
        raise ValueError(f"expected numbers below 1.8e308, got {digits[:20]}")
    return number


def _integer(digits: str) -> int | float:
    if len(digits) > 300:
        raise ValueError(f"expected numbers below 1.8e308, got one of {len(digits)} digits")
    return int(digits)
