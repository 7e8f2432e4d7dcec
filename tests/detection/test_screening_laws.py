"""The inliers do not depend on the order or position of the points."""

import numpy as np
import pytest

from lsvision import Ellipse, Profile, ProfileSensor
from lsvision.detection.arcs import IdentifiedArc
from lsvision.detection.profile_preparation import prepare_profile
from tests.detection.scenes import STEP, circle, identified, screen_arc, walk, with_foot

STD = 0.02  # mm

SCENES = range(8)


def cluttered(seed):
    """Return the points of a circle between a plate and the foot of a bead, and the arc."""
    rng = np.random.default_rng([21, seed])
    points, _, _ = with_foot(1.3)
    plate = walk(points[0], [178.0] * 20, STEP)[::-1]
    points = np.concatenate([plate, points])
    points = points + STD * rng.normal(size=(len(points), 1)) * (0, 1)
    jumps = rng.integers(22, len(points), 4)
    points[jumps, 1] += rng.choice([-1, 1], 4) * rng.uniform(0.3, 5, 4)
    return points, identified(20, len(points) - 10, circle())


@pytest.fixture(params=[None, ProfileSensor(range_std=STD)], ids=["estimated", "sensor"])
def sensor(request):
    return request.param


@pytest.mark.parametrize("seed", SCENES)
def test_reversed_points_have_the_same_inliers(seed, sensor):
    points, arc = cluttered(seed)
    count = len(points)
    expected = screen_arc(prepare_profile(Profile(points), sensor), arc)
    back = IdentifiedArc(count - 1 - arc.indices[::-1], arc.ellipse)
    found = screen_arc(prepare_profile(Profile(points[::-1]), sensor), back)
    np.testing.assert_array_equal(np.sort(count - 1 - found.indices), expected.indices)
    assert_alike(found.ellipse, expected.ellipse)


@pytest.mark.parametrize("seed", SCENES)
def test_mirrored_points_have_the_same_inliers(seed, sensor):
    points, arc = cluttered(seed)
    expected = screen_arc(prepare_profile(Profile(points), sensor), arc)
    found = screen_arc(prepare_profile(Profile(points * (-1, 1)), sensor), arc)
    np.testing.assert_array_equal(found.indices, expected.indices)
    x, y = found.ellipse.centre
    mirrored = Ellipse(
        (-x, y), found.ellipse.semi_major, found.ellipse.semi_minor, -found.ellipse.theta
    )
    assert_alike(mirrored, expected.ellipse)


@pytest.mark.parametrize("seed", SCENES)
def test_lost_rows_between_the_columns_change_no_inlier(seed, sensor, rng):
    points, arc = cluttered(seed)
    expected = screen_arc(prepare_profile(Profile(points), sensor), arc)
    rows = np.insert(np.arange(len(points)), rng.integers(0, len(points), 30), -1)
    profile = prepare_profile(Profile(np.where((rows < 0)[:, None], np.nan, points[rows])), sensor)
    found = screen_arc(profile, arc)
    np.testing.assert_array_equal(rows[profile.sensor_columns[found.indices]], expected.indices)
    assert found.ellipse == expected.ellipse


def assert_alike(found, expected):
    np.testing.assert_allclose(found.centre, expected.centre, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.semi_minor, expected.semi_minor, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.semi_major, expected.semi_major, rtol=0, atol=1e-8)
