"""Cramer-Rao bound of a radius from the true points of a pipe; a linear estimate that attains it.

The error of an estimate is compared with that of the linear estimate from the same noise, whose
mean square is exactly the squared bound, so that random deviations common to both cancel.
"""

import math

import numpy as np

from lsvision.simulate.section import noise_std

RADIUS = 3
"""Column of the semi-minor axis among centre_x, centre_y, a, b, (a - b) theta."""
MIN_POINTS = 8


def bound_radius(section, tube):
    """Bound and linear error of a simulated tube's radius; NaN if its points do not determine it.

    The error of a point is its noise along the ray, times the cosine of the angle to the normal.
    Lost points and jumps are left out.
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
    """Derivatives (n, 5) of the normal displacement of an ellipse at its points, and the normals.

    The parameters are centre_x, centre_y, a, b and (a - b) theta.
    """
    a, b = ellipse.semi_major, ellipse.semi_minor
    u, v = ellipse.to_ellipse_frame(points).T
    length = np.hypot(b * u / a, a * v / b)
    normals_uv = np.column_stack([b * u / a, a * v / b]) / length[:, None]
    normals = ellipse.from_ellipse_frame(normals_uv) - ellipse.centre
    by_axes = normals_uv * np.column_stack([u / a, v / b])
    by_turn = (a + b) * (u / a) * (v / b) / length
    return np.column_stack([normals, by_axes, by_turn]), normals
