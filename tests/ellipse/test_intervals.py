import gc
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from lsvision import Arc, CylinderSection, Ellipse
from lsvision.ellipse import intervals as module
from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.intervals import MAX_PHI, find_interval, find_intervals, is_theta_determined
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import RadiusPrior
from tests.ellipse.arcs import SENSOR, measured, pipe, upper_arc
from tests.tolerances import spread_of_share

QUANTITIES = ("radius", "centre_x", "centre_y", "theta", "phi")
RUNS = 200
"""Of intervals of 0.7 times their width 75 % hold, which each quantity shows in 79 of 80 trials."""
FAR, NEAR, CIRCLE = 35.0, 8.0, 0.0
SHORT_ARCS = 120
PENALTY = 1e5  # 1/mm, 1/rad: a violation of 1e-5 costs as much as one sigma
ISOTROPIC = 0.0025 * np.eye(2)  # mm^2
HELD = {  # what must vanish for a value v, as a function of (x, y, a, b, theta)
    "centre_x": lambda v, x, y, a, b, theta: x - v,
    "centre_y": lambda v, x, y, a, b, theta: y - v,
    "radius": lambda v, x, y, a, b, theta: min(a, b) - v,
    "phi": lambda v, x, y, a, b, theta: min(a, b) - max(a, b) * math.cos(v),
    "theta": lambda v, x, y, a, b, theta: math.sin(theta - v),
}


def fit_of(phi_deg, rng, covariances=True):
    truth = pipe(phi_deg)
    points = measured(upper_arc(truth), rng)
    return fit_ellipse(points, truth, SENSOR.covariances(points) if covariances else None)


def value_of(ellipse, quantity):
    x, y = ellipse.centre
    values = {"radius": ellipse.radius, "theta": ellipse.theta, "phi": ellipse.phi}
    return {**values, "centre_x": x, "centre_y": y}[quantity]


def least_cost(fit, starts, violation=lambda *values: 0.0):
    """Return the minimum of F over raw parameters, with an anomaly per point, under a penalty."""
    points, stds = fit.problem.points, fit.problem.stds

    def gaps(free):
        x, y, a, b, theta = free[:5]
        cos, sin, t = math.cos(theta), math.sin(theta), free[5:]
        u, v = a * np.cos(t), b * np.sin(t)
        across = [points[:, 0] - x - u * cos + v * sin, points[:, 1] - y - u * sin - v * cos]
        penalty = [PENALTY * violation(*free[:5])]
        return np.concatenate([*(gap / stds for gap in across), penalty])

    costs = []
    for ellipse in starts:
        own = ellipse.to_ellipse_frame(points)
        t = np.arctan2(own[:, 1] / ellipse.semi_minor, own[:, 0] / ellipse.semi_major)
        axes = (*ellipse.centre, ellipse.semi_major, ellipse.semi_minor, ellipse.theta)
        costs.append(2 * least_squares(gaps, [*axes, *t], xtol=1e-12, ftol=1e-12).cost)
    return min(costs)


@pytest.mark.parametrize("level", [0.68, 0.99])
@pytest.mark.parametrize("quantity", HELD)
def test_at_both_ends_the_best_other_parameters_are_worse_by_the_quantile(quantity, level, rng):
    truth = pipe(25.0)
    points = measured(upper_arc(truth, count=30), rng)
    fit = fit_ellipse(points, truth, np.tile(ISOTROPIC, (len(points), 1, 1)))
    least = least_cost(fit, [fit.ellipse])
    for end in find_interval(fit, quantity, level):
        starts = [fit.ellipse]
        held = least_cost(fit, starts, lambda *values, v=end: HELD[quantity](v, *values))
        ratio = (held - least) / fit.variance_factor
        assert ratio == pytest.approx(chi2.ppf(level, 1), rel=0.02)


@cache
def intervals_of_runs(phi_deg, level):
    """Intervals of the same arcs for every quantity."""
    rng = np.random.default_rng([int(phi_deg), 7])
    return module.find_intervals_of_fits([fit_of(phi_deg, rng) for _ in range(RUNS)], level)


