"""Test whether the points of an arc contradict the radius or the tilt known for their fit."""

import math
from dataclasses import replace
from typing import NamedTuple

from lsvision.ellipse.fit_result import EllipseFit
from lsvision.ellipse.parameters import (
    PARAMETERS,
    axes_from_parameters,
    axis_ratio_gradient,
    compute_semi_minor,
    phi_std_from_ratio,
    semi_minor_gradient,
)
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import EllipseProblem, Solution, minimise
from lsvision.ellipse.robust_gauss_newton import invert_information_or_huge
from lsvision.geometry import FloatArray
from lsvision.geometry.arrays import TINY
from lsvision.statistics.correlation import estimate_correlation

CONTRADICTION_SIGMAS = 6.0
"""Square root of the increase of chi^2 by a known value, above which the points contradict it.
More than the usual 3, for errors that are correlated or larger than assumed: of 1500 right radii of
simulated pipes (300 each with outliers, welds, twice the stated noise, and two correlations of the
errors) it rejects 1, a limit of 4.2 6, of 3 18. Of 800 radii wrong by 5 % it accepts 108, by 10 %
33 (4.2: 66 and 16; 8.4: 213 and 66), of arcs that determine the radius poorly."""
CONTRADICTION_FRACTION = 0.02
"""Smallest relative difference from the known radius, or from the ratio of the semi-axes at the
known tilt, that is a contradiction: a nominal radius may be wrong by the tolerance of a tube, and a
section may be oval."""


class RadiusOfPoints(NamedTuple):
    """Radius of the points without a prior on it, and its standard uncertainty. Units: mm."""

    radius: float
    std: float


class TiltOfPoints(NamedTuple):
    """Tilt of the points without a prior on it, and its standard uncertainty. Units: rad."""

    phi: float
    std: float


class _FreeFit(NamedTuple):
    """Parameters (5,) of the fit without a prior, and their covariance (5, 5). Units: mm."""

    parameters: FloatArray
    covariance: FloatArray

    def std(self, gradient: FloatArray) -> float:
        """Return the standard uncertainty of a quantity from its gradient by the parameters."""
        return math.sqrt(max(float(gradient @ self.covariance @ gradient), 0.0))


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
    """
    known = fit.problem.known_radius
    if known is None:
        return None
    prior = (compute_semi_minor(fit.parameters) - known.radius) / known.effective_std
    free = _fit_contradicting(fit, replace(fit.problem, known_radius=None), prior * prior)
    if free is None:
        return None
    radius = compute_semi_minor(free.parameters)
    if abs(radius - known.radius) <= CONTRADICTION_FRACTION * known.radius:
        return None
    return RadiusOfPoints(radius, free.std(semi_minor_gradient(free.parameters)))


def find_contradicting_tilt(fit: EllipseFit, known: PhiPrior | None) -> TiltOfPoints | None:
    """Return the tilt of the points alone, if they contradict a known phi.

    Parameters
    ----------
    fit : EllipseFit
        Fit with the known phi. Where it excludes a circle and the points do not determine theta, it
        is not a prior of the fit (see `PhiPrior`), whose own phi is then that of the points.
    known : PhiPrior or None
        The known phi.

    Returns
    -------
    TiltOfPoints or None
        None without a known phi, where the ratio of the semi-axes agrees with it within
        `CONTRADICTION_FRACTION` or `CONTRADICTION_SIGMAS`, or where the points do not determine an
        ellipse alone.
    """
    if known is None:
        return None
    if fit.problem.known_phi is None:
        free: _FreeFit | None = _FreeFit(fit.parameters, fit.parameter_covariance)
        max_sigmas = CONTRADICTION_SIGMAS * math.sqrt(fit.correlation.autocorrelation_time)
    else:  # the likelihood ratio decides, instead of the standard deviations
        prior, _ = known.residuals_and_jacobian(fit.parameters)
        free = _fit_contradicting(fit, replace(fit.problem, known_phi=None), float(prior @ prior))
        max_sigmas = 0.0
    if free is None:
        return None
    a, b, _ = axes_from_parameters(free.parameters)
    ratio_std, known_ratio = free.std(axis_ratio_gradient(free.parameters)), math.cos(known.phi)
    uncertainty = math.hypot(ratio_std, math.sin(known.phi) * known.std)
    if abs(b / a - known_ratio) <= max(
        CONTRADICTION_FRACTION * known_ratio, max_sigmas * uncertainty
    ):
        return None
    phi = math.acos(b / a)
    return TiltOfPoints(phi, phi_std_from_ratio(phi, ratio_std))


def _fit_contradicting(
    fit: EllipseFit, problem: EllipseProblem, prior_chi2: float
) -> _FreeFit | None:
    """Return the fit without a prior, if that prior increases chi^2 significantly.

    Likelihood ratio test: the decrease of chi^2 without the prior, over the variance factor of the
    residuals that remain, is chi-squared distributed if the known value is right.

    Parameters
    ----------
    fit : EllipseFit
        Fit with the prior.
    problem : EllipseProblem
        The same problem without it.
    prior_chi2 : float
        Part of the prior in chi^2 of the fit.
    """
    (free,) = minimise([problem], fit.parameters[None])
    if not (isinstance(free, Solution) and free.converged):
        return None
    chi2 = float(free.residuals @ free.residuals)
    time = estimate_correlation(free.residuals).autocorrelation_time
    factor = max(chi2 / max(len(free.residuals) - PARAMETERS, 1) * time, TINY)
    with_prior = fit.residuals / fit.problem.stds
    increase = float(with_prior @ with_prior) + prior_chi2 - chi2
    # Correlated residuals show a form error. From the reference band to the low-frequency band its
    # power increases by the autocorrelation time, and about as much again to the lowest
    # frequencies, which an ellipse absorbs: a rough surface may seem to be tilted.
    if increase <= CONTRADICTION_SIGMAS**2 * factor * time:
        return None
    return _FreeFit(free.parameters, factor * invert_information_or_huge(free.information))
