"""Array types, and the one way a frozen value takes an array into its keeping."""

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
Points = FloatArray
"""(n, 2) or (n, 3) points, one a row. Units: mm."""


def as_readonly_array(
    values: npt.ArrayLike, shape: tuple[int | str, ...], name: str = "array"
) -> FloatArray:
    """Copy of an array as read-only float64, its shape checked.

    Parameters
    ----------
    values : array_like
        Numbers.
    shape : tuple
        Wanted shape; a string stands for any length, as in ``("n", 2)``.
    name : str
        What the message calls the array.

    Returns
    -------
    ndarray
        A copy that refuses writing.

    Raises
    ------
    ValueError
        If the shape is another one.

    Examples
    --------
    >>> as_readonly_array([[1, 2]], ("n", 2)).flags.writeable
    False
    """
    array = np.array(values, dtype=np.float64)
    fits = array.ndim == len(shape) and all(
        isinstance(want, str) or want == got for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join(str(length) for length in shape)
        raise ValueError(f"want {name} of shape ({wanted}), got {array.shape}")
    array.setflags(write=False)
    return array


def extent_of(points: Points) -> float:
    """Longest side of the points' bounding box; 0 without points. Units: as theirs.

    Parameters
    ----------
    points : (n, d) ndarray
        Without NaN.
    """
    # A column at a time: numpy reduces along the long axis ten times as fast.
    return max(
        (float(column.max() - column.min()) for column in points.T if len(column)), default=0.0
    )
