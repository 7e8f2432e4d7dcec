"""Least-squares problems of arcs, solved together by the Levenberg-Marquardt method."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from lsvision.ellipse.levenberg_marquardt import LevenbergMarquardt
from lsvision.ellipse.outcomes import apply_to_successes
from lsvision.ellipse.parameters import (
    PARAMETERS,
    compute_semi_minor,
    orthogonal_residuals_and_normals,
    parameter_jacobian,
    radial_residuals_and_normals,
    semi_minor_gradient,
    split_parameters,
)
from lsvision.ellipse.phi_prior import EXACT_STD, PhiPrior
from lsvision.errors import FitFailed, LsvisionError, TooFewPoints
from lsvision.geometry import FloatArray, Points
from lsvision.geometry.arguments import as_known_phi, as_number_or_pair
from lsvision.geometry.arrays import TINY, pad_rows, stack_padded
from lsvision.geometry.noisy_points import ComplexArray, as_complex

MAX_EVALUATIONS = 100
"""Largest number of evaluations of the residuals, by default."""
MAX_NARROW_PRIOR_FRACTION = 1e-3
"""Largest standard deviation, as a fraction of the radius, of a narrow prior: fits with one take
steps along the cone of constant b (`add_step_on_cone`). With a limit of 1e-2 fits stop at circles,
the apex of the cone; without such steps they stop at other ellipses."""
DEFAULT_TOLERANCE = 1e-10
"""Relative decrease of chi^2 in a step, below which the iteration has converged."""


@dataclass(frozen=True)
class RadiusPrior:
    """Radius that is known before the measurement: a normal prior on b.

    Parameters
    ----------
    radius, std : float
        Mean and standard uncertainty; ``std = 0`` means exactly known. Units: mm.

    Raises
    ------
    ValueError
        If the radius is not positive, or the std is negative, or one is not finite.

    Examples
    --------
    >>> import lsvision as lsv
    >>> lsv.RadiusPrior(20.0, std=0.05)
    RadiusPrior(radius=20.0, std=0.05)
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


class Priors(NamedTuple):
    """Priors on radius and tilt of a cylinder; None for what is not known."""

    radius: RadiusPrior | None
    phi: PhiPrior | None

    @classmethod
    def from_values(
        cls, known_radius: float | Sequence[float] | None, known_phi: float | Sequence[float] | None
    ) -> Self:
        """Return the priors of numbers in mm and rad, or of pairs of number and std.

        Raises
        ------
        TypeError, ValueError
            If a value is neither a number nor a pair, or out of its range.

        Examples
        --------
        >>> Priors.from_values((20.0, 0.5), None)
        Priors(radius=RadiusPrior(radius=20.0, std=0.5), phi=None)
        """
        radius = as_number_or_pair(known_radius, "known_radius", "mm", "(radius, std)")
        phi = as_known_phi(known_phi)
        return cls(
            None if radius is None else RadiusPrior(*np.atleast_1d(radius).tolist()),
            None if phi is None else PhiPrior(*np.atleast_1d(phi).tolist()),
        )


NO_PRIORS = Priors(None, None)
"""Priors of a cylinder of which neither radius nor tilt is known."""


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

    @property
    def has_narrow_prior(self) -> bool:
        """Whether the radius is known so precisely that its prior is a narrow valley of chi^2."""
        known = self.known_radius
        return known is not None and known.std <= MAX_NARROW_PRIOR_FRACTION * known.radius

    def linearise_priors(self, parameters: FloatArray) -> FloatArray:
        """Return the rows of the priors at parameters (5,).

        Returns
        -------
        (j, 6) ndarray
            Derivative of each residual by the parameters, negative, and the residual; over its
            standard deviation.
        """
        rows = np.empty((self.prior_residual_count, PARAMETERS + 1))
        if self.known_phi is not None:
            tilt = rows[: self.known_phi.residual_count]
            tilt[:, PARAMETERS], tilt[:, :PARAMETERS] = self.known_phi.residuals_and_jacobian(
                parameters
            )
        if self.known_radius is not None:
            known = self.known_radius
            rows[-1, PARAMETERS] = compute_semi_minor(parameters) - known.radius
            rows[-1, :PARAMETERS] = semi_minor_gradient(parameters)
            rows[-1] /= known.effective_std
        rows[:, :PARAMETERS] *= -1
        return rows


