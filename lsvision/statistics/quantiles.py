"""Quantiles of one or two normal errors, and the normal distribution, without `scipy.special`.

``import scipy.special`` takes longer than all measurements of a profile.
"""

import math
from statistics import NormalDist

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.geometry.arrays import TINY

_POSITIONS, _LENGTHS = np.polynomial.legendre.leggauss(32)
_NODES, _WEIGHTS = (_POSITIONS + 1) / 2, _LENGTHS / 2
"""Gauss-Legendre rule of 32 points on the interval from 0 to 1."""
FEW_DEGREES_OF_FREEDOM, MANY_DEGREES_OF_FREEDOM = 10.0, 100.0
"""Degrees of freedom from which five terms of the expansion about a normal quantile are an initial
guess, and above which they are exact to 1e-8."""
MAX_STEPS = 6
"""Maximum number of Newton steps: as many as are needed for levels from 1e-6 to 1 - 1e-9."""
STEP_TOLERANCE = 1e-5
"""Relative size of the last step: the error after it is of the size of its square."""


def squared_quantile(quantities: int, degrees_of_freedom: FloatArray, level: float) -> FloatArray:
    """Return quantiles of a sum of squared errors, each over its estimated standard deviation.

    Definition: `quantities` times the quantile of F with `quantities` and `degrees_of_freedom`;
    with infinitely many, that of chi^2.

    Parameters
    ----------
    quantities : int
        Number of errors that are combined, 1 or 2.
    degrees_of_freedom : (k,) ndarray
        Degrees of freedom of the estimated variances, at least 1; inf where it is known.
    level : float
        Probability, between 0 and 1.

    Returns
    -------
    (k,) ndarray
        Quantiles. Their relative error is below 1e-8 for levels from 0.001 to 0.999, and below 1e-5
        from 1e-6 to 1 - 1e-9; beyond 1 - 1e-12 rounding errors dominate.

    Examples
    --------
    >>> squared_quantile(2, np.array([math.inf, 10.0]), 0.95).round(4).tolist()
    [5.9915, 8.2056]
    """
    if quantities == 1:
        return _student_quantile(degrees_of_freedom, level) ** 2
    # dof ((1 - level)^(-2 / dof) - 1), with the limit -2 log(1 - level) for infinite dof.
    rate = np.maximum(2 / degrees_of_freedom, TINY)
    return 2 * np.expm1(-rate * math.log1p(-level)) / rate


def normal_probability(values: FloatArray) -> FloatArray:
    """Return the probability that a standard normal variable is smaller, for an array of any shape.

    Examples
    --------
    >>> normal_probability(np.array([0.0, 1.0])).round(4).tolist()
    [0.5, 0.8413]
    """
    scaled = (values / -math.sqrt(2)).ravel().tolist()
    return np.array([math.erfc(x) / 2 for x in scaled]).reshape(values.shape)


def _student_quantile(degrees_of_freedom: FloatArray, level: float) -> FloatArray:
    """Return the t that |t| of Student's distribution exceeds with probability 1 - level, (k,).

    Many degrees of freedom: the expansion of Abramowitz and Stegun, Handbook of Mathematical
    Functions, 26.7.5. Fewer: Newton's method on the integral.
    """
    z = -NormalDist().inv_cdf((1 - level) / 2)
    first, second = (z**3 + z) / 4, (5 * z**5 + 16 * z**3 + 3 * z) / 96
    third = (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384
    fourth = (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160
    rate = 1 / degrees_of_freedom
    quantiles: FloatArray = z + rate * (first + rate * (second + rate * (third + rate * fourth)))
    not_many = degrees_of_freedom <= MANY_DEGREES_OF_FREEDOM
    if not_many.any():
        dof, guess = degrees_of_freedom[not_many], quantiles[not_many]
        quantiles[not_many] = _solve_student_quantile(dof, level, guess)
    return quantiles


def _solve_student_quantile(dof: FloatArray, level: float, guess: FloatArray) -> FloatArray:
    """Return the t of `_student_quantile` by Newton's method, from a guess for many dof, (k,).

    With t = sqrt(dof) / tan(v), the density of v is proportional to sin(v)^(dof - 1), and the
    probability that |t| is exceeded to its integral from 0 to v.
    """
    gamma_ratios = [math.exp(math.lgamma(n / 2) - math.lgamma((n + 1) / 2)) for n in dof.tolist()]
    total = math.sqrt(math.pi) / 2 * np.array(gamma_ratios)  # the integral from 0 to pi/2
    is_few = dof < FEW_DEGREES_OF_FREEDOM
    # For few dof v is small, and the density almost proportional to v^(dof - 1).
    v = np.where(is_few, (dof * (1 - level) * total) ** (1 / dof), np.arctan(np.sqrt(dof) / guess))
    for _ in range(MAX_STEPS):
        # Only for few dof the integral from 0 is smooth enough for the quadrature.
        start, end = np.where(is_few, 0.0, v), np.where(is_few, v, math.pi / 2)
        integral = _integrate_sine_power(start, end, dof - 1)
        excess = np.where(is_few, integral - (1 - level) * total, level * total - integral)
        step = excess / np.sin(v) ** (dof - 1)
        # Rounding errors dominate the step at levels very close to 1.
        v = np.clip(v - step, v / 2, math.pi / 2)
        if (np.abs(step) < STEP_TOLERANCE * np.minimum(v, math.pi / 2 - v)).all():
            break
    return np.sqrt(dof) / np.tan(v)


def _integrate_sine_power(start: FloatArray, end: FloatArray, power: FloatArray) -> FloatArray:
    """Return the integral of sin^power from start to end, all (k,), by quadrature.

    Over w = v^(1/4), the integrand is smooth at v = 0 for any power >= 0.
    """
    first, last = start[:, None] ** 0.25, end[:, None] ** 0.25
    w = first + (last - first) * _NODES
    integrand: FloatArray = 4 * w**3 * np.sin(w**4) ** power[:, None]
    return (last - first)[:, 0] * (integrand @ _WEIGHTS)