@pytest.mark.parametrize("phi_deg", [NEAR, FAR])
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_intervals_hold_the_truth_as_often_as_they_say(quantity, phi_deg):
    truth = value_of(pipe(phi_deg), quantity)
    shifts = (-math.pi, 0, math.pi) if quantity == "theta" else (0,)
    held = 0
    for found in intervals_of_runs(phi_deg, 0.9):
        low, high = getattr(found, quantity)
        held += any(low <= truth + shift <= high for shift in shifts)
    assert abs(held / RUNS - 0.9) < spread_of_share(0.9, RUNS)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_intervals_hold_the_estimate_and_grow_with_the_level(quantity, rng):
    fit = fit_of(FAR, rng)
    value = value_of(fit.ellipse, quantity)
    (low, high), (lower, higher) = (find_interval(fit, quantity, level) for level in (0.68, 0.99))
    assert lower < low < value < high < higher


@pytest.mark.parametrize("phi_deg", [CIRCLE, NEAR, FAR])
def test_a_higher_level_never_has_a_narrower_interval(phi_deg, rng):
    fit = fit_of(phi_deg, rng)
    all_levels = [find_intervals(fit, level) for level in (0.5, 0.68, 0.8, 0.9, 0.95, 0.99, 0.999)]
    for quantity in QUANTITIES:
        widths = np.array([high - low for low, high in (getattr(i, quantity) for i in all_levels)])
        assert (np.diff(widths) >= 0).all()


def moved(ellipse, turn=0.0, scale=1.0, shift=(0.0, 0.0)):
    x, y = ellipse.centre
    cos, sin = math.cos(turn), math.sin(turn)
    centre = (scale * (x * cos - y * sin) + shift[0], scale * (x * sin + y * cos) + shift[1])
    axes = scale * ellipse.semi_major, scale * ellipse.semi_minor
    return Ellipse(centre, *axes, ellipse.theta + turn)


def moved_fit(fit, turn=0.0, scale=1.0, shift=(0.0, 0.0)):
    """Return the fit of the same points after a rotation, scaling and shift."""
    cos, sin = math.cos(turn), math.sin(turn)
    rotation = np.array([[cos, -sin], [sin, cos]])
    points = scale * fit.problem.points @ rotation.T + np.array(shift)
    problem = replace(fit.problem, points=points, stds=scale * fit.problem.stds)
    x, y = scale * rotation @ fit.parameters[:2] + np.array(shift)
    d = scale * complex(*fit.parameters[3:]) * np.exp(2j * turn)
    double = np.array([[math.cos(2 * turn), -math.sin(2 * turn)],
                       [math.sin(2 * turn), math.cos(2 * turn)]])  # fmt: skip
    turns = np.zeros((5, 5))
    turns[:2, :2], turns[2, 2], turns[3:, 3:] = scale * rotation, scale, scale * double
    return replace(
        fit,
        ellipse=moved(fit.ellipse, turn, scale, shift),
        problem=problem,
        parameters=np.array([x, y, scale * fit.parameters[2], d.real, d.imag]),
        unscaled_covariance=turns @ fit.unscaled_covariance @ turns.T,
    )


@pytest.mark.parametrize("phi_deg", [CIRCLE, 4.0, NEAR, FAR])
def test_a_rotation_turns_theta_and_nothing_else(phi_deg, rng):
    fit = fit_of(phi_deg, rng)
    before, after = find_intervals(fit), find_intervals(moved_fit(fit, turn=0.7))
    np.testing.assert_allclose(after.radius, before.radius, rtol=0, atol=0.002)
    np.testing.assert_allclose(after.phi, before.phi, rtol=0, atol=5e-4)
    if before.theta == (0.0, math.pi):
        assert after.theta == (0.0, math.pi)
    else:
        turn = np.array(after.theta) - before.theta
        expected = 0.7 if fit.ellipse.theta + 0.7 < math.pi else 0.7 - math.pi
        np.testing.assert_allclose(turn, expected, rtol=0, atol=0.003)
    assert is_theta_determined(moved_fit(fit, turn=0.7)) == is_theta_determined(fit)


@pytest.mark.parametrize("phi_deg", [CIRCLE, NEAR, FAR])
def test_lengths_scale_and_the_centre_moves_with_the_points(phi_deg, rng):
    fit = fit_of(phi_deg, rng)
    before, after = (
        find_intervals(fit),
        find_intervals(moved_fit(fit, scale=3.0, shift=(100.0, 50.0))),
    )
    np.testing.assert_allclose(after.radius, 3 * np.array(before.radius), rtol=1e-4)
    np.testing.assert_allclose(after.centre_x, 3 * np.array(before.centre_x) + 100, atol=0.003)
    np.testing.assert_allclose(after.centre_y, 3 * np.array(before.centre_y) + 50, atol=0.003)
    np.testing.assert_allclose(after.phi, before.phi, atol=1e-4)
    np.testing.assert_allclose(after.theta, before.theta, atol=1e-3)


