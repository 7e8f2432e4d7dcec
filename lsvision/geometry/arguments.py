"""Conversion of arguments (arrays, lists, data frames, numbers) to read-only arrays and floats."""

import math
import os
from typing import Any

import numpy as np

from lsvision.geometry.arrays import FloatArray, as_readonly_array

X_COLUMNS = ("x", "x_mm")
"""Names of a data frame's column along the laser line, in any case."""
Y_COLUMNS = ("z", "z_mm", "height", "height_mm", "y", "y_mm")
"""Names of a data frame's column of heights towards the sensor, in any case; the first one that is
there is used, since y beside another height is a position of the section."""


def as_section_points(values: Any) -> FloatArray:
    """Return points of one section as a read-only (n, 2) float64 array.

    Parameters
    ----------
    values : array_like or data frame
        Numbers (n, 2): array, list, or masked array, whose masked values are lost. Of a data
        frame (pandas, polars) the columns x and z (or y, or height, each with or without ``_mm``),
        or its two columns if their labels are integers. Units: mm, y towards the sensor.

    Raises
    ------
    TypeError
        If the values are not a table of numbers.
    ValueError
        If the shape is not (n, 2), or a data frame does not have these columns, or besides z or
        height a column y that varies, as of several profiles.

    Examples
    --------
    >>> as_section_points([[0, -400], [1, -401]]).shape
    (2, 2)
    >>> as_section_points([[0, 1, 2], [-400, -401, -402]])
    Traceback (most recent call last):
    ...
    ValueError: expected points of shape (n, 2), got (2, 3): transpose them
    """
    table = (
        values
        if type(values) is np.ndarray and values.dtype == float
        else _convert_to_table(values)
    )
    if table.ndim != 2 or table.shape[1] != 2:
        raise ValueError(
            f"expected points of shape (n, 2), got {table.shape}{_suggest_shape(table.shape)}"
        )
    return as_readonly_array(table, ("n", 2), "points")


def as_number_or_pair(
    value: Any, name: str, unit: str, pair: str
) -> float | tuple[float, float] | None:
    """Return a number as float, two numbers as a tuple of floats, and None as None.

    For messages, `name` and `unit` are those of the argument, `pair` the names of two numbers, such
    as ``"(min, max)"``.

    Raises
    ------
    TypeError
        If the value is not a number or a sequence of numbers.
    ValueError
        If there are not one or two numbers.

    Examples
    --------
    >>> as_number_or_pair([20, 30], "radius", "mm", "(min, max)")
    (20.0, 30.0)
    """
    if value is None:
        return None
    expected = f"expected {name} as a number or {pair} in {unit}"
    numbers = _to_floats(value)
    if numbers is None:
        raise TypeError(f"{expected}, got {_format_value(value)}")
    if numbers.ndim == 0:
        return float(numbers)
    if numbers.shape != (2,):
        raise ValueError(f"{expected}, got {_format_value(value)}")
    return float(numbers[0]), float(numbers[1])


def as_numbers(value: Any, count: int, expected: str) -> tuple[float, ...]:
    """Return a sequence of so many numbers, such as a pair, as a tuple of floats.

    Messages name what was `expected`, such as ``"jump_mm (smallest, largest) in mm"``.

    Raises
    ------
    ValueError
        If it is not a sequence of `count` numbers.

    Examples
    --------
    >>> as_numbers([2, 12], 2, "jump_mm (smallest, largest) in mm")
    (2.0, 12.0)
    >>> as_numbers((1,), 2, "jump_mm (smallest, largest) in mm")
    Traceback (most recent call last):
    ...
    ValueError: expected jump_mm (smallest, largest) in mm, got (1,)
    """
    numbers = _to_floats(value)
    if value is None or numbers is None or numbers.shape != (count,):
        text = repr(value)
        raise ValueError(
            f"expected {expected}, got {text if len(text) < 80 else _format_value(value)}"
        )
    return tuple(numbers.tolist())


