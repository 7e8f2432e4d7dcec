"""Geometric refinement: the maximum-likelihood ellipse of an arc (paper section 2.3).

The paper minimises radial residuals with equal weights. On simulated sections that costs 5-20 %
of accuracy, because the errors of a light section lie along the ray. Here each orthogonal
residual is divided by the standard deviation of the point's error along the ellipse's normal n,
sqrt(n' Sigma n), which attains the Cramer-Rao bound.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lsvision.ellipse.arc_noise import estimate_arc_correlation
from lsvision.ellipse.arc_solutions import SolvedArc, StartedArc, solve_arcs
from lsvision.ellipse.bias import remove_bias
from lsvision.ellipse.fit_result import EllipseFit
from lsvision.ellipse.outcomes import apply_to_successes, catch_error, replace_some, unwrap
from lsvision.ellipse.parameters import (
    PARAMETERS,
    ellipse_from_parameters,
    parameters_from_ellipse,
)
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import (
    DEFAULT_TOLERANCE,
    MAX_EVALUATIONS,
    NO_PRIORS,
    EllipseProblem,
    Priors,
    RadiusPrior,
    Solution,
    minimise,
)
from lsvision.ellipse.robust_gauss_newton import invert_information_or_huge
from lsvision.errors import LsvisionError, TooFewPoints
from lsvision.geometry import Ellipse, FloatArray, Points, as_readonly_array
from lsvision.geometry.arrays import TINY, require_coordinates, require_covariances
from lsvision.geometry.noisy_points import NoisyPoints, as_complex
from lsvision.statistics.numerical_failures import report_numerical_failure, require_finite
from lsvision.statistics.robust import estimate_excess_variance


@dataclass(frozen=True, kw_only=True)
class FittingSettings:
    """Settings of the ellipse fit (paper section 2.3).

    Parameters
    ----------
    residual : {"orthogonal", "radial"}
        Residual that is minimised: distance to the nearest point of the ellipse, or the paper's
        r_j along the ray from the centre (Eq. 4).
    reweightings : int
        Number of updates of the weights 1 / (n' Sigma n) at the fitted ellipse. One is
        enough for a good initial guess; the paper has none.
    max_evaluations : int
        Largest number of evaluations of the residuals; then the fit has not converged.
    tolerance : float
        Relative decrease of chi^2 in a step, below which the iteration has converged.
    min_axis_ratio : float
        Axis ratio b / a below which the iteration ends, without convergence; 0: none. Points that
        are on no ellipse may fit a flatter one in each step.
    variance : {"given", "estimated"}
        Whether the covariances of the points are known, or only up to a common factor, which is
        then estimated from the residuals.
    """

    residual: Literal["orthogonal", "radial"] = "orthogonal"
    reweightings: int = 1
    max_evaluations: int = MAX_EVALUATIONS
    tolerance: float = DEFAULT_TOLERANCE
    min_axis_ratio: float = 0.0
    variance: Literal["given", "estimated"] = "given"

    def __post_init__(self) -> None:
        if self.residual not in ("orthogonal", "radial"):
            raise ValueError(f"expected residual 'orthogonal' or 'radial', got {self.residual!r}")
        if self.variance not in ("given", "estimated"):
            raise ValueError(f"expected variance 'given' or 'estimated', got {self.variance!r}")


def fit_ellipse(
    points: Points,
    initial_guess: Ellipse,
    covariances: FloatArray | None = None,
    *,
    known_radius: RadiusPrior | None = None,
    known_phi: PhiPrior | None = None,
    settings: FittingSettings = FittingSettings(),
) -> EllipseFit:
    """Fit the maximum-likelihood ellipse to the points of an arc.

    Parameters
    ----------
    points : (n, 2) ndarray
        Points of one arc without lost ones, in order along the line. Section frame. Units: mm.
    initial_guess : Ellipse
        Initial guess, such as an algebraic fit or the ellipse of screening.
    covariances : (n, 2, 2) ndarray, optional
        Covariance of each point's error. Default: equal, isotropic, estimated from the
        residuals. Units: mm^2.
    known_radius : RadiusPrior, optional
        Prior on the semi-minor axis.
    known_phi : PhiPrior, optional
        Prior on the tilt. Near 0 it gives a circle for an arc too short for an ellipse. A prior
        that excludes a circle is ignored where the points do not determine theta.
    settings : FittingSettings
        Settings of the fit.

    Returns
    -------
    EllipseFit

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite or beyond 1e9 mm, or a covariance is invalid.
    TooFewPoints
        For fewer than 6 points: 5 leave no degree of freedom for the residuals.
    FitFailed
        If there is no minimum near the initial guess (a straight line, two crossing lines), or
        numbers overflow.

    Notes
    -----
    An arc under 60 deg hardly determines a and b; their variances are then large. Near phi = 0
    theta is not defined, because a and b are equal.

    Examples
    --------
    >>> truth = Ellipse((3.0, -400.0), 22.0, 19.0, 0.4)
    >>> arc = truth.points_at(np.linspace(0.2, 2.6, 60))
    >>> fit = fit_ellipse(arc, Ellipse((3.0, -400.0), 20.0, 20.0, 0.0))
    >>> f"{fit.ellipse.radius:.6f} mm"
    '19.000000 mm'
    """
    points = as_readonly_array(points, ("n", 2), "points")
    require_coordinates(points)
    if covariances is None:
        settings = replace(settings, variance="estimated")
        no_noise = np.zeros(len(points), dtype=complex)
        noisy = NoisyPoints(as_complex(points), np.ones(len(points)), no_noise)
    else:
        covariances = as_readonly_array(covariances, (len(points), 2, 2), "covariances")
        require_covariances(covariances)
        noisy = NoisyPoints.of(points, covariances)
    with report_numerical_failure("an ellipse"):
        (outcome,) = fit_noisy_points(
            [(noisy, initial_guess)], Priors(known_radius, known_phi), settings
        )
    fit = unwrap(outcome)
    require_finite("an ellipse", fit.parameters, fit.residuals)
    return fit


Fits = list[EllipseFit | LsvisionError]
"""Fits of several arcs; the error where the fit of an arc has failed."""


def fit_noisy_points(
    arcs: Iterable[tuple[NoisyPoints, Ellipse]],
    priors: Priors = NO_PRIORS,
    settings: FittingSettings = FittingSettings(),
) -> Fits:
    """Fit ellipses to several arcs together, with the same priors and settings.

    Parameters
    ----------
    arcs : iterable of (NoisyPoints, Ellipse)
        Points and initial guess of each arc.
    priors : Priors
        Priors on radius and phi.
    settings : FittingSettings
        Settings of the fit.

    Returns
    -------
    list of EllipseFit or LsvisionError
        Result of `fit_ellipse` for each arc; an error is not raised, but returned.
    """
    hint = "scan slower or nearer, or lower the pitch"
    starts = [
        StartedArc(points, parameters_from_ellipse(guess))
        if len(points) > PARAMETERS
        else TooFewPoints("an arc", len(points), PARAMETERS + 1, hint)
        for points, guess in arcs
    ]
    fit = _fit if priors.phi is None or priors.phi.includes_circle else _fit_where_noncircular
    return apply_to_successes(lambda arcs: fit(arcs, priors, settings), starts)


def _fit_where_noncircular(
    arcs: list[StartedArc], priors: Priors, settings: FittingSettings
) -> Fits:
    """Fit without the prior on phi, then with it where the points determine theta."""
    fits = _fit(arcs, priors._replace(phi=None), settings)
    determined = {
        i: StartedArc(arcs[i].points, fit.parameters)
        for i, fit in enumerate(fits)
        if isinstance(fit, EllipseFit) and fit.is_noncircular
    }
    replace_some(fits, determined, lambda noncircular: _fit(noncircular, priors, settings))
    return fits


def _fit(arcs: list[StartedArc], priors: Priors, settings: FittingSettings) -> Fits:
    """Fit ellipses with the priors, whose weight relative to the points follows the residuals.

    The variance factor scales the covariances of the points, but not the priors, and the bias was
    removed from the points alone: with priors the fit is repeated.
    """
    starts: Sequence[StartedArc | LsvisionError] = arcs
    if priors != NO_PRIORS and settings.variance == "estimated":
        starts = _scale_by_free_fits(arcs, settings)
    limits = settings.max_evaluations, settings.tolerance, settings.min_axis_ratio

    def solve(arcs: Sequence[StartedArc | SolvedArc]) -> list[SolvedArc | LsvisionError]:
        return solve_arcs(arcs, priors, settings.residual, *limits)

    solved = apply_to_successes(solve, starts)
    for _ in range(settings.reweightings):
        solved = apply_to_successes(solve, solved)
    fits = apply_to_successes(
        lambda arcs: [catch_error(_build_fit, arc, settings.variance) for arc in arcs], solved
    )
    if priors == NO_PRIORS:
        return fits
    successes = {i: fit for i, fit in enumerate(fits) if isinstance(fit, EllipseFit)}
    replace_some(fits, successes, _refit_with_scaled_stds)
    return fits


def refit_with_known_radius(fit: EllipseFit, known_radius: RadiusPrior) -> EllipseFit:
    """Repeat a fit with a prior on the radius, and with the noise estimated by that fit.

    Parameters
    ----------
    fit : EllipseFit
        Fit without a prior on the radius, or with one that is replaced.
    known_radius : RadiusPrior
        Prior on the radius.

    Raises
    ------
    FitFailed
        If numbers overflow, or the result is not an ellipse.
    """
    problem = replace(fit.problem, known_radius=known_radius)
    (refitted,) = _refit_with_scaled_stds([replace(fit, problem=problem)])
    return unwrap(refitted)


def _scale_by_free_fits(
    arcs: list[StartedArc], settings: FittingSettings
) -> list[StartedArc | LsvisionError]:
    """Return the arcs with variances scaled to the residuals of fits without priors.

    The weight of a prior relative to the points follows only from such variances.
    """

    def scaled(arc: StartedArc, free: SolvedArc) -> StartedArc:
        points, residuals = arc.points, free.solution.residuals
        variance = float(residuals @ residuals) / (len(points) - PARAMETERS)
        variance = max(variance, TINY)
        points = NoisyPoints(points.z, points.mean_variance * variance, points.deviator * variance)
        return StartedArc(points, arc.parameters)

    return [
        free if isinstance(free, LsvisionError) else scaled(arc, free)
        for arc, free in zip(arcs, solve_arcs(arcs, NO_PRIORS, settings.residual), strict=True)
    ]


def _refit_with_scaled_stds(fits: list[EllipseFit]) -> Fits:
    """Refit with the points' standard deviations scaled to the residuals; the prior is not."""

    def scaled(fit: EllipseFit) -> EllipseProblem:
        stds = fit.problem.stds * math.sqrt(fit.variance_factor)
        return replace(fit.problem, stds=np.maximum(stds, math.sqrt(TINY)))

    problems = [scaled(fit) for fit in fits]
    solutions = minimise(problems, np.array([fit.parameters for fit in fits]))
    return [
        catch_error(_update_fit, fit, problem, solution)
        if isinstance(solution, Solution)
        else solution
        for fit, problem, solution in zip(fits, problems, solutions, strict=True)
    ]


def _update_fit(fit: EllipseFit, problem: EllipseProblem, solution: Solution) -> EllipseFit:
    """Return a fit with the solution of the same problem with scaled standard deviations."""
    residuals = solution.residuals * problem.stds
    # Without a noise model, the predicted standard deviations are multiples of `problem.stds`.
    chi2 = float(np.sum((fit.residuals / fit.problem.stds) ** 2))
    inverse_factor = math.sqrt(float(fit.normalised @ fit.normalised) / max(chi2, TINY))
    return replace(
        fit,
        ellipse=ellipse_from_parameters(solution.parameters),
        problem=problem,
        parameters=solution.parameters,
        residuals=residuals,
        normalised=residuals / fit.problem.stds * inverse_factor,
        unscaled_covariance=invert_information_or_huge(solution.information),
        variance_factor=1.0,
        converged=solution.converged,
    )


def _build_fit(arc: SolvedArc, variance: Literal["given", "estimated"]) -> EllipseFit:
    """Return the fit of a solved arc, with the variance factor of its residuals."""
    points, problem, solution = arc
    count, normalised = len(problem.points), solution.residuals
    residuals = normalised * problem.stds
    correlation = estimate_arc_correlation(residuals, normalised, solution.parameters)
    dof = float(max(count - PARAMETERS, 1)) + problem.prior_residual_count
    reduced_chi2 = float(normalised @ normalised) / dof
    if variance == "given":
        factor, dof = estimate_excess_variance(reduced_chi2, dof), np.inf
    else:
        factor = max(reduced_chi2, TINY)
        normalised = normalised / np.sqrt(factor)
        dof = max(dof / correlation.autocorrelation_time, 1.0)
    dof = min(dof, correlation.degrees_of_freedom)
    parameters = solution.parameters
    if problem.residual == "orthogonal" and solution.converged:
        problem, parameters = remove_bias(problem, solution, points, reduced_chi2)
    return EllipseFit(
        ellipse=ellipse_from_parameters(parameters),
        problem=problem,
        parameters=parameters,
        residuals=residuals,
        normalised=normalised,
        normals=solution.normals,
        unscaled_covariance=invert_information_or_huge(solution.information),
        variance_factor=factor * correlation.autocorrelation_time,
        degrees_of_freedom=dof,
        correlation=correlation,
        converged=solution.converged,
    )
