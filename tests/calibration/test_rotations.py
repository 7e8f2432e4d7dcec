"""Stacks of rotations against power series and single rotations."""

import numpy as np
import pytest

from lsvision.calibration.rotations import (
    find_nearest_rotations,
    list_cube_rotations,
    list_dense_rotations,
    rotation_vector_jacobian,
    rotations_from_vectors,
    vectors_from_rotations,
)
from tests.alike import rotation_series

MACHINE = 1e-12
QUOTIENT = 1e-7  # of central difference quotients with a step of 1e-4 rad

VECTORS = [(0, 0, 0), (1e-10, 0, 0), (1e-5, -2e-5, 0), (0.3, -1, 2), (3.1, 0.2, 0), (0, np.pi, 0)]


@pytest.mark.parametrize("vector", VECTORS)
def test_rotation_equals_its_power_series_and_rotation_vectors_is_the_inverse(vector):
    rotation = rotations_from_vectors(np.array(vector, dtype=float))
    np.testing.assert_allclose(rotation, rotation_series(vector), rtol=0, atol=MACHINE)
    again = rotations_from_vectors(vectors_from_rotations(rotation))
    np.testing.assert_allclose(again, rotation, rtol=0, atol=MACHINE)


@pytest.mark.parametrize("vector", [(0, 0, 0), (1e-5, -2e-5, 0), (0.3, -1, 2), (2.9, 0.2, 0)])
def test_rotation_vector_jacobian_is_its_difference_quotient(vector):
    vector = np.array(vector, dtype=float)
    steps = rotations_from_vectors(1e-4 * np.stack([np.eye(3), -np.eye(3)]))
    ahead, behind = vectors_from_rotations(steps @ rotations_from_vectors(vector))
    quotient = (ahead - behind).T / 2e-4
    np.testing.assert_allclose(rotation_vector_jacobian(vector), quotient, rtol=0, atol=QUOTIENT)


def test_stacks_equal_single_rotations():
    vectors = np.random.default_rng(0).normal(size=(4, 5, 3))
    stack = vectors_from_rotations(rotations_from_vectors(vectors))
    np.testing.assert_allclose(
        stack[2, 3], vectors_from_rotations(rotations_from_vectors(vectors[2, 3]))
    )


def test_nearest_rotations_are_proper():
    mirrored = find_nearest_rotations(np.diag([1.0, 1.0, -1.0]))
    assert np.linalg.det(mirrored) == pytest.approx(1)


def test_a_cube_has_24_rotations():
    cube = list_cube_rotations()
    assert len({rotation.tobytes() for rotation in cube}) == 24
    np.testing.assert_allclose(np.linalg.det(cube), 1)


def test_one_of_the_dense_rotations_is_within_32_deg_of_any():
    dense = list_dense_rotations()
    assert dense.shape == (192, 3, 3)
    any_rotation = rotations_from_vectors(np.random.default_rng(8).normal(0, 1.5, (3000, 3)))
    traces = np.einsum("nij,kij->nk", any_rotation, dense).max(axis=1)
    assert np.degrees(np.arccos((traces.min() - 1) / 2)) < 32.0
