"""Geometric refinement of one arc (paper section 2.3), with a correction of its noise model."""

from dataclasses import replace
from typing import NamedTuple

from lsvision.ellipse.arc_noise import errors_grow_with_incidence, smoothed_noise
from lsvision.ellipse.fit import EllipseFit, FittingSettings, fit_noisy_points
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import RadiusPrior
from lsvision.geometry import Ellipse
from lsvision.geometry.noisy_points import NoisyPoints


class Priors(NamedTuple):
    """Priors on radius and tilt of a cylinder."""

    radius: RadiusPrior | None
    phi: PhiPrior | None


def refine_arc(
    points: NoisyPoints,
    initial_guess: Ellipse,
    priors: Priors,
    settings: FittingSettings,
    estimated_std: float | None,
) -> EllipseFit:
    """Fit an ellipse to the inliers of an arc, with the noise model corrected by its residuals.

    Parameters
    ----------
    points : NoisyPoints
        Inliers, in order along the line.
    initial_guess : Ellipse
        Ellipse of the homogenised arc. Units: mm, rad.
    priors : Priors
        Priors on radius and phi.
    settings : FittingSettings
        Settings of the fit.
    estimated_std : float or None
        Standard deviation of an estimated noise, None for a noise model. The variance of an
        estimated noise is free, and an arc whose errors are correlated or grow with incidence is
        refitted with the noise of a sensor that smooths along the line. Units: mm.

    Returns
    -------
    EllipseFit

    Raises
    ------
    LsvisionError
        If no ellipse can be fitted; see `fit_ellipse`.
    """
    if estimated_std is None:
        return fit_noisy_points(points, initial_guess, priors.radius, priors.phi, settings)
    settings = replace(settings, variance="estimated")
    fit = fit_noisy_points(points, initial_guess, priors.radius, priors.phi, settings)
    independent = not fit.correlation.neighbours_correlated
    if independent and not errors_grow_with_incidence(fit.normalised, fit.normals):
        return fit
    smoothed = smoothed_noise(points, fit.normals, estimated_std)
    return fit_noisy_points(smoothed, fit.ellipse, priors.radius, priors.phi, settings)
