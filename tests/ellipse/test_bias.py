"""Fits to many noisy points have no bias."""

import math
from dataclasses import replace

import numpy as np
import pytest

from lsvision import Arc, CylinderSection, Ellipse
from lsvision.ellipse.bias import _compute_jacobian_and_slopes
from lsvision.ellipse.fit import FittingSettings, fit_ellipse, fit_noisy_points
from lsvision.ellipse.problem import Priors, RadiusPrior, minimise
from lsvision.geometry.noisy_points import NoisyPoints

RADIUS = 30.0
COUNT = 8000
"""Points of an arc: with 2000 the bias is hardly larger than the scatter of a mean of the runs."""
RUNS = 60


def arc_seen_from_above(tilt, count, half_deg=65.0):
    """Exact points at equal steps of x whose normals are up to `half_deg` from +Y."""
    ellipse = Ellipse((0.0, -400.0), RADIUS / math.cos(tilt), RADIUS, 0.7)
    dense = ellipse.points_at(np.linspace(0, 2 * np.pi, 50_001))
    normals = np.gradient(dense, axis=0)[:, ::-1] * [1, -1]
    seen = np.abs(np.degrees(np.arctan2(normals[:, 0], normals[:, 1]))) < half_deg
    x, y = dense[seen][dense[seen][:, 0].argsort()].T
    columns = np.linspace(x[0], x[-1], count)
    return ellipse, np.column_stack([columns, np.interp(columns, x, y)])


@pytest.mark.parametrize("known_radius", [None, RadiusPrior(RADIUS + 0.2, 0.2)])
@pytest.mark.parametrize("variance", ["given", "estimated"])
def test_errors_along_the_ray_do_not_make_the_radius_too_small(variance, known_radius, rng):
    """Without the correction it is 1.3 of its standard deviations too small."""
    ellipse, exact = arc_seen_from_above(0.4, COUNT)
    arcs, noise = [], 0.3
    covariances = np.tile(np.diag([(0.2 * noise) ** 2, noise**2]), (len(exact), 1, 1))
    if variance == "estimated":
        covariances *= 9
    for _ in range(RUNS):
        points = exact + rng.normal(size=exact.shape) * [0, noise]
        arcs.append((NoisyPoints.of(points, covariances), ellipse))
    settings = FittingSettings(variance=variance)
    fits = fit_noisy_points(arcs, Priors(known_radius, None), settings)
    sections = [CylinderSection(fit, Arc(0, COUNT), np.arange(COUNT)) for fit in fits]
    # The mean of a prior is off by its std: that pulls the radius by std^2 / prior std.
    pull = 0.0 if known_radius is None else 1 / known_radius.std
    errors = [
        (each.radius - RADIUS) / each.radius_std - pull * each.radius_std for each in sections
    ]
    print(f"mean {np.mean(errors):.2f} sigma")
    assert abs(np.mean(errors)) < 0.1 + 4 / math.sqrt(RUNS)


def test_the_fit_of_isotropic_errors_is_the_geometric_one(rng):
    ellipse, exact = arc_seen_from_above(0.4, 100)
    points = exact + 0.3 * rng.normal(size=exact.shape)
    for covariances in (None, np.tile(0.09 * np.eye(2), (100, 1, 1))):
        fit = fit_ellipse(points, ellipse, covariances)
        np.testing.assert_allclose(fit.problem.points, points, rtol=0, atol=1e-12)


def test_the_slopes_are_the_derivatives_along_the_arc():
    ellipse, _ = arc_seen_from_above(0.4, 10)
    points = ellipse.points_at(np.linspace(0.2, 2.8, 20_001))
    fit = fit_ellipse(points[::4000], ellipse)
    (solution,) = minimise([replace(fit.problem, points=points, stds=np.ones(len(points)))],
                           fit.parameters[None])  # fmt: skip
    jacobian, slopes = _compute_jacobian_and_slopes(solution)
    lengths = np.cumsum(np.r_[0, np.hypot(*np.diff(points, axis=0).T)])
    expected = np.gradient(jacobian, lengths, axis=1)[:, 1:-1]
    np.testing.assert_allclose(slopes[:, 1:-1], expected, rtol=0, atol=1e-7)
