"""Sums of squares of a gauge study, and confidence intervals of combinations of mean squares.

The intervals are those of the modified large sample method: Ting, Burdick, Graybill, Jeyaratnam and
Lu, Confidence intervals on linear combinations of variance components that are unrestricted in
sign, J. Statistical Computation and Simulation 35, 1990; for gauge studies Burdick, Borror and
Montgomery, A review of methods for measurement systems capability analysis, J. Quality Technology
35, 2003. The terms of Ting et al. for pairs of mean squares with the same sign are left out: the
interval of a sum is then that of Graybill and Wang (1980).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lsvision.errors import LsvisionError
from lsvision.geometry import FloatArray

ROUNDING = 4 * float(np.finfo(np.float64).eps)
"""Relative rounding error of a value's deviation from a mean, at most."""


def mean_square_interval(
    coefficients: Sequence[float],
    mean_squares: Sequence[float],
    degrees_of_freedom: Sequence[float],
    level: float = 0.95,
) -> tuple[float, float]:
    """Return the confidence interval of a linear combination of expected mean squares.

    It is exact for a single mean square, else approximate; a negative limit is set to 0, since the
    combination is a variance. Coefficients may be negative.

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
    # At the lower limit the positive terms are smaller and the negative ones larger than observed,
    # at the upper limit it is the reverse.
    low = estimate - math.sqrt(max(_squared_distance_to_limit(plus, minus, tail), 0.0))
    high = estimate + math.sqrt(max(_squared_distance_to_limit(minus, plus, tail), 0.0))
    return max(low, 0.0), max(high, 0.0)


def _squared_distance_to_limit(
    decreased: Sequence[tuple[float, float]], increased: Sequence[tuple[float, float]], tail: float
) -> float:
    """Return the squared distance from the estimate to one limit of its interval.

    Each term is the absolute value of coefficient times mean square, and its degrees of freedom.
    The terms `decreased` are smaller at this limit than observed, the terms `increased` larger.
    `tail` is the probability that the true value lies beyond this limit.
    """
    from scipy.stats import f

    total = sum((_compute_g(dof, tail) * term) ** 2 for term, dof in decreased)
    total += sum((_compute_h(dof, tail) * term) ** 2 for term, dof in increased)
    for term, dof in decreased:
        for other_term, other_dof in increased:
            quantile = float(f.isf(tail, dof, other_dof))
            # With this cross term the interval of the difference of two mean squares contains 0
            # exactly where their F test is not significant.
            cross = (
                (quantile - 1) ** 2
                - (_compute_g(dof, tail) * quantile) ** 2
                - _compute_h(other_dof, tail) ** 2
            )
            total += cross / quantile * term * other_term
    return total


def _compute_g(dof: float, tail: float) -> float:
    """Return G of Ting et al.: 1 - lower limit / observed value, for a single mean square."""
    from scipy.stats import chi2

    return 1 - dof / float(chi2.isf(tail, dof))


def _compute_h(dof: float, tail: float) -> float:
    """Return H of Ting et al.: upper limit / observed value - 1, for a single mean square."""
    from scipy.stats import chi2

    return dof / float(chi2.ppf(tail, dof)) - 1


def require_finite_values(values: FloatArray) -> None:
    """Raise an LsvisionError if a measured value of a study is not finite."""
    invalid = int(np.count_nonzero(~np.isfinite(values)))
    if invalid:
        raise LsvisionError(
            f"expected finite values, got {invalid} of {values.size} that are not: measure them "
            "again"
        )


def compute_sums_of_squares(values: FloatArray) -> tuple[float, float, float, float]:
    """Return the sums of squares of parts, operators, interaction and repeatability.

    The values, (parts, operators, trials), are of a study in which each operator measures each part
    equally often; the sums are in the square of their unit, and 0 where only rounding errors are.
    """
    parts, operators, trials = values.shape
    # From the first value, so that equal values have no spread by rounding errors of their mean.
    offsets = values - values.flat[0]
    centred = offsets - offsets.mean()
    by_part, by_operator = centred.mean(axis=(1, 2)), centred.mean(axis=(0, 2))
    cells = centred.mean(axis=2)
    parts_sum = operators * trials * float(by_part @ by_part)
    operators_sum = parts * trials * float(by_operator @ by_operator)
    interaction = cells - by_part[:, None] - by_operator[None]
    interaction_sum = trials * float((interaction**2).sum())
    repeatability_sum = float(((centred - cells[:, :, None]) ** 2).sum())
    rounding = values.size * (ROUNDING * float(np.abs(values).max())) ** 2
    sums = (parts_sum, operators_sum, interaction_sum, repeatability_sum)
    parts_sum, operators_sum, interaction_sum, repeatability_sum = (
        square if square > rounding else 0.0 for square in sums
    )
    return parts_sum, operators_sum, interaction_sum, repeatability_sum
