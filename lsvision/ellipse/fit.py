"""Geometric refinement: the maximum-likelihood ellipse of an arc (paper section 2.3).

The paper minimises radial residuals with equal weights. On simulated sections that costs 5-20 %
of accuracy, because the errors of a light section lie along the ray. Here each orthogonal
residual is divided by the standard deviation of the point's error along the ellipse's normal n,
sqrt(n' Sigma n), which attains the Cramer-Rao bound.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lsvision.ellipse.parameters import (
    PARAMETERS,
    deviator_of,
    ellipse_from_parameters,
    parameters_from_ellipse,
)
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import (
    DEFAULT_TOLERANCE,
    MAX_EVALUATIONS,
    EllipseProblem,
    RadiusPrior,
    Solution,
    minimise,
)
from lsvision.ellipse.robust_gauss_newton import (
    IDENTITY,
    ellipse_residuals,
    solve_positive_definite,
)
from lsvision.errors import TooFewPoints
from lsvision.geometry import Ellipse, FloatArray, Points, as_readonly_array
from lsvision.geometry.arrays import TINY, require_coordinates, require_covariances
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints, as_complex, as_vectors
from lsvision.statistics.correlation import Correlation, estimate_correlation
from lsvision.statistics.numerical_failures import report_numerical_failure, require_finite
from lsvision.statistics.robust import SIGNIFICANT_SIGMAS

NONCIRCULAR_SIGMAS = 5.0
"""Standard deviations of (p, q) from 0 above which phi and theta are normally distributed."""


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
    variance : {"given", "estimated"}
        Whether the covariances of the points are known, or only up to a common factor, which is
        then estimated from the residuals.
    """

    residual: Literal["orthogonal", "radial"] = "orthogonal"
    reweightings: int = 1
    max_evaluations: int = MAX_EVALUATIONS
    tolerance: float = DEFAULT_TOLERANCE
    variance: Literal["given", "estimated"] = "given"


@dataclass(frozen=True, eq=False)
class EllipseFit:
    """Fitted ellipse with its residuals and covariance.

    Parameters
    ----------
    ellipse : Ellipse
        Estimated ellipse. Units: mm, rad.
    problem : EllipseProblem
        Points, weights and priors of the least-squares problem.
    parameters : (5,) ndarray
        ``centre_x, centre_y, m, p, q``; see `lsvision.ellipse.parameters`. Units: mm.
    residuals : (n,) ndarray
        Signed residuals, positive outside the ellipse. Units: mm.
    normalised : (n,) ndarray
        Residuals over their predicted standard deviation (over their rms where no noise
        model is given).
    normals : (n,) complex ndarray
        Outward unit normals of the ellipse at the points.
    unscaled_covariance : (5, 5) ndarray
        Covariance of the parameters for a variance factor of 1. Units: mm^2.
    variance_factor : float
        Factor on that covariance: 1 where the noise model explains the residuals; more where
        they are larger, or correlated along the line.
    degrees_of_freedom : float
        Degrees of freedom of `variance_factor`; infinite if it follows from the noise model.
    correlation : Correlation
        Correlation of the residuals along the line.
    converged : bool
        Whether the iteration reached its minimum; false where the ellipse was still becoming
        flatter.
    """

    ellipse: Ellipse
    problem: "EllipseProblem"
    parameters: FloatArray
    residuals: FloatArray
    normalised: FloatArray
    normals: ComplexArray
    unscaled_covariance: FloatArray
    variance_factor: float
    degrees_of_freedom: float
    correlation: Correlation
    converged: bool

    @property
    def parameter_covariance(self) -> FloatArray:
        """Covariance of `parameters`, (5, 5). Units: mm^2."""
        return self.variance_factor * self.unscaled_covariance

    @property
    def is_noncircular(self) -> bool:
        """Whether (p, q) differs from 0 by more than 5 standard deviations, so theta is defined."""
        largest = float(np.linalg.eigvalsh(self.parameter_covariance[-2:, -2:])[-1])
        return abs(deviator_of(self.parameters)) > NONCIRCULAR_SIGMAS * math.sqrt(largest)

    @property
    def rms(self) -> float:
        """Root mean square of the residuals. Units: mm."""
        return float(np.sqrt(np.mean(self.residuals**2)))


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
        fit = fit_noisy_points(noisy, initial_guess, known_radius, known_phi, settings)
    require_finite("an ellipse", fit.parameters, fit.residuals)
    return fit


