"""Quantiles of one or two normal errors, and the normal distribution, without `scipy.special`.

``import scipy.special`` takes longer than all measurements of a profile.
"""

import math
from statistics import NormalDist

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.geometry.arrays import TINY

_POSITIONS, _WEIGHTS = np.polynomial.legendre.leggauss(32)
_NODES, _WEIGHTS = (_POSITIONS + 1) / 2, _WEIGHTS / 2
"""Gauss-Legendre rule of 32 points on the interval from 0 to 1."""
FEW_DEGREES_OF_FREEDOM, MANY_DEGREES_OF_FREEDOM = 10.0, 100.0
"""Degrees of freedom from which five terms of the expansion about a normal quantile are an initial
guess, and from which they are exact to 1e-8."""
MAX_STEPS = 10
"""Maximum number of Newton steps; at most 7 are needed from one degree of freedom and up to a level
of 0.999."""
STEP_TOLERANCE = 1e-5
"""Relative size of the last step: the error after it is of the size of its square."""


def squared_quantile(quantities: int, degrees_of_freedom: FloatArray, level: float) -> FloatArray:
    """Return quantiles of a sum of squared errors, each over its estimated standard deviation.

    Their relative error is below 1e-8, from one degree of freedom on.

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
        Quantiles.

    Examples
    --------
    >>> squared_quantile(2, np.array([math.inf, 10.0]), 0.95).round(4).tolist()
    [5.9915, 8.2056]
    """
    if quantities == 1:
        return _student_quantile(degrees_of_freedom, level) ** 2
    rate, exponent = 2 / degrees_of_freedom, -math.log1p(-level)
    finite = np.maximum(rate, TINY)  # of a known variance 0: expm1(x) / x is then 1
    return 2 * np.expm1(finite * exponent) / finite


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
    """Return t that |t| exceeds with probability 1 - level, for an array (k,).

    With t = sqrt(dof) tan(u), the density of u is proportional to cos(u)^(dof - 1). The expansion
    is that of Abramowitz and Stegun, Handbook of Mathematical Functions, 26.7.5.
    """
    z = NormalDist().inv_cdf((1 + level) / 2)
    first, second = (z**3 + z) / 4, (5 * z**5 + 16 * z**3 + 3 * z) / 96
    third = (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384
    fourth = (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160
    rate = 1 / degrees_of_freedom
    quantiles: FloatArray = z + rate * (first + rate * (second + rate * (third + rate * fourth)))
    few = degrees_of_freedom <= MANY_DEGREES_OF_FREEDOM
    if few.any():
        dof = degrees_of_freedom[few]
        half = [math.exp(math.lgamma(n / 2) - math.lgamma((n + 1) / 2)) for n in dof.tolist()]
        part = level * math.sqrt(math.pi) / 2 * np.array(half)
        start = np.where(dof < FEW_DEGREES_OF_FREEDOM, z, quantiles[few])
        u = np.arctan(start / np.sqrt(dof))
        for _ in range(MAX_STEPS):  # the integral is concave: from below, Newton never passes u
            step = (part - _cosine_power_integral(u, dof - 1)) / np.cos(u) ** (dof - 1)
            u = np.minimum(u + step, math.pi / 2)
            if (np.abs(step) < STEP_TOLERANCE * u).all():
                break
        quantiles[few] = np.sqrt(dof) * np.tan(u)
    return quantiles


def _cosine_power_integral(u: FloatArray, power: FloatArray) -> FloatArray:
    """Return the integral of cos^power from 0 to u; over w, with u = pi/2 - w^4, it is smooth."""
    first, last = (math.pi / 2 - u[:, None]) ** 0.25, (math.pi / 2) ** 0.25
    w = first + (last - first) * _NODES
    integrand: FloatArray = 4 * w**3 * np.sin(w**4) ** power[:, None]
    integral: FloatArray = (last - first[:, 0]) * (integrand @ _WEIGHTS)
    return integral
