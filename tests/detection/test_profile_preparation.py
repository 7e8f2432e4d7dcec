import math

import numpy as np
import pytest

from lsvision import PointNoise, Profile, ProfileSensor, measure_cylinders
from lsvision.detection.profile_preparation import (
    estimate_noise_std,
    measure_typical_pitch,
    prepare_profile,
)
from lsvision.geometry.noisy_points import as_vectors
from tests.detection.scenes import PITCH, dome, flat

NAN = math.nan


@pytest.mark.parametrize("make", [flat(0, 600), dome(0, 400)], ids=["flat", "curved"])
def test_the_noise_of_a_line_is_estimated(make, rng):
    noisy = make + 0.05 * rng.normal(size=make.shape)
    assert estimate_noise_std(noisy, PITCH) == pytest.approx(0.05, rel=0.15)


def test_steps_and_jumps_do_not_count_as_noise(rng):
    points = np.concatenate([flat(0, 300), flat(300, 600, y=-420)])
    points = points + 0.05 * rng.normal(size=points.shape)
    points[::40, 1] += 9.0
    assert estimate_noise_std(points, PITCH) == pytest.approx(0.05, rel=0.35)


def test_a_fifth_of_jumps_little_more_than_doubles_the_estimate(rng):
    points = flat(0, 6000) + 0.05 * rng.normal(size=(10_000, 2))
    points[rng.random(10_000) < 0.2, 1] += 9.0
    assert 0.1 < estimate_noise_std(points, PITCH) < 0.12


def test_a_stretch_that_was_interpolated_does_not_hide_the_noise(rng):
    points = flat(0, 6000) + 0.05 * rng.normal(size=(10_000, 2))
    points[:2800, 1] = 1e-6 * rng.normal(size=2800)
    assert estimate_noise_std(points, PITCH) > 0.2 * 0.05


@pytest.mark.parametrize("columns", [2, 3, 4])
def test_heights_held_over_columns_do_not_hide_the_noise(columns, rng):
    points = flat(0, 600)
    points[:, 1] = np.repeat(0.05 * rng.normal(size=len(points)), columns)[: len(points)]
    assert estimate_noise_std(points, PITCH) > 0.4 * 0.05


def test_points_listed_twice_have_the_noise_of_one(rng):
    points = flat(0, 600) + 0.05 * rng.normal(size=(1000, 2))
    twice = estimate_noise_std(np.repeat(points, 2, axis=0), PITCH)
    assert twice == estimate_noise_std(points, PITCH)


@pytest.mark.parametrize(
    "points", [np.empty((0, 2)), np.zeros((1, 2)), np.zeros((50, 2)), flat(0, 9)]
)
def test_the_estimate_is_never_zero(points):
    assert estimate_noise_std(points, PITCH) == pytest.approx(1e-5 * PITCH, rel=0.1)


@pytest.mark.parametrize(
    ("x", "columns"),
    [
        ([0, 1, 2, 3], [0, 1, 2, 3]),
        ([3, 2, 1, 0], [0, 1, 2, 3]),
        ([0, NAN, 2, 3], [0, 2, 3]),
        ([2, 0, 3, 1], [1, 3, 0, 2]),
        ([1, 1, 1, 1], [0, 1, 2, 3]),
        ([1e300, 0, 1], [1, 2]),
        ([], []),
        ([NAN, NAN], []),
    ],
    ids=["rising", "falling", "lost", "unsorted", "one column", "huge", "empty", "all lost"],
)
def test_the_sensors_order_is_kept_where_it_is_one(x, columns):
    profile = Profile(np.column_stack([np.array(x, dtype=float), np.zeros(len(x))]))
    prepared = prepare_profile(profile, None)
    np.testing.assert_array_equal(prepared.sensor_columns[prepared.valid_indices], columns)
    np.testing.assert_array_equal(prepared.points, profile.points[prepared.sensor_columns])
    np.testing.assert_array_equal(as_vectors(prepared.noisy_points.z), prepared.points)


def test_a_given_noise_model_is_not_undercut():
    sensor = ProfileSensor(range_std=0.05)
    points = flat(0, 30)
    points[7] = NAN
    prepared = prepare_profile(Profile(points), sensor)
    assert not prepared.noise_is_estimated
    assert prepared.min_variance_factor == 1
    expected = sensor.covariances(points[prepared.sensor_columns])
    np.testing.assert_allclose(prepared.noisy_points.covariances, expected, atol=1e-15)
    assert prepared.noise_std == pytest.approx(0.05 * 1.1**2, rel=0.05)


