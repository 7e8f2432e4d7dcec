"""Array types, and validated read-only copies of arrays."""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

Item = TypeVar("Item")
Output = TypeVar("Output")
Stack = TypeVar("Stack", bound=tuple[Any, ...])

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
Points = FloatArray
"""(n, 2) or (n, 3) points, one per row. Units: mm."""
TINY = 1e-300
"""Smallest divisor, which prevents division by zero."""
MAX_SIZE_RATIO = 3
"""Largest ratio of the sizes of arrays that are stacked together. With 3, profiles of welded pipes
in clutter are measured fastest: smaller groups have more overhead, larger ones more padding."""


def pad_rows(sizes: Sequence[int]) -> tuple[IntArray, BoolArray]:
    """Return indices (k, n) that arrange k concatenated arrays of up to n elements as rows.

    `sizes` are the numbers of elements of the arrays, at least one each. Shorter arrays are
    extended by their last element; the second result (k, n) is False where an element is such an
    extension.

    Examples
    --------
    >>> indices, valid = pad_rows([3, 1])
    >>> indices.tolist(), valid.sum(axis=1).tolist()
    ([[0, 1, 2], [3, 3, 3]], [3, 1])
    """
    columns = np.arange(max(sizes))
    counts = np.array(sizes)[:, None]
    starts = counts.cumsum()[:, None] - counts
    return starts + np.minimum(columns, counts - 1), columns < counts


def stack_padded(arrays: Sequence[npt.NDArray[Any]], indices: IntArray) -> npt.NDArray[Any]:
    """Stack k arrays of up to n elements as (k, n), with the indices of `pad_rows`.

    Examples
    --------
    >>> arrays = [np.array([1, 2, 3]), np.array([4])]
    >>> stack_padded(arrays, pad_rows([3, 1])[0]).tolist()
    [[1, 2, 3], [4, 4, 4]]
    """
    return np.concatenate(arrays).take(indices)


def stack_with_mask(
    arrays: Sequence[npt.NDArray[Any]],
) -> tuple[npt.NDArray[Any], BoolArray | None]:
    """Stack k arrays of up to n elements as (k, n), and return the mask (k, n) of valid elements.

    Elements are valid unless they only extend a shorter array. The mask of a single array is None,
    because all of its elements are valid.

    Examples
    --------
    >>> stacked, valid = stack_with_mask([np.array([1, 2, 3]), np.array([4])])
    >>> stacked.tolist(), valid.sum(axis=1).tolist()
    ([[1, 2, 3], [4, 4, 4]], [3, 1])
    """
    if len(arrays) == 1:
        return arrays[0][None], None
    indices, valid = pad_rows([len(array) for array in arrays])
    return stack_padded(arrays, indices), valid


def select_rows(stack: Stack, rows: BoolArray | IntArray | list[int]) -> Stack:
    """Return some rows of all arrays and lists of a tuple or named tuple, and of tuples in it.

    Fields of another type, such as numbers, are the same for all rows and are returned unchanged.

    Examples
    --------
    >>> select_rows((np.array([1, 2, 3]), ["a", "b", "c"], 7), np.array([True, False, True]))
    (array([1, 3]), ['a', 'c'], 7)
    """
    indices: Any = rows
    if isinstance(rows, np.ndarray) and rows.dtype == bool:
        indices = rows.nonzero()  # once instead of for each field

    def select(field: Any) -> Any:
        if isinstance(field, tuple):
            return select_rows(field, indices)
        if isinstance(field, list):
            return [field[index] for index in np.arange(len(field))[indices].tolist()]
        return field[indices] if hasattr(field, "__getitem__") else field

    fields = map(select, stack)
    return type(stack)(*fields) if hasattr(stack, "_fields") else type(stack)(fields)


def apply_in_groups(
    step: Callable[[list[Item]], Iterable[Output]],
    items: Sequence[Item],
    sizes: Sequence[int],
    max_elements: int,
) -> list[Output]:
    """Apply a function that stacks the arrays of its items to groups of items of similar size.

    `step` returns one result for each item of a list, `sizes` are the numbers of array elements of
    the items, and `max_elements` is the largest number of a group, padding included; a larger item
    is a group of its own. The results are in the order of `items`.

    Examples
    --------
    >>> apply_in_groups(lambda group: [len(group)] * len(group), "abcd", [300, 10, 400, 12], 1000)
    [2, 2, 2, 2]
    """
    groups: list[list[int]] = []
    for index in sorted(range(len(items)), key=lambda index: sizes[index]):
        size, group = sizes[index], groups[-1] if groups else []
        similar = bool(group) and size <= MAX_SIZE_RATIO * sizes[group[0]]
        if similar and size * (len(group) + 1) <= max_elements:
            group.append(index)
        else:
            groups.append([index])
    results: dict[int, Output] = {}
    for group in groups:
        results |= zip(group, step([items[index] for index in group]), strict=True)
    return [results[index] for index in range(len(items))]


