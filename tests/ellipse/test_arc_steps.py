"""Steps in coordinates of an arc: what they share with straight steps, and what they preserve."""

import math

import numpy as np
import pytest

from lsvision.ellipse.arc_steps import move_along_arcs
from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.parameters import compute_semi_minor, semi_minor_gradient
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import RadiusPrior
from tests.ellipse.arcs import SENSOR, measured, pipe, upper_arc

STEP = np.array([0.4, -0.6, 0.5, -0.3, 0.2])  # mm


@pytest.fixture
def stack_of(rng):
    def build(**priors):
        truth = pipe(20.0)
        points = measured(upper_arc(truth), rng)
        return FitStack.of([fit_ellipse(points, truth, SENSOR.covariances(points), **priors)])

    return build


def moved_by(stack, step, fraction=1.0):
    start = stack.parameters
    return move_along_arcs(stack, np.array([0]), start, start + step, np.array([fraction]))[0]


@pytest.mark.parametrize("priors", [{}, {"known_radius": RadiusPrior(19.0, 0.1)},
                                    {"known_phi": PhiPrior(math.radians(20), 0.01)}])  # fmt: skip
def test_a_step_is_straight_to_first_order(stack_of, priors):
    stack = stack_of(**priors)
    step = STEP.copy()
    if "known_phi" in priors:  # of which the step is made linear: first order only along the ring
        _, _, m, p, q = stack.parameters[0]
        step[2:] = 0.5, 0.5 * p / m - 0.3 * q / m, 0.5 * q / m + 0.3 * p / m
    gaps = [
        np.abs(moved_by(stack, step, fraction) - stack.parameters[0] - fraction * step).max()
        for fraction in (0.1, 0.05, 0.025)
    ]
    assert gaps[0] < 0.1 * np.abs(0.1 * step).max()
    assert gaps[1] == pytest.approx(gaps[0] / 4, rel=0.1)
    assert gaps[2] == pytest.approx(gaps[1] / 4, rel=0.1)


def test_the_middle_point_of_the_arc_moves_straight(stack_of):
    stack = stack_of()
    (w,) = stack.arc_middles

    def middle(parameters):
        x, y, m, p, q = parameters
        return complex(x, y) + m * w + complex(p, q) * w.conjugate()

    start = stack.parameters[0]
    expected = middle(start) + 0.5 * (middle(start + 4 * STEP) - middle(start))
    assert middle(moved_by(stack, 4 * STEP, 0.5)) == pytest.approx(expected, abs=1e-9)


def test_a_known_radius_changes_by_its_gradient_times_the_step(stack_of):
    stack = stack_of(known_radius=RadiusPrior(19.0, 0.1))
    start = stack.parameters[0]
    expected = compute_semi_minor(start) + semi_minor_gradient(start) @ STEP
    assert compute_semi_minor(moved_by(stack, STEP)) == pytest.approx(expected, abs=1e-9)


def test_a_known_radius_is_preserved_by_a_step_from_a_circle_in_any_direction(stack_of):
    stack = stack_of(known_radius=RadiusPrior(19.0, 0.1))
    stack.parameters[0, 2:] = 19.0, 0.0, 0.0
    for angle in (0.0, 1.0, 2.5, 4.0):
        step = np.array([0.1, 0.2, 0.4, 0.4 * math.cos(angle), 0.4 * math.sin(angle)])
        assert compute_semi_minor(moved_by(stack, step)) == pytest.approx(19.0, abs=1e-9)


def test_a_known_phi_is_preserved_by_a_step_along_its_ring(stack_of):
    stack = stack_of(known_phi=PhiPrior(math.radians(20), 0.01))
    _, _, m, p, q = stack.parameters[0]
    along_ring = np.array([0.3, 0.1, 0.0, -0.8 * q, 0.8 * p])
    _, _, new_m, new_p, new_q = moved_by(stack, along_ring)
    assert math.hypot(new_p, new_q) / new_m == pytest.approx(math.hypot(p, q) / m)
    assert math.atan2(new_q, new_p) - math.atan2(q, p) == pytest.approx(math.atan(0.8))


def test_only_a_full_step_to_a_circle_leads_to_one(stack_of):
    stack = stack_of()
    to_circle = np.array([0.1, 0.2, 0.3, *-stack.parameters[0, 3:]])
    assert (moved_by(stack, to_circle)[3:] == 0).all()
    assert np.hypot(*moved_by(stack, to_circle, 0.9)[3:]) > 0


def test_a_known_phi_does_not_reach_a_circle(stack_of):
    """From which no further step could be computed."""
    stack = stack_of(known_phi=PhiPrior(math.radians(20), 0.01))
    _, _, m, p, q = stack.parameters[0]
    _, _, new_m, new_p, new_q = moved_by(stack, np.array([0.0, 0.0, 0.0, -3 * p, -3 * q]))
    phi, new_phi = (2 * math.atan(math.sqrt(ratio)) for ratio in
                    (math.hypot(p, q) / m, math.hypot(new_p, new_q) / new_m))  # fmt: skip
    assert new_phi == pytest.approx(0.1 * phi)
