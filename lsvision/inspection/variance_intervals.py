"""Confidence intervals of sums and differences of mean squares: the modified large sample method.

Ting, Burdick, Graybill, Jeyaratnam and Lu (1990); for gauge studies Burdick, Borror and Montgomery,
A review of methods for measurement systems capability analysis, J. Quality Technology 35, 2003.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np


def mean_square_interval(
    coefficients: Sequence[float],
    mean_squares: Sequence[float],
    degrees_of_freedom: Sequence[float],
    level: float = 0.95,
) -> tuple[float, float]:
    """Return the interval of a linear combination of expected mean squares.

    Parameters
    ----------
    coefficients, mean_squares, degrees_of_freedom : sequence of float
        One coefficient, mean square and number of degrees of freedom for each term; coefficients
        may be negative.
    level : float
        Level of confidence of the interval; exact for a single mean square, else approximate.

    Returns
    -------
    low, high : float
        At least 0.

    Examples
    --------
    >>> low, high = mean_square_interval([1.0], [0.04], [60])
    >>> f"{low:.4f} {high:.4f}"
    '0.0288 0.0593'
    """
    terms = [
        (coefficient * square, dof)
        for coefficient, square, dof in zip(
            coefficients, mean_squares, degrees_of_freedom, strict=True
        )
        if coefficient != 0
    ]
    estimate = sum(term for term, _ in terms)
    plus = [(term, dof) for term, dof in terms if term > 0]
    minus = [(-term, dof) for term, dof in terms if term < 0]
    tail = (1 - level) / 2
    low = estimate - math.sqrt(max(_squared_half_width(plus, minus, tail), 0.0))
    # Upwards the roles of the positive and of the negative terms are exchanged.
    high = estimate + math.sqrt(max(_squared_half_width(minus, plus, tail), 0.0))
    return max(low, 0.0), max(high, 0.0)


def _squared_half_width(
    falling: Sequence[tuple[float, float]], rising: Sequence[tuple[float, float]], tail: float
) -> float:
    """Return the squared distance to the end at which `falling` decrease and `rising` increase.

    Terms are (coefficient times mean square, degrees of freedom).
    """
    from scipy.stats import f

    total = sum((_g(dof, tail) * term) ** 2 for term, dof in falling)
    total += sum((_h(dof, tail) * term) ** 2 for term, dof in rising)
    for term, dof in falling:
        for rising_term, rising_dof in rising:
            quantile = float(f.isf(tail, dof, rising_dof))
            cross = (
                (quantile - 1) ** 2 - (_g(dof, tail) * quantile) ** 2 - _h(rising_dof, tail) ** 2
            )
            total += cross / quantile * term * rising_term
    return total


def _g(dof: float, tail: float) -> float:
    """Return G of Ting et al.: the relative distance to the lower end of one mean square."""
    from scipy.stats import chi2

    return 1 - dof / float(chi2.isf(tail, dof))


def _h(dof: float, tail: float) -> float:
    """Return H of Ting et al.: the relative distance to the upper end of one mean square."""
    from scipy.stats import chi2

    return dof / float(chi2.ppf(tail, dof)) - 1


def sums_of_squares(values: np.ndarray) -> tuple[float, float, float, float]:
    """Return the sums of squares of parts, operators, interaction and repeatability.

    Parameters
    ----------
    values : (parts, operators, trials) ndarray
        Measured values of a balanced crossed study.
    """
    parts, operators, trials = values.shape
    centred = values - values.mean()
    by_part, by_operator = centred.mean(axis=(1, 2)), centred.mean(axis=(0, 2))
    cells = centred.mean(axis=2)
    parts_sum = operators * trials * float(by_part @ by_part)
    operators_sum = parts * trials * float(by_operator @ by_operator)
    interaction = cells - by_part[:, None] - by_operator[None]
    interaction_sum = trials * float((interaction**2).sum())
    repeatability_sum = float(((centred - cells[:, :, None]) ** 2).sum())
    return parts_sum, operators_sum, interaction_sum, repeatability_sum