def fit_noisy_points(
    points: NoisyPoints,
    initial_guess: Ellipse,
    known_radius: RadiusPrior | None = None,
    known_phi: PhiPrior | None = None,
    settings: FittingSettings = FittingSettings(),
) -> EllipseFit:
    """Fit an ellipse to points with covariances; parameters and errors as in `fit_ellipse`."""
    if len(points) <= PARAMETERS:
        raise TooFewPoints(
            "an arc", len(points), PARAMETERS + 1, "scan slower or nearer, or lower the pitch"
        )
    if known_phi is not None and not known_phi.includes_circle:
        free = fit_noisy_points(points, initial_guess, known_radius, None, settings)
        if not free.is_noncircular:
            return free
        initial_guess = free.ellipse
    parameters = parameters_from_ellipse(initial_guess)
    has_prior = known_radius is not None or known_phi is not None
    if has_prior and settings.variance == "estimated":
        points = _scale_by_free_fit(points, parameters, settings)
    vectors = as_vectors(points.z)
    for _ in range(1 + settings.reweightings):
        stds = np.sqrt(ellipse_residuals(points, parameters).variances)
        problem = EllipseProblem(vectors, stds, known_radius, settings.residual, known_phi)
        solution = minimise(problem, parameters, settings.max_evaluations, settings.tolerance)
        parameters = solution.parameters
    fit = _build_fit(problem, solution, known_noise=settings.variance == "given")
    return _refit_with_scaled_stds(fit) if has_prior and fit.variance_factor != 1 else fit


def with_known_radius(fit: EllipseFit, known_radius: RadiusPrior) -> EllipseFit:
    """Return a fit with a prior on the radius added, at the noise that the fit has found.

    Parameters
    ----------
    fit : EllipseFit
        Without a prior on the radius, or with one that is replaced.
    known_radius : RadiusPrior
        The prior.
    """
    return _refit_with_scaled_stds(
        replace(fit, problem=replace(fit.problem, known_radius=known_radius))
    )


def _scale_by_free_fit(
    points: NoisyPoints, initial_guess: FloatArray, settings: FittingSettings
) -> NoisyPoints:
    """Return the points with the variance of a fit without priors, which scales their weights."""
    vectors = as_vectors(points.z)
    stds = np.sqrt(ellipse_residuals(points, initial_guess).variances)
    residuals = minimise(
        EllipseProblem(vectors, stds, None, settings.residual), initial_guess
    ).residuals
    variance = float(residuals @ residuals) / (len(points) - PARAMETERS)
    variance = max(variance, TINY)
    return NoisyPoints(points.z, points.mean_variance * variance, points.deviator * variance)


def _refit_with_scaled_stds(fit: EllipseFit) -> EllipseFit:
    """Refit with the points' standard deviations scaled to the residuals; the prior is not."""
    factor = fit.variance_factor
    stds = np.maximum(fit.problem.stds * np.sqrt(factor), math.sqrt(TINY))
    problem = replace(fit.problem, stds=stds)
    solution = minimise(problem, fit.parameters)
    residuals = solution.residuals[: len(problem.points)] * problem.stds
    return replace(
        fit,
        ellipse=ellipse_from_parameters(solution.parameters),
        problem=problem,
        parameters=solution.parameters,
        residuals=residuals,
        normalised=residuals / fit.problem.stds,
        unscaled_covariance=_inverse(solution.jacobian.T @ solution.jacobian),
        variance_factor=1.0,
        converged=solution.converged,
    )


def _inverse(information: FloatArray) -> FloatArray:
    """Return the inverse of the information; huge variances where it is singular."""
    inverse = solve_positive_definite(information, IDENTITY)
    if math.isnan(inverse[0, 0]):
        scale = 1 / np.sqrt(np.maximum(information.diagonal(), TINY))
        scales = scale[:, None] * scale
        values, vectors = np.linalg.eigh(information * scales)
        with np.errstate(over="ignore"):  # all points at one position: infinite variances
            inverse = (vectors / np.maximum(values, np.finfo(float).eps)) @ vectors.T * scales
    return inverse


def _build_fit(problem: EllipseProblem, solution: Solution, *, known_noise: bool) -> EllipseFit:
    count = len(problem.points)
    normalised = solution.residuals[:count]
    residuals = normalised * problem.stds
    normals = -as_complex(solution.jacobian[:count, :2])
    correlation = estimate_correlation(normalised)
    dof = float(max(count - PARAMETERS, 1)) + problem.prior_residual_count
    reduced_chi2 = float(normalised @ normalised) / dof
    if known_noise:
        significant = reduced_chi2 > 1 + SIGNIFICANT_SIGMAS * math.sqrt(2 / dof)
        factor, dof = (reduced_chi2 if significant else 1.0), np.inf
    else:
        factor = max(reduced_chi2, TINY)
        normalised = normalised / np.sqrt(factor)
        dof = max(dof / correlation.autocorrelation_time, 1.0)
    dof = min(dof, correlation.degrees_of_freedom)
    return EllipseFit(
        ellipse=ellipse_from_parameters(solution.parameters),
        problem=problem,
        parameters=solution.parameters,
        residuals=residuals,
        normalised=normalised,
        normals=normals / np.maximum(np.abs(normals), TINY),
        unscaled_covariance=_inverse(solution.jacobian.T @ solution.jacobian),
        variance_factor=factor * correlation.autocorrelation_time,
        degrees_of_freedom=dof,
        correlation=correlation,
        converged=solution.converged,
    )
