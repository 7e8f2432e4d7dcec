"""Views, rays and brute-force fits for the planning tests, independent of the tested code."""

import math

import numpy as np
import pytest

from lsvision.geometry import Cylinder, Pose
from lsvision.planning import SensorView
from lsvision.planning.sensor_view import find_visible_points
from lsvision.sensors.profile_sensor import ProfileSensor

ROUNDING = 1e-9  # relative: two exact formulas in double precision
DIFFERENCES = 1e-4  # relative: central differences, and the lateral share of ProfileSensor
STEP = 1e-5  # mm, rad: of the central differences
MAX_STEPS, CONVERGED = 50, 1e-6  # of the fits; mm, rad
RUNS = 400  # Monte Carlo: RMSE known to 1 / sqrt(2 * 400) = 3.5 %, one sigma
FOUR_SIGMA = 4 / math.sqrt(2 * RUNS)
FINE = ProfileSensor(range_std=0.05, reference_range=400.0)
VIEW = SensorView(sensor=FINE, pitch=0.6)
CASES = [
    pytest.param(19.0, 10, 30, id="steep"),
    pytest.param(15.0, 100, 25, id="major axis towards the sensor"),
    pytest.param(29.0, 175, 15, id="theta near 0/pi"),
    pytest.param(40.0, 60, 40, id="large"),
]


def sigmas(prediction):
    return np.array([prediction.radius_std, prediction.theta_std, prediction.phi_std])


def rad(*degrees):
    return tuple(math.radians(value) for value in degrees)


def ray_ranges(unknowns, rays, origins):
    """Ranges (..., n) to cylinders (..., 5): x, y, radius, theta, phi; from the quadratic in 3D."""
    x, y, radius, theta, phi = np.moveaxis(np.asarray(unknowns)[..., None], -2, 0)
    axis = np.stack([np.sin(phi) * np.cos(theta), np.sin(phi) * np.sin(theta), np.cos(phi)], -1)
    d = np.cross(rays, axis)
    m = np.cross(origins - np.stack([x, y, 0 * x], -1), axis)
    half = np.sum(d * m, axis=-1)
    square = np.sum(d * d, axis=-1)
    root = np.maximum(half**2 - square * (np.sum(m * m, axis=-1) - radius**2), 0.0)
    return (-half - np.sqrt(root)) / square


def rays_to(points):
    return points / np.linalg.norm(points, axis=1, keepdims=True), np.zeros_like(points)


def scan_rays(pipe, feed):
    """Rays of all points of a scan, and the origins they start from, in the scan's frame."""
    rays, origins = [], []
    for shift in feed.shifts:
        seen = find_visible_points(pipe.transformed(Pose(translation=-shift)), VIEW)
        rays.append(rays_to(np.column_stack([seen, np.zeros(len(seen))]))[0])
        origins.append(np.tile(shift, (len(seen), 1)))
    return np.concatenate(rays), np.concatenate(origins)


def ray_stds(ranges):
    return FINE.range_std * (ranges / FINE.reference_range) ** 2


def range_fisher(unknowns, rays, origins, stds):
    columns = []
    for index in range(5):
        step = np.zeros(5)
        step[index] = STEP
        high, low = (ray_ranges(unknowns + sign * step, rays, origins) for sign in (1, -1))
        columns.append((high - low) / (2 * STEP) / stds)
    jacobian = np.column_stack(columns)
    return np.linalg.inv(jacobian.T @ jacobian)


def along_ray(points, std):
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    return std**2 * rays[:, :, None] * rays[:, None, :]


def pipe_and_points(radius, theta_deg, phi_deg, view=VIEW):
    theta, phi = rad(theta_deg, phi_deg)
    unknowns = np.array([view.offset, -view.standoff, radius, theta, phi])
    axis = (math.sin(phi) * math.cos(theta), math.sin(phi) * math.sin(theta), math.cos(phi))
    pipe = Cylinder((view.offset, -view.standoff, 0.0), axis, radius)
    return unknowns, pipe, find_visible_points(pipe, view)


def fit_ranges(unknowns, rays, origins, measured, stds, known_radius=None):
    """Fit a cylinder to each row of ranges (k, n) by Gauss-Newton steps from the truth: (k, 5)."""

    def residuals(x):
        errors = (ray_ranges(x, rays, origins) - measured) / stds
        if known_radius is None:
            return errors
        prior = (x[:, 2:3] - known_radius[0]) / known_radius[1]
        return np.concatenate([errors, prior], axis=1)

    fitted = np.tile(np.asarray(unknowns, dtype=float), (len(measured), 1))
    for _ in range(MAX_STEPS):
        steps = STEP * np.eye(5)
        columns = [(residuals(fitted + s) - residuals(fitted - s)) / (2 * STEP) for s in steps]
        jacobian = np.stack(columns, axis=-1)
        transposed = jacobian.swapaxes(1, 2)
        gradient = transposed @ residuals(fitted)[..., None]
        change = np.linalg.solve(transposed @ jacobian, gradient)[..., 0]
        fitted -= change
        if np.abs(change).max() < CONVERGED:
            return fitted
    raise AssertionError(f"no minimum after {MAX_STEPS} steps: still moving by {change.max()}")


def rmse_of_brute_force(unknowns, rays, origins, std, known_radius=None):
    rng = np.random.default_rng(7)
    truth = ray_ranges(unknowns, rays, origins)
    measured = truth + rng.normal(0, std, (RUNS, len(rays)))
    errors = fit_ranges(unknowns, rays, origins, measured, std, known_radius) - unknowns
    return np.sqrt(np.mean(np.square(errors), axis=0))[2:]
