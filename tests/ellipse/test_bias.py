"""Fits to many noisy points have no bias."""

import math

import numpy as np
import pytest

from lsvision import Arc, CylinderSection, Ellipse
from lsvision.ellipse.fit import FittingSettings, fit_ellipse, fit_noisy_points
from lsvision.ellipse.problem import Priors, RadiusPrior
from lsvision.geometry.noisy_points import NoisyPoints
from tests.tolerances import FIVE_SIGMA

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


def test_isotropic_errors_do_not_make_a_circle_too_large(rng):
    """Without the correction its radius is too large by noise^2 / (2 radius), 0.0167 mm."""
    angles = np.linspace(0, 2 * np.pi, 40_000, endpoint=False)
    circle = Ellipse((0.0, -400.0), RADIUS, RADIUS, 0.0)
    radii = []
    for _ in range(4):
        points = circle.points_at(angles) + rng.normal(size=(len(angles), 2))
        fit = fit_ellipse(points, circle, np.tile(np.eye(2), (len(angles), 1, 1)))
        radii.append((fit.ellipse.semi_major + fit.ellipse.semi_minor) / 2)
    assert abs(np.mean(radii) - RADIUS) < FIVE_SIGMA * 1.0 / math.sqrt(4 * len(angles))