@pytest.mark.parametrize("quarters", [1, 2, 3])
@pytest.mark.parametrize("phi_deg", [CIRCLE, 3.0])
def test_a_quarter_turn_exchanges_the_ends_of_the_centre(phi_deg, quarters, rng):
    """With an exactly known radius and nearly a circle, where some of these ends are circles."""
    fit = prior_fit(phi_deg, rng, known_radius=RadiusPrior(19.0))
    before, after = find_intervals(fit), find_intervals(moved_fit(fit, turn=quarters * math.pi / 2))
    (left, right), (low, high) = before.centre_x, before.centre_y
    corners = np.exp(0.5j * math.pi * quarters) * np.array(
        [complex(left, low), complex(right, high)]
    )
    np.testing.assert_allclose(after.centre_x, np.sort(corners.real), atol=0.001)
    np.testing.assert_allclose(after.centre_y, np.sort(corners.imag), atol=0.001)
    assert after.centre_x[1] - after.centre_x[0] < 1.0


def test_all_five_are_computed_once(rng, monkeypatch):
    calls = []
    find = module.find_interval_ends
    monkeypatch.setattr(module, "find_interval_ends", lambda *args: calls.append(1) or find(*args))
    fit = fit_of(FAR, rng)
    section = CylinderSection(fit, Arc(0, 70), np.arange(70))
    found = {quantity: section.interval(quantity) for quantity in QUANTITIES}
    assert section.theta_determined
    assert len(calls) == 1
    assert found == find_intervals(fit, 0.95)._asdict()
    section.interval("radius", 0.9)
    assert len(calls) == 2
    find_intervals(replace(fit))  # equal to itself alone
    assert len(calls) == 3


def test_intervals_are_kept_as_long_as_their_fit(rng):
    fits = [fit_of(FAR, rng) for _ in range(3)]
    kept = len(module._INTERVALS_BY_FIT)
    for fit in fits:
        find_intervals(fit)
    assert len(module._INTERVALS_BY_FIT) == kept + 3
    del fit, fits
    gc.collect()
    assert len(module._INTERVALS_BY_FIT) <= kept


def different_fits(rng):
    """Arcs of several lengths and numbers of points, with and without known quantities."""
    fits = [
        prior_fit(phi, rng, degrees=degrees, **known)
        for phi in (CIRCLE, 3.0, FAR, 45.0)
        for degrees in (50.0, 90.0, 140.0)
        for known in ({}, {"known_radius": RadiusPrior(19.0, 0.05)},
                      {"known_phi": PhiPrior(math.radians(phi), math.radians(2))})
    ]  # fmt: skip
    return [*fits, short_fit(rng), fit_ellipse(fits[0].problem.points, fits[0].ellipse, None)]


@pytest.mark.parametrize("level", [0.68, 0.95, 0.999])
def test_intervals_of_many_fits_are_those_of_each(level, rng):
    fits = different_fits(rng)
    together = module.find_intervals_of_fits(fits, level)
    for fit, found in zip(fits, together, strict=True):
        expected = np.array(find_intervals(replace(fit), level))
        widths = np.diff(expected, axis=1)
        np.testing.assert_allclose((found - expected) / widths, 0, atol=1e-3)


def test_thetas_of_many_fits_are_determined_as_of_each(rng):
    fits = different_fits(rng)
    determined = module.are_thetas_determined(fits)
    assert determined == [is_theta_determined(replace(fit)) for fit in fits]
    assert True in determined
    assert False in determined


def short_fit(rng):
    """A fit of 25 points on 35 deg, whose radius is not determined."""
    truth = pipe(20.0)
    points = measured(upper_arc(truth, 35.0, count=25), rng)
    return fit_ellipse(points, truth, SENSOR.covariances(points))


def test_no_fit_has_no_intervals():
    assert module.find_intervals_of_fits([]) == []
    assert module.are_thetas_determined([]) == []


