import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from scipy.optimize import approx_fprime, brentq, least_squares

from lsvision import Ellipse, Profile, measure_cylinders
from lsvision.ellipse import parameters as module
from lsvision.ellipse.fit import FittingSettings, fit_ellipse
from lsvision.ellipse.outcomes import unwrap
from lsvision.ellipse.parameters import (
    add_step_on_cone,
    compute_semi_minor,
    ellipse_from_parameters,
    orthogonal_residuals_and_normals,
    parameters_from_ellipse,
    radial_residuals_and_normals,
    semi_major_gradient,
    semi_minor_gradient,
)
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import EllipseProblem, RadiusPrior, Solution, minimise
from lsvision.errors import FitFailed, TooFewPoints
from lsvision.geometry import orthogonal_residuals, radial_residuals
from lsvision.geometry.noisy_points import as_complex
from lsvision.simulate import random_section
from tests.alike import assert_same_ellipse
from tests.bench.core.scenes import make_scene
from tests.ellipse.arcs import about, measured, pipe, residuals_and_jacobian, upper_arc
from tests.strategies import PROPERTY, ellipses
from tests.tolerances import BRUTE_FORCE, DIFFERENCES, MACHINE, PUBLISHED

GANDER = Path(__file__).parents[2] / "../shared/real/gander1994/gander1994.json"
PRIOR = RadiusPrior(19.0, 0.1)


def solved(problem, start, **options):
    """Solution of a problem alone."""
    (outcome,) = minimise([problem], parameters_from_ellipse(start)[None], **options)
    return unwrap(outcome)


def residuals(problem, parameters):
    return residuals_and_jacobian(problem, parameters)[0]


def problem_of(points, residual="orthogonal", prior=None):
    return EllipseProblem(points, np.linspace(0.5, 2.0, len(points)), prior, residual)


@pytest.mark.parametrize("phi_deg", [0.0, 0.01, 10.0, 60.0], ids=lambda phi: f"phi {phi}")
@pytest.mark.parametrize("residual", ["orthogonal", "radial"])
def test_the_jacobian_is_the_derivative(residual, phi_deg, rng):
    points = upper_arc(pipe(phi_deg)) + 0.3 * rng.normal(size=(70, 2))
    prior = PRIOR if phi_deg > 1 else None  # at a circle b has no derivative, the rest has
    problem, at = problem_of(points, residual, prior), parameters_from_ellipse(pipe(phi_deg))
    step = 1e-5
    differences = np.column_stack([
        (residuals(problem, at + step * unit) - residuals(problem, at - step * unit)) / (2 * step)
        for unit in np.eye(5)
    ])  # fmt: skip
    scale, (_, jacobian) = np.abs(differences).max(), residuals_and_jacobian(problem, at)
    np.testing.assert_allclose(jacobian, differences, atol=DIFFERENCES * scale)


def test_an_exact_radius_counts_as_a_prior_of_a_millionth():
    assert RadiusPrior(20.0).effective_std == pytest.approx(2e-5)
    assert RadiusPrior(20.0, 0.5).effective_std == 0.5


@pytest.mark.parametrize(
    ("compare", "residuals"),
    [
        (orthogonal_residuals_and_normals, orthogonal_residuals),
        (radial_residuals_and_normals, radial_residuals),
    ],
    ids=["orthogonal", "radial"],
)
def test_the_comparison_gives_the_residuals_of_shapes(compare, residuals, rng):
    points = upper_arc(pipe(40.0)) + rng.normal(size=(70, 2))
    (signed,), _, w = compare(as_complex(points)[None], parameters_from_ellipse(pipe(40.0))[None])
    np.testing.assert_allclose(signed, residuals(points, pipe(40.0)), atol=MACHINE)
    np.testing.assert_allclose(np.abs(w), 1, atol=MACHINE)


