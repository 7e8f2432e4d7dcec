import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import approx_fprime, minimize_scalar

from lsvision.ellipse.cost_expansion import _find_nearest_points, expand_cost
from lsvision.ellipse.fit import FittingSettings, fit_ellipse
from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.parameters import FOOT_TOLERANCE, parameters_from_ellipse
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import RadiusPrior
from tests.ellipse.arcs import SENSOR, measured, pipe, residuals_and_jacobian, upper_arc

SHIFT = np.array([0.03, -0.02, 0.04, 0.03, -0.05])  # mm: a few sigmas
STEP = 1e-4  # mm: of central differences
PRIORS = {
    "none": {},
    "radius": {"known_radius": RadiusPrior(19.05, 0.02)},
    "phi of a circle": {"known_phi": PhiPrior(math.radians(2), math.radians(3))},
    "phi": {"known_phi": PhiPrior(math.radians(24), math.radians(0.2))},
    "both": {
        "known_radius": RadiusPrior(19.05, 0.02),
        "known_phi": PhiPrior(math.radians(24), math.radians(0.2)),
    },
}


@pytest.fixture(params=PRIORS)
def fit(request, rng):
    truth = pipe(4.0 if "circle" in request.param else 25.0)
    points = measured(upper_arc(truth), rng)
    free = fit_ellipse(points, truth, SENSOR.covariances(points))
    problem = replace(free.problem, **PRIORS[request.param])
    return replace(free, problem=problem, variance_factor=1.7)


def expand_rows(fit, rows):
    return expand_cost(FitStack.of([fit]), np.zeros(len(rows), dtype=int), rows)


def cost(fit, parameters):
    residuals, _ = residuals_and_jacobian(fit.problem, parameters)
    return float(residuals @ residuals) / fit.variance_factor


def gradient(fit, parameters):
    residuals, jacobian = residuals_and_jacobian(fit.problem, parameters)
    return jacobian.T @ residuals / fit.variance_factor


def rows_about(fit):
    return np.array([fit.parameters, fit.parameters + SHIFT, fit.parameters - 2 * SHIFT])


def test_cost_and_gradient_are_those_of_the_problem(fit):
    rows = rows_about(fit)
    expansion = expand_rows(fit, rows)
    sigmas = np.sqrt(np.diagonal(expansion.covariance, axis1=1, axis2=2))
    for k, row in enumerate(rows):
        assert expansion.cost[k] == pytest.approx(cost(fit, row), rel=1e-5)
        differences = [
            (cost(fit, row + STEP * axis) - cost(fit, row - STEP * axis)) / (4 * STEP)
            for axis in np.eye(5)
        ]
        gaps = (expansion.gradient[k] - differences) * sigmas[k]
        np.testing.assert_allclose(gaps, 0, atol=5e-3)  # sigmas: feet are found to 1e-4 rad


def test_the_information_is_the_derivative_of_the_gradient(fit):
    rows = rows_about(fit)
    expansion = expand_rows(fit, rows)
    for k, row in enumerate(rows):
        differences = approx_fprime(row, lambda x: gradient(fit, x), STEP)
        sigmas = np.sqrt(np.diag(expansion.covariance[k]))
        gaps = (expansion.information[k] - (differences + differences.T) / 2) * np.outer(
            sigmas, sigmas
        )
        np.testing.assert_allclose(gaps, 0, atol=0.02)  # of one
        np.testing.assert_allclose(
            expansion.covariance[k] @ expansion.information[k], np.eye(5), atol=1e-6
        )


def test_what_is_of_the_points_is_without_the_priors(fit):
    bare = replace(fit, problem=replace(fit.problem, known_radius=None, known_phi=None))
    rows = rows_about(fit)
    of_points, alone = expand_rows(fit, rows), expand_rows(bare, rows)
    np.testing.assert_allclose(of_points.cost_of_points, alone.cost)
    np.testing.assert_allclose(of_points.gradient_of_points, alone.gradient)
    np.testing.assert_allclose(of_points.information_of_points, alone.information, rtol=1e-6)


def test_radial_residuals_have_the_gauss_newton_information(rng):
    truth = pipe(25.0)
    points = measured(upper_arc(truth), rng)
    fit = fit_ellipse(points, truth, settings=FittingSettings(residual="radial"))
    row = fit.parameters + SHIFT
    expansion = expand_rows(fit, row[None])
    residuals, jacobian = residuals_and_jacobian(fit.problem, row)
    factor = fit.variance_factor
    assert expansion.cost[0] == pytest.approx(residuals @ residuals / factor)
    np.testing.assert_allclose(expansion.information[0], jacobian.T @ jacobian / factor, rtol=1e-9)


def test_where_the_cost_bends_downwards_the_information_stays_positive(fit):
    far = fit.parameters + np.array([[0, 6, 0, 0, 0], [0, 0, 9, 0, 0], [0, -9, -6, 0, 0]])
    expansion = expand_rows(fit, far)
    assert (np.linalg.eigvalsh(expansion.information) > 0).all()


def test_parameters_that_are_no_numbers_cost_without_limit(fit):
    with np.errstate(all="ignore"):
        expansion = expand_rows(fit, np.array([fit.parameters, np.full(5, np.nan)]))
    assert np.isfinite(expansion.cost[0])
    assert expansion.cost[1] == expansion.cost_of_points[1] == np.inf


def test_nearest_points_are_exact_where_all_first_steps_are_large():
    """Points far from a flat ellipse: the distances are those of a search along the ellipse."""
    a, b, angles = 30.0, 11.0, np.radians([25.0, 40.0, 60.0, 75.0])
    z = 1.3 * (a * np.cos(angles) + 1j * b * np.sin(angles))
    parameters = np.array([[0.0, 0.0, (a + b) / 2, (a - b) / 2, 0.0]])
    distances, _, _, w = _find_nearest_points(z[None], parameters)
    first = np.angle((a + b) / 2 * z - (a - b) / 2 * z.conj())
    assert (np.abs(np.angle(w[0]) - first) > 10 * FOOT_TOLERANCE).all()
    for point, found in zip(z, distances[0], strict=True):
        search = minimize_scalar(
            lambda t, point=point: abs(a * math.cos(t) + 1j * b * math.sin(t) - point),
            bounds=(0, math.pi / 2), method="bounded", options={"xatol": 1e-9},
        )  # fmt: skip
        assert found == pytest.approx(search.fun, rel=1e-9)


def test_the_second_derivative_of_residuals_is_that_of_differences():
    """Of a flat ellipse with errors of one sign: sum r Hess r, which is added to J'J."""
    truth = pipe(62.0)
    exact = upper_arc(truth, degrees=320.0, count=200)
    angle = np.linspace(0, 1, len(exact))
    out = exact - np.array(truth.centre)
    points = exact + 0.05 * angle[:, None] * out / np.linalg.norm(out, axis=1)[:, None]
    fit = replace(
        fit_ellipse(points, truth, SENSOR.covariances(points)),
        parameters=parameters_from_ellipse(truth),
    )
    (information,) = expand_rows(fit, fit.parameters[None]).information
    differences = approx_fprime(fit.parameters, lambda x: gradient(fit, x), STEP)
    _, jacobian = residuals_and_jacobian(fit.problem, fit.parameters)
    gauss_newton = jacobian.T @ jacobian / fit.variance_factor
    expected = (differences + differences.T) / 2 - gauss_newton
    found = information - gauss_newton
    print(found.round(1), expected.round(1), sep="\n")
    for row, expected_row in zip(found, expected, strict=True):
        np.testing.assert_allclose(row, expected_row, atol=0.03 * np.abs(expected_row).max())
