"""Notes on the order of the points of a table, which may be several profiles in one."""

from collections.abc import Sequence

import numpy as np

from lsvision.geometry import FloatArray, IntArray

MIN_POINTS_PER_PROFILE = 5
"""Smallest number of points of a profile, on average where a column numbers the profiles: fewer do
not determine an ellipse."""
_MIN_SWEEP_FRACTION = 0.8
"""Smallest fraction of the range of x that a sweep covers."""
_MIN_SWEEPS = 3
"""Smallest number of sweeps that are noted: a closed section goes back and forth once."""
_MAX_ORDERED_STEP_FRACTION = 0.05
"""Largest median step of x, as a fraction of its range, of points that are in the order of a
sensor."""


def note_order(sections: Sequence[FloatArray]) -> tuple[str, ...]:
    """Return a note if x of the only section repeats its range: several profiles."""
    if len(sections) != 1 or sections[0].shape[1] != 2:
        return ()
    x = sections[0][np.isfinite(sections[0][:, 0]), 0]
    if len(x) <= 2 * MIN_POINTS_PER_PROFILE:
        return ()
    with np.errstate(over="ignore", invalid="ignore"):  # numbers near the largest float
        steps, span = np.diff(x), np.ptp(x)
        typical = np.median(np.abs(steps))
    if not ((steps > 0).any() and (steps < 0).any()):
        return ()
    restarts = len(find_restarts(x))
    if restarts:
        return (
            f"x starts again {restarts} times: if these are several profiles, add a column of "
            "their numbers, or write one per file",
        )
    sweeps = _count_sweeps(x, span)
    if sweeps < _MIN_SWEEPS or typical > _MAX_ORDERED_STEP_FRACTION * span:
        return ()
    return (
        f"x goes back and forth, {sweeps} times over its range: if these are several profiles, "
        "add a column of their numbers, or write one per file",
    )


def find_restarts(x: FloatArray) -> IntArray:
    """Return the indices at which x, without NaN, has jumped back by half its range.

    Empty if two of them, or one and the first or last point, are less than
    `MIN_POINTS_PER_PROFILE` points apart.
    """
    if len(x) <= 2 * MIN_POINTS_PER_PROFILE:
        return np.array([], dtype=np.intp)
    with np.errstate(over="ignore", invalid="ignore"):
        steps, span = np.diff(x), np.ptp(x)
    rising, falling = np.count_nonzero(steps > 0), np.count_nonzero(steps < 0)
    jumps = steps < -0.5 * span if rising >= falling else steps > 0.5 * span
    restarts = np.flatnonzero(jumps) + 1
    if np.diff([0, *restarts, len(x)]).min() < MIN_POINTS_PER_PROFILE:
        return restarts[:0]
    return restarts


def _count_sweeps(x: FloatArray, span: float) -> int:
    """Return how often x goes from one end of its range to the other."""
    low = np.flatnonzero(x < x.min() + (1 - _MIN_SWEEP_FRACTION) * span / 2)
    high = np.flatnonzero(x > x.max() - (1 - _MIN_SWEEP_FRACTION) * span / 2)
    ends = np.concatenate([np.zeros(len(low)), np.ones(len(high))])
    in_order = ends[np.argsort(np.concatenate([low, high]), kind="stable")]
    return int(np.count_nonzero(np.diff(in_order)))
