"""Least-squares problem of one arc, and its solution by the Levenberg-Marquardt method."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.parameters import (
    PARAMETERS,
    centre_of,
    orthogonal_residuals_and_normals,
    parameter_jacobian,
    radial_residuals_and_normals,
    semi_minor,
    semi_minor_gradient,
)
from lsvision.ellipse.phi_prior import EXACT_STD, PhiPrior
from lsvision.errors import FitFailed, TooFewPoints
from lsvision.geometry import FloatArray, Points
from lsvision.geometry.noisy_points import as_complex
from lsvision.statistics.compiled_routines import levenberg_marquardt

MAX_EVALUATIONS = 100
DEFAULT_TOLERANCE = 1e-10
"""Relative decrease of chi^2 in a step, below which the iteration has converged. As the relative
change of the parameters it is always this: a larger one would depend on the origin's distance."""


@dataclass(frozen=True, slots=True)
class RadiusPrior:
    """Radius that is known before the measurement: a normal prior on b.

    Parameters
    ----------
    radius, std : float
        Mean and standard uncertainty; ``std = 0`` means exactly known. Units: mm.
    """

    radius: float
    std: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.radius) and self.radius > 0):
            raise ValueError(f"expected a positive known radius in mm, got {self.radius}")
        if not (math.isfinite(self.std) and self.std >= 0):
            raise ValueError(f"expected a known radius with std >= 0 mm, got {self.std}")

    @property
    def effective_std(self) -> float:
        """Standard deviation of the prior in the fit, never 0. Units: mm."""
        return max(self.std, EXACT_STD * self.radius)


@dataclass(frozen=True, eq=False, slots=True)
class EllipseProblem:
    """Least-squares problem of one arc with fixed weights.

    Parameters
    ----------
    points : (n, 2) ndarray
        Points in the section frame. Units: mm.
    stds : (n,) ndarray
        Standard deviation of each residual. Units: mm.
    known_radius : RadiusPrior or None
        Prior on b.
    residual : {"orthogonal", "radial"}
        Definition of a residual; see `FittingSettings`.
    known_phi : PhiPrior, optional
        Prior on the tilt.
    """

    points: Points
    stds: FloatArray
    known_radius: RadiusPrior | None
    residual: str
    known_phi: PhiPrior | None = None

    @property
    def prior_residual_count(self) -> int:
        """Number of residuals of the priors."""
        tilt = 0 if self.known_phi is None else self.known_phi.residual_count
        return tilt + (self.known_radius is not None)

    def evaluate(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residuals over their standard deviations, and their derivative.

        Returns
        -------
        residuals : (n + k,) ndarray
            The last k are those of the priors.
        jacobian : (n + k, 5) ndarray
            Derivatives of the residuals. Units: 1/mm.
        """
        compare = (
            orthogonal_residuals_and_normals
            if self.residual == "orthogonal"
            else radial_residuals_and_normals
        )
        signed, n, w = compare(self.points, parameters)
        rows = parameter_jacobian(n, w)
        if self.residual == "radial":
            # A shift of the centre also rotates the ray about the point: the residual lies along
            # the ray, while n is the derivative at its intersection with the ellipse.
            ray = as_complex(self.points) - centre_of(parameters)
            length = np.abs(ray)
            turning = (ray - n * length) * (signed / length**2)
            rows[0] += turning.real
            rows[1] += turning.imag
        rows /= -self.stds
        residuals, jacobian = signed / self.stds, rows.T
        if self.prior_residual_count == 0:
            return residuals, jacobian
        prior = self._prior(parameters)
        return np.concatenate([residuals, prior[0]]), np.concatenate([jacobian, prior[1]])

    def _prior(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        residuals, jacobian = (
            np.empty(self.prior_residual_count),
            np.empty((self.prior_residual_count, PARAMETERS)),
        )
        if self.known_phi is not None:
            tilt = slice(0, self.known_phi.residual_count)
            residuals[tilt], jacobian[tilt] = self.known_phi.residuals_and_jacobian(parameters)
        if self.known_radius is not None:
            known = self.known_radius
            residuals[-1] = (semi_minor(parameters) - known.radius) / known.effective_std
            jacobian[-1] = semi_minor_gradient(parameters) / known.effective_std
        return residuals, jacobian


class Solution(NamedTuple):
    """Estimated parameters (k,), with residuals (n,) and Jacobian (n, k) at them.

    `converged` is false where the largest number of evaluations ended the iteration.
    """

    parameters: FloatArray
    residuals: FloatArray
    jacobian: FloatArray
    converged: bool


def minimise(
    problem: EllipseProblem,
    initial_guess: FloatArray,
    max_evaluations: int = MAX_EVALUATIONS,
    tolerance: float = DEFAULT_TOLERANCE,
) -> Solution:
    """Fit the least-squares ellipse by Levenberg-Marquardt (MINPACK) with analytic Jacobian.

    Raises
    ------
    FitFailed
        If the parameters are not finite.
    """
    rows = len(problem.points) + problem.prior_residual_count
    if rows < PARAMETERS:
        raise TooFewPoints("an arc", rows, PARAMETERS, "scan slower or nearer")
    solution = least_squares(problem.evaluate, initial_guess, max_evaluations, tolerance)
    if not np.isfinite(solution.parameters).all():
        raise FitFailed("the ellipse fit overflowed: the points do not lie on an ellipse")
    return solution


Evaluation = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def least_squares(
    evaluate: Evaluation,
    initial_guess: FloatArray,
    max_evaluations: int = MAX_EVALUATIONS,
    tolerance: float = DEFAULT_TOLERANCE,
) -> Solution:
    """Solve a least-squares problem by Levenberg-Marquardt (MINPACK) with analytic Jacobian.

    Parameters
    ----------
    evaluate : callable
        Function of the parameters (k,) that returns residuals (n,) and Jacobian (n, k).
    initial_guess : (k,) ndarray
        Initial parameters.
    max_evaluations : int
        Largest number of evaluations.
    tolerance : float
        Relative decrease of chi^2 in a step, below which the iteration has converged.
    """
    cached = cache_last_evaluation(evaluate)
    with np.errstate(all="ignore"):
        parameters, converged = levenberg_marquardt(
            lambda x: cached(x)[0], lambda x: cached(x)[1], initial_guess,
            xtol=DEFAULT_TOLERANCE, ftol=tolerance, max_evaluations=max_evaluations,
        )  # fmt: skip
        return Solution(parameters, *cached(parameters), converged=converged)


def cache_last_evaluation(evaluate: Evaluation) -> Evaluation:
    """Return a function that keeps its last result: MINPACK calls for both parts separately."""
    last: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def cached(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = parameters.tobytes()
        if key not in last:
            last.clear()
            last[key] = evaluate(parameters)
        return last[key]

    return cached