@PROPERTY
@given(ellipses(phi_deg=(0.0, 80.0)))
def test_the_comparison_finds_nearest_points_wherever_the_points_are(ellipse):
    rng = np.random.default_rng(0)
    points = ellipse.points_at(rng.uniform(0, 2 * math.pi, 40))
    points = ellipse.centre + rng.uniform(0.05, 3.0, (40, 1)) * (points - ellipse.centre)
    at = as_complex(points)[None], parameters_from_ellipse(ellipse)[None]
    (signed,), normals, w = orthogonal_residuals_and_normals(*at)
    around = ellipse.points_at(np.linspace(0, 2 * math.pi, 20_000))
    brute = [np.hypot(*(around - point).T).min() for point in points]
    np.testing.assert_allclose(np.abs(signed), brute, atol=1e-4 * ellipse.semi_major)
    np.testing.assert_allclose(np.abs(normals), 1, atol=MACHINE)
    np.testing.assert_allclose(np.abs(w), 1, atol=MACHINE)


@PROPERTY
@given(ellipses(phi_deg=(0.0, 80.0)))
def test_an_ellipse_comes_back_from_its_parameters(ellipse):
    parameters = parameters_from_ellipse(ellipse)
    assert_same_ellipse(ellipse_from_parameters(parameters), ellipse, atol=MACHINE)
    assert compute_semi_minor(parameters) == pytest.approx(ellipse.semi_minor, rel=MACHINE)


@pytest.mark.parametrize("phi_deg", [1.0, 30.0])
def test_the_gradients_of_the_semi_axes_are_derivatives(phi_deg):
    at = parameters_from_ellipse(pipe(phi_deg))
    minor = approx_fprime(at, lambda p: ellipse_from_parameters(p).semi_minor, 1e-7)
    major = approx_fprime(at, lambda p: ellipse_from_parameters(p).semi_major, 1e-7)
    np.testing.assert_allclose(semi_minor_gradient(at), minor, atol=1e-4)
    np.testing.assert_allclose(semi_major_gradient(at), major, atol=1e-4)


def orthogonal_oracle(points, start):
    """Return the best ellipse with an anomaly for each point as a parameter."""

    def gaps(free):
        x, y, a, b, theta = free[:5]
        cos, sin, t = math.cos(theta), math.sin(theta), free[5:]
        u, v = a * np.cos(t), b * np.sin(t)
        return np.concatenate([points[:, 0] - x - u * cos + v * sin,
                               points[:, 1] - y - u * sin - v * cos])  # fmt: skip

    own = start.to_ellipse_frame(points)
    t = np.arctan2(own[:, 1] / start.semi_minor, own[:, 0] / start.semi_major)
    axes = (*start.centre, start.semi_major, start.semi_minor, start.theta)
    x, y, a, b, theta = least_squares(gaps, [*axes, *t], xtol=1e-12, ftol=1e-14).x[:5]
    return Ellipse.from_axes((x, y), a, b, theta)


def radial_oracle(points, start):
    """Return the minimum of the paper's J, Eq. (4) with theta along a, by numeric derivatives."""

    def residuals(free):
        x, y, a, b, theta = free
        rho, turn = np.hypot(*(points - (x, y)).T), np.arctan2(points[:, 1] - y, points[:, 0] - x)
        return rho - a * b / np.hypot(b * np.cos(turn - theta), a * np.sin(turn - theta))

    axes = (*start.centre, start.semi_major, start.semi_minor, start.theta)
    found = least_squares(residuals, axes, jac="3-point", xtol=1e-13, ftol=1e-15, gtol=1e-13)
    x, y, a, b, theta = found.x
    return Ellipse.from_axes((x, y), a, b, theta)


@pytest.mark.parametrize(
    ("residual", "oracle"),
    [("orthogonal", orthogonal_oracle), ("radial", radial_oracle)],
    ids=["orthogonal", "radial"],
)
def test_the_minimum_is_that_of_brute_force(residual, oracle, rng):
    truth = pipe(35.0)
    points = upper_arc(truth, degrees=200, count=30) + 0.05 * rng.normal(size=(30, 2))
    found = fit_ellipse(points, about(truth), settings=FittingSettings(residual=residual)).ellipse
    assert_same_ellipse(found, oracle(points, truth), atol=10 * BRUTE_FORCE)