def test_an_arc_that_tells_no_radius_has_the_limits_for_intervals(rng):
    truth = pipe(20.0)
    points = measured(upper_arc(truth, 35.0, count=25), rng)
    fit = fit_ellipse(points, truth, SENSOR.covariances(points))
    found, ellipse = find_intervals(fit, 0.99), fit.ellipse
    (x, y), far = ellipse.centre, 50 * ellipse.semi_major
    np.testing.assert_allclose(found.radius, (0.02 * ellipse.radius, 50 * ellipse.radius))
    np.testing.assert_allclose(found.phi, (0.0, math.radians(88)))
    np.testing.assert_allclose(found.theta, (0.0, math.pi))
    np.testing.assert_allclose((found.centre_x, found.centre_y), ((x - far, x + far),
                                                                  (y - far, y + far)))  # fmt: skip
    assert not is_theta_determined(fit)


def prior_fit(phi_deg, rng, degrees=120.0, **known):
    truth = pipe(phi_deg)
    points = measured(upper_arc(truth, degrees), rng)
    return fit_ellipse(points, truth, SENSOR.covariances(points), **known)


@pytest.mark.parametrize("phi_deg", [CIRCLE, 3.0, FAR])
def test_an_exactly_known_radius_narrows_what_is_left(phi_deg, rng):
    known = prior_fit(phi_deg, rng, known_radius=RadiusPrior(19.0))
    free = replace(known, problem=replace(known.problem, known_radius=None))
    low, high = find_interval(known, "radius")
    assert high - low == pytest.approx(2 * 1.96 * 19e-6, rel=0.01)
    assert (low + high) / 2 == pytest.approx(19.0, abs=1e-4)
    for quantity in ("centre_x", "centre_y", "phi"):
        low, high = find_interval(known, quantity)
        assert 0 < high - low < 1.0
    fit = fit_ellipse(known.problem.points, known.ellipse, None)
    assert free.problem.known_radius is None
    low, high = find_interval(known, "centre_y")
    wide = find_interval(fit, "centre_y")
    assert high - low < wide[1] - wide[0]


@pytest.mark.parametrize("seed", [60, 71, 96])
def test_an_exactly_known_radius_of_an_untilted_pipe_bounds_all_intervals(seed):
    """The largest centre_y lies near the circle, across which full steps would alternate."""
    rng, truth = np.random.default_rng(seed), pipe(CIRCLE, radius=20.0)
    exact = upper_arc(truth, math.degrees(rng.uniform(1.5, 2.8)), count=60)
    points = exact + 0.02 * rng.normal(size=exact.shape)
    covariances = np.tile(0.0004 * np.eye(2), (60, 1, 1))
    fit = fit_ellipse(points, truth, covariances, known_radius=RadiusPrior(20.0))
    for low, high in (find_intervals(fit).centre_x, find_intervals(fit).centre_y):
        assert high - low < 0.5


def test_an_exactly_known_phi_is_its_own_interval(rng):
    phi = math.radians(FAR)
    low, high = find_interval(prior_fit(FAR, rng, known_phi=PhiPrior(phi)), "phi")
    assert high - low == pytest.approx(2 * 1.96e-6, rel=0.02)
    assert low <= phi <= high


@pytest.mark.parametrize(
    "known",
    [
        {"known_phi": PhiPrior(math.radians(FAR - 10), 0.02)},
        {"known_radius": RadiusPrior(20.0, 0.1)},
    ],
)
def test_a_narrow_interval_has_ends_where_a_prior_contradicts_the_points(known, rng):
    fit = prior_fit(FAR, rng, degrees=160.0, **known)
    (narrow_low, narrow_high), (low, high) = (find_intervals(fit, p).centre_y for p in (0.1, 0.5))
    assert low < narrow_low < fit.ellipse.centre[1] < narrow_high < high
    normal = chi2.ppf([0.1, 0.5], 1) ** 0.5
    assert (narrow_high - narrow_low) / (high - low) == pytest.approx(
        normal[0] / normal[1], rel=0.05
    )


def test_an_exactly_known_circle_has_any_theta_and_hardly_a_phi(rng):
    fit = prior_fit(CIRCLE, rng, known_phi=PhiPrior(0.0))
    found = find_intervals(fit)
    assert found.theta == (0.0, math.pi)
    assert found.phi[0] == 0
    assert found.phi[1] == pytest.approx(1.96e-3, rel=0.05)
    assert not is_theta_determined(fit)


