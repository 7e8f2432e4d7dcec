"""Heights that are rounded to steps larger than their noise."""

from collections.abc import Sequence

import numpy as np

from lsvision.geometry import FloatArray

_MIN_TIE_FRACTION = 0.5
"""Smallest fraction of neighbours with equal heights: with noise of half a step, about half are."""
_MAX_STEP_RATIO = 2.5
"""Largest median of the steps between other neighbours, in units of the smallest."""
_MIN_POINTS, _MIN_STEPS = 20, 10
"""Smallest number of neighbours, and of those with different heights."""
_MAX_PROFILES = 20
"""Number of profiles of a file that are examined."""


def find_rounding(heights: Sequence[FloatArray]) -> float | None:
    """Return the step to which the heights of profiles are rounded; None if noise exceeds it.

    Most neighbours then have equal heights, and most others differ by one step. The error of
    rounding, uniform in +/- half a step, has a standard deviation of step / sqrt(12).

    Examples
    --------
    >>> x = np.linspace(-20, 20, 200)
    >>> find_rounding([np.round(np.sqrt(625 - x**2))])
    1.0
    """
    with np.errstate(over="ignore"):
        differences = [np.diff(z[np.isfinite(z)]) for z in heights[:_MAX_PROFILES]]
    steps = np.concatenate([*differences, np.empty(0)])
    moving = np.abs(steps[steps != 0])
    most_are_equal = len(moving) <= (1 - _MIN_TIE_FRACTION) * len(steps)
    if not most_are_equal or len(steps) < _MIN_POINTS or len(moving) < _MIN_STEPS:
        return None
    step = float(moving.min())
    return step if np.median(moving) <= _MAX_STEP_RATIO * step else None
