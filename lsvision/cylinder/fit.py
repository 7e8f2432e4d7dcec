"""Maximum-likelihood fit of a cylinder to points in space, usually of several sections.

The residual of a point is its distance from the surface divided by the standard deviation
sqrt(n' Sigma n) of that distance. Two cylinders, the twins, fit the points of one section, with a
large uncertainty; only one fits those of two or more sections.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lsvision.cylinder.alternatives import (
    CylinderComparison,
    build_in_plane_covariances,
    select_fit,
)
from lsvision.cylinder.fit_result import CylinderFit, estimate_variance_factor
from lsvision.cylinder.initial_guess import guess_cylinders
from lsvision.cylinder.point_checks import (
    require_noise_estimate,
    require_not_degenerate,
    require_type,
    validate_points,
)
from lsvision.cylinder.problem import (
    PARAMETERS,
    CylinderProblem,
    build_weighted_problem,
    cylinder_from_parameters,
    invert_information,
    minimise,
    normalised_residuals,
    parameters_from_cylinder,
    rotate_covariances,
)
from lsvision.ellipse.problem import Priors, RadiusPrior
from lsvision.errors import LsvisionError
from lsvision.geometry import BoolArray, Cylinder, FloatArray, Points, build_tangent_frame
from lsvision.geometry.arrays import measure_extent
from lsvision.geometry.settings_repr import ShowsChanges
from lsvision.statistics.numerical_failures import report_numerical_failure, require_finite
from lsvision.statistics.robust import mad_std

MAX_TRUNCATION_ITERATIONS = 20
"""Largest number of fits with truncation; usually five are needed."""
MAX_TILT_TANGENT = 0.1
"""Tangent of the angle between axis and frame, above which a fit is repeated in the frame of its
solution."""
MAX_DENSITY_SIGMAS = 40.0
"""Standard deviations beyond which the density of a normal distribution is 0 in floating point."""


@dataclass(frozen=True, kw_only=True, repr=False)
class CylinderFittingSettings(ShowsChanges):
    """Settings of the cylinder fit.

    Parameters
    ----------
    reweightings : int
        Number of times the weights are recomputed at the fitted cylinder: 1 / (n' Sigma n) of the
        points, or without covariances that of a known radius relative to the residuals.
    truncation : float, optional
        Largest distance of an inlier from the surface, in standard deviations; above 1. Other
        points are excluded, and the fit is repeated until the inliers do not change. The method
        assumes that three quarters of the points are inliers; with more outliers it may fit these,
        too, and `CylinderFit.variance_factor` is then large. The standard deviation is the larger
        of that of the noise model, if there is one, and the robust one (MAD) of the residuals.
        The covariance includes the effect of excluding such points, for normal errors.
        None: all points are inliers.

    Raises
    ------
    ValueError
        If a value is out of its range.

    Examples
    --------
    >>> import lsvision as lsv
    >>> lsv.CylinderFittingSettings(truncation=3.0)
    CylinderFittingSettings(truncation=3.0)
    """

    reweightings: int = 3
    truncation: float | None = None

    def __post_init__(self) -> None:
        if not self.reweightings >= 1:
            raise ValueError(f"expected at least one reweighting, got {self.reweightings}")
        if self.truncation is not None and not self.truncation > 1:
            raise ValueError(f"expected a truncation above 1 sigma, got {self.truncation}")


def fit_cylinder(
    points: npt.ArrayLike,
    covariances: npt.ArrayLike | None = None,
    *,
    initial_guess: Cylinder | None = None,
    known_radius: RadiusPrior | float | Sequence[float] | None = None,
    settings: CylinderFittingSettings = CylinderFittingSettings(),
) -> CylinderFit:
    """Fit a cylinder to points in space by maximum likelihood.

    Parameters
    ----------
    points : (n, 3) array_like
        At least 6 points, without covariances 8, in one frame, without lost points; those of one
        section follow one another, along the line. Units: mm.
    covariances : (n, 3, 3) array_like, optional
        Covariance of each point's error. None: least squares of the distances with equal
        weights, and the noise estimated from the residuals. Units: mm^2.
    initial_guess : Cylinder, optional
        Start of the iteration, which converges to the nearest minimum; the points of one section
        have two (the twins). None: estimated from the points.
    known_radius : RadiusPrior, float or (float, float), optional
        Prior on the radius: the radius, or (radius, std). Units: mm.
    settings : CylinderFittingSettings
        Reweightings and truncation.

    Returns
    -------
    CylinderFit
        The cylinder with its covariance. Its direction has the sign of that of the initial guess;
        without an initial guess, the largest component of the direction is positive.

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite or a coordinate beyond 1e9 mm, or a covariance
        is zero or not symmetric and positive semi-definite.
    TypeError
        If `initial_guess` or `settings` is something else, or `known_radius` neither a number nor a
        pair.
    TooFewPoints
        If there are fewer than 6 points; or without covariances fewer than 8 inliers, 7 with a
        known radius, that do not lie exactly on the cylinder: their noise cannot be estimated.
    DegenerateGeometry
        If all points are at one position or on a straight line; or, without an initial guess, in
        one plane, such as the points of one section, which two cylinders fit; or if two cylinders
        fit equally well, as to two sections of short arcs (up to about 90 deg, the more often the
        larger the noise) on opposite sides; or, also without covariances and not exactly in planes,
        if those on one side fit a cylinder between their planes better than one along them.
    FitFailed
        If no cylinder fits, for example to noisy points of a plane, or if numbers overflow.

    Notes
    -----
    The distances are corrected for the bias that noise causes on a curved surface, about
    sigma^2 / (2 r): negligible for one point, significant in the mean of 10 000.

    Examples
    --------
    >>> angle, height = np.meshgrid(np.linspace(0, 2, 30), [0.0, 10.0])
    >>> pipe = np.stack([19 * np.cos(angle), 19 * np.sin(angle), height], axis=-1).reshape(-1, 3)
    >>> fit = fit_cylinder(pipe)
    >>> f"radius {fit.radius:.6f} mm, axis {fit.direction.round(6) + 0.0}"
    'radius 19.000000 mm, axis [0. 0. 1.]'
    """
    require_type(settings, CylinderFittingSettings, "settings")
    if initial_guess is not None:
        require_type(initial_guess, Cylinder, "initial_guess")
    points, covariances = validate_points(points, covariances)
    if not isinstance(known_radius, RadiusPrior):
        known_radius = Priors.from_values(known_radius, None).radius
    with report_numerical_failure("a cylinder"):
        fit = _fit_validated(points, covariances, initial_guess, known_radius, settings)
    if covariances is None:
        require_noise_estimate(fit, known_radius)
    cylinder = fit.cylinder
    require_finite("a cylinder", cylinder.point, cylinder.direction, fit.radius, fit.covariance)
    return fit


def _fit_validated(
    points: Points,
    covariances: FloatArray | None,
    initial_guess: Cylinder | None,
    known_radius: RadiusPrior | None,
    settings: CylinderFittingSettings,
) -> CylinderFit:
    """Fit a cylinder to valid points, after centring them and scaling their extent to 1."""
    origin, scale = points.mean(axis=0), measure_extent(points)
    require_not_degenerate(points - origin, has_initial_guess=initial_guess is not None)
    scaled = (points - origin) / scale
    scaled_covariances = None if covariances is None else covariances / scale**2
    prior = known_radius and RadiusPrior(known_radius.radius / scale, known_radius.std / scale)
    if initial_guess is None:
        comparison = CylinderComparison(
            scaled,
            build_in_plane_covariances(scaled) if covariances is None else scaled_covariances,
            covariances is not None,
            prior,
            settings.truncation or math.inf,
        )
        guesses = guess_cylinders(comparison)
        fits = _fit_all(scaled, scaled_covariances, guesses, prior, settings)
        fit = _rescale(select_fit(fits, comparison, scale), origin, scale)
    else:
        guess = Cylinder(
            (initial_guess.point - origin) / scale,
            initial_guess.direction,
            initial_guess.radius / scale,
        )
        fit = _fit_truncated(scaled, scaled_covariances, guess, prior, settings)
        fit = _rescale(fit, origin, scale)
    return _orient_like_initial_guess(fit, initial_guess)


def _fit_all(
    points: Points,
    covariances: FloatArray | None,
    guesses: list[Cylinder],
    known_radius: RadiusPrior | None,
    settings: CylinderFittingSettings,
) -> list[CylinderFit]:
    """Return the fits from several initial guesses, without those that fail but the first."""
    first, *others = guesses
    fits = [_fit_truncated(points, covariances, first, known_radius, settings)]
    for guess in others:
        try:
            fits.append(_fit_truncated(points, covariances, guess, known_radius, settings))
        except LsvisionError:
            continue
    return fits


def _fit_truncated(
    points: Points,
    covariances: FloatArray | None,
    initial_guess: Cylinder,
    known_radius: RadiusPrior | None,
    settings: CylinderFittingSettings,
) -> CylinderFit:
    """Fit a cylinder to the inliers of points, and repeat the fit until they do not change."""
    cylinder, inliers = initial_guess, np.ones(len(points), dtype=bool)
    if settings.truncation is not None:
        _, _, normalised = normalised_residuals(points, covariances, cylinder)
        inliers = _find_inliers(normalised, settings.truncation, inliers)
    for _ in range(MAX_TRUNCATION_ITERATIONS):
        selected = None if covariances is None else covariances[inliers]
        fit = _fit(points[inliers], selected, cylinder, known_radius, settings)
        if settings.truncation is None:
            return fit
        cylinder = fit.cylinder
        residuals, stds, normalised = normalised_residuals(points, covariances, cylinder)
        fit = replace(fit, residuals=residuals, normalised=normalised, stds=stds, inliers=inliers)
        new_inliers = _find_inliers(normalised, settings.truncation, inliers)
        if (new_inliers == inliers).all():
            break
        inliers = new_inliers
    return fit


def _find_inliers(normalised: FloatArray, truncation: float, previous: BoolArray) -> BoolArray:
    """Return the mask of the residuals within a truncation; `previous` if they are too few."""
    # Outliers bias the first fits, so that the limit decreases while outliers are excluded.
    noise_factor = max(1.0, mad_std(normalised))
    inliers: BoolArray = np.abs(normalised) <= truncation * noise_factor
    return inliers if inliers.sum() > PARAMETERS else previous


def _fit(
    points: Points,
    covariances: FloatArray | None,
    cylinder: Cylinder,
    known_radius: RadiusPrior | None,
    settings: CylinderFittingSettings,
) -> CylinderFit:
    """Fit a cylinder to points from an initial one, with the weights recomputed before each fit.

    The fit is not repeated if no weight depends on the cylinder.
    """
    has_fixed_weights = covariances is None and known_radius is None
    for _ in range(settings.reweightings + 1):
        frame = build_tangent_frame(cylinder.direction)
        rotated = None if covariances is None else rotate_covariances(covariances, frame)
        parameters = parameters_from_cylinder(frame, cylinder)
        prior = known_radius and _scale_prior(known_radius, points, covariances, cylinder, settings)
        problem = build_weighted_problem(points @ frame.T, rotated, parameters, prior)
        solution, has_converged = minimise(problem, parameters)
        cylinder = cylinder_from_parameters(frame, solution)
        if has_fixed_weights and has_converged and math.hypot(*solution[2:4]) < MAX_TILT_TANGENT:
            break
    foot_points = problem.points @ frame
    return _build_fit(
        points, foot_points, cylinder, problem, settings, known_noise=covariances is not None
    )


def _compute_inlier_variance(truncation: float | None) -> float:
    """Return the variance of normal errors within a truncation, over that of all of them."""
    if truncation is None:
        return 1.0
    truncation = min(truncation, MAX_DENSITY_SIGMAS)
    density = math.exp(-(truncation**2) / 2) / math.sqrt(2 * math.pi)
    return 1 - 2 * truncation * density / math.erf(truncation / math.sqrt(2))


def _scale_prior(
    known_radius: RadiusPrior,
    points: Points,
    covariances: FloatArray | None,
    cylinder: Cylinder,
    settings: CylinderFittingSettings,
) -> RadiusPrior:
    """Return the prior with the same weight relative to points with the errors that are observed.

    Its std is divided by the factor by which they exceed those of the problem, so that the
    covariance, multiplied by the square of this factor, contains the stated std.
    """
    residuals, _, normalised = normalised_residuals(points, covariances, cylinder)
    factor, _, std_scale = _estimate_variance_factor(
        residuals if covariances is None else normalised,
        len(points) - PARAMETERS,
        settings,
        known_noise=covariances is not None,
    )
    scale = max(std_scale * math.sqrt(factor), float(np.finfo(float).eps))
    return RadiusPrior(known_radius.radius, known_radius.std / scale)


def _estimate_variance_factor(
    normalised: FloatArray,
    degrees_of_freedom: int,
    settings: CylinderFittingSettings,
    *,
    known_noise: bool,
) -> tuple[float, float, float]:
    """Return the numbers of `estimate_variance_factor`, with the effect of a truncation.

    A truncation makes the residuals smaller than the errors. It also increases the uncertainty,
    since points become inliers or outliers as the cylinder moves: to first order the variance by
    one over that of the inliers.
    """
    variance = _compute_inlier_variance(settings.truncation)
    factor, dof, std_scale = estimate_variance_factor(
        normalised / math.sqrt(variance), degrees_of_freedom, known_noise=known_noise
    )
    return factor / variance, dof, std_scale


def _build_fit(
    points: Points,
    foot_points: Points,
    cylinder: Cylinder,
    problem: CylinderProblem,
    settings: CylinderFittingSettings,
    *,
    known_noise: bool,
) -> CylinderFit:
    """Return the fit of a cylinder to points, with the Jacobian at their foot points."""
    frame = build_tangent_frame(cylinder.direction)
    problem = replace(problem, points=foot_points @ frame.T)
    residuals, jacobian = problem.evaluate(parameters_from_cylinder(frame, cylinder))
    normalised = residuals[: len(points)]
    factor, dof, std_scale = _estimate_variance_factor(
        normalised, len(residuals) - PARAMETERS, settings, known_noise=known_noise
    )
    return CylinderFit(
        cylinder=cylinder,
        covariance=factor * std_scale**2 * invert_information(jacobian.T @ jacobian),
        residuals=cylinder.signed_distances(points),
        normalised=normalised / std_scale,
        stds=problem.stds * std_scale,
        inliers=np.ones(len(points), dtype=bool),
        variance_factor=factor,
        degrees_of_freedom=dof,
    )


def _rescale(fit: CylinderFit, origin: FloatArray, scale: float) -> CylinderFit:
    """Return a fit to centred and scaled points, transformed to the original points in mm."""
    scaled = fit.cylinder
    parameter_scales = np.array([scale, scale, 1.0, 1.0, scale])
    return replace(
        fit,
        cylinder=Cylinder(scaled.point * scale + origin, scaled.direction, scaled.radius * scale),
        covariance=fit.covariance * np.outer(parameter_scales, parameter_scales),
        residuals=fit.residuals * scale,
        stds=fit.stds * scale,
    )


def _orient_like_initial_guess(fit: CylinderFit, initial_guess: Cylinder | None) -> CylinderFit:
    """Return the fit with the sign of the direction as `fit_cylinder` defines it."""
    if initial_guess is None:
        reverse = fit.direction[np.argmax(np.abs(fit.direction))] < 0
    else:
        reverse = fit.direction @ initial_guess.direction < 0
    return fit.with_reversed_direction() if reverse else fit