def test_a_weakly_known_radius_is_still_determined_by_the_points(rng):
    """Its interval is the prior's only if the points hardly narrow it (`MAX_PRIOR_STD_RATIO`)."""
    free = prior_fit(FAR, rng)
    std = CylinderSection(free, Arc(0, 70), np.arange(70)).radius_std
    fit = prior_fit(FAR, rng, known_radius=RadiusPrior(19.0, std / 4))
    assert module._find_intervals_of_known_quantities(fit, 2.0) == {}
    surely = prior_fit(FAR, rng, known_radius=RadiusPrior(19.0, std / 40))
    low, high = module._find_intervals_of_known_quantities(surely, 2.0)["radius"]
    assert high - low == pytest.approx(4 * std / 40, rel=0.01)


@pytest.mark.parametrize("phi_deg", [NEAR, FAR])
def test_noise_free_points_have_hardly_a_width(phi_deg):
    fit = fit_ellipse(upper_arc(pipe(phi_deg)), pipe(phi_deg))
    for quantity in QUANTITIES:
        low, high = find_interval(fit, quantity)
        assert low <= value_of(pipe(phi_deg), quantity) <= high
        assert 1e-9 < high - low < 1e-5
    assert is_theta_determined(fit)


def test_theta_is_determined_by_two_intervals(rng):
    """A circle is excluded at 99.9 %, and an error of 23 deg at 95 %: sections near both limits."""
    arcs = ((12.0, 120.0), (28.0, 85.0), (33.0, 85.0), (3.5, 300.0))
    fits = [prior_fit(phi_deg, rng, degrees) for phi_deg, degrees in arcs for _ in range(20)]
    at_95, at_999 = (module.find_intervals_of_fits(fits, level) for level in (0.95, 0.999))
    seen = set()
    for fit, found, wide in zip(fits, at_95, at_999, strict=True):
        open_999 = wide.theta == (0.0, math.pi)
        low, high = found.theta
        off = max(high - fit.ellipse.theta, fit.ellipse.theta - low)
        if abs(off - math.radians(23)) < 0.01 or found.phi[1] == MAX_PHI:
            continue
        expected = not open_999 and off < math.radians(23)
        assert is_theta_determined(fit) == expected
        seen.add((open_999, off < math.radians(23)))
    print(seen)
    assert {(False, True), (False, False), (True, True)} <= seen


def test_far_from_a_circle_the_interval_is_that_of_the_covariance(rng):
    exact = upper_arc(pipe(FAR), count=400)
    fit = fit_ellipse(exact, pipe(FAR), SENSOR.covariances(exact) / 100)
    low, high = find_interval(fit, "centre_x", 0.95)
    std = math.sqrt(fit.parameter_covariance[0, 0])
    assert ((high - low) / 2) == pytest.approx(1.96 * std, rel=0.02)


def test_an_estimated_noise_has_wider_intervals_than_the_same_known(rng):
    """With few points Student's quantile is larger than that of the normal distribution."""
    truth, exact = pipe(FAR), upper_arc(pipe(FAR), count=11)
    fit = fit_ellipse(measured(exact, rng), truth)
    low, high = find_interval(fit, "centre_x", 0.95)
    assert high - low > 2 * 2.2 * math.sqrt(fit.parameter_covariance[0, 0])


def test_the_interval_of_a_circles_phi_reaches_zero(rng):
    lows = [find_interval(fit_of(CIRCLE, rng), "phi", 0.95)[0] for _ in range(15)]
    # 95 % of them should; 9 of 15 or fewer happens once in ten million.
    assert sum(low == 0 for low in lows) >= 10


@pytest.mark.parametrize("degrees", [180.0, 240.0, 360.0])
def test_the_interval_of_a_circles_radius_holds_it(degrees):
    """At a circle the radius m - h is at the tip of a cone: chi^2 alone gives 93, 90 and 86 %."""
    held = []
    for seed in range(300):
        rng = np.random.default_rng([12, seed])
        exact = upper_arc(pipe(CIRCLE), degrees=degrees * 119 / 120, count=120)
        points = exact + 0.05 * rng.normal(size=exact.shape)
        covariances = np.tile(ISOTROPIC, (len(points), 1, 1))
        low, high = find_interval(fit_ellipse(points, pipe(CIRCLE), covariances), "radius")
        held.append(low < 19.0 < high)
    assert np.mean(held) == pytest.approx(0.95, abs=0.035)


