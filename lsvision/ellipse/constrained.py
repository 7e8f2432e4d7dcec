"""The fit of an arc with one quantity held fixed, the others free.

Each constraint is built into the parameters, not added as a penalty: a map from the free
parameters to (centre_x, centre_y, m, p, q) with its derivative.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.problem import EllipseProblem, least_squares
from lsvision.shapes import FloatArray

ParametersAndJacobian = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class Constraint:
    """One quantity held fixed.

    Parameters
    ----------
    expand : callable
        Free parameters (k,) to all parameters (5,) and the derivative (5, k).
    initial_guesses : callable
        All parameters of the free fit to the free parameters to start from, one or more.
    """

    expand: Callable[[FloatArray], ParametersAndJacobian]
    initial_guesses: Callable[[FloatArray], list[FloatArray]]


def constrained_cost(
    problem: EllipseProblem, constraint: Constraint, parameters: FloatArray
) -> float:
    """Least sum of squares under a constraint, over all its starts.

    Parameters
    ----------
    problem : EllipseProblem
        The arc.
    constraint : Constraint
        What is held.
    parameters : (5,) ndarray
        Of the free fit.
    """

    def evaluate(free: FloatArray) -> ParametersAndJacobian:
        expanded, derivative = constraint.expand(free)
        residuals, jacobian = problem.evaluate(expanded)
        return residuals, jacobian @ derivative

    costs = []
    for start in constraint.initial_guesses(parameters):
        residuals = least_squares(evaluate, start).residuals
        costs.append(float(residuals @ residuals))
    finite = [cost for cost in costs if math.isfinite(cost)]
    return min(finite) if finite else math.inf


def fixed_centre(axis: int, value: float) -> Constraint:
    """One coordinate of the centre, 0 for x and 1 for y. Units: mm."""
    free = [i for i in range(5) if i != axis]
    derivative = np.eye(5)[:, free]

    def expand(rest: FloatArray) -> ParametersAndJacobian:
        return np.insert(rest, axis, value), derivative

    return Constraint(expand, lambda parameters: [parameters[free]])


def fixed_radius(radius: float) -> Constraint:
    """Radius b = m - h, so m = b + |(p, q)|. Units: mm."""

    def expand(free: FloatArray) -> ParametersAndJacobian:
        x, y, p, q = free
        h = max(math.hypot(p, q), 1e-12)
        derivative = np.zeros((5, 4))
        derivative[[0, 1, 3, 4], [0, 1, 2, 3]] = 1.0
        derivative[2, 2:] = p / h, q / h
        return np.array([x, y, radius + h, p, q]), derivative

    def starts(parameters: FloatArray) -> list[FloatArray]:
        # Where the section is nearly a circle, the other axis may become the smaller one.
        x, y, m, p, q = parameters
        h = max(math.hypot(p, q), 1e-6 * m)
        same = np.array([x, y, p, q])
        turned = np.array([x, y, -p, -q]) * np.array([1, 1, 0.5, 0.5])
        return [same, turned] if h < 0.1 * m else [same]

    return Constraint(expand, starts)


def fixed_phi(phi: float) -> Constraint:
    """Tilt: h / m = (1 - cos phi) / (1 + cos phi), the direction free. Units: rad."""
    share = (1 - math.cos(phi)) / (1 + math.cos(phi))

    def expand(free: FloatArray) -> ParametersAndJacobian:
        x, y, m, turn = free
        cos, sin = math.cos(turn), math.sin(turn)
        derivative = np.zeros((5, 4))
        derivative[[0, 1, 2], [0, 1, 2]] = 1.0
        derivative[3, 2:] = share * cos, -share * m * sin
        derivative[4, 2:] = share * sin, share * m * cos
        return np.array([x, y, m, share * m * cos, share * m * sin]), derivative

    def starts(parameters: FloatArray) -> list[FloatArray]:
        x, y, m, p, q = parameters
        turn = math.atan2(q, p)
        near_circle = share < 0.1 and math.hypot(p, q) < 0.1 * m
        turns = (turn, turn + np.pi) if near_circle else (turn,)
        return [np.array([x, y, m, t]) for t in turns]

    return Constraint(expand, starts)


def fixed_theta(theta: float) -> Constraint:
    """(p, q) = h (cos 2 theta, sin 2 theta) with h >= 0, as h = s^2. Units: rad."""
    cos, sin = math.cos(2 * theta), math.sin(2 * theta)

    def expand(free: FloatArray) -> ParametersAndJacobian:
        x, y, m, s = free
        derivative = np.zeros((5, 4))
        derivative[[0, 1, 2], [0, 1, 2]] = 1.0
        derivative[3, 3], derivative[4, 3] = 2 * s * cos, 2 * s * sin
        return np.array([x, y, m, s * s * cos, s * s * sin]), derivative

    def starts(parameters: FloatArray) -> list[FloatArray]:
        x, y, m, p, q = parameters
        along = max(p * cos + q * sin, 0.05 * math.hypot(p, q), 1e-6 * m)
        return [np.array([x, y, m, math.sqrt(along)])]

    return Constraint(expand, starts)


def circle_constraint() -> Constraint:
    """A circle: p = q = 0."""
    derivative = np.eye(5)[:, :3]

    def expand(free: FloatArray) -> ParametersAndJacobian:
        return np.append(free, [0.0, 0.0]), derivative

    return Constraint(expand, lambda parameters: [parameters[:3]])