@dataclass(frozen=True, eq=False, slots=True)
class ProblemStack:
    """Problems of k arcs with up to n points each, whose residuals have one definition.

    Parameters
    ----------
    problems : list of EllipseProblem
        The problems.
    z : (k, n) complex ndarray
        Points x + iy; after the last point of an arc it is repeated. Units: mm.
    inverse_stds : (k, 1, n) ndarray
        1 / standard deviation of the residuals; 0 for repeated points. Units: 1/mm.
    """

    problems: list[EllipseProblem]
    z: ComplexArray
    inverse_stds: FloatArray

    @classmethod
    def of(cls, problems: list[EllipseProblem]) -> Self:
        """Return the stack of one or more problems."""
        z, stds = [as_complex(problem.points) for problem in problems], [p.stds for p in problems]
        if len(problems) == 1:
            return cls(problems, z[0][None], (1 / stds[0])[None, None])
        indices, valid = pad_rows([len(points) for points in z])
        return cls(
            problems, stack_padded(z, indices), (valid / stack_padded(stds, indices))[:, None]
        )

    def select(self, which: list[int]) -> "ProblemStack":
        """Return the stack of some of the problems."""
        problems = [self.problems[i] for i in which]
        return ProblemStack(problems, self.z[which], self.inverse_stds[which])

    def evaluate(self, parameters: FloatArray) -> tuple[FloatArray, ComplexArray]:
        """Return the rows of the residuals of the points at parameters (k, 5), and the normals.

        Returns
        -------
        rows : (k, 6, n) ndarray
            Derivatives of the residuals by the parameters, negative, and the residuals; over their
            standard deviations.
        normals : (k, n) complex ndarray
            Outward unit normals of the ellipses.
        """
        radial = self.problems[0].residual == "radial"
        compare = radial_residuals_and_normals if radial else orthogonal_residuals_and_normals
        signed, normals, w = compare(self.z, parameters)
        rows = np.empty((len(w), PARAMETERS + 1, w.shape[1]))
        parameter_jacobian(normals, w, out=rows[:, :PARAMETERS])
        if radial:
            # A shift of the centre also rotates the ray about the point: the residual lies along
            # the ray, while n is the derivative at its intersection with the ellipse.
            ray = self.z - split_parameters(parameters)[0]
            length = np.abs(ray)
            turning = (ray - normals * length) * (signed / length**2)
            rows[:, 0] += turning.real
            rows[:, 1] += turning.imag
            normals /= np.maximum(np.abs(normals), TINY)
        rows[:, PARAMETERS] = signed
        rows *= self.inverse_stds
        return rows, normals

    def build_normal_equations(self, rows: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the normal equations (k, 6, 6) of points and priors, see `LevenbergMarquardt`."""
        equations: FloatArray = rows @ rows.swapaxes(1, 2)
        for i, problem in enumerate(self.problems):
            if problem.known_radius is not None or problem.known_phi is not None:
                prior = problem.linearise_priors(parameters[i])
                equations[i] += prior.T @ prior
        return equations


class Solution(NamedTuple):
    """Estimated ellipse of one arc.

    Parameters
    ----------
    parameters : (5,) ndarray
        See `lsvision.ellipse.parameters`. Units: mm.
    residuals : (n,) ndarray
        Residuals of the points over their standard deviations.
    normals : (n,) complex ndarray
        Outward unit normals of the ellipse at the points.
    information : (5, 5) ndarray
        Information of points and priors about the parameters. Units: 1/mm^2.
    converged : bool
        False where the largest number of evaluations ended the iteration.
    evaluations : int
        Number of evaluations of the residuals.
    """

    parameters: FloatArray
    residuals: FloatArray
    normals: ComplexArray
    information: FloatArray
    converged: bool
    evaluations: int


def minimise(
    problems: Sequence[EllipseProblem],
    initial_guesses: FloatArray,
    max_evaluations: int = MAX_EVALUATIONS,
    tolerance: float = DEFAULT_TOLERANCE,
    min_axis_ratio: float = 0.0,
) -> list[Solution | LsvisionError]:
    """Fit the least-squares ellipses of k arcs by the Levenberg-Marquardt method.

    Parameters
    ----------
    problems : sequence of EllipseProblem
        The problems, whose residuals have one definition.
    initial_guesses : (k, 5) ndarray
        Initial parameters. Units: mm.
    max_evaluations : int
        Largest number of evaluations.
    tolerance : float
        Relative decrease of chi^2 in a step, below which the iteration has converged.
    min_axis_ratio : float
        Axis ratio b / a below which the iteration ends, without convergence; 0: none.

    Returns
    -------
    list of Solution or LsvisionError
        `TooFewPoints` for an arc with fewer residuals than parameters, `FitFailed` where numbers
        overflow.
    """
    counts = [len(problem.points) + problem.prior_residual_count for problem in problems]
    guesses = np.array(initial_guesses, dtype=float)
    starts: list[tuple[EllipseProblem, FloatArray] | LsvisionError] = [
        (problem, guess)
        if count >= PARAMETERS
        else TooFewPoints("an arc", count, PARAMETERS, "scan slower or nearer")
        for problem, guess, count in zip(problems, guesses, counts, strict=True)
    ]

    def solve(arcs: list[tuple[EllipseProblem, FloatArray]]) -> list[Solution | LsvisionError]:
        searches = [
            LevenbergMarquardt(
                guess,
                max_evaluations,
                tolerance,
                min_axis_ratio=min_axis_ratio,
                on_cone=problem.has_narrow_prior,
            )
            for problem, guess in arcs
        ]
        return _solve(ProblemStack.of([problem for problem, _ in arcs]), searches)

    return apply_to_successes(solve, starts)


def _solve(
    stack: ProblemStack, searches: list[LevenbergMarquardt]
) -> list[Solution | LsvisionError]:
    """Run the searches of a stack together; those that have finished are left out."""
    no_rows = np.empty((PARAMETERS + 1, 0)), np.empty(0, dtype=complex)
    rows_at_best = [no_rows] * len(searches)
    active, active_stack = list(range(len(searches))), stack
    with np.errstate(all="ignore"):
        while active:
            trials = np.array([searches[i].trial for i in active])
            rows, normals = active_stack.evaluate(trials)
            equations = active_stack.build_normal_equations(rows, trials)
            running = []
            for i, matrix, row, normal in zip(active, equations, rows, normals, strict=True):
                search = searches[i]
                if search.update(matrix):
                    rows_at_best[i] = row, normal
                if not search.finished:
                    running.append(i)
            if 0 < len(running) < len(active):
                active_stack = stack.select(running)
            active = running
    return [
        _build_solution(*fields)
        for fields in zip(stack.problems, searches, rows_at_best, strict=True)
    ]


def _build_solution(
    problem: EllipseProblem,
    search: LevenbergMarquardt,
    rows_at_best: tuple[FloatArray, ComplexArray],
) -> Solution | LsvisionError:
    """Return the result of a search, with the rows and normals at its best parameters."""
    if not search.is_finite:
        return FitFailed("the ellipse fit overflowed: the points do not lie on an ellipse")
    (rows, normals), count = rows_at_best, len(problem.points)
    rows, normals = rows[:, :count], normals[:count]
    residuals = rows[PARAMETERS]
    if search.last_step is None:
        residuals = residuals.copy()  # a view would keep the rows of the whole stack in memory
    else:
        residuals = residuals - search.last_step @ rows[:PARAMETERS]
    information = search.equations[:PARAMETERS, :PARAMETERS]
    return Solution(
        search.parameters, residuals, normals, information, search.converged, search.evaluations
    )