def test_where_a_circle_is_possible_the_radius_reaches_as_far_as_its_interval(rng):
    exact = upper_arc(pipe(CIRCLE), degrees=240.0, count=120)
    points = exact + 0.05 * rng.normal(size=exact.shape)
    covariances = np.tile(ISOTROPIC, (len(points), 1, 1))
    fit = fit_ellipse(points, pipe(CIRCLE), covariances)
    circle = fit_ellipse(points, pipe(CIRCLE), covariances, known_phi=PhiPrior(0.0))
    if find_interval(fit, "phi")[0] > 0:
        return  # in 5 % of the trials
    std = math.sqrt(circle.parameter_covariance[2, 2] / circle.variance_factor)
    for level in (0.68, 0.95, 0.999):
        sigmas = math.sqrt(chi2.ppf(level, 1) * fit.variance_factor)
        if find_interval(fit, "phi", level)[0] == 0:
            assert find_interval(fit, "radius", level)[1] > (
                circle.parameters[2] + 0.97 * sigmas * std
            )


@pytest.mark.parametrize("seed", [1302, 867, 360])
def test_the_critical_ratio_of_phi_is_updated_often_enough(seed, monkeypatch):
    """Arcs for which one update in each iteration ends at another phi."""
    rng = np.random.default_rng([13, seed])
    truth = pipe(rng.uniform(0, 45))
    points = measured(upper_arc(truth, rng.uniform(60, 160), int(rng.integers(30, 150))), rng)
    fits = [fit_ellipse(points, truth, SENSOR.covariances(points)) for _ in range(2)]
    found = find_interval(fits[0], "phi")
    monkeypatch.setattr("lsvision.ellipse.region_extrema.CRITICAL_UPDATES", 6)
    assert found == pytest.approx(find_interval(fits[1], "phi"), abs=1e-3)


def test_a_circle_may_have_any_theta(rng):
    fits = [fit_of(CIRCLE, rng) for _ in range(15)]
    assert sum(find_interval(fit, "theta") == (0.0, math.pi) for fit in fits) >= 10
    assert sum(is_theta_determined(fit) for fit in fits) <= 1


def test_an_exact_circle_has_no_theta_and_phi_from_zero():
    exact = upper_arc(pipe(CIRCLE))
    fit = fit_ellipse(exact, pipe(CIRCLE), SENSOR.covariances(exact))
    low, high = find_interval(fit, "phi")
    assert (low, find_interval(fit, "theta")) == (0.0, (0.0, math.pi))
    assert 0 < high < MAX_PHI
    assert not is_theta_determined(fit)


def test_a_tilted_pipe_is_no_circle_and_its_theta_is_bounded(rng):
    fit = fit_of(FAR, rng)
    low, high = find_interval(fit, "theta")
    assert is_theta_determined(fit)
    assert low <= fit.ellipse.theta <= high < low + math.pi / 2


def test_the_interval_of_theta_runs_through_the_seam(rng):
    truth = pipe(FAR, theta=0.0)
    points = measured(upper_arc(truth), rng)
    low, high = find_interval(
        fit_ellipse(points, truth, SENSOR.covariances(points)), "theta", 0.9999
    )
    assert (low < 0 < high) or (low < math.pi < high)


@pytest.mark.parametrize(
    ("quantity", "level", "message"),
    [
        (
            "diameter",
            0.95,
            "expected one of radius, theta, phi, centre_x, centre_y, got 'diameter'",
        ),
        ("radius", 0.0, "expected a level between 0 and 1, got 0"),
        ("radius", 1.0, "got 1"),
        ("phi", 95, "got 95"),
        ("phi", math.nan, "got nan"),
    ],
)
def test_what_is_no_quantity_or_level_is_rejected(quantity, level, message, rng):
    with pytest.raises(ValueError, match=message):
        find_interval(fit_of(FAR, rng), quantity, level)


def test_intervals_turn_with_nothing_and_give_the_same_twice(rng):
    fit = fit_of(NEAR, rng)
    before = fit.parameters.copy()
    assert find_interval(fit, "phi") == find_interval(fit, "phi")
    np.testing.assert_array_equal(fit.parameters, before)


