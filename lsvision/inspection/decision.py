"""Decision OK, NG or undecided by the guard band of ISO 14253-1."""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import StrEnum

from lsvision.inspection.uncertain import two_sided_factor


class Decision(StrEnum):
    """Decision on a quantity, a part or a whole measurement: OK, NG (not good) or undecided.

    Examples
    --------
    >>> Decision.OK == "OK", worst([Decision.OK, Decision.UNDECIDED])
    (True, <Decision.UNDECIDED: 'undecided'>)
    """

    OK = "OK"
    NG = "NG"
    UNDECIDED = "undecided"


_SEVERITY = {Decision.OK: 0, Decision.UNDECIDED: 1, Decision.NG: 2}


def worst(decisions: Iterable[Decision]) -> Decision:
    """Return the worst of several decisions (NG, then undecided, then OK); OK if there are none."""
    return max(decisions, key=_SEVERITY.__getitem__, default=Decision.OK)


def decide(interval: tuple[float, float], limits: tuple[float, float]) -> Decision:
    """Return the decision: OK if the interval lies inside the limits, NG outside, else undecided.

    Parameters
    ----------
    interval : (float, float)
        Contains the true value at the job's level; with a level of 0.95 each false answer has a
        probability of at most 2.5 %.
    limits : (float, float)
        Smallest and largest good value; infinite where there is none.

    Examples
    --------
    >>> [decide(ends, (18.9, 19.1)).value for ends in ((18.95, 19.05), (19.05, 19.2), (19.2, 19.3))]
    ['OK', 'undecided', 'NG']
    """
    low, high = interval
    lower, upper = limits
    if lower <= low and high <= upper:
        return Decision.OK
    return Decision.NG if high < lower or low > upper else Decision.UNDECIDED


def widen_interval(
    value: float, interval: tuple[float, float], extra_std: float, level: float
) -> tuple[float, float]:
    """Return an interval whose half widths include a further uncertainty, added in quadrature.

    Parameters
    ----------
    value : float
        The estimate.
    interval : (float, float)
        Its interval at `level`, which need not be symmetric about it.
    extra_std : float
        Standard uncertainty that the fit does not contain and that is independent of it, such as
        the effect of temperature.
    level : float
        Level of confidence of the interval.

    Returns
    -------
    (float, float)
        ``value - hypot(value - low, z extra_std)`` and likewise above, with the normal quantile z.

    Examples
    --------
    >>> low, high = widen_interval(19.0, (18.97, 19.04), 0.03 / 1.96, 0.95)
    >>> f"{low:.3f} {high:.3f}"
    '18.958 19.050'
    """
    low, high = interval
    extra = two_sided_factor(level) * extra_std
    return value - math.hypot(value - low, extra), value + math.hypot(high - value, extra)
