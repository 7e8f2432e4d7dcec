"""Points that pull an ellipse to themselves: seen not in their own residual, but in the others'.

At a grazing end n' Sigma n almost vanishes, and a jump there weighs as much as the rest of the
arc: the ellipse goes through it, and beside all the others. So where a fit scatters more than its
noise allows, each of the outermost points is left out in turn.
"""

from dataclasses import replace

import numpy as np

from lsvision.errors import LsvisionError
from lsvision.fitting.ellipse_fit import EllipseFit
from lsvision.fitting.ellipse_problem import ArcProblem, minimise
from lsvision.shapes import BoolArray, FloatArray

OUTERMOST = 4
"""Points at either end that are tried."""
MOST_DROPPED = 3
MOST_EVALUATIONS = 20
"""Of a fit without one of its points, which begins beside its minimum."""
TELLING = 16.0
"""By which chi^2 must fall, in units of what it is for each point then: four sigma."""


def without_leverage(fit: EllipseFit) -> BoolArray:
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
    for _ in range(MOST_DROPPED):
        inside = np.flatnonzero(kept)
        trials = [
            (*_cost_without(fit.problem, kept, int(i), parameters), int(i))
            for i in (*inside[:OUTERMOST], *inside[-OUTERMOST:])
        ]
        least, found, dropped = min(trials, key=lambda trial: trial[0])
        per_point = max(least / max(len(inside) - 1 - len(parameters), 1), 1.0)
        if cost - least < TELLING * per_point:
            break
        kept[dropped] = False
        parameters, cost = found, least
    return kept


def _cost_without(
    problem: ArcProblem, kept: BoolArray, index: int, parameters: FloatArray
) -> tuple[float, FloatArray]:
    """Chi^2 and parameters of the fit to all that is kept but one; infinite where it fails."""
    rest = kept.copy()
    rest[index] = False
    try:
        solution = minimise(
            replace(problem, points=problem.points[rest], stds=problem.stds[rest]),
            parameters,
            MOST_EVALUATIONS,
        )
    except LsvisionError:
        return np.inf, parameters
    return float(solution.residuals @ solution.residuals), solution.parameters