def test_gander_golub_and_strebels_ellipse_comes_out_to_their_four_decimals():
    if not GANDER.exists():
        pytest.skip("../shared/real is not here")
    data = json.loads(GANDER.read_text())
    published = data["ellipse_geometric_best_fit_published_4dp"]
    truth = Ellipse(tuple(published["center"]), published["a"], published["b"],
                    published["alpha_rad"])  # fmt: skip
    points = np.array(data["ellipse_points"], dtype=float)
    found = fit_ellipse(points, Ellipse((4.84, 4.98), 4.3, 3.3, 0.6)).ellipse
    np.testing.assert_allclose(found.centre, truth.centre, atol=PUBLISHED)
    assert found.semi_major == pytest.approx(truth.semi_major, abs=PUBLISHED)
    assert found.semi_minor == pytest.approx(truth.semi_minor, abs=PUBLISHED)
    assert found.theta == pytest.approx(truth.theta, abs=PUBLISHED)


def test_a_prior_pulls_the_radius_by_its_weight(rng):
    """With one prior the minimum is where the gradients of data and prior cancel."""
    truth = pipe(25.0)
    points = measured(upper_arc(truth), rng)
    problem = problem_of(points, prior=RadiusPrior(truth.radius + 0.5, 0.05))
    found = solved(problem, truth)
    residuals, jacobian = residuals_and_jacobian(problem, found.parameters)
    cancel = jacobian.T @ residuals / np.linalg.norm(jacobian, axis=0)
    np.testing.assert_allclose(cancel, 0, atol=1e3 * DIFFERENCES)
    assert residuals[-1] < 0
    information = jacobian.T @ jacobian
    scale = np.abs(information).max()
    np.testing.assert_allclose(found.information, information, atol=1e-6 * scale)


@pytest.mark.parametrize("residual", ["orthogonal", "radial"])
def test_residuals_and_jacobian_have_a_row_more_with_a_prior(residual):
    points, at = upper_arc(pipe(20.0), count=9), parameters_from_ellipse(pipe(20.0))
    without = residuals_and_jacobian(problem_of(points, residual), at)
    assert [part.shape for part in without] == [(9,), (9, 5)]
    with_prior = residuals_and_jacobian(problem_of(points, residual, PRIOR), at)
    assert [part.shape for part in with_prior] == [(10,), (10, 5)]


def mixed_problems(rng):
    """Return problems of many sizes and priors, one too small, one with an outlier; and guesses."""
    priors = [
        (None, None), (RadiusPrior(12.0), None), (None, PhiPrior(0.0)),
        (RadiusPrior(14.0, 0.1), PhiPrior(0.5, 0.02)), (None, PhiPrior(0.6)),
    ]  # fmt: skip
    problems, guesses = [], []
    for i, (radius, phi) in enumerate(2 * priors):
        truth = pipe(3.0 + 5 * i, radius=10.0 + 2 * i, theta=0.3 * i)
        points = measured(upper_arc(truth, 80.0 + 12 * i, 20 + 17 * i), rng)
        stds = np.full(len(points), 0.05)
        problems.append(EllipseProblem(points, stds, radius, "orthogonal", phi))
        guesses.append(about(truth))
    problems[3].points[5] += (4.0, 30.0)
    problems.append(problem_of(upper_arc(pipe(20.0))[:3]))
    guesses.append(pipe(20.0))
    return problems, np.array([parameters_from_ellipse(guess) for guess in guesses])


@pytest.mark.parametrize("order", ["as they are", "reverse"])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-10])
def test_problems_in_a_stack_have_the_solutions_of_each_alone(order, tolerance, rng):
    problems, guesses = mixed_problems(rng)
    if order == "reverse":
        problems, guesses = problems[::-1], guesses[::-1]
    options = {"max_evaluations": 20, "tolerance": tolerance}
    found = minimise(problems, guesses, **options)
    for together, problem, guess in zip(found, problems, guesses, strict=True):
        (alone,) = minimise([problem], guess[None], **options)
        if not isinstance(alone, Solution):
            assert isinstance(together, TooFewPoints)
            continue
        assert together.converged == alone.converged
        if alone.converged:
            for name in ("parameters", "residuals", "information"):
                wanted = getattr(alone, name)
                scale = np.abs(wanted).max()
                np.testing.assert_allclose(
                    getattr(together, name), wanted, rtol=1e-9, atol=1e-9 * scale
                )


