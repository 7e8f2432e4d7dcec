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

from lsvision.errors import TooFewPoints
from lsvision.fitting.correlation import (
    SLOW_FREEDOM,
    Correlation,
    find_correlation,
    grazing_stds,
)
from lsvision.fitting.ellipse_parameters import (
    PARAMETERS,
    ellipse_of,
    orthogonal_comparison,
    parameters_of,
)
from lsvision.fitting.ellipse_problem import (
    MOST_EVALUATIONS,
    NEGLIGIBLE,
    ArcProblem,
    KnownRadius,
    Solution,
    minimise,
)
from lsvision.fitting.known_phi import KnownPhi
from lsvision.fitting.quick_fit import IDENTITY, compare, solve_positive
from lsvision.shapes import Ellipse, FloatArray, Points
from lsvision.shapes.noisy_points import NoisyPoints

SURPRISE = 3.3
"""Standard deviations of chi^2 beyond which a noise model is held to be too optimistic."""

FAR_FROM_CIRCLE = 5.0
"""Sigmas of (p, q) beyond which phi and theta have errors as normal as any."""


@dataclass(frozen=True, kw_only=True, slots=True)
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
    most_evaluations : int
        Of the residuals; then the iteration ends where it is, unsettled.
    negligible : float
        A step that mends so small a share of chi^2, or changes the parameters by so small a
        share of them, is the last.
    """

    residual: Literal["orthogonal", "radial"] = "orthogonal"
    reweightings: int = 1
    most_evaluations: int = MOST_EVALUATIONS
    negligible: float = NEGLIGIBLE


@dataclass(frozen=True, eq=False, slots=True)
class EllipseFit:
    """An ellipse with the evidence it rests on.

    Parameters
    ----------
    ellipse : Ellipse
        The estimate.
    problem : ArcProblem
        Points, weights and prior: what the likelihood is made of.
    parameters : (5,) ndarray
        ``centre_x, centre_y, m, p, q``; see `lsvision.fitting.ellipse_parameters`. Units: mm.
    residuals : (n,) ndarray
        Signed, positive outside. Units: mm.
    normalised : (n,) ndarray
        Residuals over their predicted standard deviation (over their rms where no noise
        model is given).
    model_covariance : (5, 5) ndarray
        Of the parameters, if the points' weights are right. Units: mm^2.
    variance_factor : float
        By which the covariance of the model is multiplied: 1 where the noise model explains
        the residuals; more where they are larger, or correlated along the line.
    degrees_of_freedom : float
        Of `variance_factor`; infinite where it comes from the noise model alone.
    settled : bool
        Whether the iteration reached its minimum; false for an ellipse that was still on its way
        to a needle.
    """

    ellipse: Ellipse
    problem: "ArcProblem"
    parameters: FloatArray
    residuals: FloatArray
    normalised: FloatArray
    model_covariance: FloatArray
    variance_factor: float
    degrees_of_freedom: float
    settled: bool

    @property
    def regular_covariance(self) -> FloatArray:
        """(5, 5), order of `parameters`. Units: mm^2."""
        return self.variance_factor * self.model_covariance

    @property
    def tells_theta(self) -> bool:
        """Whether (p, q) is so far from a circle that its error hardly turns it."""
        largest = float(np.linalg.eigvalsh(self.regular_covariance[3:, 3:])[-1])
        return math.hypot(*self.parameters[3:]) > FAR_FROM_CIRCLE * math.sqrt(largest)

    @property
    def rms(self) -> float:
        """Root mean square of the residuals. Units: mm."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def fit_ellipse(
    points: Points,
    start: Ellipse,
    covariances: FloatArray | None = None,
    *,
    known_radius: KnownRadius | None = None,
    known_phi: KnownPhi | None = None,
    settings: FittingSettings = FittingSettings(),
) -> EllipseFit:
    """Maximum-likelihood ellipse of the points of an arc.

    Parameters
    ----------
    points : (n, 2) ndarray
        Points of one arc without lost ones, in order along the line. Section frame. Units: mm.
    start : Ellipse
        Where to begin; an algebraic fit or a screened ellipse.
    covariances : (n, 2, 2) ndarray, optional
        Covariance of each point's error. None: equal, isotropic, estimated from the
        residuals. Units: mm^2.
    known_radius : KnownRadius, optional
        A prior on the semi-minor axis.
    known_phi : KnownPhi, optional
        A prior on the tilt: makes a circle, or nearly one, of an arc too short for an ellipse.
        One that is surely no circle is used where the points tell theta, else nothing of it.
    settings : FittingSettings
        Residual and number of reweightings.

    Returns
    -------
    EllipseFit

    Raises
    ------
    TooFewPoints
        Under 6 points (5 with a known radius would leave nothing to judge by).
    FitFailed
        If the data have no minimum near the start: a straight line, two crossing lines.

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
    if len(points) <= PARAMETERS:
        raise TooFewPoints(
            "an arc", len(points), PARAMETERS + 1, "scan slower or nearer, or lower the pitch"
        )
    if known_phi is not None and not known_phi.near_circle:
        free = fit_ellipse(points, start, covariances, known_radius=known_radius, settings=settings)
        if not free.tells_theta:
            return free
        start = free.ellipse
    parameters = parameters_of(start)
    if covariances is None and (known_radius is not None or known_phi is not None):
        covariances = _covariances_without_prior(points, parameters, settings)
    for _ in range(1 + settings.reweightings):
        stds = _normal_stds(points, covariances, parameters)
        problem = ArcProblem(points, stds, known_radius, settings.residual, known_phi)
        solution = minimise(problem, parameters, settings.most_evaluations, settings.negligible)
        parameters = solution.parameters
        if covariances is None:
            break
    correlation = find_correlation(solution.residuals[: len(points)])
    if covariances is None and correlation.coloured and settings.residual == "orthogonal":
        _, normals, _ = orthogonal_comparison(points, parameters)
        problem = ArcProblem(points, grazing_stds(normals.imag), known_radius, settings.residual)
        solution = minimise(problem, parameters, settings.most_evaluations, settings.negligible)
        correlation = find_correlation(solution.residuals[: len(points)])
    fit = _fit_with_evidence(problem, solution, correlation, known_noise=covariances is not None)
    return fit if problem.prior_rows == 0 else _weighed_against_prior(fit)


def _covariances_without_prior(
    points: Points, start: FloatArray, settings: FittingSettings
) -> FloatArray:
    """A prior needs the noise's size: take it from a fit that has none."""
    free = ArcProblem(points, np.ones(len(points)), None, settings.residual)
    residuals = minimise(free, start).residuals
    variance = float(residuals @ residuals) / (len(points) - PARAMETERS)
    variance = max(variance, np.finfo(float).tiny)
    covariances: FloatArray = np.broadcast_to(np.eye(2) * variance, (len(points), 2, 2))
    return covariances


