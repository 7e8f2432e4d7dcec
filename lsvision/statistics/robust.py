"""How far most values lie off, whatever a few of them do."""

import numpy as np

from lsvision.geometry import FloatArray

MAD_TO_STD = 1.4826
"""Standard deviation over the median of the absolute values, for a normal distribution."""


def upper_median(values: FloatArray) -> float:
    """Median of finite values, the upper one of two; `np.median` takes five times as long.

    Parameters
    ----------
    values : (n,) ndarray
        At least one.
    """
    middle, ordered = len(values) // 2, values.copy()
    ordered.partition(middle)
    return float(ordered[middle])


def mad_std(values: FloatArray) -> float:
    """Standard deviation about zero, from the median of the absolute values.

    Parameters
    ----------
    values : (n,) ndarray
        At least one; same unit as the result.
    """
    return MAD_TO_STD * upper_median(np.abs(values))
