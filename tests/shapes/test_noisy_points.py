import numpy as np
import pytest

from lsvision.shapes.noisy_points import NoisyPoints, as_complex, as_vectors
from tests.tolerances import MACHINE


def noisy_points(rng, count=7):
    halves = rng.normal(size=(count, 2, 2))
    return rng.normal(size=(count, 2)), halves @ halves.transpose(0, 2, 1)


def test_the_variance_along_a_normal_is_that_of_the_matrix(rng):
    points, covariances = noisy_points(rng)
    normals = np.exp(1j * rng.uniform(0, 2 * np.pi, len(points)))
    n = as_vectors(normals)
    expected = np.einsum("ni,nij,nj->n", n, covariances, n)
    found = NoisyPoints.of(points, covariances).variances_along(normals)
    np.testing.assert_allclose(found, expected, rtol=MACHINE)


@pytest.mark.parametrize("which", [slice(2, 5), np.array([4, 1]), np.arange(7) > 4])
def test_a_part_keeps_points_and_covariances_together(which, rng):
    points, covariances = noisy_points(rng)
    part = NoisyPoints.of(points, covariances)[which]
    same = NoisyPoints.of(points[which], covariances[which])
    assert len(part) == len(points[which])
    for name in ("z", "variance", "deviator"):
        np.testing.assert_array_equal(getattr(part, name), getattr(same, name))


def test_vectors_come_back_from_complex_numbers(rng):
    vectors = rng.normal(size=(9, 4))[:, ::2]  # not in one piece
    np.testing.assert_array_equal(as_vectors(as_complex(vectors)), vectors)
