"""Least-squares solutions of several arcs, whose weights are those at their initial guesses."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.problem import (
    DEFAULT_TOLERANCE,
    MAX_EVALUATIONS,
    EllipseProblem,
    Priors,
    Solution,
    minimise,
)
from lsvision.ellipse.robust_gauss_newton import ray_normal_variances
from lsvision.errors import LsvisionError
from lsvision.geometry import FloatArray
from lsvision.geometry.noisy_points import NoisyPoints, as_vectors


class StartedArc(NamedTuple):
    """Points of an arc, and the parameters (5,) of an initial guess. Units: mm."""

    points: NoisyPoints
    parameters: FloatArray


class SolvedArc(NamedTuple):
    """Points of an arc, and their problem with its solution."""

    points: NoisyPoints
    problem: EllipseProblem
    solution: Solution

    @property
    def parameters(self) -> FloatArray:
        """Estimated parameters (5,), the initial guess of another solution. Units: mm."""
        return self.solution.parameters


def solve_arcs(
    arcs: Sequence[StartedArc | SolvedArc],
    priors: Priors,
    residual: str,
    max_evaluations: int = MAX_EVALUATIONS,
    tolerance: float = DEFAULT_TOLERANCE,
    min_axis_ratio: float = 0.0,
) -> list[SolvedArc | LsvisionError]:
    """Solve the problems of one or more arcs together.

    Parameters
    ----------
    arcs : sequence of StartedArc or SolvedArc
        Points and initial guesses.
    priors : Priors
        Priors on radius and phi, the same for all arcs.
    residual : {"orthogonal", "radial"}
        Definition of a residual; see `FittingSettings`.
    max_evaluations, tolerance, min_axis_ratio
        As for `minimise`.

    Returns
    -------
    list of SolvedArc or LsvisionError
        The error where the iteration has failed.
    """
    guesses = np.array([arc.parameters for arc in arcs])
    stacked, _ = NoisyPoints.stack([arc.points for arc in arcs])
    stds = np.sqrt(ray_normal_variances(stacked, guesses))
    problems = [
        EllipseProblem(
            as_vectors(arc.points.z), row[: len(arc.points)], priors.radius, residual, priors.phi
        )
        for arc, row in zip(arcs, stds, strict=True)
    ]
    solutions = minimise(problems, guesses, max_evaluations, tolerance, min_axis_ratio)
    return [
        SolvedArc(arc.points, problem, solution) if isinstance(solution, Solution) else solution
        for arc, problem, solution in zip(arcs, problems, solutions, strict=True)
    ]
