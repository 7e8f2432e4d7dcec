"""Robust estimates of scale (median absolute deviation)."""

import numpy as np

from lsvision.geometry import FloatArray

MAD_TO_STD = 1.4826
"""Standard deviation over the median absolute deviation, for a normal distribution."""

SIGNIFICANT_SIGMAS = 3.0
"""Standard deviations that chance exceeds in 0.3 % of the cases: a smaller deviation is no effect,
a larger one of a single point may be an outlier."""


def upper_median(values: FloatArray) -> float:
    """Return the median of finite values, the upper of two; five times as fast as `np.median`.

    Parameters
    ----------
    values : (n,) ndarray
        At least one value.
    """
    middle, ordered = len(values) // 2, values.copy()
    ordered.partition(middle)
    return float(ordered[middle])


def mad_std(values: FloatArray) -> float:
    """Return the standard deviation about zero, by the median of the absolute values."""
    return MAD_TO_STD * float(np.median(np.abs(values)))


def upper_mad_std(values: FloatArray) -> float:
    """Return the standard deviation about zero, by the upper median of the absolute values."""
    return MAD_TO_STD * upper_median(np.abs(values))