@pytest.mark.parametrize("residual", ["orthogonal", "radial"])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-10])
def test_the_iteration_ends_near_the_minimum_of_minpack(residual, tolerance, rng):
    truth = pipe(30.0)
    points = measured(upper_arc(truth), rng)
    problem = EllipseProblem(points, np.full(len(points), 0.05), PRIOR, residual)
    start = parameters_from_ellipse(about(truth))
    best = least_squares(
        lambda at: residuals(problem, at), start, method="lm", xtol=1e-14, ftol=1e-14
    )
    found = solved(problem, about(truth), tolerance=tolerance)
    assert found.converged
    stds = np.sqrt(np.diag(np.linalg.inv(found.information)))
    np.testing.assert_array_less(np.abs(found.parameters - best.x) / stds, 10 * tolerance**0.5)


def test_residuals_after_the_last_step_are_those_at_the_solution(rng):
    """The last step has no evaluation: residuals are extrapolated to first order."""
    truth = pipe(30.0)
    points = measured(upper_arc(truth), rng)
    problem = EllipseProblem(points, np.full(len(points), 0.05), None, "orthogonal")
    found = solved(problem, truth, tolerance=1e-3)
    wanted = residuals(problem, found.parameters)
    np.testing.assert_allclose(found.residuals, wanted, atol=1e-3)


@pytest.mark.parametrize("points_std", [1e-6, 0.05, 10.0])
@pytest.mark.parametrize("phi", [None, PhiPrior(math.radians(30.0))], ids=["", "and phi"])
def test_an_exactly_known_radius_is_kept_whatever_the_weight_of_the_points(points_std, phi, rng):
    truth = pipe(30.0)
    points = measured(upper_arc(truth), rng)
    known = RadiusPrior(19.2)
    problem = EllipseProblem(points, np.full(len(points), points_std), known, "orthogonal", phi)
    found = solved(problem, about(truth), tolerance=1e-3)
    assert found.converged
    radius = ellipse_from_parameters(found.parameters).radius
    if points_std > 1e-3:
        assert radius == pytest.approx(19.2, abs=5 * known.effective_std)
        if phi is not None:
            assert ellipse_from_parameters(found.parameters).phi == pytest.approx(phi.phi, abs=1e-5)


def test_too_few_evaluations_are_reported():
    points = upper_arc(pipe(30.0)) + 0.05 * np.sin(np.arange(140)).reshape(70, 2)
    problem = problem_of(points)
    assert not solved(problem, about(pipe(30.0)), max_evaluations=3).converged
    found = solved(problem, about(pipe(30.0)))
    assert found.converged
    assert 3 < found.evaluations < 20


def test_a_start_without_finite_residuals_has_failed():
    problem = problem_of(upper_arc(pipe(20.0)))
    (outcome,) = minimise([problem], np.full((1, 5), math.nan))
    assert isinstance(outcome, FitFailed)


@pytest.mark.parametrize("count", [0, 1, 4])
def test_too_few_rows_are_rejected(count):
    problem = problem_of(upper_arc(pipe(20.0))[:count])
    with pytest.raises(TooFewPoints, match=f"an arc has {count} points? and needs 5: scan slower"):
        solved(problem, pipe(20.0))


@pytest.mark.parametrize(
    "parameters",
    [(0, 0, math.nan, 0, 0), (0, 0, 5, 5, 0), (math.inf, 0, 5, 1, 0)],
    ids=["nan", "flat", "endless"],
)
def test_parameters_without_an_ellipse_are_rejected(parameters):
    with pytest.raises(FitFailed, match="the points have no ellipse"):
        ellipse_from_parameters(np.array(parameters, dtype=float))


@pytest.mark.parametrize(
    ("radius", "std", "message"),
    [
        (0.0, 0.0, "positive known radius in mm, got 0"),
        (-19.0, 0.1, "got -19"),
        (math.nan, 0.1, "got nan"),
        (19.0, -0.1, "std >= 0 mm, got -0.1"),
        (19.0, math.inf, "got inf"),
    ],
)
def test_what_is_no_radius_is_rejected(radius, std, message):
    with pytest.raises(ValueError, match=message):
        RadiusPrior(radius, std)