@pytest.mark.parametrize("degrees", [80.0, 100.0])
def test_a_determined_theta_is_not_off_by_thirty_degrees(degrees, rng):
    """A short arc excludes a circle far more often than it determines the direction."""
    far = determined = 0
    for theta in rng.uniform(0, math.pi, SHORT_ARCS):
        truth = pipe(20.0, theta=theta)
        points = measured(upper_arc(truth, degrees, count=round(degrees / 2)), rng)
        fit = fit_ellipse(points, pipe(0.0), SENSOR.covariances(points))
        off = (fit.ellipse.theta - theta + math.pi / 2) % math.pi - math.pi / 2
        if is_theta_determined(fit):
            determined, far = determined + 1, far + (abs(off) > math.radians(30))
    print(f"{far} of {determined} off, at {degrees:.0f} deg")
    assert far <= 2 + 0.02 * determined


def test_a_variance_that_rounding_makes_negative_counts_as_zero(rng):
    """That of an exactly known radius; found by tests.fuzz."""
    fit = prior_fit(20.0, rng, known_radius=RadiusPrior(30.0))
    gradient = np.array([0.0, 0.0, 1.0, *(-fit.parameters[3:] / np.hypot(*fit.parameters[3:]))])
    negative = fit.unscaled_covariance - 1e-3 * np.outer(gradient, gradient)
    assert gradient @ negative @ gradient < 0
    low, high = find_interval(replace(fit, unscaled_covariance=negative), "radius")
    assert low <= high


@pytest.mark.parametrize("tilt", [0.0, 0.05])
def test_the_centre_beside_a_known_radius_is_held_also_where_any_tilt_lowers_it(tilt):
    """With c of one quantity, 81 % of the intervals of an untilted pipe hold."""
    rng = np.random.default_rng(4)
    fits = []
    for _ in range(250):
        truth = Ellipse((0.0, -300.0), 20 / math.cos(tilt), 20.0, rng.uniform(0, math.pi))
        arc = truth.points_at(np.linspace(0.5, math.pi - 0.5, 90) - truth.theta)
        arc[:, 1] += 0.1 * rng.normal(size=90)
        noise = np.tile(np.diag([1e-6, 0.01]), (90, 1, 1))
        fits.append(fit_ellipse(arc, truth, noise, known_radius=RadiusPrior(20.0)))
    ends = [each.centre_y for each in module.find_intervals_of_fits(fits)]
    held = np.mean([low <= -300 <= high for low, high in ends])
    print(f"{held:.1%} hold")
    assert 0.93 - spread_of_share(0.93, 250) <= held <= 0.99


@pytest.mark.parametrize(
    ("tilt", "low", "high"), [(1e-3, -0.1623, 0.02557), (0.1, -0.1068, 0.0395)]
)
def test_the_ends_of_the_centre_beside_a_known_radius(tilt, low, high):
    """They move by 1.3 % where c is taken for another fraction of |d|, by a third."""
    truth = Ellipse((0.0, -300.0), 20 / math.cos(tilt), 20.0, 0.3)
    arc = truth.points_at(np.linspace(0.5, math.pi - 0.5, 90) - 0.3)
    noise = np.tile(np.diag([1e-6, 0.01]), (90, 1, 1))
    ends = find_interval(fit_ellipse(arc, truth, noise, known_radius=RadiusPrior(20.0)), "centre_y")
    assert ends[0] + 300 == pytest.approx(low, rel=0.006)
    assert ends[1] + 300 == pytest.approx(high, rel=0.006)


@pytest.mark.parametrize("std", [0.0, 0.5])
@pytest.mark.parametrize("points", [[(0, 0), (1, 0.05)], [(1e-9 * x, 0) for x in range(12)]])
def test_a_known_radius_beside_points_at_one_or_two_positions_has_wide_intervals(points, std):
    points = np.repeat(np.array(points, dtype=float), 12 // len(points), axis=0)
    noise = np.tile(0.01 * np.eye(2), (12, 1, 1))
    guess = Ellipse((0.0, -20.0), 20.0, 20.0, 0.0)
    fit = fit_ellipse(points, guess, noise, known_radius=RadiusPrior(20.0, std))
    for quantity in ("centre_x", "centre_y"):
        low, high = find_interval(fit, quantity)
        assert high - low > 100
