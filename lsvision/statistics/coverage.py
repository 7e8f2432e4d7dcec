"""Coverage factors: half widths of intervals and joint regions in standard uncertainties."""

import math


def coverage_factor(quantities: int, degrees_of_freedom: float, level: float) -> float:
    """Return the half width of an interval, or of a joint region, in standard uncertainties.

    Parameters
    ----------
    quantities : int
        Number of quantities of the joint region, 1 for an interval.
    degrees_of_freedom : float
        Degrees of freedom of the estimated noise; infinite where it is known.
    level : float
        Level of confidence, between 0 and 1.

    Returns
    -------
    float
        Root of `quantities` times the quantile of F, or the root of that of chi^2 for infinite
        degrees of freedom; for one quantity that of Student's t.

    Raises
    ------
    ValueError
        If the level is not between 0 and 1.

    Examples
    --------
    >>> [round(coverage_factor(1, dof, 0.95), 2) for dof in (10.0, math.inf)]
    [2.23, 1.96]
    """
    from scipy.special import chdtri, fdtri

    if not 0 < level < 1:
        raise ValueError(f"expected a level between 0 and 1, got {level}")
    if math.isinf(degrees_of_freedom):
        return math.sqrt(chdtri(quantities, 1 - level))
    return math.sqrt(quantities * fdtri(quantities, degrees_of_freedom, level))
