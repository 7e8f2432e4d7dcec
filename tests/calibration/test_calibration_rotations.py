"""Stacks of rotations against the series and each other."""

import numpy as np
import pytest

from lsvision.calibration.rotations import (
    cube_rotations,
    nearest_rotations,
    rotation_vectors,
    rotations_of,
)

MACHINE = 1e-12


def series(vector, terms=60):
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    total, term = np.eye(3), np.eye(3)
    for power in range(1, terms):
        term = term @ cross / power
        total = total + term
    return total


VECTORS = [(0, 0, 0), (1e-10, 0, 0), (1e-5, -2e-5, 0), (0.3, -1, 2), (3.1, 0.2, 0), (0, np.pi, 0)]


@pytest.mark.parametrize("vector", VECTORS)
def test_the_exponential_is_its_series_and_the_logarithm_its_inverse(vector):
    rotation = rotations_of(np.array(vector, dtype=float))
    np.testing.assert_allclose(rotation, series(vector), rtol=0, atol=MACHINE)
    again = rotations_of(rotation_vectors(rotation))
    np.testing.assert_allclose(again, rotation, rtol=0, atol=MACHINE)


def test_stacks_are_turned_one_by_one():
    vectors = np.random.default_rng(0).normal(size=(4, 5, 3))
    stack = rotation_vectors(rotations_of(vectors))
    np.testing.assert_allclose(stack[2, 3], rotation_vectors(rotations_of(vectors[2, 3])))


def test_nearest_rotations_do_not_mirror():
    mirrored = nearest_rotations(np.diag([1.0, 1.0, -1.0]))
    assert np.linalg.det(mirrored) == pytest.approx(1)


def test_a_cube_has_24_rotations():
    cube = cube_rotations()
    assert len({rotation.tobytes() for rotation in cube}) == 24
    np.testing.assert_allclose(np.linalg.det(cube), 1)