def as_known_phi(value: Any) -> float | tuple[float, float] | None:
    """Return a known tilt, or (tilt, std), in rad, after a check that it is not in deg.

    Raises
    ------
    TypeError
        If it is neither a number nor a pair.
    ValueError
        If the tilt or its std is pi / 2 or more.

    Examples
    --------
    >>> as_known_phi(20)
    Traceback (most recent call last):
    ...
    ValueError: expected known_phi from 0 to below pi/2 rad, got 20: convert degrees by \
math.radians(20) = 0.349
    """
    known = as_number_or_pair(value, "known_phi", "rad", "(phi, std)")
    if known is None:
        return None
    numbers = known if isinstance(known, tuple) else (known,)
    for number_name, number in zip(("known_phi", "the std of known_phi"), numbers, strict=False):
        if number >= math.pi / 2:
            raise ValueError(
                f"expected {number_name} from 0 to below pi/2 rad, got {number:g}: convert "
                f"degrees by math.radians({number:g}) = {math.radians(number):.3g}"
            )
    return known


def _convert_to_table(values: Any) -> FloatArray:
    """Return an array, list, masked array or data frame as a float array; lost points are NaN."""
    if isinstance(values, str | bytes | os.PathLike):
        raise TypeError(
            f"expected points as an (n, 2) array in mm, got {values!r}: files are read by "
            "lsvision.read_profile"
        )
    if hasattr(values, "columns") and hasattr(values, "to_numpy"):
        return _select_columns(values)
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.asarray(values, dtype=np.float64).filled(np.nan)
    table = _to_floats(values)
    if table is None or not table.ndim:
        raise TypeError(
            f"expected points as an (n, 2) array of numbers in mm, got {_format_value(values)}"
        )
    return table


def _to_floats(values: Any) -> FloatArray | None:
    """Return numbers as a float array, missing ones as NaN; None if they are not numbers."""
    try:
        # Text, booleans, complex numbers and dates could be converted, too, but are mistakes.
        is_numeric = np.asarray(values).dtype.kind in "fiuO"
        return np.asarray(values, dtype=np.float64) if is_numeric else None
    except (TypeError, ValueError):
        return None


def _select_columns(frame: Any) -> FloatArray:
    """Return the columns x and height of a data frame; raise the errors of `as_section_points`."""
    labels = list(frame.columns)
    # Reversed, so that the first one of several labels with the same name is used.
    by_name = {str(label).strip().lower(): label for label in reversed(labels)}
    x = next((by_name[name] for name in X_COLUMNS if name in by_name), None)
    heights = [by_name[name] for name in Y_COLUMNS if name in by_name]
    if x is None and len(labels) == 2 and all(isinstance(label, int) for label in labels):
        x, heights = labels[0], [labels[1]]
    if x is None or not heights:
        named = ", ".join(map(str, labels)) or "none"
        raise ValueError(
            f"expected a data frame with columns x and z (or y) in mm, z towards the sensor, got "
            f"{named}: rename or convert them, as "
            "frame.assign(x=..., z=-frame['range'])[['x', 'z']]"
        )
    if len(heights) > 1 and _has_several_values(frame[heights[1]]):
        raise ValueError(
            f"expected one profile, got columns {x}, {heights[1]}, {heights[0]} with several "
            f"values of {heights[1]}: pass one profile at a time, or frame[[{x!r}, {heights[0]!r}]]"
        )
    positions, values = _to_floats(frame[x]), _to_floats(frame[heights[0]])
    if positions is None or values is None:
        raise TypeError(
            f"expected numbers in mm in the columns {x} and {heights[0]}, got other values: "
            "convert them, and mark lost points by NaN"
        )
    return np.column_stack([positions, values])


def _has_several_values(column: Any) -> bool:
    """Return whether a column of a data frame has other values than one number and NaN."""
    values = _to_floats(column)
    return values is None or len(np.unique(values[~np.isnan(values)])) > 1


def _suggest_shape(shape: tuple[int, ...]) -> str:
    """Return the remedy for points of a wrong shape, for the end of a message; may be empty."""
    if len(shape) != 2:
        return ""
    if shape[0] == 2:
        return ": transpose them"
    if shape[1] == 3:
        return ": take x and height alone, as points[:, [0, 2]]"
    return ""


def _format_value(value: Any) -> str:
    """Return a value as text for a message: short values completely, others by type and shape."""
    text = repr(value)
    if len(text) <= 40 and "\n" not in text:
        return f"{type(value).__name__} {text}"
    shape = np.shape(value) if isinstance(value, np.ndarray) else None
    if shape is not None:
        return f"an array of shape {shape} and type {value.dtype}"
    size = f" of {len(value)}" if hasattr(value, "__len__") else ""
    return f"{type(value).__name__}{size}"
