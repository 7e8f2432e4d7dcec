"""Markers of lost points among the heights: one value that interrupts the surface again and again.

A marker far from all heights is found by its distance (`lsvision.statistics.lost_markers`); one
within their range, such as 0 in heights relative to the middle of the sensor's range, is not. There
it is recognised by the surface, which continues after it as if it were not there.
"""

from collections.abc import Sequence

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, IntArray

MIN_INTERRUPTIONS = 3
"""Smallest number of places at which a value interrupts a surface that continues after it, from
which on it marks lost points: hardly an object has so many slots with a floor at one height."""
MAX_INTERRUPTION_POINTS = 3
"""Largest number of points of such a place: between two pipes, more points lie on a floor."""
MAX_STEP_RATIO = 0.25
"""Largest step of the surface across such a place, relative to its distance from the value."""
MIN_DISTANCE_RATIO = 10.0
"""Smallest distance of the surface from the value, in steps between neighbouring points."""
MIN_SPIKE_RATIO = 5.0
"""Smallest step before and after a spike, relative to the 20 % quantile of all steps."""
MAX_CANDIDATES = 3
"""Largest number of values of a file that are examined."""
MIN_INTERRUPTION_FRACTION = 0.9
"""Smallest fraction of the interruptions near a value that are at the value itself: the floors of
slots scatter."""
MIN_REPEATS, MIN_REPEATS_RATIO = 10, 4.0
"""Smallest number of repetitions of a value that `find_repeated_value` returns for a note, also
relative to the next most frequent one: the heights of a plane scatter."""
MIN_VALUES = 10
"""Smallest number of different values, or of runs of equal points, among which one may be noted."""


def find_interrupting_values(profiles: Sequence[FloatArray]) -> dict[float, list[bool]]:
    """Return the values that interrupt the surface of a profile in several places.

    Parameters
    ----------
    profiles : sequence of (n,) ndarray
        Heights of each profile in the order of the sensor, in any unit; NaN is left out.

    Returns
    -------
    dict of float to list of bool
        For each value that marks lost points, whether it does so in each profile.

    Examples
    --------
    >>> heights = 5 * np.sin(np.arange(60) / 20)
    >>> heights[[12, 20, 33, 34, 50]] = -1.0
    >>> find_interrupting_values([heights, heights[:10]])
    {-1.0: [True, False]}
    """
    heights = [profile[np.isfinite(profile)] for profile in profiles]
    found = {
        value: [_interrupts(profile, value) for profile in heights]
        for value in _find_candidates(np.concatenate([*heights, np.empty(0)]))
    }
    return {value: is_marker for value, is_marker in found.items() if any(is_marker)}


def _find_candidates(heights: FloatArray) -> list[float]:
    """Return the most frequent heights of spikes: points, or runs of equal points, between steps.

    The steps before and after a spike have opposite signs, and are large compared with the 20 %
    quantile of all steps: if half of the points are lost at random, a third of the steps between
    different heights are those of the surface.
    """
    starts = _run_starts(heights)
    values, lengths = heights[starts], np.diff(starts, append=len(heights))
    if len(values) < 2 * MIN_INTERRUPTIONS:
        return []
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.diff(values)
        sizes, rises = np.abs(steps), steps > 0
        small = np.partition(sizes, len(sizes) // 5)[len(sizes) // 5]
        is_large = sizes > MIN_SPIKE_RATIO * small
    is_spike = (rises[:-1] != rises[1:]) & is_large[:-1] & is_large[1:]
    is_spike &= lengths[1:-1] <= MAX_INTERRUPTION_POINTS
    spikes, counts = np.unique(values[1:-1][is_spike], return_counts=True)
    most = np.argsort(-counts, kind="stable")[:MAX_CANDIDATES]
    return [float(spikes[k]) for k in most if counts[k] >= MIN_INTERRUPTIONS]


def _run_starts(heights: FloatArray) -> IntArray:
    """Return the indices at which runs of equal heights begin."""
    differs: BoolArray = heights[1:] != heights[:-1]
    return np.flatnonzero(np.concatenate([np.ones(min(len(heights), 1), dtype=bool), differs]))


def _interrupts(heights: FloatArray, value: float) -> bool:
    """Return whether the surface continues after a value in several places, and is far from it."""
    others_at = np.flatnonzero(heights != value)
    if len(others_at) > len(heights) - MIN_INTERRUPTIONS:
        return False
    others = heights[others_at]
    step = _compute_typical_step(others)
    gaps = np.diff(others_at)
    ends = np.flatnonzero((gaps > 1) & (gaps <= MAX_INTERRUPTION_POINTS + 1))
    before, after = others[ends], others[ends + 1]
    with np.errstate(over="ignore", invalid="ignore"):
        distance = np.minimum(np.abs(before - value), np.abs(after - value))
        goes_on = np.abs(after - before) < MAX_STEP_RATIO * distance
        far = distance > MIN_DISTANCE_RATIO * step
    count = np.count_nonzero(goes_on & far)
    similar = _count_excursions(others, value, MIN_DISTANCE_RATIO * step)
    return bool(count >= max(MIN_INTERRUPTIONS, MIN_INTERRUPTION_FRACTION * (count + similar)))


def _compute_typical_step(heights: FloatArray) -> float:
    """Return the median step between neighbours, at least the smallest above 0; inf without any."""
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.abs(np.diff(heights))
        moving = steps[steps > 0]
        return float(max(np.median(steps), moving.min())) if len(moving) else np.inf


def _count_excursions(heights: FloatArray, value: float, distance: float) -> int:
    """Return how often a few points lie near a value between points that are far from it."""
    with np.errstate(over="ignore", invalid="ignore"):
        far_at = np.flatnonzero(np.abs(heights - value) > distance)
    gaps = np.diff(far_at)
    return int(np.count_nonzero((gaps > 1) & (gaps <= MAX_INTERRUPTION_POINTS + 1)))


def find_repeated_value(heights: FloatArray) -> float | None:
    """Return a height that occurs much more often than all others; None without one.

    Its count is compared in total and, if none stands out, in one run of consecutive points. Noise
    makes the points of a plane differ: such a value may mark lost points.
    """
    finite = heights[np.isfinite(heights)]
    values, counts = np.unique(finite, return_counts=True)
    starts = _run_starts(finite)
    runs = np.diff(starts, append=len(finite))
    value = _find_most_frequent(values, counts)
    return _find_most_frequent(finite[starts], runs) if value is None else value


def _find_most_frequent(values: FloatArray, counts: IntArray) -> float | None:
    """Return the value whose count is much larger than that of all others, or None.

    The values may also be those of runs of points, with the lengths of the runs as counts.
    """
    if len(values) < MIN_VALUES:
        return None
    next_most, most = np.argsort(counts, kind="stable")[-2:]
    enough = max(MIN_REPEATS, MIN_REPEATS_RATIO * counts[next_most])
    return float(values[most]) if counts[most] >= enough else None
