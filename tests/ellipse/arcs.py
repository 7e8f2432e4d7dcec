"""One arc for the tests of the fit: a pipe at 400 mm and a sensor's noise along the ray."""

import math

import numpy as np

from lsvision import Ellipse, ProfileSensor
from lsvision.ellipse.critical_ratio import CriticalRatios
from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.problem import ProblemStack
from lsvision.ellipse.robust_gauss_newton import (
    WeightedSystem,
    ellipse_residuals,
    invert_information_or_nan,
    take_gauss_newton_step,
)

SENSOR = ProfileSensor(range_std=0.05)


def pipe(phi_deg, radius=19.0, theta=0.5):
    return Ellipse((5.0, -400.0), radius / math.cos(math.radians(phi_deg)), radius, theta)


def upper_arc(ellipse, degrees=140.0, count=70):
    """Return exact points of the side towards the sensor."""
    top, half = math.pi / 2 - ellipse.theta, math.radians(degrees) / 2
    return ellipse.points_at(np.linspace(top + half, top - half, count))


def measured(points, rng, sensor=SENSOR):
    """Return the points with errors along the rays, of the size that `sensor` states."""
    factors = np.linalg.cholesky(sensor.covariances(points))
    return points + np.einsum("nij,nj->ni", factors, rng.normal(size=points.shape))


def about(ellipse):
    """Return an initial guess some mm and 17 deg away."""
    x, y = ellipse.centre
    return Ellipse(
        (x + 2, y - 1), ellipse.radius * 1.15, ellipse.radius * 1.05, ellipse.theta + 0.3
    )


def residuals_and_jacobian(problem, parameters):
    """Residuals (n + j,) over their standard deviations, the last j those of the priors."""
    (rows,), _ = ProblemStack.of([problem]).evaluate(parameters[None])
    rows = np.concatenate([rows.T, problem.linearise_priors(parameters)])
    return rows[:, 5], -rows[:, :5]


def parameter_stds(points, parameters):
    """Standard deviations of an ellipse's parameters, from noisy points that lie on it."""
    system = WeightedSystem.of(ellipse_residuals(points, parameters), 1.0)
    return np.sqrt(np.diag(invert_information_or_nan(system.build_normal_equations())))


def refine_ellipse(points, parameters, steps):
    """Parameters after robust Gauss-Newton steps; NaN where a step gives no ellipse."""
    for _ in range(steps):
        if not math.isnan(parameters[0]):
            parameters = take_gauss_newton_step(ellipse_residuals(points, parameters), parameters)
    return parameters


def ratios_of(fit, level):
    """Critical ratios of one fit."""
    return CriticalRatios.of(FitStack.of([fit]), level)


def ratios_of_flattening(ratios, flattenings):
    """Critical ratios of phi of one fit, for values of h / m."""
    return ratios.compute_for_flattening(
        np.zeros(len(flattenings), dtype=int), np.array(flattenings)
    )
