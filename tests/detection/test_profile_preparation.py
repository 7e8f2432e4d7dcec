import math

import numpy as np
import pytest

from lsvision import Profile, ProfileSensor
from lsvision.detection.profile_preparation import (
    estimate_noise_std,
    prepare_profile,
    typical_pitch,
)
from tests.detection.scenes import dome, flat

NAN = math.nan


@pytest.mark.parametrize("make", [flat(0, 600), dome(0, 400)], ids=["flat", "curved"])
def test_the_noise_of_a_line_is_estimated(make, rng):
    noisy = make + 0.05 * rng.normal(size=make.shape)
    assert estimate_noise_std(noisy) == pytest.approx(0.05, rel=0.15)


def test_steps_and_jumps_do_not_count_as_noise(rng):
    points = np.concatenate([flat(0, 300), flat(300, 600, y=-420)])
    points = points + 0.05 * rng.normal(size=points.shape)
    points[::40, 1] += 9.0
    assert estimate_noise_std(points) == pytest.approx(0.05, rel=0.35)


@pytest.mark.parametrize(
    "points", [np.empty((0, 2)), np.zeros((1, 2)), np.zeros((50, 2)), flat(0, 9)]
)
def test_the_estimate_is_never_zero(points):
    assert estimate_noise_std(points) > 0


@pytest.mark.parametrize(
    ("x", "columns"),
    [
        ([0, 1, 2, 3], [0, 1, 2, 3]),
        ([3, 2, 1, 0], [0, 1, 2, 3]),
        ([0, NAN, 2, 3], [0, 2, 3]),
        ([2, 0, 3, 1], [1, 3, 0, 2]),
        ([1, 1, 1, 1], [0, 1, 2, 3]),
        ([], []),
        ([NAN, NAN], []),
    ],
    ids=["rising", "falling", "lost", "unsorted", "one column", "empty", "all lost"],
)
def test_the_sensors_order_is_kept_where_it_is_one(x, columns):
    profile = Profile(np.column_stack([np.array(x, dtype=float), np.zeros(len(x))]))
    weighed = prepare_profile(profile, None)
    np.testing.assert_array_equal(weighed.sensor_columns[weighed.valid_indices], columns)
    np.testing.assert_array_equal(weighed.points, profile.points[weighed.sensor_columns])


def test_a_noise_model_is_written_out_point_by_point():
    sensor = ProfileSensor(range_std=0.05)
    profile = Profile(flat(0, 30))
    weighed = prepare_profile(profile, sensor)
    assert weighed.noise_known
    np.testing.assert_array_equal(weighed.covariances, sensor.covariances(profile.points))
    assert weighed.noise_std == pytest.approx(0.05 * 1.1**2, rel=0.05)


def test_without_a_model_noise_is_isotropic():
    weighed = prepare_profile(Profile(flat(0, 30)), None)
    assert not weighed.noise_known
    np.testing.assert_allclose(weighed.covariances[3], weighed.noise_std**2 * np.eye(2))


def test_an_all_lost_profile_with_a_model_has_no_noise():
    assert prepare_profile(Profile([[NAN, NAN]] * 3), ProfileSensor()).noise_std == 0.0


@pytest.mark.parametrize(
    ("points", "pitch"),
    [
        (np.empty((0, 2)), 1e-9),
        (np.array([[3.0, 4.0]] * 5), 1e-9),
        (np.array([[0.0, 0.0], [0.0, 9.0], [0.0, 10.0]]), 10 / 3),
        (np.array([[0.0, 0.0], [2.0, 9.0], [4.0, 1.0], [4.0, 1.0]]), 2.0),
    ],
    ids=["nothing", "one place", "upright", "duplicate"],
)
def test_the_pitch_is_positive_always(points, pitch):
    assert typical_pitch(points) == pytest.approx(pitch)
