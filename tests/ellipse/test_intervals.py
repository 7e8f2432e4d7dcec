import math

import numpy as np
import pytest

from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.intervals import MAX_PHI, interval, theta_is_determined
from tests.ellipse.arcs import SENSOR, measured, pipe, upper_arc
from tests.tolerances import spread_of_share

RUNS = {"radius": 80, "centre_x": 80, "centre_y": 60, "theta": 60, "phi": 40}
FAR, NEAR, CIRCLE = 35.0, 8.0, 0.0
SHORT_ARCS = 120


def fit_of(phi_deg, rng, covariances=True):
    truth = pipe(phi_deg)
    points = measured(upper_arc(truth), rng)
    return fit_ellipse(points, truth, SENSOR.covariances(points) if covariances else None)


def value_of(ellipse, quantity):
    x, y = ellipse.centre
    values = {"radius": ellipse.radius, "theta": ellipse.theta, "phi": ellipse.phi}
    return {**values, "centre_x": x, "centre_y": y}[quantity]


@pytest.mark.parametrize("phi_deg", [NEAR, FAR])
@pytest.mark.parametrize("quantity", RUNS)
def test_intervals_hold_the_truth_as_often_as_they_say(quantity, phi_deg, rng):
    level, runs = 0.9, RUNS[quantity] // 2  # at both tilts
    truth = value_of(pipe(phi_deg), quantity)
    held = 0
    for _ in range(runs):
        low, high = interval(fit_of(phi_deg, rng), quantity, level)
        shifts = (-math.pi, 0, math.pi) if quantity == "theta" else (0,)
        held += any(low <= truth + shift <= high for shift in shifts)
    assert abs(held / runs - level) < spread_of_share(level, runs)


@pytest.mark.parametrize("quantity", RUNS)
def test_intervals_hold_the_estimate_and_grow_with_the_level(quantity, rng):
    fit = fit_of(FAR, rng)
    value = value_of(fit.ellipse, quantity)
    (low, high), (lower, higher) = (interval(fit, quantity, level) for level in (0.68, 0.99))
    assert lower < low < value < high < higher


def test_far_from_a_circle_the_interval_is_that_of_the_covariance(rng):
    exact = upper_arc(pipe(FAR), count=400)
    fit = fit_ellipse(exact, pipe(FAR), SENSOR.covariances(exact) / 100)
    low, high = interval(fit, "centre_x", 0.95)
    std = math.sqrt(fit.parameter_covariance[0, 0])
    assert ((high - low) / 2) == pytest.approx(1.96 * std, rel=0.02)


def test_an_estimated_noise_has_wider_intervals_than_the_same_known(rng):
    """Student's quantile over that of the normal, at few points."""
    truth, exact = pipe(FAR), upper_arc(pipe(FAR), count=11)
    fit = fit_ellipse(measured(exact, rng), truth)
    low, high = interval(fit, "centre_x", 0.95)
    assert high - low > 2 * 2.2 * math.sqrt(fit.parameter_covariance[0, 0])


def test_the_interval_of_a_circles_phi_reaches_zero(rng):
    lows = [interval(fit_of(CIRCLE, rng), "phi", 0.95)[0] for _ in range(15)]
    # 95 % of them should; 9 of 15 or fewer happens once in ten million.
    assert sum(low == 0 for low in lows) >= 10


def test_a_circle_may_have_any_theta(rng):
    fits = [fit_of(CIRCLE, rng) for _ in range(15)]
    assert sum(interval(fit, "theta") == (0.0, math.pi) for fit in fits) >= 10
    assert sum(theta_is_determined(fit) for fit in fits) <= 1


def test_an_exact_circle_has_no_theta_and_phi_from_zero():
    exact = upper_arc(pipe(CIRCLE))
    fit = fit_ellipse(exact, pipe(CIRCLE), SENSOR.covariances(exact))
    low, high = interval(fit, "phi")
    assert (low, interval(fit, "theta")) == (0.0, (0.0, math.pi))
    assert 0 < high < MAX_PHI
    assert not theta_is_determined(fit)


def test_a_tilted_pipe_is_no_circle_and_its_theta_is_bounded(rng):
    fit = fit_of(FAR, rng)
    low, high = interval(fit, "theta")
    assert theta_is_determined(fit)
    assert low <= fit.ellipse.theta <= high < low + math.pi / 2


def test_the_interval_of_theta_runs_through_the_seam(rng):
    truth = pipe(FAR, theta=0.0)
    points = measured(upper_arc(truth), rng)
    low, high = interval(fit_ellipse(points, truth, SENSOR.covariances(points)), "theta", 0.9999)
    assert (low < 0 < high) or (low < math.pi < high)


@pytest.mark.parametrize(
    ("quantity", "level", "message"),
    [
        ("diameter", 0.95, "want one of radius, theta, phi, centre_x, centre_y, got 'diameter'"),
        ("radius", 0.0, "want a level between 0 and 1, got 0"),
        ("radius", 1.0, "got 1"),
        ("phi", 95, "got 95"),
        ("phi", math.nan, "got nan"),
    ],
)
def test_what_is_no_quantity_or_level_is_refused(quantity, level, message, rng):
    with pytest.raises(ValueError, match=message):
        interval(fit_of(FAR, rng), quantity, level)


def test_intervals_turn_with_nothing_and_give_the_same_twice(rng):
    fit = fit_of(NEAR, rng)
    before = fit.parameters.copy()
    assert interval(fit, "phi") == interval(fit, "phi")
    np.testing.assert_array_equal(fit.parameters, before)


@pytest.mark.parametrize("degrees", [80.0, 100.0])
def test_a_determined_theta_is_not_off_by_thirty_degrees(degrees, rng):
    """A short arc excludes the circle far more often than it knows the direction."""
    far = determined = 0
    for theta in rng.uniform(0, math.pi, SHORT_ARCS):
        truth = pipe(20.0, theta=theta)
        points = measured(upper_arc(truth, degrees, count=round(degrees / 2)), rng)
        fit = fit_ellipse(points, pipe(0.0), SENSOR.covariances(points))
        off = (fit.ellipse.theta - theta + math.pi / 2) % math.pi - math.pi / 2
        if theta_is_determined(fit):
            determined, far = determined + 1, far + (abs(off) > math.radians(30))
    print(f"{far} of {determined} off, at {degrees:.0f} deg")
    assert far <= 2 + 0.02 * determined
