"""Cramer-Rao bound of a radius with the true membership, and the linear estimate that reaches it.

The error of an estimate is compared with the linear estimate's from the same noise: its mean
square is the bound exactly, so that what chance does to both cancels.
"""

import math

import numpy as np

from lsvision.simulate.section import noise_std

RADIUS = 3
"""Column of the semi-minor axis among centre_x, centre_y, a, b, (a - b) theta."""
MIN_POINTS = 8


def bound_radius(section, tube):
    """Bound and linear error of a simulated tube's radius; NaN where its points leave it open.

    Noise along the ray counts by its part across the ellipse; lost points and jumps not at all.
    """
    seen = section.truth.labels == tube.label
    if seen.sum() < MIN_POINTS:
        return math.nan, math.nan
    exact = section.truth.points[seen]
    rays = exact - section.sensor.origin
    rays /= np.hypot(*rays.T)[:, None]
    gradients, normals = _distance_gradients(tube.ellipse, exact)
    std = noise_std(exact, section.sensor) * np.abs((rays * normals).sum(axis=1))
    across = ((section.profile.points[seen] - exact) * normals).sum(axis=1)
    weighted = gradients / std[:, None]
    try:
        covariance = np.linalg.inv(weighted.T @ weighted)
    except np.linalg.LinAlgError:
        return math.nan, math.nan
    linear = covariance @ weighted.T @ (across / std)
    return math.sqrt(covariance[RADIUS, RADIUS]), float(linear[RADIUS])


def _distance_gradients(ellipse, points):
    """Change of the distances of points on an ellipse by its unknowns, and its normals there."""
    a, b = ellipse.semi_major, ellipse.semi_minor
    u, v = ellipse.to_ellipse_frame(points).T
    length = np.hypot(b * u / a, a * v / b)
    own = np.column_stack([b * u / a, a * v / b]) / length[:, None]
    normals = ellipse.from_ellipse_frame(own) - ellipse.centre
    by_axes = own * np.column_stack([u / a, v / b])
    by_turn = (a + b) * (u / a) * (v / b) / length
    return np.column_stack([normals, by_axes, by_turn]), normals
