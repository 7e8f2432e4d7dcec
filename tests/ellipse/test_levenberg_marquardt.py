"""The iteration for one ellipse, on problems whose minimum is known."""

import math

import numpy as np
import pytest

from lsvision.ellipse.levenberg_marquardt import (
    REGION_TOLERANCE,
    LevenbergMarquardt,
    _solve_damped_step,
)
from tests.tolerances import MACHINE

MINIMUM = np.array([3.0, -400.0, 20.0, 1.0, -2.0])


def matrix_of(jacobian, residuals):
    """Normal equations as `update` expects them: the Jacobian is that of the model."""
    rows = np.vstack([jacobian.T, residuals])
    return rows @ rows.T


def run(jacobian, residuals_of, start, max_evaluations=50, tolerance=1e-10):
    """The finished search, and the costs at all trials."""
    search, costs = LevenbergMarquardt(start, max_evaluations, tolerance), []
    while not search.finished:
        residuals = residuals_of(search.trial)
        costs.append(float(residuals @ residuals))
        search.update(matrix_of(jacobian(search.trial), residuals))
    return search, costs


def linear(rng, count=12):
    jacobian = rng.normal(size=(count, 5))
    noise = 0.1 * rng.normal(size=count)
    noise -= jacobian @ np.linalg.lstsq(jacobian, noise)[0]
    return lambda _: jacobian, lambda at: jacobian @ (MINIMUM - at) + noise


@pytest.mark.parametrize("tolerance", [1e-3, 1e-10])
def test_a_linear_problem_is_solved_by_one_step(tolerance, rng):
    search, costs = run(*linear(rng), MINIMUM + 1.0, tolerance=tolerance)
    assert search.converged
    assert len(costs) == search.evaluations <= 3
    np.testing.assert_allclose(search.parameters, MINIMUM, atol=MACHINE)


def test_a_step_that_makes_it_worse_is_not_taken(rng):
    """For residuals arctan(x), Gauss-Newton steps diverge from x = 3."""
    start = MINIMUM + 3.0
    search, costs = run(
        lambda at: -np.diag(1 / (1 + (at - MINIMUM) ** 2)),
        lambda at: np.append(np.arctan(at - MINIMUM), 0.1)[:5],
        start,
    )
    assert max(costs) > costs[0]
    assert search.converged
    np.testing.assert_allclose(search.parameters, MINIMUM, atol=1e-6)


def test_a_minimum_at_infinity_is_not_reached():
    """exp(-x) has no minimum: the iteration ends with the largest number of evaluations."""
    search, costs = run(
        lambda at: np.diag(np.exp(-at / 10) / 10),
        lambda at: np.exp(-at / 10),
        np.zeros(5),
        20,
        1e-3,
    )
    assert not search.converged
    assert search.evaluations == len(costs) == 20


def test_a_perfect_fit_ends_the_search():
    search, _ = run(lambda _: np.eye(5), lambda at: MINIMUM - at, MINIMUM + 2.0**-3)
    assert search.converged
    np.testing.assert_array_equal(search.parameters, MINIMUM)


@pytest.mark.parametrize("worst", [math.nan, math.inf])
def test_a_first_cost_that_is_not_finite_ends_the_search(worst):
    search = LevenbergMarquardt(MINIMUM, 20, 1e-3)
    search.update(np.full((6, 6), worst))
    assert search.finished
    assert not search.converged
    assert not search.is_finite


@pytest.mark.parametrize("length", [1e-3, 0.1, 1.0])
def test_a_damped_step_is_as_long_as_the_trust_region(length, rng):
    rows = rng.normal(size=(9, 5)) * [1, 1, 1, 1, 1e-4]
    information, gradient = rows.T @ rows, rng.normal(size=5)
    step, damping = _solve_damped_step(information, gradient, length)
    assert np.linalg.norm(step) == pytest.approx(length, rel=REGION_TOLERANCE)
    wanted = np.linalg.solve(information + damping * np.eye(5), gradient)
    np.testing.assert_allclose(step, wanted, rtol=1e-6)


def test_a_step_within_the_trust_region_is_not_damped(rng):
    information, gradient = np.diag([1.0, 2.0, 3.0, 4.0, 5.0]), rng.normal(size=5)
    step, damping = _solve_damped_step(information, gradient, 100.0)
    assert damping == 0
    np.testing.assert_allclose(step, gradient / np.diag(information), rtol=MACHINE)