@pytest.mark.parametrize(("longest", "calls"), [(0.12, 0), (0.185, 0), (0.215, 1), (0.3, 1)])
def test_after_a_large_newton_step_the_nearest_points_are_found_in_closed_form(
    longest, calls, monkeypatch
):
    """The limit is a Newton step of 0.2 rad, here from differences of the squared distance."""
    a, b, found = 30.0, 19.0, []
    closed_form = module._find_nearest_directions
    monkeypatch.setattr(
        module, "_find_nearest_directions", lambda *args: found.append(1) or closed_form(*args)
    )

    def step(factor):
        x, y = factor * np.array([a * math.cos(0.8), b * math.sin(0.8)])
        squared = lambda t: ((x - a * math.cos(t)) ** 2 + (y - b * math.sin(t)) ** 2) / 2  # noqa: E731
        low, at, high = (squared(0.8 + shift) for shift in (-1e-4, 0.0, 1e-4))
        return abs((high - low) / 2e-4 / ((high - 2 * at + low) / 1e-8))

    factor = brentq(lambda f: step(f) - longest, 1.0, 8.0)
    point = factor * np.array([[a * math.cos(0.8), b * math.sin(0.8)]])
    ellipse = Ellipse.from_axes((0.0, 0.0), a, b, 0.0)
    near = as_complex(ellipse.points_at(np.array([0.8]))) + 1e-3
    rows = np.array([as_complex(point), near, near])
    at = np.tile(parameters_from_ellipse(ellipse), (3, 1))
    (signed, *others), _, _ = orthogonal_residuals_and_normals(rows, at)
    assert len(found) == calls  # of the one point, not of its neighbours in the stack
    (alone,), _, _ = orthogonal_residuals_and_normals(near[None], at[:1])
    np.testing.assert_array_equal(others, [alone, alone])
    np.testing.assert_allclose(signed, orthogonal_residuals(point, ellipse), atol=1e-6)


@pytest.mark.parametrize("seed", [700_044, 700_373])
@pytest.mark.parametrize("given", [True, False])
def test_an_exactly_known_radius_is_no_narrow_valley_for_the_fit(seed, given):
    section = random_section("single", seed)
    (tube,) = section.truth.tubes
    profile, sensor = Profile(section.profile.points), section.sensor if given else None
    (found,) = measure_cylinders(profile, sensor=sensor, known_radius=tube.radius).cylinders
    assert found.fit.converged
    problem, parameters = found.fit.problem, found.fit.parameters
    (best,) = minimise([problem], parameters[None], 2000, 1e-13)
    costs = [np.square(residuals(problem, each)).sum() for each in (parameters, best.parameters)]
    assert costs[0] - costs[1] < 0.02


def test_a_roughly_known_radius_does_not_stop_the_fit_at_a_circle():
    scene = make_scene("D", 12, 5_550_123)
    radius = scene.tubes[0].radius
    (found,) = measure_cylinders(
        scene.points, known_radius=(1.01 * radius, 0.01 * radius)
    ).cylinders
    assert found.fit.converged
    assert found.phi > 0.05


def test_a_step_on_the_cone_changes_b_by_its_gradient(rng):
    for _ in range(20):
        parameters = np.array([3.0, -400.0, 20.0, *rng.normal(0, 2, 2)])
        step = rng.normal(0, 1, 5)
        moved = add_step_on_cone(parameters, step)
        change = compute_semi_minor(moved) - compute_semi_minor(parameters)
        assert change == pytest.approx(semi_minor_gradient(parameters) @ step, abs=1e-12)
        np.testing.assert_allclose(np.delete(moved - parameters - step, 2), 0, atol=1e-12)


@pytest.mark.parametrize(("min_axis_ratio", "converged"), [(0.0, True), (0.15, True), (0.3, False)])
def test_the_iteration_ends_at_an_ellipse_that_is_too_flat(min_axis_ratio, converged):
    """The best ellipse of a wedge has an axis ratio of 0.19; an earlier one has 0.26."""
    x = np.linspace(-10, 10, 60)
    y = -300 - 0.3 * np.abs(x) + 0.02 * np.random.default_rng(1).normal(size=60)
    problem = EllipseProblem(np.column_stack([x, y]), np.full(60, 0.02), None, "orthogonal")
    guess = np.array([[0.0, -312.0, 12.0, 1.0, 0.0]])
    (solution,) = minimise([problem], guess, 100, 1e-3, min_axis_ratio)
    m, h = solution.parameters[2], math.hypot(*solution.parameters[3:])
    assert solution.converged is converged
    assert (m - h) / (m + h) < 0.3
    assert bool((m - h) / (m + h) < 0.2) is converged
