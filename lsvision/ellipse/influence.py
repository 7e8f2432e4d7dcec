"""Points that pull an ellipse to themselves: seen not in their own residual, but in the others'.

At a grazing end n' Sigma n almost vanishes, and a jump there weighs as much as the rest of the
arc: the ellipse goes through it, and beside all the others. So where a fit scatters more than its
noise allows, each of the outermost points is left out in turn.
"""

from dataclasses import replace

import numpy as np

from lsvision.ellipse.fit import EllipseFit
from lsvision.ellipse.problem import EllipseProblem, minimise
from lsvision.errors import LsvisionError
from lsvision.shapes import BoolArray, FloatArray

END_POINTS_TESTED = 4
"""Points at either end that are tried."""
MAX_REJECTED_POINTS = 3
MAX_EVALUATIONS = 20
"""Of a fit without one of its points, which begins beside its minimum."""
MIN_CHI2_DECREASE = 16.0
"""By which chi^2 must fall, in units of what it is for each point then: four sigma."""


def reject_influential_points(fit: EllipseFit) -> BoolArray:
    """Which points of a fit remain when those that alone spoil it are left out.

    Parameters
    ----------
    fit : EllipseFit
        With known noise.

    Returns
    -------
    (n,) bool ndarray
        All of them where the fit scatters no more than its noise, or no single end point is to
        blame.
    """
    points = fit.problem.points
    kept = np.ones(len(points), dtype=bool)
    if fit.variance_factor == 1:
        return kept
    parameters, cost = fit.parameters, float(fit.normalised @ fit.normalised)
    for _ in range(MAX_REJECTED_POINTS):
        inside = np.flatnonzero(kept)
        trials = [
            (*_chi2_without_point(fit.problem, kept, int(i), parameters), int(i))
            for i in (*inside[:END_POINTS_TESTED], *inside[-END_POINTS_TESTED:])
        ]
        least, found, dropped = min(trials, key=lambda trial: trial[0])
        per_point = max(least / max(len(inside) - 1 - len(parameters), 1), 1.0)
        if cost - least < MIN_CHI2_DECREASE * per_point:
            break
        kept[dropped] = False
        parameters, cost = found, least
    return kept


def _chi2_without_point(
    problem: EllipseProblem, kept: BoolArray, index: int, parameters: FloatArray
) -> tuple[float, FloatArray]:
    """Chi^2 and parameters of the fit to all that is kept but one; infinite where it fails."""
    rest = kept.copy()
    rest[index] = False
    try:
        solution = minimise(
            replace(problem, points=problem.points[rest], stds=problem.stds[rest]),
            parameters,
            MAX_EVALUATIONS,
        )
    except LsvisionError:
        return np.inf, parameters
    return float(solution.residuals @ solution.residuals), solution.parameters
