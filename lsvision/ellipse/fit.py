"""Geometric refinement: the maximum-likelihood ellipse of an arc (paper section 2.3).

The paper minimises radial residuals with equal weights. Measured on simulated sections that
costs 5-20 % of accuracy, because a light section's errors lie along the ray: here each
orthogonal residual is divided by the standard deviation of the point's error along the
ellipse's normal n, sqrt(n' Sigma n), which reaches the Cramer-Rao bound.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lsvision.ellipse.parameters import (
    PARAMETERS,
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
from lsvision.geometry.arrays import require_coordinates, require_covariances
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints, as_complex, as_vectors
from lsvision.statistics.correlation import (
    LOW_FREQUENCY_DOF,
    Correlation,
    estimate_correlation,
)
from lsvision.statistics.numerical_failures import refuse_numerical_failure, require_finite

CHI2_TEST_SIGMAS = 3.3
"""Standard deviations of chi^2 beyond which a noise model is held to be too optimistic."""

TINY = 1e-300
NONCIRCULAR_SIGMAS = 5.0
"""Sigmas of (p, q) beyond which phi and theta have errors as normal as any."""


@dataclass(frozen=True, kw_only=True)
class FittingSettings:
    """Ellipse fitting, section 2.3.

    Parameters
    ----------
    residual : {"orthogonal", "radial"}
        What is minimised: the distance to the nearest point of the ellipse, or the paper's
        r_j along the ray from the centre (Eq. 4).
    reweightings : int
        How often the weights 1 / (n' Sigma n) are renewed at the fitted ellipse. One is
        enough from a conditioned start; the paper has none.
    max_evaluations : int
        Of the residuals; then the iteration ends where it is, unsettled.
    tolerance : float
        A step that reduces chi^2 by so small a share is the last.
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
    """An ellipse with the evidence it rests on.

    Parameters
    ----------
    ellipse : Ellipse
        The estimate.
    problem : EllipseProblem
        Points, weights and prior: what the likelihood is made of.
    parameters : (5,) ndarray
        ``centre_x, centre_y, m, p, q``; see `lsvision.ellipse.parameters`. Units: mm.
    residuals : (n,) ndarray
        Signed, positive outside. Units: mm.
    normalised : (n,) ndarray
        Residuals over their predicted standard deviation (over their rms where no noise
        model is given).
    normals : (n,) complex ndarray
        Outward unit normals of the ellipse at the points.
    unscaled_covariance : (5, 5) ndarray
        Of the parameters, if the points' weights are right. Units: mm^2.
    variance_factor : float
        By which the covariance of the model is multiplied: 1 where the noise model explains
        the residuals; more where they are larger, or correlated along the line.
    degrees_of_freedom : float
        Of `variance_factor`; infinite where it comes from the noise model alone.
    correlation : Correlation
        Of the residuals along the line.
    converged : bool
        Whether the iteration reached its minimum; false for an ellipse that was still on its way
        to a needle.
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
        """(5, 5), order of `parameters`. Units: mm^2."""
        return self.variance_factor * self.unscaled_covariance

    @property
    def is_noncircular(self) -> bool:
        """Whether (p, q) is so far from a circle that its error hardly turns it."""
        largest = float(np.linalg.eigvalsh(self.parameter_covariance[3:, 3:])[-1])
        return math.hypot(*self.parameters[3:]) > NONCIRCULAR_SIGMAS * math.sqrt(largest)

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
    """Maximum-likelihood ellipse of the points of an arc.

    Parameters
    ----------
    points : (n, 2) ndarray
        Points of one arc without lost ones, in order along the line. Section frame. Units: mm.
    initial_guess : Ellipse
        Where to begin; an algebraic fit or a screened ellipse.
    covariances : (n, 2, 2) ndarray, optional
        Covariance of each point's error. None: equal, isotropic, estimated from the
        residuals. Units: mm^2.
    known_radius : RadiusPrior, optional
        A prior on the semi-minor axis.
    known_phi : PhiPrior, optional
        A prior on the tilt: makes a circle, or nearly one, of an arc too short for an ellipse.
        One that is surely no circle is used where the points tell theta, else nothing of it.
    settings : FittingSettings
        Residual and number of reweightings.

    Returns
    -------
    EllipseFit

    Raises
    ------
    ValueError
        If the shapes are others, a number is not finite or beyond 1e9 mm, or a covariance is none.
    TooFewPoints
        Under 6 points (5 with a known radius would leave nothing to judge by).
    FitFailed
        If the data have no minimum near the start: a straight line, two crossing lines; or the
        numbers overflow.

    Notes
    -----
    An arc under 60 deg leaves a and b almost free; the covariance says so. Near phi = 0 theta
    means nothing: a and b are equal.

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
    with refuse_numerical_failure("an ellipse"):
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
    """`fit_ellipse` for points that carry their covariances: same parameters, errors and notes."""
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
    return _refit_with_scaled_stds(fit) if has_prior else fit


def _scale_by_free_fit(
    points: NoisyPoints, initial_guess: FloatArray, settings: FittingSettings
) -> NoisyPoints:
    """The points with the variance that a fit without priors finds: a prior needs its size."""
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
    if factor == 1:
        return fit
    problem = replace(fit.problem, stds=fit.problem.stds * np.sqrt(factor))
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
    """Inverse of the information; huge variances where it is singular."""
    inverse = solve_positive_definite(information, IDENTITY)
    if math.isnan(inverse[0, 0]):
        scale = 1 / np.sqrt(np.maximum(information.diagonal(), TINY))
        scales = scale[:, None] * scale
        values, vectors = np.linalg.eigh(information * scales)
        with np.errstate(over="ignore"):  # all points at one place: infinite variances
            inverse = (vectors / np.maximum(values, 1e-14)) @ vectors.T * scales
    return inverse


def _build_fit(problem: EllipseProblem, solution: Solution, *, known_noise: bool) -> EllipseFit:
    count = len(problem.points)
    normalised = solution.residuals[:count]
    residuals = normalised * problem.stds
    normals = -as_complex(solution.jacobian[:count, :2])
    correlation = estimate_correlation(normalised)
    freedom = float(max(count - PARAMETERS, 1)) + problem.prior_residual_count
    excess = float(normalised @ normalised) / freedom
    if known_noise:
        surprising = excess > 1 + CHI2_TEST_SIGMAS * np.sqrt(2 / freedom)
        factor, freedom = (excess if surprising else 1.0), np.inf
    else:
        factor = max(excess, TINY)
        normalised = normalised / np.sqrt(factor)
        freedom = max(freedom / correlation.autocorrelation_time, 1.0)
    if correlation.coloured:
        freedom = min(freedom, LOW_FREQUENCY_DOF)
    return EllipseFit(
        ellipse=ellipse_from_parameters(solution.parameters),
        problem=problem,
        parameters=solution.parameters,
        residuals=residuals,
        normalised=normalised,
        normals=normals / np.maximum(np.abs(normals), TINY),
        unscaled_covariance=_inverse(solution.jacobian.T @ solution.jacobian),
        variance_factor=factor * correlation.autocorrelation_time,
        degrees_of_freedom=freedom,
        correlation=correlation,
        converged=solution.converged,
    )
