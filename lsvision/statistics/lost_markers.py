"""Detection of marker values, which sensors write in place of lost points."""

import math
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
MIN_LIMIT_GAP_SPANS, MIN_KNOWN_GAP_SPANS, MIN_ZERO_GAP_SPANS, MIN_UNKNOWN_GAP_SPANS = (
    0.1,
    1.0,
    2.0,
    4.0,
)
"""Smallest distance of a marker from the nearest other value, in spans of the other values: for the
limit of an integer type, a repeated value such as -9999, 0, and any other value (a floor without
noise under a pipe is 3 spans from it)."""
MIN_SINGLE_KNOWN_GAP_SPANS = 5.0
"""The same for a value such as -9999 that is not repeated."""
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
_MIN_SCALED_LIMIT = 32.0
"""Smallest size of a limit over a power of ten (32.767 of 16 bits): smaller ones, such as 3.2767,
are also plausible heights."""
_HUGE = 1e15
"""Size from which a value is a marker in any unit."""


def find_lost_markers(
    values: FloatArray,
    *,
    limits: Sequence[float] = (),
    is_range: bool = False,
    known_only: bool = False,
) -> tuple[float, ...]:
    """Return the values that look like markers of lost points.

    They are far from the other values, and repeated or known markers: the limits of an integer
    type, values such as 9999, and of distances 0 and less.

    Parameters
    ----------
    values : (n,) ndarray
        One coordinate of all points, in the units of the file; NaN, infinity and numbers close to
        the largest float are ignored.
    limits : sequence of float
        Smallest and largest number of the type in which the values were stored: known markers.
    is_range : bool
        True for distances from the sensor: 0 and less are not distances, and the largest may be
        the end of the sensor's range.
    known_only : bool
        Return known markers only, not values that are merely repeated.

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
    if len(finite) < MIN_OTHER_VALUES + 1 or not _may_have_marker(finite):
        return ()
    unique, counts = np.unique(finite, return_counts=True)
    suspects = _find_suspects(unique, counts)
    others = np.setdiff1d(np.arange(len(unique)), suspects)
    if counts[others].sum() < MIN_OTHER_VALUES:
        return ()
    markers: list[float] = []
    initial_others = unique[others]
    # The nearest suspect first: if it is no marker, the next one is compared with it, too.
    for index in sorted(suspects, key=lambda i: _distance(float(unique[i]), initial_others)):
        value, count = float(unique[index]), int(counts[index])
        spans = _compute_min_spans(value, count, limits, is_range=is_range, known_only=known_only)
        min_distance = spans * _compute_central_span(unique[others], counts[others])
        is_repeated = count >= MIN_MULTIPLICITY_RATIO * counts[others].mean()
        is_known = value in limits or _is_known_marker(value) or (is_range and value <= 0)
        if (is_known or is_repeated) and _distance(value, unique[others]) > min_distance:
            markers.append(value)
        else:
            others = np.append(others, index)
    return tuple(sorted(markers))


def _find_suspects(unique: FloatArray, counts: IntArray) -> list[int]:
    """Return the indices of the outermost values, as far as they are repeated or known markers."""
    suspects: list[int] = []
    for end in (range(len(unique)), range(len(unique) - 1, -1, -1)):
        for index in end[:MAX_MARKERS_PER_SIDE]:
            if counts[index] < 2 and not _is_known_marker(float(unique[index])):
                break
            suspects.append(index)
    return suspects


def _may_have_marker(finite: FloatArray) -> bool:
    """Return whether an extreme value is repeated or a known marker; if not, there is none."""
    low, high = float(finite.min()), float(finite.max())
    repeated = np.count_nonzero(finite == low) > 1 or np.count_nonzero(finite == high) > 1
    return bool(repeated) or any(map(_is_known_marker, (low, high)))


def _compute_min_spans(
    value: float, count: int, limits: Sequence[float], *, is_range: bool, known_only: bool
) -> float:
    """Return the smallest distance of a marker, in spans of the others; inf if it is none."""
    if value in limits or _is_limit(value) or (is_range and value <= 0 and not known_only):
        return MIN_LIMIT_GAP_SPANS
    if _is_common_marker(value):
        return MIN_KNOWN_GAP_SPANS if count > 1 else MIN_SINGLE_KNOWN_GAP_SPANS
    if known_only or count < MIN_REPEATS:
        return math.inf
    if is_range:
        return MIN_KNOWN_GAP_SPANS
    return MIN_UNKNOWN_GAP_SPANS if value else MIN_ZERO_GAP_SPANS


def _is_known_marker(value: float) -> bool:
    """Return whether a value is the limit of an integer type, or like 9999."""
    return _is_limit(value) or _is_common_marker(value)


def _is_limit(value: float) -> bool:
    """Return whether a value is huge, or the limit of an integer type over a power of ten."""
    size = abs(value)
    if size >= _HUGE:
        return True
    if size < _MIN_SCALED_LIMIT:
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


def _compute_central_span(others: FloatArray, counts: IntArray) -> float:
    """Return the span between the 2 % and 98 % quantiles, which leaves out single outliers."""
    heights = np.repeat(others, counts)
    low, high = np.quantile(heights, [0.02, 0.98])
    return float(high - low)
