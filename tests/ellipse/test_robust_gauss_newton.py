import math

import numpy as np
import numpy.testing as npt
import pytest
from scipy.optimize import approx_fprime, minimize

from lsvision.ellipse.parameters import ellipse_from_parameters, parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import (
    EllipseResiduals,
    WeightedSystem,
    add_flattening_prior,
    ellipse_residuals,
    ray_normal_variances,
    solve_damped_step,
    solve_positive_definite,
    take_gauss_newton_step,
)
from lsvision.geometry import Ellipse, orthogonal_residuals
from lsvision.geometry.noisy_points import NoisyPoints, as_complex
from tests.alike import assert_same_ellipse
from tests.ellipse.arcs import (
    SENSOR,
    about,
    measured,
    parameter_stds,
    pipe,
    refine_ellipse,
    upper_arc,
)
from tests.tolerances import DIFFERENCES, ROUNDING

TRUTH = pipe(25.0)
PARAMETERS = parameters_from_ellipse(TRUTH)


def noisy(points):
    return NoisyPoints.of(points, SENSOR.covariances(points))


def compared_with(residuals, variances):
    normals = as_complex(upper_arc(TRUTH, count=len(residuals)) - TRUTH.centre)
    normals /= np.abs(normals)
    return EllipseResiduals(residuals, normals, normals, variances, variances)


def distances(values, points):
    """Return the distances of points from the ellipse of these parameters."""
    x, y, m, p, q = values
    h = math.hypot(p, q)
    return orthogonal_residuals(points, Ellipse((x, y), m + h, m - h, math.atan2(q, p) / 2))


def test_residuals_are_distances_to_second_order():
    points = upper_arc(TRUTH)
    outwards = points - TRUTH.centre
    outwards /= np.hypot(*outwards.T)[:, None]
    for off in (0.2, 0.02):
        found = ellipse_residuals(noisy(points + off * outwards), PARAMETERS).residuals
        wanted = orthogonal_residuals(points + off * outwards, TRUTH)
        assert np.abs(found - wanted).max() < 0.02 * off**2


def test_the_jacobian_is_the_derivative_of_the_distances():
    points = upper_arc(TRUTH)[5]
    compared = ellipse_residuals(noisy(points[None]), PARAMETERS)
    rows = WeightedSystem.of(compared, 1.0).rows[:5]
    slope = approx_fprime(PARAMETERS, lambda values: distances(values, points[None])[0], 1e-6)
    np.testing.assert_allclose(-rows[:, 0], slope, atol=20 * DIFFERENCES)


def test_variances_are_those_along_the_normal_by_matrices():
    points = upper_arc(TRUTH)
    compared = ellipse_residuals(noisy(points), PARAMETERS)
    n = np.column_stack([compared.normals.real, compared.normals.imag])
    wanted = np.einsum("ni,nij,nj->n", n, SENSOR.covariances(points), n)
    np.testing.assert_allclose(compared.variances, wanted, rtol=1e-9)


def test_a_normal_across_the_ray_is_held_to_be_13_deg_off():
    """There the error has no part along the normal at all."""
    flank = np.array([[20.0, 0.0]])
    along_y = np.array([[[0.0, 0.0], [0.0, 0.05**2]]])
    compared = ellipse_residuals(
        NoisyPoints.of(flank, along_y), np.array([0.0, 0.0, 20.0, 0.0, 0.0])
    )
    assert compared.variances[0] == pytest.approx(0, abs=1e-15)
    std = math.sqrt(compared.inflated_variances[0]) / 0.05
    assert math.degrees(math.asin(std)) == pytest.approx(13, abs=0.5)


def test_points_three_sigma_off_have_half_the_weight():
    variances = np.full(3, 0.05**2)
    compared = compared_with(0.05 * np.array([0.0, 3.0, -3.0]), variances)
    weights = WeightedSystem.of(compared, 1.0).weights
    np.testing.assert_allclose(weights / weights[0], [1.0, 0.5, 0.5], rtol=ROUNDING)
    assert weights[0] == pytest.approx(400)


def test_a_variance_factor_scales_the_noise_not_the_residuals():
    compared = compared_with(np.array([0.0, 0.3]), np.full(2, 0.05**2))
    weights = WeightedSystem.of(compared, 4.0).weights
    np.testing.assert_allclose(weights, [100.0, 50.0], rtol=ROUNDING)