def _weighed_against_prior(fit: EllipseFit) -> EllipseFit:
    """The fit with points that weigh what they are found to; the prior is as sure as before."""
    factor = fit.variance_factor
    if factor == 1:
        return fit
    problem = replace(fit.problem, stds=fit.problem.stds * np.sqrt(factor))
    solution = minimise(problem, fit.parameters)
    residuals = solution.residuals[: len(problem.points)] * problem.stds
    return replace(
        fit,
        ellipse=ellipse_of(solution.parameters),
        problem=problem,
        parameters=solution.parameters,
        residuals=residuals,
        normalised=residuals / fit.problem.stds,
        model_covariance=_inverse(solution.jacobian.T @ solution.jacobian),
        variance_factor=1.0,
        settled=solution.settled,
    )


def _normal_stds(
    points: Points, covariances: FloatArray | None, parameters: FloatArray
) -> FloatArray:
    if covariances is None:
        return np.ones(len(points))
    stds: FloatArray = np.sqrt(compare(NoisyPoints.of(points, covariances), parameters).variances)
    return stds


def _inverse(information: FloatArray) -> FloatArray:
    """Inverse of the information after scaling; huge variances where it is singular."""
    scale = 1 / np.sqrt(np.maximum(information.diagonal(), 1e-300))
    both = scale[:, None] * scale
    inverse = solve_positive(information * both, IDENTITY)
    if np.isnan(inverse[0, 0]):
        values, vectors = np.linalg.eigh(information * both)
        inverse = (vectors / np.maximum(values, 1e-14)) @ vectors.T
    with np.errstate(over="ignore"):  # all points at one place: infinite variances
        return inverse * both


def _fit_with_evidence(
    problem: ArcProblem, solution: Solution, correlation: Correlation, *, known_noise: bool
) -> EllipseFit:
    normalised = solution.residuals[: len(problem.points)]
    residuals = normalised * problem.stds
    freedom = float(max(len(residuals) - PARAMETERS, 1)) + problem.prior_rows
    excess = float(normalised @ normalised) / freedom
    if known_noise:
        surprising = excess > 1 + SURPRISE * np.sqrt(2 / freedom)
        factor, freedom = (excess if surprising else 1.0), np.inf
    else:
        factor = max(excess, np.finfo(float).tiny)
        normalised = normalised / np.sqrt(factor)
        freedom = max(freedom / correlation.factor, 1.0)
    if correlation.coloured:
        freedom = min(freedom, SLOW_FREEDOM)
    return EllipseFit(
        ellipse=ellipse_of(solution.parameters),
        problem=problem,
        parameters=solution.parameters,
        residuals=residuals,
        normalised=normalised,
        model_covariance=_inverse(solution.jacobian.T @ solution.jacobian),
        variance_factor=factor * correlation.factor,
        degrees_of_freedom=freedom,
        settled=solution.settled,
    )