def test_without_a_model_noise_lies_along_y_and_may_be_half_as_large(rng):
    prepared = prepare_profile(Profile(flat(0, 600) + 0.05 * rng.normal(size=(1000, 2))), None)
    assert prepared.noise_is_estimated
    assert prepared.min_variance_factor == 0.5**2
    assert prepared.noise_std == pytest.approx(0.05, rel=0.15)
    expected = prepared.noise_std**2 * np.diag([0.35**2, 1.0])
    np.testing.assert_allclose(prepared.noisy_points.covariances, [expected] * 1000)


@pytest.mark.parametrize(("count", "kept"), [(8192, 8192), (8400, 4200), (8401, 4200)])
def test_more_points_than_a_sensor_has_are_thinned_from_both_ends_alike(count, kept):
    points = np.column_stack([np.arange(float(count)), np.zeros(count)])
    columns = prepare_profile(Profile(points), None).sensor_columns
    assert len(columns) == kept
    np.testing.assert_array_equal(columns, count - 1 - columns[::-1])


def test_lost_columns_are_no_points():
    points = np.repeat(flat(0, 30), 2, axis=0)
    points[::2] = NAN
    prepared = prepare_profile(Profile(points), None)
    np.testing.assert_array_equal(prepared.points, flat(0, 30))
    np.testing.assert_array_equal(prepared.sensor_columns, np.arange(1, 100, 2))


def test_an_all_lost_profile_with_a_model_has_no_noise():
    assert prepare_profile(Profile([[NAN, NAN]] * 3), ProfileSensor()).noise_std == 0.0


@pytest.mark.parametrize(
    ("points", "pitch"),
    [
        (np.empty((0, 2)), 1.0),
        (np.array([[3.0, 4.0]] * 5), 1.0),
        (np.array([[0.0, 0.0], [0.0, 9.0], [0.0, 10.0]]), 10 / 3),
        (np.array([[0.0, 0.0], [2.0, 9.0], [4.0, 1.0], [4.0, 1.0]]), 2.0),
    ],
    ids=["nothing", "one place", "upright", "duplicate"],
)
def test_the_pitch_is_positive_always(points, pitch):
    assert measure_typical_pitch(points) == pytest.approx(pitch)


@pytest.mark.parametrize("wrong", [0.0, -1.0, NAN, math.inf, [[1.0, 2.0], [2.0, 1.0]]])
def test_a_noise_model_without_covariances_is_a_value_error(wrong):
    points = dome(0, 20)
    covariances = np.tile(0.01 * np.eye(2), (len(points), 1, 1))
    covariances[5] = wrong
    with pytest.raises(ValueError, match=r"expected (finite|symmetric).* covariances"):
        prepare_profile(Profile(points), PointNoise(covariances))
    points[5] = NAN  # of a lost point any covariance will do
    assert len(prepare_profile(Profile(points), PointNoise(covariances)).points) == len(points) - 1


def test_an_error_along_the_ray_alone_is_a_covariance():
    points = dome(0, 20)
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    covariances = 0.01 * rays[:, :, None] * rays[:, None]
    prepared = prepare_profile(Profile(points), PointNoise(covariances))
    assert prepared.noise_std == pytest.approx(0.1)


@pytest.mark.parametrize("pitch", [0.1, 0.3])
def test_pipes_in_steps_of_1_mm_beside_a_floor_have_the_error_of_rounding(pitch):
    """The floor shows no noise, and the pipe fits the steps better than their rounding error."""
    rng, held, far, count = np.random.default_rng(9), 0, 0, 30
    for _ in range(count):
        x, middle, floor = np.arange(-60, 60, pitch), rng.uniform(-5, 5), rng.uniform(-290, -289)
        centre, z = floor + rng.uniform(5, 20), np.full(len(x), floor)
        on_pipe = np.abs(x - middle) < 23.5
        z[on_pipe] = np.maximum(centre + np.sqrt(25**2 - (x[on_pipe] - middle) ** 2), floor)
        (pipe,) = measure_cylinders(
            np.column_stack([x, np.round(z + rng.normal(0, 0.03, len(x)))])
        ).cylinders
        low, high = pipe.interval("radius")
        held += low <= 25 <= high
        far += abs(pipe.radius - 25) > 5 * pipe.radius_std
    assert far == 0
    assert held >= 0.9 * count