def test_normal_equations_of_parts_add_up_to_those_of_all(rng):
    system = WeightedSystem.of(
        ellipse_residuals(noisy(measured(upper_arc(TRUTH), rng)), PARAMETERS), 1.0
    )
    begins = np.arange(len(system.weights)) < 30
    first, second = (system.build_normal_equations(part) for part in (begins, ~begins))
    both, whole = first + second, system.build_normal_equations()
    design = np.sqrt(system.weights)[:, None] * system.rows[:5].T
    np.testing.assert_allclose(both, whole, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(whole[:, :5], design.T @ design, rtol=1e-9, atol=1e-6)
    step, *_ = np.linalg.lstsq(design, np.sqrt(system.weights) * system.rows[5], rcond=None)
    np.testing.assert_allclose(np.linalg.solve(both[:, :5], both[:, 5]), step, rtol=1e-6)


def test_before_the_data_speak_a_tilt_of_57_deg_is_one_sigma():
    held = np.zeros((5, 6))
    add_flattening_prior(held, PARAMETERS)
    h = 1 / math.sqrt(held[3, 3])
    a, b = PARAMETERS[2] + h, PARAMETERS[2] - h
    assert math.degrees(math.acos(b / a)) == pytest.approx(57, abs=1)
    assert held[4, 4] == held[3, 3]
    # The prior pulls (p, q) to the circle.
    np.testing.assert_allclose(held[3:, 5], -PARAMETERS[3:] / h**2, rtol=ROUNDING)
    np.testing.assert_array_equal(held[:3], 0)


def test_a_step_of_a_tenth_of_the_ellipse_costs_as_much_as_one_sigma(rng):
    """Damped least squares written out as a cost, and minimised without derivatives' formulas."""
    design, size = rng.normal(size=(3, 5)) * 0.1, float(PARAMETERS[2])
    misfit = rng.normal(size=3)
    equations = np.column_stack([design.T @ design, design.T @ misfit])

    def cost(step):
        flattening = (PARAMETERS[3:] + step[3:]) / size / 0.3  # over its weak prior
        chi2 = ((misfit - design @ step) ** 2).sum() + (flattening**2).sum()
        return chi2 + (step**2).sum() / (0.1 * size) ** 2

    best = minimize(cost, np.zeros(5), tol=1e-12)
    np.testing.assert_allclose(solve_damped_step(equations, PARAMETERS), best.x, atol=1e-4)


def test_refined_ellipses_are_near_the_truth_from_a_start_millimetres_off(rng):
    points = noisy(measured(upper_arc(TRUTH), rng))
    found = refine_ellipse(points, parameters_from_ellipse(about(TRUTH)), steps=6)
    assert_same_ellipse(ellipse_from_parameters(found), TRUTH, atol=1.0)
    assert np.abs((found - PARAMETERS) / parameter_stds(points, found)).max() < 4


def test_a_weld_bead_at_a_flank_hardly_moves_the_ellipse(rng):
    points = measured(upper_arc(TRUTH), rng)
    clean = refine_ellipse(noisy(points), PARAMETERS, steps=4)
    points[:4, 1] += (4.0, 3.0, 2.0, 1.0)
    found = refine_ellipse(noisy(points), PARAMETERS, steps=4)
    assert (np.abs(found - clean) < 2 * parameter_stds(noisy(points), clean)).all()


def test_points_of_no_ellipse_give_nan():
    x = np.linspace(-20, 20, 30)
    valley = np.column_stack([x, -400 + 0.02 * x**2])
    found = refine_ellipse(noisy(valley), PARAMETERS, steps=20)
    assert np.isnan(found).all() or np.isfinite(found).all()
    assert not np.isinf(found).any()


def test_a_matrix_that_is_not_positive_definite_has_no_solution():
    assert np.isnan(solve_positive_definite(-np.eye(5), np.ones(5))).all()
    np.testing.assert_allclose(solve_positive_definite(4 * np.eye(5), np.ones(5)), 0.25)


def test_variances_along_the_normals_alone_are_those_of_the_residuals(rng):
    points = noisy(measured(upper_arc(TRUTH), rng))
    wanted = ellipse_residuals(points, PARAMETERS).variances
    np.testing.assert_allclose(ray_normal_variances(points, PARAMETERS), wanted, rtol=1e-9)
    stacked, _ = NoisyPoints.stack([points, points[:20]])
    found = ray_normal_variances(stacked, np.array([PARAMETERS, PARAMETERS]))
    np.testing.assert_allclose(found[1, :20], wanted[:20], rtol=1e-9)


def test_a_step_of_one_arc_uses_its_members():
    points = noisy(upper_arc(TRUTH))
    evaluated = ellipse_residuals(points, 1.01 * PARAMETERS)
    members = np.arange(len(points)) % 3 > 0
    step = take_gauss_newton_step(evaluated, 1.01 * PARAMETERS, members)
    selected = ellipse_residuals(points[members], 1.01 * PARAMETERS)
    npt.assert_allclose(step, take_gauss_newton_step(selected, 1.01 * PARAMETERS), rtol=ROUNDING)
