import math

import numpy as np
import pytest
from scipy.optimize import approx_fprime, least_squares

from lsvision.ellipse.constrained import (
    circle_constraint,
    constrained_cost,
    fixed_centre,
    fixed_phi,
    fixed_radius,
    fixed_theta,
)
from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.parameters import ellipse_from_parameters
from tests.ellipse.arcs import measured, pipe, upper_arc

PENALTY = 1e5  # 1/mm, 1/rad: a violation of 1e-5 costs as much as one sigma

# Each: the constraint, and what must vanish, as a function of (x, y, a, b, theta).
HELD = {
    "centre x": (fixed_centre(0, 5.3), lambda x, y, a, b, theta: [x - 5.3]),
    "centre y": (fixed_centre(1, -400.4), lambda x, y, a, b, theta: [y + 400.4]),
    "radius": (fixed_radius(19.4), lambda x, y, a, b, theta: [min(a, b) - 19.4]),
    "phi": (fixed_phi(0.3), lambda x, y, a, b, theta: [min(a, b) - max(a, b) * math.cos(0.3)]),
    "theta": (fixed_theta(0.7), lambda x, y, a, b, theta: [math.sin(theta - 0.7)]),
    "circle": (circle_constraint(), lambda x, y, a, b, theta: [a - b]),
}


@pytest.fixture
def fit(rng):
    truth = pipe(25.0)
    return fit_ellipse(
        measured(upper_arc(truth), rng), truth, np.tile(0.0025 * np.eye(2), (70, 1, 1))
    )


def penalised_cost(fit, violation, starts):
    """Raw parameters and one anomaly a point; the constraint as a steep penalty."""
    points, stds = fit.problem.points, fit.problem.stds

    def gaps(free):
        x, y, a, b, theta = free[:5]
        cos, sin, t = math.cos(theta), math.sin(theta), free[5:]
        u, v = a * np.cos(t), b * np.sin(t)
        across = [points[:, 0] - x - u * cos + v * sin, points[:, 1] - y - u * sin - v * cos]
        return np.concatenate([*(gap / stds for gap in across),
                               PENALTY * np.array(violation(x, y, a, b, theta))])  # fmt: skip

    costs = []
    for ellipse in starts:
        own = ellipse.to_ellipse_frame(points)
        t = np.arctan2(own[:, 1] / ellipse.semi_minor, own[:, 0] / ellipse.semi_major)
        axes = (*ellipse.centre, ellipse.semi_major, ellipse.semi_minor, ellipse.theta)
        costs.append(2 * least_squares(gaps, [*axes, *t], xtol=1e-12, ftol=1e-12).cost)
    return min(costs)


@pytest.mark.parametrize("name", HELD)
def test_the_cost_is_that_of_a_steep_penalty(name, fit):
    constraint, violation = HELD[name]
    found = constrained_cost(fit.problem, constraint, fit.parameters)
    expected = penalised_cost(fit, violation, [fit.ellipse, pipe(15.0)])
    assert found == pytest.approx(expected, rel=1e-3)
    assert found > float(
        fit.problem.evaluate(fit.parameters)[0] @ fit.problem.evaluate(fit.parameters)[0]
    )


@pytest.mark.parametrize("name", HELD)
def test_every_free_parameter_keeps_the_constraint(name, fit):
    constraint, violation = HELD[name]
    for free in constraint.initial_guesses(fit.parameters):
        for shift in (0.0, 0.03):
            ellipse = ellipse_from_parameters(constraint.expand(free + shift)[0])
            axes = (ellipse.semi_major, ellipse.semi_minor)
            np.testing.assert_allclose(
                violation(*ellipse.centre, *axes, ellipse.theta), 0, atol=1e-9
            )


@pytest.mark.parametrize("name", HELD)
def test_the_derivative_of_a_constraint_is_one(name, fit):
    constraint, _ = HELD[name]
    for free in constraint.initial_guesses(fit.parameters):
        differences = approx_fprime(free, lambda x: constraint.expand(x)[0], 1e-7)
        np.testing.assert_allclose(constraint.expand(free)[1], differences, atol=1e-4)


def test_what_the_fit_has_anyway_costs_nothing(fit):
    best = fit.problem.evaluate(fit.parameters)[0]
    held = (
        fixed_radius(fit.ellipse.radius),
        fixed_phi(fit.ellipse.phi),
        fixed_theta(fit.ellipse.theta),
    )
    for constraint in held:
        cost = constrained_cost(fit.problem, constraint, fit.parameters)
        assert cost == pytest.approx(float(best @ best), rel=1e-6)
