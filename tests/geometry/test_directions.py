"""Tangent basis of a direction, and directions over a hemisphere."""

import numpy as np
import pytest

from lsvision.geometry import build_hemisphere_directions, build_tangent_frame

MACHINE = 1e-12  # of unit vectors


def test_the_frame_of_z_is_the_identity():
    np.testing.assert_array_equal(build_tangent_frame(np.array([0.0, 0.0, 1.0])), np.eye(3))


@pytest.mark.parametrize("seed", range(5))
def test_the_frame_is_a_rotation_that_ends_with_the_direction(seed):
    direction = np.random.default_rng(seed).normal(size=3)
    direction /= np.linalg.norm(direction)
    frame = build_tangent_frame(direction)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), rtol=0, atol=MACHINE)
    np.testing.assert_allclose(np.linalg.det(frame), 1.0, rtol=0, atol=MACHINE)
    np.testing.assert_array_equal(frame[2], direction)


def test_e_phi_and_e_theta_are_the_derivatives_by_the_angles():
    phi, theta, step = 0.4, 1.1, 1e-6

    def direction(phi: float, theta: float) -> np.ndarray:
        return np.array([np.sin(phi) * np.cos(theta), np.sin(phi) * np.sin(theta), np.cos(phi)])

    e_phi, e_theta, _ = build_tangent_frame(direction(phi, theta))
    by_phi = direction(phi + step, theta) - direction(phi - step, theta)
    by_theta = direction(phi, theta + step) - direction(phi, theta - step)
    np.testing.assert_allclose(by_phi / (2 * step), e_phi, rtol=0, atol=1e-9)
    np.testing.assert_allclose(by_theta / (2 * step), np.sin(phi) * e_theta, rtol=0, atol=1e-9)


def test_hemisphere_directions_are_evenly_spread_unit_vectors():
    directions = build_hemisphere_directions(400)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=0, atol=MACHINE)
    assert (directions[:, 2] > 0).all()
    cosines = directions @ directions.T - 2 * np.eye(400)
    nearest = np.degrees(np.arccos(cosines.max(axis=1)))
    assert nearest.min() > 4.0  # 7 deg is the side of a square of 1/400 of the hemisphere
    assert nearest.max() < 8.0
