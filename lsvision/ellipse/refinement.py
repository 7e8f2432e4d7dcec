"""Geometric refinement of arcs (paper section 2.3), with a correction of their noise models."""

from collections.abc import Collection, Sequence
from dataclasses import replace

from lsvision.ellipse.arc_noise import (
    apply_smoothing_sensor_noise,
    has_errors_growing_with_incidence,
)
from lsvision.ellipse.fit import Fits, FittingSettings, fit_noisy_points
from lsvision.ellipse.fit_result import EllipseFit
from lsvision.ellipse.outcomes import replace_some
from lsvision.ellipse.problem import Priors
from lsvision.geometry import Ellipse
from lsvision.geometry.noisy_points import NoisyPoints


def refine_arcs(
    points: Sequence[NoisyPoints],
    initial_guesses: Sequence[Ellipse],
    priors: Priors,
    settings: FittingSettings,
    estimated_stds: Sequence[float | None],
) -> Fits:
    """Fit ellipses to the inliers of arcs, and correct the noise models by the residuals.

    Parameters
    ----------
    points : sequence of NoisyPoints
        Inliers of each arc, in order along the line.
    initial_guesses : sequence of Ellipse
        Ellipses of the homogenised arcs. Units: mm, rad.
    priors : Priors
        Priors on radius and phi, the same for all arcs.
    settings : FittingSettings
        Settings of the fit.
    estimated_stds : sequence of float or None
        Standard deviation of an estimated noise, None for a given noise model. An estimated noise
        is scaled by the residuals; an arc whose errors are correlated, or increase with the angle
        of incidence, is fitted again with the noise of a sensor that smooths along the line.
        Units: mm.

    Returns
    -------
    list of EllipseFit or LsvisionError
        Fit of each arc, or the error if no ellipse can be fitted; see `fit_ellipse`.
    """
    arcs = dict(enumerate(zip(points, initial_guesses, estimated_stds, strict=True)))
    given = {i: (arc, guess) for i, (arc, guess, std) in arcs.items() if std is None}
    estimated = {i: (arc, guess, std) for i, (arc, guess, std) in arcs.items() if std is not None}
    fits = dict(zip(given, fit_noisy_points(given.values(), priors, settings), strict=True))
    settings = replace(settings, variance="estimated")
    fits |= zip(estimated, _refine_estimated(estimated.values(), priors, settings), strict=True)
    return [fits[i] for i in arcs]


def _refine_estimated(
    arcs: Collection[tuple[NoisyPoints, Ellipse, float]], priors: Priors, settings: FittingSettings
) -> Fits:
    """Fit ellipses to arcs with estimated noise; fit some again with that of a smoothing sensor."""
    fits = fit_noisy_points([(points, guess) for points, guess, _ in arcs], priors, settings)
    with_smoothing_sensor = {
        i: (apply_smoothing_sensor_noise(points, fit.normals, std), fit.ellipse)
        for i, (fit, (points, _, std)) in enumerate(zip(fits, arcs, strict=True))
        if isinstance(fit, EllipseFit) and _shows_smoothing(fit)
    }
    replace_some(fits, with_smoothing_sensor, lambda arcs: fit_noisy_points(arcs, priors, settings))
    return fits


def _shows_smoothing(fit: EllipseFit) -> bool:
    """Return whether the errors are those of a smoothing sensor.

    They are correlated, or increase with the angle of incidence.
    """
    return fit.correlation.neighbours_correlated or has_errors_growing_with_incidence(
        fit.normalised, fit.normals
    )
