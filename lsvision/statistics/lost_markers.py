"""Detection of marker values, which sensors write in place of lost points."""

from collections.abc import Sequence

import numpy as np

from lsvision.geometry import FloatArray, IntArray

MIN_OTHER_VALUES = 5
"""Smallest number of values that are no markers; their span is the unit of a marker's distance."""
MAX_MARKERS_PER_SIDE = 3
"""Largest number of different markers below the other values, and above them."""
MIN_REPEATS = 3
"""Smallest number of repetitions of a marker other than the common marker values."""
MIN_MULTIPLICITY_RATIO = 2.5
"""Smallest ratio of the repetitions of a marker to the mean repetitions of the other values:
rounded heights and planes without noise repeat, too."""
MIN_LIMIT_GAP, MIN_KNOWN_GAP, MIN_ZERO_GAP, MIN_UNKNOWN_GAP = 0.1, 1.0, 2.0, 4.0
"""Smallest distance of a marker from the nearest other value, in spans of the other values: for the
limit of an integer type, a value such as -9999, 0, and any other value (a floor without noise
under a pipe is 3 spans from it)."""
_BITS = (15, 16, 23, 24, 31, 32)
"""Sizes of the integer types (with and without sign) in which sensors store distances; the limits
of 64 bits are beyond `_HUGE`."""
_LIMITS = frozenset(
    limit
    for k in _BITS
    for limit in (2.0**k, 2.0**k - 1, -(2.0**k), -(2.0**k - 1))
    if abs(limit) > 32000
)
"""Limits of these types."""
_HUGE = 1e15
"""Size from which a value is a marker in any unit."""


def find_lost_markers(
    values: FloatArray,
    *,
    limits: Sequence[float] = (),
    is_range: bool = False,
    known_only: bool = False,
) -> tuple[float, ...]:
    """Return the values that look like markers of lost points: far from the others, and repeated.

    Parameters
    ----------
    values : (n,) ndarray
        One coordinate of all points, in the units of the file; NaN is ignored.
    limits : sequence of float
        Smallest and largest number of the type in which the values were stored.
    is_range : bool
        True for distances from the sensor: 0 and less are not distances, and the largest may be
        the end of the sensor's range.
    known_only : bool
        Return common marker values only, not others that are merely repeated.

    Returns
    -------
    tuple of float
        Markers, ascending.

    Examples
    --------
    >>> heights = np.array([-170.1, -170.3, -999.9999, -169.8, -999.9999, -170.0, -169.9, -170.2])
    >>> find_lost_markers(heights)
    (-999.9999,)
    """
    finite = values[np.abs(values) < np.finfo(np.float64).max / 4]
    if len(finite) < MIN_OTHER_VALUES + 1 or not _may_hold_marker(finite):
        return ()
    unique, counts = np.unique(finite, return_counts=True)
    ends = [range(len(unique)), range(len(unique) - 1, -1, -1)]
    suspects: list[int] = []
    for end in ends:
        for index in list(end)[:MAX_MARKERS_PER_SIDE]:
            if (
                counts[index] < 2
                and not _is_limit(unique[index])
                and not _is_common_marker(unique[index])
            ):
                break
            suspects.append(index)
    others = np.setdiff1d(np.arange(len(unique)), suspects)
    if counts[others].sum() < MIN_OTHER_VALUES:
        return ()
    markers: list[float] = []
    initial_others = unique[others]
    for index in sorted(suspects, key=lambda i: _distance(float(unique[i]), initial_others)):
        value, count = float(unique[index]), int(counts[index])
        needed = _min_distance(value, count, limits, is_range=is_range, known_only=known_only)
        span = _central_span(unique[others], counts[others])
        is_repeated = count >= MIN_MULTIPLICITY_RATIO * counts[others].mean()
        is_known = (
            value in limits
            or _is_limit(value)
            or _is_common_marker(value)
            or (is_range and value <= 0)
        )
        if (
            needed is None
            or _distance(value, unique[others]) <= needed * span
            or not (is_known or is_repeated)
        ):
            others = np.append(others, index)
        else:
            markers.append(value)
    return tuple(sorted(markers))


def _may_hold_marker(finite: FloatArray) -> bool:
    """Return whether an extreme value repeats or is a common marker; if not, there is no marker."""
    low, high = float(finite.min()), float(finite.max())
    repeated = np.count_nonzero(finite == low) > 1 or np.count_nonzero(finite == high) > 1
    return bool(repeated) or any(_is_limit(v) or _is_common_marker(v) for v in (low, high))


def _min_distance(
    value: float, count: int, limits: Sequence[float], *, is_range: bool, known_only: bool
) -> float | None:
    """Return the smallest distance of a marker, in spans of the others; None if it is none."""
    if value in limits or _is_limit(value) or (is_range and value <= 0 and not known_only):
        return MIN_LIMIT_GAP
    if _is_common_marker(value):
        return MIN_KNOWN_GAP if count > 1 else 5 * MIN_KNOWN_GAP
    if known_only or count < MIN_REPEATS:
        return None
    if is_range:
        return MIN_KNOWN_GAP
    return MIN_UNKNOWN_GAP if value else MIN_ZERO_GAP


def _is_limit(value: float) -> bool:
    """Return whether a value is huge, or the limit of an integer type over a power of ten."""
    size = abs(value)
    if size >= _HUGE:
        return True
    if size < 32:
        return False
    return any(round(value * scale, 6) in _LIMITS for scale in (1, 10, 100, 1e3, 1e4))


def _is_common_marker(value: float) -> bool:
    """Return whether a value is like 9999 or -999.9999, or a negative power of ten <= -10 000."""
    digits = f"{abs(value):.10f}".rstrip("0").replace(".", "").lstrip("0")
    if len(digits) >= 3 and set(digits) == {"9"} and abs(value) > 99:
        return True
    power = np.log10(abs(value)) if value < -9999 else 0.0
    return bool(power >= 4 and power == round(power))


def _distance(value: float, others: FloatArray) -> float:
    """Return the distance of a value from the nearest of the others."""
    return float(np.abs(others - value).min())


def _central_span(others: FloatArray, counts: IntArray) -> float:
    """Return the span between the 2 % and 98 % quantiles, which leaves out single outliers."""
    heights = np.repeat(others, counts)
    low, high = np.quantile(heights, [0.02, 0.98])
    return float(high - low)
