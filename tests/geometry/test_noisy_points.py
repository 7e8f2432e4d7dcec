import numpy as np
import pytest

from lsvision import ProfileSensor
from lsvision.geometry.noisy_points import NoisyPoints, as_complex, as_vectors
from tests.tolerances import MACHINE


def noisy_points(rng, count=7):
    halves = rng.normal(size=(count, 2, 2))
    return rng.normal(size=(count, 2)), halves @ halves.transpose(0, 2, 1)


def test_the_variance_along_a_normal_is_that_of_the_matrix(rng):
    points, covariances = noisy_points(rng)
    normals = np.exp(1j * rng.uniform(0, 2 * np.pi, len(points)))
    n = as_vectors(normals)
    expected = np.einsum("ni,nij,nj->n", n, covariances, n)
    found = NoisyPoints.of(points, covariances).normal_variances(normals)
    np.testing.assert_allclose(found, expected, rtol=MACHINE)


@pytest.mark.parametrize("which", [slice(2, 5), np.array([4, 1]), np.arange(7) > 4])
def test_indexing_selects_points_and_covariances(which, rng):
    points, covariances = noisy_points(rng)
    part = NoisyPoints.of(points, covariances)[which]
    same = NoisyPoints.of(points[which], covariances[which])
    assert len(part) == len(points[which])
    for name in ("z", "mean_variance", "deviator"):
        np.testing.assert_array_equal(getattr(part, name), getattr(same, name))


def test_covariances_are_recovered(rng):
    points, covariances = noisy_points(rng)
    found = NoisyPoints.of(points, covariances).covariances
    np.testing.assert_allclose(found, covariances, atol=1e-12)


def test_alike_gives_equal_covariances(rng):
    points, _ = noisy_points(rng)
    alike = NoisyPoints.uniform(as_complex(points), 0.2, 0.5)
    one_by_one = NoisyPoints.of(points, np.tile(np.diag([0.04, 0.25]), (7, 1, 1)))
    for name in ("z", "mean_variance", "deviator"):
        np.testing.assert_allclose(getattr(alike, name), getattr(one_by_one, name), atol=1e-15)


def test_as_vectors_inverts_as_complex(rng):
    vectors = rng.normal(size=(9, 4))[:, ::2]  # not contiguous
    np.testing.assert_array_equal(as_vectors(as_complex(vectors)), vectors)


def fan(count=61, half_deg=30.0):
    """Points below a sensor at the origin, and their rays towards it."""
    directions = np.radians(np.linspace(-90 - half_deg, -90 + half_deg, count))
    points = 400 * np.column_stack([np.cos(directions), np.sin(directions)])
    return points, -as_complex(points) / 400


def test_incidence_cosines_of_errors_along_the_ray(rng):
    points, rays = fan()
    noisy = NoisyPoints.of(points, ProfileSensor().covariances(points))
    incidence = rng.uniform(-np.pi, np.pi, len(points))
    found = noisy.compute_incidence_cosines(rays * np.exp(1j * incidence))
    np.testing.assert_allclose(found, np.cos(incidence), atol=1e-12)


@pytest.mark.parametrize("ratio", [0.8, 1.0, 3.0], ids=lambda ratio: f"x over y {ratio}")
def test_incidence_cosines_of_errors_without_direction_use_the_fan(ratio):
    points, _ = fan(1)
    noisy = NoisyPoints.of(points, np.diag([ratio, 1.0])[None] ** 2)
    angles_deg = np.array([0, 59, 61, 119, 121, 180])  # of the normal, off +Y
    normals = np.exp(1j * np.radians(90 - angles_deg))
    seen = [noisy.compute_incidence_cosines(normal[None])[0] > 0 for normal in normals]
    assert seen == [True, True, True, True, False, False]


@pytest.mark.parametrize(
    ("ray_deg", "detected"), [(0, True), (36.5, True), (39, False), (90, False)]
)
def test_the_ray_is_the_error_direction_within_38_deg_of_y(ray_deg, detected):
    ray = np.exp(1j * np.radians(90 - ray_deg))
    along = np.array([ray.real, ray.imag])
    noisy = NoisyPoints.of(np.zeros((1, 2)), np.outer(along, along)[None])
    facing = noisy.compute_incidence_cosines(np.array([ray * np.exp(1j * np.radians(80))]))[0]
    assert (facing == pytest.approx(np.cos(np.radians(80)))) == detected


@pytest.mark.parametrize("angle_deg", [-25.0, 0.0, 10.0])
def test_the_mean_ray_rotates_with_the_rays(angle_deg, rng):
    away = np.radians(90 + angle_deg + rng.uniform(-15, 15, 9))
    rays = np.exp(1j * np.append(away, 2 * np.radians(90 + angle_deg) - away))
    along = as_vectors(rays)
    covariances = along[:, :, None] * along[:, None, :] + 0.01 * np.eye(2)
    ray = NoisyPoints.of(-400 * along, covariances).mean_ray
    assert ray == pytest.approx(np.exp(1j * np.radians(90 + angle_deg)), abs=1e-12)


@pytest.mark.parametrize("variances", [(1.0, 1.0), (1.0, 1.2), (4.0, 1.0)])
def test_the_mean_ray_is_along_y_where_the_errors_have_no_clear_direction(variances):
    noisy = NoisyPoints.of(np.zeros((5, 2)), np.tile(np.diag(variances), (5, 1, 1)))
    assert noisy.mean_ray == 1j
    assert noisy[:0].mean_ray == 1j
