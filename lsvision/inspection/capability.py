"""Statistics of many verdicts: binomial intervals and process capability."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

NOT_CLAIMED = (
    "ISO 22514-7 is not claimed: it does not cover a radius or an angle fitted to many points"
)
"""Note below every table of capability indices."""
PROCESS_SIGMAS = 6.0
"""Width of a process in standard deviations, in Cp and Cpk."""


@dataclass(frozen=True)
class Capability:
    """Cp and Cpk of a quantity with their confidence intervals.

    Parameters
    ----------
    count : int
        Number of parts.
    mean, std : float
        Mean and standard deviation of the measured values, in their unit.
    cp : float
        Process capability: (upper - lower limit) / (6 std); NaN with only one limit.
    cpk : float
        Distance of the mean from the nearer limit, over 3 std; negative outside.
    cp_interval, cpk_interval : (float, float)
        At `level`: Cp by chi^2, Cpk by Bissell's approximation.
    measurement_fraction : float
        Fraction of `std` squared that the standard uncertainties of the measurements explain, at
        most 1; NaN if they are not given.
    level : float
        Level of confidence of the intervals.
    """

    count: int
    mean: float
    std: float
    cp: float
    cpk: float
    cp_interval: tuple[float, float]
    cpk_interval: tuple[float, float]
    measurement_fraction: float
    level: float = 0.95


def estimate_capability(
    values: Sequence[float],
    limits: tuple[float, float],
    stds: Sequence[float] = (),
    level: float = 0.95,
) -> Capability:
    """Return Cp and Cpk of measured values.

    Parameters
    ----------
    values : sequence of float
        Measured values, one for each part, at least two.
    limits : (float, float)
        Lower and upper limit; one may be infinite.
    stds : sequence of float
        Standard uncertainty of each value, without components that are common to all values:
        these do not add to the spread.
    level : float
        Level of confidence of the intervals.

    Raises
    ------
    ValueError
        With fewer than two values, values that are all equal, or one that is not finite; if the
        limits are reversed or both infinite, or the level is not between 0 and 1.

    References
    ----------
    Montgomery, Introduction to Statistical Quality Control, section 8.3; Bissell, How reliable is
    your capability index?, Applied Statistics 39, 1990.

    Examples
    --------
    >>> result = estimate_capability([18.98, 19.0, 19.02, 19.01, 18.99], (18.9, 19.1))
    >>> f"{result.cp:.2f}"
    '2.11'
    """
    from scipy.special import ndtri
    from scipy.stats import chi2

    require_study_arguments(level)
    measured = np.asarray(values, dtype=np.float64)
    count = len(measured)
    if not np.isfinite(measured).all():
        raise ValueError("expected finite values, got some that are not: leave them out")
    if not limits[0] < limits[1] or not any(map(math.isfinite, limits)):
        raise ValueError(f"expected limits (lower, upper), one or both finite, got {limits}")
    # From the first value, so that equal values have no spread by rounding errors of their mean.
    offsets = measured - measured[:1]
    std = float(offsets.std(ddof=1)) if count > 1 else 0.0
    if not std > 0:
        raise ValueError(f"expected two values or more that differ, got {count} without spread")
    mean, (lower, upper) = float(measured[0] + offsets.mean()), limits
    cp = (upper - lower) / (PROCESS_SIGMAS * std) if math.isfinite(upper - lower) else math.nan
    cpk = min(upper - mean, mean - lower) / (PROCESS_SIGMAS / 2 * std)
    tail = (1 - level) / 2
    factors = np.sqrt(chi2.ppf([tail, 1 - tail], count - 1) / (count - 1))
    half_width = float(ndtri(1 - tail)) * math.sqrt(1 / (9 * count) + cpk**2 / (2 * (count - 1)))
    measurement_variance = float(np.mean(np.square(stds))) if len(stds) else math.nan
    return Capability(
        count=count,
        mean=mean,
        std=std,
        cp=cp,
        cpk=cpk,
        cp_interval=(cp * float(factors[0]), cp * float(factors[1])),
        cpk_interval=(cpk - half_width, cpk + half_width),
        measurement_fraction=min(measurement_variance / std**2, 1.0),
        level=level,
    )


def binomial_interval(hits: int, count: int, level: float = 0.95) -> tuple[float, float]:
    """Return the confidence interval of a probability from counts, after Clopper and Pearson.

    It contains the probability with `level` at least; without trials it is (0, 1).

    Raises
    ------
    ValueError
        If `hits` is not from 0 to `count`, or the level not between 0 and 1.

    Examples
    --------
    >>> low, high = binomial_interval(0, 30)
    >>> f"{low:.3f} {high:.3f}"
    '0.000 0.116'
    """
    from scipy.special import betaincinv

    require_study_arguments(level)
    if not 0 <= hits <= count:
        raise ValueError(f"expected hits from 0 to {count}, got {hits}")
    tail = (1 - level) / 2
    low = float(betaincinv(hits, count - hits + 1, tail)) if hits else 0.0
    high = float(betaincinv(hits + 1, count - hits, 1 - tail)) if hits < count else 1.0
    return low, high


def require_study_arguments(level: float, tolerance: float | None = None) -> None:
    """Raise a ValueError unless the level is between 0 and 1, and a given tolerance above 0."""
    if not 0 < level < 1:
        raise ValueError(f"expected a level between 0 and 1, got {level}")
    if tolerance is not None and not 0 < tolerance < math.inf:
        raise ValueError(f"expected a finite tolerance above 0, got {tolerance}")
