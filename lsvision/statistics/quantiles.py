"""Quantiles of one or two normal errors, and the normal distribution, without `scipy.special`.

``import scipy.special`` takes longer than all measurements of a profile.
"""

import math
from statistics import NormalDist

import numpy as np

from lsvision.geometry import FloatArray

_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
_NODES, _WEIGHTS = (_PLACES + 1) / 2, _WEIGHTS / 2
MANY_DEGREES_OF_FREEDOM = 1e5
"""Degrees of freedom from which two terms of the expansion about a normal quantile are exact."""
MAX_STEPS = 10
"""Of Newton's method; 7 are the most from one degree of freedom and up to a level of 0.999."""
STEP_TOLERANCE = 1e-6
"""Relative size of the last step: the error after it is of the size of its square."""


def squared_quantile(quantities: int, degrees_of_freedom: float, level: float) -> float:
    """Return the quantile of a sum of squared errors, each over its estimated standard deviation.

    Its relative error is below 1e-8, from one degree of freedom on.

    Definition: `quantities` times the quantile of F with `quantities` and `degrees_of_freedom`;
    with infinitely many, that of chi^2.

    Parameters
    ----------
    quantities : int
        How many errors: 1 or 2.
    degrees_of_freedom : float
        Of the estimate of their variance, at least 1; inf where it is known.
    level : float
        Probability, between 0 and 1.

    Examples
    --------
    >>> round(squared_quantile(1, math.inf, 0.95), 4), round(squared_quantile(2, 10.0, 0.95), 4)
    (3.8415, 8.2056)
    """
    if quantities == 1:
        return _student_quantile(degrees_of_freedom, level) ** 2
    if math.isinf(degrees_of_freedom):
        return -2 * math.log1p(-level)
    return degrees_of_freedom * math.expm1(-2 / degrees_of_freedom * math.log1p(-level))


def normal_probability(values: FloatArray) -> FloatArray:
    """Return the probability that a standard normal variable is smaller, for an array of any shape.

    Examples
    --------
    >>> normal_probability(np.array([0.0, 1.0])).round(4).tolist()
    [0.5, 0.8413]
    """
    scaled = (values / -math.sqrt(2)).ravel().tolist()
    return np.array([math.erfc(x) / 2 for x in scaled]).reshape(values.shape)


def _student_quantile(degrees_of_freedom: float, level: float) -> float:
    """Return t that |t| exceeds with probability 1 - level.

    With t = sqrt(dof) tan(u), the density of u is proportional to cos(u)^(dof - 1).
    """
    dof = degrees_of_freedom
    normal = NormalDist().inv_cdf((1 + level) / 2)
    if dof > MANY_DEGREES_OF_FREEDOM:
        return normal + (normal**3 + normal) / (4 * dof)
    whole = math.sqrt(math.pi) / 2 * math.exp(math.lgamma(dof / 2) - math.lgamma((dof + 1) / 2))
    u = math.atan(normal / math.sqrt(dof))
    for _ in range(MAX_STEPS):  # Newton from below: the integral is concave
        part = _integral(u, dof - 1)
        step = (level * whole - part) / math.cos(u) ** (dof - 1)
        u = min(u + step, math.pi / 2)
        if abs(step) < STEP_TOLERANCE * u:
            break
    return math.sqrt(dof) * math.tan(u)


def _integral(u: float, power: float) -> float:
    """Return the integral of cos^power from 0 to u; over w, with u = pi/2 - w^4, it is smooth."""
    first, last = (math.pi / 2 - u) ** 0.25, (math.pi / 2) ** 0.25
    w = first + (last - first) * _NODES
    integrand: FloatArray = 4 * w**3 * np.sin(w**4) ** power
    return float((last - first) * (_WEIGHTS @ integrand))
