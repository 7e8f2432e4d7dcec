"""Equality of frozen dataclasses that hold arrays."""

from collections.abc import Hashable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


class ComparedByValue:
    """Equality and hash of a frozen dataclass by its fields, arrays element by element.

    The ``==`` of a dataclass compares tuples of fields, which fails for arrays. Here two values are
    equal if they are of the same class and all their fields are equal: arrays of the same shape
    and numbers (NaN is equal to NaN: a lost point), dataclasses by their fields. Fields
    declared with ``field(compare=False)`` are ignored. Equal values have equal hashes.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, eq=False)
    ... class Points(ComparedByValue):
    ...     xy: np.ndarray
    >>> Points(np.array([0.0, np.nan])) == Points(np.array([0.0, np.nan]))
    True
    >>> len({Points(np.zeros(2)), Points(np.zeros(2)), Points(np.ones(2))})
    2
    """

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return _are_equal(self, other)

    def __hash__(self) -> int:
        return hash(_make_hashable(self))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copied or pickled value, whose arrays are then read-only again."""
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)


def _are_equal(first: Any, second: Any) -> bool:
    """Return whether two values are equal; see `ComparedByValue`."""
    if type(first) is not type(second):
        is_array = isinstance(first, np.ndarray) or isinstance(second, np.ndarray)
        return not is_array and bool(first == second)
    if isinstance(first, np.ndarray):
        return np.array_equal(first, second, equal_nan=first.dtype.kind in "fc")
    if is_dataclass(first):
        return _are_equal(_list_field_values(first), _list_field_values(second))
    if isinstance(first, tuple):
        return len(first) == len(second) and all(map(_are_equal, first, second))
    if isinstance(first, Mapping):
        return first.keys() == second.keys() and all(
            _are_equal(first[key], second[key]) for key in first
        )
    return bool(first == second) or (first != first and second != second)  # noqa: PLR0124 - NaN


def _make_hashable(value: Any) -> Hashable:
    """Return a hashable representation; equal for equal values."""
    if isinstance(value, np.ndarray):
        # -0.0 and 0.0, and NaN of different bits, are equal but differ in their bytes.
        return value.shape, (np.nan_to_num(value.astype(np.complex128)) + 0.0).tobytes()
    if is_dataclass(value):
        return type(value).__name__, _make_hashable(_list_field_values(value))
    if isinstance(value, tuple):
        return tuple(map(_make_hashable, value))
    if isinstance(value, Mapping):
        return frozenset((key, _make_hashable(item)) for key, item in value.items())
    return "NaN" if value != value else value  # noqa: PLR0124


def _list_field_values(value: Any) -> tuple[Any, ...]:
    """Return the values of the fields of a dataclass that are compared."""
    return tuple(getattr(value, field.name) for field in fields(value) if field.compare)
