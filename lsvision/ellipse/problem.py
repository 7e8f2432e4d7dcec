"""The least-squares problem of one arc, and its solution by Levenberg and Marquardt."""

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
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.errors import FitFailed, TooFewPoints
from lsvision.geometry import FloatArray, Points
from lsvision.geometry.noisy_points import as_complex

MAX_EVALUATIONS = 100
DEFAULT_TOLERANCE = 1e-10
"""A last step is one of this share of the parameters, or that mends this share of chi^2."""
MINPACK_MAXFEV_REACHED = 5
"""MINPACK's info for that."""
EXACT_RADIUS_STD = 1e-6
"""Share of a known radius that stands for "exactly": small beside any noise, not singular."""


@dataclass(frozen=True, slots=True)
class RadiusPrior:
    """What is known of a radius before the measurement: a prior on b.

    Parameters
    ----------
    radius, std : float
        Units: mm. ``std = 0`` means exactly known.
    """

    radius: float
    std: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.radius) and self.radius > 0):
            raise ValueError(f"want a positive known radius in mm, got {self.radius}")
        if not (math.isfinite(self.std) and self.std >= 0):
            raise ValueError(f"want a known radius with std >= 0 mm, got {self.std}")

    @property
    def effective_std(self) -> float:
        """One sigma as the fit uses it. Units: mm."""
        return max(self.std, EXACT_RADIUS_STD * self.radius)


@dataclass(frozen=True, eq=False, slots=True)
class EllipseProblem:
    """Least-squares problem of one arc with its weights held fixed.

    Parameters
    ----------
    points : (n, 2) ndarray
        Section frame. Units: mm.
    stds : (n,) ndarray
        Standard deviation of each residual. Units: mm.
    known_radius : RadiusPrior or None
        Prior on b.
    residual : {"orthogonal", "radial"}
        See `FittingSettings`.
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
        """How many residuals are not of points."""
        tilt = 0 if self.known_phi is None else self.known_phi.residual_count
        return tilt + (self.known_radius is not None)

    def evaluate(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals over their standard deviations, and their derivative.

        Returns
        -------
        residuals : (n + k,) ndarray
            The last k are those of the priors.
        jacobian : (n + k, 5) ndarray
            Units: 1/mm.
        """
        compare = (
            orthogonal_residuals_and_normals
            if self.residual == "orthogonal"
            else radial_residuals_and_normals
        )
        signed, n, w = compare(self.points, parameters)
        rows = parameter_jacobian(n, w)
        if self.residual == "radial":
            # The ray turns as the centre moves: n counts where it meets the ellipse, and the
            # rest of the residual lies along the ray.
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
    """Least squares' parameters (k,), and residuals (n,) and Jacobian (n, k) there.

    `converged` is false where the iteration was still moving when it had to end.
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
    """The ellipse of least squares, by Levenberg-Marquardt (MINPACK) with analytic Jacobian.

    Raises
    ------
    FitFailed
        If the iteration leaves the finite numbers.
    """
    rows = len(problem.points) + problem.prior_residual_count
    if rows < PARAMETERS:
        raise TooFewPoints("an arc", rows, PARAMETERS, "scan slower or nearer")
    solution = least_squares(problem.evaluate, initial_guess, max_evaluations, tolerance)
    if not np.isfinite(solution.parameters).all():
        raise FitFailed("the ellipse fit left the finite numbers: the points lie on no ellipse")
    return solution


Evaluation = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def least_squares(
    evaluate: Evaluation,
    initial_guess: FloatArray,
    max_evaluations: int = MAX_EVALUATIONS,
    tolerance: float = DEFAULT_TOLERANCE,
) -> Solution:
    """Least squares by Levenberg-Marquardt (MINPACK) with analytic Jacobian.

    Parameters
    ----------
    evaluate : callable
        Parameters to residuals (n,) and Jacobian (n, k).
    initial_guess : (k,) ndarray
        Where to begin.
    max_evaluations : int
        Then the iteration ends where it is.
    tolerance : float
        A last step is one of this share of the parameters, or that mends this share of chi^2.
    """
    from scipy.optimize import leastsq

    remembered = cache_last_evaluation(evaluate)
    with np.errstate(all="ignore"):
        found, *_, ending = leastsq(
            lambda x: remembered(x)[0], initial_guess, Dfun=lambda x: remembered(x)[1],
            xtol=tolerance, ftol=tolerance, maxfev=max_evaluations, full_output=True,
        )  # fmt: skip
        return Solution(found, *remembered(found), converged=ending != MINPACK_MAXFEV_REACHED)


def cache_last_evaluation(evaluate: Evaluation) -> Evaluation:
    """MINPACK asks for residuals and Jacobian apart, at the same point; compute both once."""
    last: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def remembered(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = parameters.tobytes()
        if key not in last:
            last.clear()
            last[key] = evaluate(parameters)
        return last[key]

    return remembered
