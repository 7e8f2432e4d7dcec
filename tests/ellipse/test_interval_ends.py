"""Interval ends, compared with those of an independent search over (x, y, a, b, theta)."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from lsvision import Ellipse
from lsvision.ellipse import interval_ends, region_extrema
from lsvision.ellipse.critical_ratio import CriticalRatios
from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.interval_ends import IntervalEnds, find_interval_ends
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import RadiusPrior
from lsvision.geometry import orthogonal_residuals
from tests.ellipse.arcs import (
    SENSOR,
    measured,
    pipe,
    ratios_of,
    ratios_of_flattening,
    upper_arc,
)

ALL = np.ones(region_extrema.END_COUNT, dtype=bool)
LEVEL = 0.95
SECTIONS = {
    "far from a circle": (35.0, 140.0, {}),
    "near a circle": (9.0, 140.0, {}),
    "short": (30.0, 75.0, {}),
    "long": (20.0, 200.0, {}),
    "steep": (65.0, 120.0, {}),
    "known radius": (20.0, 90.0, {"known_radius": RadiusPrior(19.0, 0.1)}),
    "known phi": (20.0, 110.0, {"known_phi": PhiPrior(math.radians(20), math.radians(1))}),
}
QUANTITIES = {  # rows low, high; value of (x, y, a, b, theta) and of ends
    "radius": (0, 1, lambda x, y, a, b, theta: min(a, b)),
    "centre x": (6, 7, lambda x, y, a, b, theta: x),
    "centre y": (8, 9, lambda x, y, a, b, theta: y),
}


def ends_of(fit, level=LEVEL, wanted=ALL):
    """The ends of one fit."""
    stack = FitStack.of([fit])
    found = find_interval_ends(stack, CriticalRatios.of(stack, level), wanted[None])
    return IntervalEnds(*(each[0] for each in found))


def section(name, rng):
    phi, degrees, priors = SECTIONS[name]
    truth = pipe(phi)
    points = measured(upper_arc(truth, degrees), rng)
    return fit_ellipse(points, truth, SENSOR.covariances(points), **priors)


def raw(parameters):
    x, y, m, p, q = parameters
    h = math.hypot(p, q)
    return np.array([x, y, m + h, m - h, math.atan2(q, p) / 2])


def cost_of_raw(fit, values):
    x, y, a, b, theta = values
    if not 0.05 < a / b < 20 or b < 0:
        return 1e4
    residuals = orthogonal_residuals(fit.problem.points, Ellipse.from_axes((x, y), a, b, theta))
    total = float(((residuals / fit.problem.stds) ** 2).sum())
    if fit.problem.known_radius is not None:
        known = fit.problem.known_radius
        total += ((min(a, b) - known.radius) / known.std) ** 2
    if fit.problem.known_phi is not None:
        known = fit.problem.known_phi
        total += ((math.acos(min(a, b) / max(a, b)) - known.phi) / known.std) ** 2
    return total / fit.variance_factor


def search(fit, value, critical, starts):
    """Return the extremum of a value over F <= min F + c, by sequential quadratic programming."""
    scale = np.sqrt(np.abs(np.diag(fit.parameter_covariance)))
    scale[4] /= math.hypot(*fit.parameters[3:])
    least = cost_of_raw(fit, raw(fit.parameters))
    unit = abs(value(*(starts[0] + scale)) - value(*starts[0])) + 1e-9
    found = []
    for start in starts:
        result = minimize(
            lambda t, at=start: value(*(at + scale * t)) / unit, np.zeros(5), method="SLSQP",
            constraints={
                "type": "ineq",
                "fun": lambda t, at=start: critical - cost_of_raw(fit, at + scale * t) + least,
            },
            options={"maxiter": 300, "ftol": 1e-7},
        )  # fmt: skip
        if result.success:
            found.append(result.fun * unit)
    return min(found)


@pytest.mark.parametrize("name", SECTIONS)
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_the_ends_are_the_extrema_of_the_region(name, quantity):
    # Two short arcs in a hundred have ends that contradict each other, and report limits.
    fit = section(name, np.random.default_rng(5))
    ends = ends_of(fit)
    assert ends.reliable.all()
    low, high, value = QUANTITIES[quantity]
    starts = [raw(fit.parameters), *(raw(row) for row in ends.parameters[[low, high]])]
    (critical,) = ratios_of(fit, LEVEL).one_dof
    least = search(fit, value, critical, starts)
    most = -search(fit, lambda *v: -value(*v), critical, starts)
    found = [value(*raw(ends.parameters[row])) for row in (low, high)]
    np.testing.assert_allclose(found, (least, most), rtol=0, atol=0.006 * (most - least))


@pytest.mark.parametrize("name", SECTIONS)
def test_every_end_lies_on_the_boundary_of_its_region(name, rng):
    fit = section(name, rng)
    ratios = ratios_of(fit, LEVEL)
    ends = ends_of(fit)
    least = cost_of_raw(fit, raw(fit.parameters))
    for row in (0, 1, 6, 7, 8, 9):
        ratio = cost_of_raw(fit, raw(ends.parameters[row])) - least
        assert ratio == pytest.approx(ratios.one_dof[0], rel=0.02)
    h = np.hypot(*ends.parameters[:, 3:].T)
    for row in (2, 3):
        if ends.wanted[row]:
            flattening = h[row] / ends.parameters[row, 2]
            ratio = cost_of_raw(fit, raw(ends.parameters[row])) - least
            assert ratio == pytest.approx(ratios_of_flattening(ratios, [flattening])[0], rel=0.02)
    for row in (10, 11):
        if ends.wanted[row]:
            ratio = cost_of_raw(fit, raw(ends.parameters[row])) - least
            direction = np.array([complex(*ends.parameters[row, 3:])])
            (expected,) = ratios.compute_for_direction(np.array([0]), direction)
            assert ratio == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("level", [0.68, 0.95])
def test_the_ends_of_phi_follow_their_critical_ratio_near_a_circle(level, rng):
    """Near a circle the critical ratio changes as fast as F."""
    for _ in range(30):
        truth = pipe(rng.uniform(0, 8))
        points = measured(upper_arc(truth, rng.uniform(100, 200)), rng)
        fit = fit_ellipse(points, truth, SENSOR.covariances(points))
        ratios = ratios_of(fit, level)
        ends = ends_of(fit, level)
        least = cost_of_raw(fit, raw(fit.parameters))
        for row in (region_extrema.PHI_LOW, region_extrema.PHI_HIGH):
            if ends.wanted[row]:
                m, p, q = ends.parameters[row, 2:]
                (critical,) = ratios_of_flattening(ratios, [math.hypot(p, q) / m])
                ratio = cost_of_raw(fit, raw(ends.parameters[row])) - least
                assert ratio == pytest.approx(critical, rel=0.004)


@pytest.mark.parametrize("phi", [0.0, 3.0, 6.0, 9.0])
def test_the_best_circle_is_that_of_a_search(phi, rng):
    truth = pipe(phi)
    points = measured(upper_arc(truth), rng)
    fit = fit_ellipse(points, truth, SENSOR.covariances(points))
    ends, points = ends_of(fit, 0.999), fit.problem.points  # without the bias

    def cost(circle):
        x, y, r = circle
        gaps = np.hypot(points[:, 0] - x, points[:, 1] - y) - r
        return float(((gaps / fit.problem.stds) ** 2).sum()) / fit.variance_factor

    best = minimize(cost, [5.0, -400.0, 19.0], method="Nelder-Mead", options={"xatol": 1e-6})
    expected = best.fun - cost_of_raw(fit, raw(fit.parameters))
    assert ends.circle_ratios == pytest.approx(expected, rel=0.02, abs=0.02)


@pytest.mark.parametrize("degrees", [230.0, 300.0])
def test_the_largest_radius_of_a_circle_may_be_that_of_a_circle(degrees):
    """On a long arc m and d are hardly correlated, and b = m - h has its maximum at h = 0."""
    truth = pipe(0.0)
    points = upper_arc(truth, degrees)
    fit = fit_ellipse(points, truth, SENSOR.covariances(points))
    ratios = ratios_of(fit, LEVEL)
    ends = ends_of(fit)
    assert ends.reliable.all()

    def surplus(r):
        best = minimize(
            lambda centre: cost_of_raw(fit, (*centre, r, r, 0.0)), [5.0, -400.0],
            method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9},
        )  # fmt: skip
        return best.fun - ratios.one_dof[0]

    largest = brentq(surplus, 19.0, 19.5, xtol=1e-5)
    m, p, q = ends.parameters[region_extrema.RADIUS_HIGH, 2:]
    assert m - math.hypot(p, q) == pytest.approx(largest, abs=5e-4)


@pytest.fixture
def expansions(monkeypatch):
    """List with an element for each call of `expand_cost`."""
    calls = []
    expand = interval_ends.expand_cost
    monkeypatch.setattr(
        interval_ends, "expand_cost", lambda *args: calls.append(1) or expand(*args)
    )
    return calls


def test_arcs_over_ninety_degrees_need_one_expansion_after_the_first(rng, expansions):
    counts = []
    for phi in (0.0, 8.0, 20.0, 35.0):
        for _ in range(5):
            truth = pipe(phi)
            points = measured(upper_arc(truth, 120.0), rng)
            fit = fit_ellipse(points, truth, SENSOR.covariances(points))
            expansions.clear()
            ends_of(fit)
            counts.append(len(expansions) - 1)
    assert np.mean(counts) < 1.5


def test_only_the_wanted_rows_move(rng):
    fit = section("far from a circle", rng)
    wanted = np.zeros(region_extrema.END_COUNT, dtype=bool)
    wanted[region_extrema.X_HIGH] = True
    ends = ends_of(fit, LEVEL, wanted)
    moved = (ends.parameters != fit.parameters).any(axis=1)
    np.testing.assert_array_equal(moved, wanted)
    np.testing.assert_array_equal(ends.wanted, wanted)


def two_lobes():
    """A short arc whose region has two lobes: one with the smallest radius, one with the largest
    phi, which a step from the estimate does not see."""
    rng = np.random.default_rng(TWO_LOBES_SEED)
    truth = pipe(rng.uniform(0, 50), rng.uniform(8, 60), rng.uniform(0, math.pi))
    arc = upper_arc(truth, rng.uniform(60, 90), int(rng.integers(30, 120)))
    points = measured(arc, rng)
    return fit_ellipse(points, truth, SENSOR.covariances(points))


TWO_LOBES_SEED, TWO_LOBES_LEVEL = 700014, 0.999


def test_no_end_is_further_out_for_another_quantity_than_its_own():
    fit = two_lobes()
    ends = ends_of(fit, TWO_LOBES_LEVEL)
    assert ends.reliable.all()
    rows = np.flatnonzero(ends.wanted & (np.arange(13) != region_extrema.CIRCLE))
    phis = np.hypot(*ends.parameters[rows, 3:].T) / ends.parameters[rows, 2]
    own = phis[np.isin(rows, [region_extrema.PHI_HIGH, region_extrema.PHI_HIGH_2])].max()
    assert phis.max() <= own * 1.001


def test_an_arc_that_tells_no_radius_has_no_reliable_ends(rng, expansions):
    """The search for them ends soon, too."""
    truth = pipe(20.0)
    points = measured(upper_arc(truth, 35.0, count=25), rng)
    fit = fit_ellipse(points, truth, SENSOR.covariances(points))
    assert not ends_of(fit, 0.99).reliable.any()
    assert len(expansions) <= 32
