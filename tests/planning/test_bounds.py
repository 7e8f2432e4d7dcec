"""Cramer-Rao bounds compared with the information of the ranges and with brute-force fits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array

from lsvision.geometry import Cylinder, Ellipse, Pose, build_tangent_frame
from lsvision.planning import scan_bound, section_bound
from lsvision.planning.sensor_view import cylinder_normals
from tests.planning.views import (
    CASES,
    DIFFERENCES,
    FOUR_SIGMA,
    ROUNDING,
    VIEW,
    along_ray,
    pipe_and_points,
    range_fisher,
    ray_ranges,
    rays_to,
    rmse_of_brute_force,
    sigmas,
)


@pytest.mark.parametrize(("radius", "theta_deg", "phi_deg"), CASES)
def test_section_bound_is_the_inverse_information_of_the_ranges(radius, theta_deg, phi_deg):
    unknowns, pipe, points = pipe_and_points(radius, theta_deg, phi_deg)
    bound = section_bound(pipe.section(), points, along_ray(points, 0.05))
    rays, origins = rays_to(np.column_stack([points, np.zeros(len(points))]))
    oracle = np.sqrt(np.diag(range_fisher(unknowns, rays, origins, 0.05)))
    got = [bound.centre_x_std, bound.centre_y_std, *sigmas(bound)]
    np.testing.assert_allclose(got, oracle, rtol=DIFFERENCES)


def test_turning_the_section_turns_theta_and_keeps_the_sigmas():
    pipe = Ellipse((3.0, -400.0), 22.0, 19.0, 0.3)
    anomaly, noise = np.linspace(0.2, 2.4, 60), np.tile(0.01 * np.eye(2), (60, 1, 1))
    turned = replace(pipe, theta=pipe.theta + 1.1)
    plain, other = (section_bound(e, e.points_at(anomaly), noise) for e in (pipe, turned))
    np.testing.assert_allclose(sigmas(other), sigmas(plain), rtol=1e-7)


def test_moving_the_frame_keeps_the_sigmas_of_a_cylinder():
    rng = np.random.default_rng(1)
    pipe = Cylinder((0, 0, 0), (0.3, 0.2, 0.9), 19.0)
    angles, along = rng.uniform(0, 2, 200), rng.uniform(-10, 10, 200)
    axes = np.linalg.svd(pipe.direction[None])[2][1:]
    radial = np.column_stack([np.cos(angles), np.sin(angles)]) @ axes
    points = 19.0 * radial + np.outer(along, pipe.direction)
    quarter = Pose([[0, -1, 0], [1, 0, 0], [0, 0, 1]], (5.0, 6.0, 7.0))
    plain = scan_bound(pipe, points, np.full(200, 0.01))
    moved = scan_bound(pipe.transformed(quarter), quarter.apply(points), np.full(200, 0.01))
    np.testing.assert_allclose(moved.covariance, plain.covariance, atol=1e-12)
    assert moved.direction_std == pytest.approx(plain.direction_std, rel=ROUNDING)


def test_lost_points_do_not_count():
    pipe = Ellipse((3.0, -400.0), 22.0, 19.0, 0.3)
    points = pipe.points_at(np.linspace(0.2, 2.4, 60))
    noise = along_ray(points, 0.1)
    holed, holed_noise = points.copy(), noise.copy()
    holed[::2], holed_noise[::2] = np.nan, np.nan
    some = section_bound(pipe, points[1::2], noise[1::2])
    np.testing.assert_array_equal(sigmas(section_bound(pipe, holed, holed_noise)), sigmas(some))


def test_brute_force_fit_of_one_section_reaches_the_bound():
    unknowns, pipe, points = pipe_and_points(19.0, 20, 30, replace(VIEW, pitch=1.0))
    bound = section_bound(pipe.section(), points, along_ray(points, 0.02))
    rays, origins = rays_to(np.column_stack([points, np.zeros(len(points))]))
    rmse = rmse_of_brute_force(unknowns, rays, origins, 0.02)
    np.testing.assert_allclose(rmse / sigmas(bound), 1.0, atol=FOUR_SIGMA)


def test_brute_force_fit_with_a_known_radius_reaches_the_bound():
    unknowns, pipe, points = pipe_and_points(19.0, 20, 30, replace(VIEW, pitch=1.0))
    bound = section_bound(pipe.section(), points, along_ray(points, 0.02), known_radius_std=1e-3)
    rays, origins = rays_to(np.column_stack([points, np.zeros(len(points))]))
    rmse = rmse_of_brute_force(unknowns, rays, origins, 0.02, known_radius=(19.0, 1e-3))
    # The prior mean is the true radius and not random: only the angles have their full spread.
    np.testing.assert_allclose((rmse / sigmas(bound))[1:], 1.0, atol=FOUR_SIGMA)


def test_brute_force_fit_of_a_scan_reaches_the_bound():
    unknowns, pipe, points = pipe_and_points(19.0, 20, 20, replace(VIEW, pitch=2.0))
    shifts = np.repeat([[0, 0, -5.0], [0, 0, 0.0], [0, 0, 5.0]], len(points), axis=0)
    rays, origins = rays_to(np.tile(np.column_stack([points, 0 * points[:, 0]]), (3, 1)))
    origins = origins + shifts
    hits = origins + rays * ray_ranges(unknowns, rays, origins)[:, None]
    variances = (0.05 * np.sum(cylinder_normals(pipe, hits) * rays, axis=1)) ** 2
    rmse = rmse_of_brute_force(unknowns, rays, origins, 0.05)
    predicted = sigmas(scan_bound(pipe, hits, variances))
    np.testing.assert_allclose(rmse / predicted, 1.0, atol=FOUR_SIGMA)


def test_position_error_along_the_axis_includes_the_direction_error():
    _, pipe, seen = pipe_and_points(19.0, 20, 20)
    points = np.column_stack([seen, np.zeros(len(seen))])
    farther = replace(pipe, point=pipe.point + 50.0 * pipe.direction)
    near, far = (scan_bound(c, points, np.full(len(seen), 0.01)) for c in (pipe, farther))
    way = np.eye(5)
    way[:2, 2:4] = 50.0 * np.eye(2)
    np.testing.assert_allclose(far.covariance, way @ near.covariance @ way.T, rtol=1e-6, atol=1e-9)


def test_limit_of_phi_std_is_of_the_order_of_the_spread_at_a_circle():
    _, pipe, points = pipe_and_points(19.0, 0, 0, replace(VIEW, pitch=1.0))
    bound = section_bound(pipe.section(), points, along_ray(points, 0.02))
    rng = np.random.default_rng(3)
    # Linear in the regular unknowns; the two of the flattening make a vector of length (a - b) / 2.
    a, b, c = bound.covariance[2, 2], bound.covariance[3, 3], bound.covariance[2, 3]
    gap = np.abs(rng.normal(0, math.sqrt(a + b - 2 * c), 20000))
    spread = math.sqrt(np.mean(np.arccos(1 - gap / 19.0) ** 2))
    assert 0.5 < bound.phi_std / spread < 2.0


@pytest.mark.parametrize("lost", ["points", "shared_errors"])
def test_values_that_are_not_finite_are_named(lost):
    pipe = Cylinder((0.0, -400.0, 0.0), (0.1, 0.2, 1.0), 20.0)
    points = np.concatenate([pipe.ring(z, np.linspace(0.0, 2.0, 30)) for z in (0.0, 50.0)])
    shared_errors = np.zeros((60, 1))
    {"points": points, "shared_errors": shared_errors}[lost][3] = np.nan
    with pytest.raises(ValueError, match="expected finite"):
        scan_bound(pipe, points, np.full(60, 0.01), shared_errors=shared_errors)


def test_shared_errors_may_be_sparse(rng):
    pipe = Cylinder([0.0, -400.0, 0.0], [0.0, 0.3, 1.0], 19.0)
    e1, e2 = build_tangent_frame(pipe.direction)[:2]
    angles, axial = rng.uniform(0.5, 2.6, 60), rng.uniform(-20, 20, 60)
    normals = np.outer(np.cos(angles), e1) + np.outer(np.sin(angles), e2)
    points = pipe.point + 19.0 * normals + np.outer(axial, pipe.direction)
    errors = rng.normal(size=(60, 4)) * (rng.random((60, 4)) < 0.3)
    dense, sparse = (
        scan_bound(pipe, points, np.full(60, 0.01), shared_errors=e)
        for e in (errors, csr_array(errors))
    )
    np.testing.assert_allclose(sparse.covariance, dense.covariance, rtol=1e-12)
