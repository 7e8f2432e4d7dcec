"""Array types, and validated read-only copies of arrays."""

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
Points = FloatArray
"""(n, 2) or (n, 3) points, one per row. Units: mm."""
TINY = 1e-300
"""Smallest divisor, which prevents division by zero."""


def as_readonly_array(
    values: npt.ArrayLike, shape: tuple[int | str, ...], name: str = "array"
) -> FloatArray:
    """Return a read-only float64 copy of an array after checking its shape.

    Parameters
    ----------
    values : array_like
        Array to copy.
    shape : tuple
        Expected shape; a string stands for any length, as in ``("n", 2)``.
    name : str
        Name of the array in the error message.

    Returns
    -------
    ndarray
        Writing to it raises an error.

    Raises
    ------
    ValueError
        If the shape differs from the expected one.

    Examples
    --------
    >>> as_readonly_array([[1, 2]], ("n", 2)).flags.writeable
    False
    """
    array = np.array(values, dtype=np.float64)
    matches = array.ndim == len(shape) and all(
        isinstance(length, str) or length == got
        for length, got in zip(shape, array.shape, strict=True)
    )
    if not matches:
        expected = ", ".join(str(length) for length in shape)
        raise ValueError(f"expected {name} of shape ({expected}), got {array.shape}")
    array.setflags(write=False)
    return array


def extent_of(points: Points) -> float:
    """Return the longest side of the bounding box of points; 0 without points.

    Parameters
    ----------
    points : (n, d) ndarray
        Without NaN; the result has the same unit.
    """
    # One column at a time, because numpy reduces a contiguous axis ten times faster.
    return max(
        (float(column.max() - column.min()) for column in points.T if len(column)), default=0.0
    )