def as_column(values: Sequence[Any]) -> Any:
    """Return k numbers as a column (k, 1), which broadcasts over rows; a single one as a scalar.

    With a scalar, numpy is faster than with a column.

    Examples
    --------
    >>> as_column([2.0]), as_column([2.0, 3.0]).tolist()
    (2.0, [[2.0], [3.0]])
    """
    return values[0] if len(values) == 1 else np.array(values)[:, None]


def as_readonly_array(
    values: npt.ArrayLike, shape: tuple[int | str, ...], name: str = "array"
) -> FloatArray:
    """Return a read-only float64 copy of an array after checking its shape.

    In `shape`, a string means any length, as in ``("n", 2)``; `name` is that of the array in the
    error message.

    Raises
    ------
    TypeError, ValueError
        If the shape differs from the expected one, or a value is not a number.

    Examples
    --------
    >>> as_readonly_array([[1, 2]], ("n", 2)).flags.writeable
    False
    """
    array = np.array(values, dtype=np.float64)
    matches = array.ndim == len(shape) and all(
        isinstance(length, str) or length == actual
        for length, actual in zip(shape, array.shape, strict=True)
    )
    if not matches:
        expected = ", ".join(str(length) for length in shape)
        raise ValueError(f"expected {name} of shape ({expected}), got {array.shape}")
    array.setflags(write=False)
    return array


def freeze_arrays(instance: object, **shapes: tuple[int | str, ...]) -> None:
    """Replace fields of a frozen dataclass by the results of `as_readonly_array`.

    `shapes` are the shapes that it checks, by the names of the fields, which errors state.
    """
    for name, shape in shapes.items():
        object.__setattr__(instance, name, as_readonly_array(getattr(instance, name), shape, name))


def as_unit_vector(values: npt.ArrayLike, name: str) -> tuple[FloatArray, float]:
    """Return the read-only unit vector (3,) along a vector (3,), and the vector's length.

    The message of an error states the `name`.

    Raises
    ------
    ValueError
        If the shape is not (3,), or the length is zero or not finite.
    """
    vector = as_readonly_array(values, (3,), name)
    length = math.hypot(*vector.tolist())  # without overflow or underflow of the squares
    if not 0 < length < np.inf:
        raise ValueError(f"expected a finite, non-zero {name}, got {vector}")
    return as_readonly_array(vector / length, (3,)), length


def rms(values: FloatArray) -> float:
    """Return the root mean square of an array."""
    return float(np.sqrt(np.mean(np.square(values))))


def measure_extent(points: Points) -> float:
    """Return the longest side of the bounding box of finite points (n, d); 0 without points."""
    # One column at a time is faster than a reduction of the first axis.
    return max(
        (float(column.max() - column.min()) for column in points.T if len(column)), default=0.0
    )


MAX_COORDINATE_MM = 1e9
"""Largest coordinate of a valid point, a thousand kilometres: its square is rounded to about 100
mm^2, so that fits to larger coordinates lose their accuracy. Units: mm."""
MAX_VARIANCE_MM2 = MAX_COORDINATE_MM**2
"""Largest variance of a point. Units: mm^2."""
_MIN_VARIANCE_MM2 = 1 / MAX_VARIANCE_MM2
"""Variance below which a covariance counts as zero. Units: mm^2."""
PSD_TOLERANCE = 1e-9
"""Largest asymmetry, and largest negative eigenvalue, of a covariance that count as rounding
errors; relative to its largest element."""


def require_coordinates(points: Points) -> None:
    """Raise an error if points (n, d) in mm are not finite or too far away for a fit.

    Raises
    ------
    ValueError
        If a coordinate is NaN, infinite or larger than `MAX_COORDINATE_MM`.
    """
    if not (np.abs(points) <= MAX_COORDINATE_MM).all():
        raise ValueError(
            f"expected finite coordinates within {MAX_COORDINATE_MM:g} mm, got "
            f"{float(np.abs(points).max()):g}: leave lost points out, check the units"
        )


def require_covariances(covariances: FloatArray) -> None:
    """Raise an error if matrices (n, k, k) in mm^2 are not covariances of points.

    Raises
    ------
    ValueError
        If a matrix is not finite, not symmetric or zero, or has a negative eigenvalue or an element
        above `MAX_VARIANCE_MM2`.
    """
    if not (np.abs(covariances) <= MAX_VARIANCE_MM2).all():
        raise ValueError(
            f"expected finite covariances up to {MAX_VARIANCE_MM2:g} mm^2, got "
            f"{float(np.abs(covariances).max()):g}: check the units"
        )
    if not len(covariances):
        return
    largest = np.abs(covariances).max(axis=(1, 2))
    asymmetry = np.abs(covariances - covariances.swapaxes(1, 2)).max(axis=(1, 2))
    smallest_eigenvalue = np.linalg.eigvalsh(covariances)[:, 0]
    is_invalid = (largest < _MIN_VARIANCE_MM2) | (asymmetry > PSD_TOLERANCE * largest)
    is_invalid |= smallest_eigenvalue < -PSD_TOLERANCE * largest
    if is_invalid.any():
        index = int(np.argmax(is_invalid))
        raise ValueError(
            "expected symmetric positive semi-definite covariances other than zero, got "
            f"{covariances[index].tolist()} for point {index}"
        )
