"""Test whether the points of an arc contradict the known radius with which they were fitted."""

import math
from dataclasses import replace
from typing import NamedTuple

from lsvision.ellipse.fit_result import EllipseFit
from lsvision.ellipse.parameters import PARAMETERS, semi_minor, semi_minor_gradient
from lsvision.ellipse.problem import Solution, minimise
from lsvision.ellipse.robust_gauss_newton import invert_information_or_huge
from lsvision.geometry.arrays import TINY
from lsvision.statistics.correlation import estimate_correlation

CONTRADICTION_SIGMAS = 6.0
"""Square root of the increase of chi^2 by a known radius, above which the points contradict it."""
CONTRADICTION_FRACTION = 0.02
"""Smallest difference from the known radius, as a fraction of it, that is a contradiction: a
nominal radius may be wrong by the tolerance of a tube, and a section may be oval."""


class RadiusOfPoints(NamedTuple):
    """Radius of the points without a prior on it, and its standard uncertainty. Units: mm."""

    radius: float
    std: float


def find_contradicting_radius(fit: EllipseFit) -> RadiusOfPoints | None:
    """Return the radius of the points alone, if they contradict the known radius of a fit.

    Parameters
    ----------
    fit : EllipseFit
        Fit with or without a known radius.

    Returns
    -------
    RadiusOfPoints or None
        None without a known radius, where the points agree with it within `CONTRADICTION_SIGMAS` or
        `CONTRADICTION_FRACTION`, or where they do not determine an ellipse alone.

    Notes
    -----
    Likelihood ratio test: the decrease of chi^2 without the prior, over the variance factor of the
    residuals that remain, is chi-squared distributed with one degree of freedom if the known
    radius is right.
    """
    known = fit.problem.known_radius
    if known is None:
        return None
    (free,) = minimise([replace(fit.problem, known_radius=None)], fit.parameters[None])
    if not (isinstance(free, Solution) and free.converged):
        return None
    chi2 = float(free.residuals @ free.residuals)
    correlation = estimate_correlation(free.residuals)
    dof = max(len(free.residuals) - PARAMETERS, 1)
    factor = max(chi2 / dof * correlation.autocorrelation_time, TINY)
    with_prior = fit.residuals / fit.problem.stds
    prior = (semi_minor(fit.parameters) - known.radius) / known.effective_std
    increase = float(with_prior @ with_prior) + prior * prior - chi2
    radius = semi_minor(free.parameters)
    agrees = (
        increase <= CONTRADICTION_SIGMAS**2 * factor
        or abs(radius - known.radius) <= CONTRADICTION_FRACTION * known.radius
    )
    if agrees:
        return None
    gradient = semi_minor_gradient(free.parameters)
    variance = float(gradient @ invert_information_or_huge(free.information) @ gradient)
    return RadiusOfPoints(radius, math.sqrt(max(factor * variance, 0.0)))
