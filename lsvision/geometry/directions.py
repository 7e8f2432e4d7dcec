"""Unit vectors: the tangent basis of a direction, and a uniform grid on a hemisphere."""

import numpy as np

from lsvision.geometry.arrays import FloatArray


def build_tangent_frame(direction: FloatArray) -> FloatArray:
    """Return the (3, 3) rotation whose rows are e_phi, e_theta and the direction (unit vector).

    e_theta = Z x direction (normalised) points where the azimuth of the direction increases, e_phi
    where its angle from Z increases. For the direction Z e_phi is X and e_theta Y, for -Z e_phi is
    -X and e_theta Y.
    """
    e_theta = np.array([-direction[1], direction[0], 0.0])
    length = float(np.linalg.norm(e_theta))
    e_theta = e_theta / length if length > 0 else np.array([0.0, 1.0, 0.0])
    return np.stack([np.cross(e_theta, direction), e_theta, direction])


def build_hemisphere_directions(count: int) -> FloatArray:
    """Return (count, 3) unit vectors with z > 0, uniformly distributed (Fibonacci lattice).

    They are ordered by their angle from Z.
    """
    k = np.arange(count) + 0.5
    z = 1 - k / count
    azimuth = np.pi * (1 + np.sqrt(5.0)) * k
    ring_radius = np.sqrt(1 - z * z)
    return np.column_stack([ring_radius * np.cos(azimuth), ring_radius * np.sin(azimuth), z])
