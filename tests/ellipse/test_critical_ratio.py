import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import chi2, f

from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.phi_prior import PhiPrior
from tests.ellipse.arcs import SENSOR, ratios_of, ratios_of_flattening, upper_arc
from tests.ellipse.arcs import pipe as exact_pipe
from tests.tolerances import spread_of_share

DRAWN = 40_000
M = 20.0


def fit_with(sigmas, d, freedom=math.inf, known_phi=None):
    """Return a fit with this d = (p, q), and with these stds of d."""
    truth = exact_pipe(10.0)
    points = upper_arc(truth)
    fit = fit_ellipse(points, truth, SENSOR.covariances(points))
    covariance = np.diag([1.0, 1.0, 1.0, sigmas[0] ** 2, sigmas[1] ** 2])
    return replace(
        fit,
        problem=replace(fit.problem, known_phi=known_phi),
        parameters=np.array([5.0, -400.0, M, *d]),
        unscaled_covariance=covariance,
        variance_factor=1.0,
        degrees_of_freedom=freedom,
    )


def shares_within(criticals, sigmas, true, alternatives, rng):
    """Return how often the estimate of a true d is within sqrt(c) sigmas of an alternative."""
    drawn = true / sigmas + rng.normal(size=(DRAWN, 2))
    reach = 1.001 * math.sqrt(max(criticals))  # farther ones are inf
    distances, _ = cKDTree(alternatives / sigmas).query(drawn, distance_upper_bound=reach)
    return [float((distances**2 <= critical).mean()) for critical in criticals]


@pytest.mark.parametrize("level", [0.68, 0.95, 0.999])
def test_at_the_circle_it_is_of_two_degrees_of_freedom_and_far_away_of_one(level):
    ratios = ratios_of(fit_with((0.1, 0.3), (0.4, 0.2)), level)
    assert ratios.one_dof == pytest.approx(chi2.ppf(level, 1))
    assert ratios.two_dof == pytest.approx(chi2.ppf(level, 2))
    at_circle, far = ratios_of_flattening(ratios, [0.0, 0.9])
    assert at_circle == pytest.approx(ratios.two_dof, rel=1e-6)
    assert ratios.for_circle == ratios.two_dof
    assert far == ratios.one_dof


def test_it_is_students_where_the_noise_was_estimated():
    ratios = ratios_of(fit_with((0.1, 0.3), (0.4, 0.2), freedom=9.0), 0.95)
    assert ratios.one_dof == pytest.approx(f.ppf(0.95, 1, 9))
    assert ratios.two_dof == pytest.approx(2 * f.ppf(0.95, 2, 9))
    assert ratios_of_flattening(ratios, [0.0])[0] == pytest.approx(ratios.two_dof)


@pytest.mark.parametrize("aspect", [1.0, 3.0, 8.0])
@pytest.mark.parametrize("degrees", [10.0, 50.0, 85.0])
def test_that_of_phi_holds_the_estimate_as_often_as_it_says(aspect, degrees, rng):
    sigmas = np.array([0.1 * aspect, 0.1])
    direction = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    levels = (0.8, 0.95)
    ratios = [ratios_of(fit_with(sigmas, direction), level) for level in levels]
    turns = np.linspace(0, 2 * np.pi, 4000)
    for h in (0.05, 0.15, 0.3, 0.7):
        criticals = [ratios_of_flattening(each, [h / M])[0] for each in ratios]
        ring = h * np.column_stack([np.cos(turns), np.sin(turns)])
        shares = shares_within(criticals, sigmas, h * direction, ring, rng)
        for level, each, critical, share in zip(levels, ratios, criticals, shares, strict=True):
            assert share > level - spread_of_share(level, DRAWN)  # never below one degree's
            if critical > 1.001 * each.one_dof:
                assert share == pytest.approx(level, abs=0.003 + spread_of_share(level, DRAWN))


@pytest.mark.parametrize("h", [0.01, 0.1, 0.25])
@pytest.mark.parametrize("degrees", [0.0, 60.0])
def test_that_of_theta_holds_the_estimate_as_often_as_it_says(h, degrees, rng):
    sigmas, level = np.array([0.3, 0.1]), 0.9
    direction = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    ratios = ratios_of(fit_with(sigmas, (0.0, h)), level)
    (critical,) = ratios.compute_for_direction(np.array([0]), np.array([3 * complex(*direction)]))
    half_line = np.linspace(0, 5, 20_000)[:, None] * direction
    (share,) = shares_within([critical], sigmas, h * direction, half_line, rng)
    assert share == pytest.approx(level, abs=0.002 + spread_of_share(level, DRAWN))


@pytest.mark.parametrize("aspect", [1.0, 3.0, 8.0])
def test_that_of_phi_has_no_steps(aspect):
    """Also at five sigmas from the circle, and far out on an elongated ring."""
    sigmas = np.array([0.1 * aspect, 0.1])
    ratios = ratios_of(fit_with(sigmas, (0.02, 0.2)), 0.95)
    steps = [
        np.abs(
            np.diff(ratios_of_flattening(ratios, (np.linspace(0.0, 1.9, count) / M).tolist()))
        ).max()
        for count in (200, 400, 800)
    ]
    assert steps[0] > 1.7 * steps[1] > 1.7**2 * steps[2]
    beyond = np.array(ratios_of_flattening(ratios, (np.linspace(0.45, 1.9, 200) / M).tolist()))
    assert np.abs(np.diff(beyond)).max() < 0.02
    assert beyond.min() >= ratios.one_dof


def test_a_ring_of_more_than_a_sigma_counts_as_straight_within_one_percent():
    ratios = ratios_of(fit_with((0.1, 0.1), (1.0, 0.0)), 0.999)
    inner, last, beyond = ratios_of_flattening(ratios, [0.1 / M, 0.119 / M, 0.13 / M])
    assert inner > 1.01 * last > 1.01 * ratios.one_dof
    assert last < 1.005 * ratios.one_dof
    assert beyond == ratios.one_dof


def test_a_known_phi_near_zero_raises_it_to_that_of_the_prior():
    known = PhiPrior(0.0, math.radians(2))
    std = known.deviator_std * M
    ratios = ratios_of(fit_with((std, std), (0.0, 0.0), known_phi=known), 0.95)
    expected = known.compute_critical_ratio(0.95)
    assert expected > ratios.two_dof
    assert ratios.for_circle == pytest.approx(expected)
    half = ratios_of(fit_with((std, 1e-6), (0.0, 0.0), known_phi=known), 0.95)
    assert half.for_circle == pytest.approx((expected + half.two_dof) / 2, rel=1e-3)
    np.testing.assert_allclose(ratios_of_flattening(ratios, [0.0, 1e-4, 0.5]), expected)


def test_theta_is_open_where_a_circle_is_within_the_ratio_of_two_quantities():
    ratios = ratios_of(fit_with((0.1, 0.3), (0.4, 0.2)), 0.95)
    assert ratios.allows_any_theta(np.array([5.99]))
    assert not ratios.allows_any_theta(np.array([6.0]))
    excluded = fit_with((0.1, 0.3), (0.4, 0.2), known_phi=PhiPrior(0.3, 0.01))
    assert not ratios_of(excluded, 0.95).allows_any_theta(np.array([0.0]))
