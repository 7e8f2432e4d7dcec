"""Values that sensors write where they measured nothing, told by what they are and where."""

from collections.abc import Sequence

import numpy as np

from lsvision.geometry import FloatArray, IntArray

MIN_REST = 5
"""Values beside a marker; fewer do not show how far from them it lies."""
MAX_MARKERS_PER_SIDE = 3
"""Different markers below the heights, and above them."""
MIN_REPEATS = 3
"""How often an unknown value repeats to be a marker."""
MIN_MULTIPLICITY_RATIO = 2.5
"""How much more often than the other values an unknown value repeats: rounded heights and
planes without noise repeat, too."""
MIN_LIMIT_GAP, MIN_KNOWN_GAP, MIN_ZERO_GAP, MIN_UNKNOWN_GAP = 0.1, 1.0, 2.0, 4.0
"""Distance of a marker from the nearest other value, in spans of the other values: of the limit of
an integer type, of a value as -9999, of 0, and of any other value (a floor without noise under a
pipe lies 3 spans from it)."""
_BITS = (15, 16, 23, 24, 31, 32, 63, 64)
_LIMITS = np.unique([sign * (2.0**k + d) for k in _BITS for sign in (1, -1) for d in (0, -1)])
_LIMITS = _LIMITS[(_LIMITS < -32000) | (_LIMITS > 32000)]
_HUGE = 1e15


def find_lost_markers(
    values: FloatArray,
    *,
    limits: Sequence[float] = (),
    is_range: bool = False,
    known_only: bool = False,
) -> tuple[float, ...]:
    """Values that look like marks of lost points: far from the rest, and repeated.

    Parameters
    ----------
    values : (n,) ndarray
        One coordinate of all points, in the units of the file; NaN is passed over.
    limits : sequence of float
        Ends of the type that the values were stored in.
    is_range : bool
        True for distances from the sensor: 0 and less is none, and the largest may be the end
        of the sensor's range.
    known_only : bool
        Pass over values that only repeat: a number that is known for it is wanted.

    Returns
    -------
    tuple of float
        Rising.

    Examples
    --------
    >>> heights = np.array([-170.1, -170.3, -999.9999, -169.8, -999.9999, -170.0, -169.9, -170.2])
    >>> find_lost_markers(heights)
    (-999.9999,)
    """
    known = values[np.abs(values) < np.finfo(np.float64).max / 4]
    if len(known) < MIN_REST + 1 or not _may_hold_marker(known):
        return ()
    unique, counts = np.unique(known, return_counts=True)
    ends = [range(len(unique)), range(len(unique) - 1, -1, -1)]
    suspects: list[int] = []
    for end in ends:
        for index in list(end)[:MAX_MARKERS_PER_SIDE]:
            if counts[index] < 2 and not _is_limit(unique[index]) and not _is_nines(unique[index]):
                break
            suspects.append(index)
    rest = np.setdiff1d(np.arange(len(unique)), suspects)
    if counts[rest].sum() < MIN_REST:
        return ()
    markers: list[float] = []
    core = unique[rest]
    for index in sorted(suspects, key=lambda i: _gap(float(unique[i]), core)):
        value, count = float(unique[index]), int(counts[index])
        needed = _needed_gap(value, count, limits, is_range=is_range, known_only=known_only)
        span = _span(unique[rest], counts[rest])
        common = count >= MIN_MULTIPLICITY_RATIO * counts[rest].mean()
        sure = value in limits or _is_limit(value) or _is_nines(value) or (is_range and value <= 0)
        if needed is None or _gap(value, unique[rest]) <= needed * span or not (sure or common):
            rest = np.append(rest, index)
        else:
            markers.append(value)
    return tuple(sorted(markers))


def _may_hold_marker(known: FloatArray) -> bool:
    """Quick refusal of what holds none: an end that repeats, or is known for it."""
    low, high = float(known.min()), float(known.max())
    repeated = np.count_nonzero(known == low) > 1 or np.count_nonzero(known == high) > 1
    return bool(repeated) or any(_is_limit(v) or _is_nines(v) for v in (low, high))


def _needed_gap(
    value: float, count: int, limits: Sequence[float], *, is_range: bool, known_only: bool
) -> float | None:
    """Spans of the rest that the value must lie from it; None where it is no marker at all."""
    if value in limits or _is_limit(value) or (is_range and value <= 0 and not known_only):
        return MIN_LIMIT_GAP
    if _is_nines(value):
        return MIN_KNOWN_GAP if count > 1 else 5 * MIN_KNOWN_GAP
    if known_only or count < MIN_REPEATS:
        return None
    if is_range:
        return MIN_KNOWN_GAP
    return MIN_UNKNOWN_GAP if value else MIN_ZERO_GAP


def _is_limit(value: float) -> bool:
    """The end of an integer type, in whole numbers or in thousandths, or beyond all numbers."""
    size = abs(value)
    if size >= _HUGE:
        return True
    if size < 32:
        return False
    scaled = [round(value * scale, 6) for scale in (1, 10, 100, 1e3, 1e4)]
    return bool(np.isin(scaled, _LIMITS).any())


def _is_nines(value: float) -> bool:
    """A number as 9999 or -999.9999, or a negative power of ten from -10 000 on."""
    digits = f"{abs(value):.10f}".rstrip("0").replace(".", "").lstrip("0")
    if len(digits) >= 3 and set(digits) == {"9"} and abs(value) > 99:
        return True
    power = np.log10(abs(value)) if value < -9999 else 0.0
    return bool(power >= 4 and power == round(power))


def _gap(value: float, rest: FloatArray) -> float:
    return float(np.abs(rest - value).min())


def _span(rest: FloatArray, counts: IntArray) -> float:
    """Span of the rest without its outer fiftieths: single stray points lie there."""
    heights = np.repeat(rest, counts)
    low, high = np.quantile(heights, [0.02, 0.98])
    return float(high - low)
