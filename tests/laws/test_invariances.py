"""What must hold whatever the numbers are: translate, scale, mirror, reverse; rotate with a sensor.

Reversal, mirror images and lost rows between the columns may change nothing, on the default path
and with a noise model: a radius moves by no more than rounding does. Where no noise model is given
the errors are taken along Y, so a rotation is another measurement and no law; with a sensor whose
origin is known a rotation about that origin is one, as long as everything is seen from there as
before.
"""

import math

import numpy as np
import pytest

from lsvision import Profile, ProfileSensor, measure_cylinders
from lsvision.simulate import SectionSettings, random_section
from tests.alike import turn_between
from tests.other_scenes import other_scene

SAME_SIGMAS = 0.01  # of the result's own sigma: other rounding, same points
FEW_SIGMAS = 0.25  # where the pixel grid falls otherwise a point at an arc's end may come or go
SENSOR = ProfileSensor(range_std=0.03)
ROUGH = SectionSettings(lost_fraction=0.10, jump_fraction=0.05)


def own(kind, seed, settings=SectionSettings()):
    return random_section(kind, seed, noise_mm=0.03, settings=settings).profile.points


def others(seed):
    rng = np.random.default_rng([61, seed])
    points, _, _ = other_scene(rng, 2, welded=True, cluttered=True)
    return points


SCENES = {
    "single 1": own("single", 1),
    "single 4": own("single", 4),
    "welded_pair 7": own("welded_pair", 7),
    "planar 3": own("planar", 3),
    "welded_complex 5": own("welded_complex", 5),
    "three_stacked 2": own("three_stacked", 2),
    "single 20, rough": own("single", 20, ROUGH),
    "welded_pair 21, rough": own("welded_pair", 21, ROUGH),
    "complex 22, rough": own("complex", 22, ROUGH),
    **{f"welded in clutter {seed}": others(seed) for seed in range(4)},
}


@pytest.fixture(params=SCENES, scope="module")
def name(request):
    return request.param


@pytest.fixture(params=[None, SENSOR], ids=["default", "sensor"], scope="module")
def seen(request, name):
    """The points of a scene, the sensor, and the cylinders found."""
    points, sensor = SCENES[name], request.param
    found = measured(points, sensor)
    assert found
    return points, sensor, found


def measured(points, sensor=None):
    return measure_cylinders(Profile(points), sensor=sensor).cylinders


def turn_about(points, angle, pivot=(0.0, 0.0)):
    cos, sin = math.cos(angle), math.sin(angle)
    return (points - pivot) @ np.array([[cos, sin], [-sin, cos]]) + pivot


def assert_alike(found, expected, sigmas=SAME_SIGMAS):
    """Radius and phi alike, within a share of their own sigma; as many cylinders."""
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        assert abs(one.radius - other.radius) <= sigmas * other.radius_std
        assert abs(one.phi - other.phi) <= sigmas * other.phi_std
        assert one.radius_std == pytest.approx(other.radius_std, rel=sigmas)


def assert_same_rows(found, expected, rows):
    """The same points; `rows` are the former rows of the columns found."""
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(np.sort(rows[one.indices]), np.sort(other.indices))


def test_reversing_the_columns_reverses_the_indices_only(seen):
    points, sensor, expected = seen
    found = measured(points[::-1], sensor)
    assert_alike(found, expected)
    assert_same_rows(found, expected, np.arange(len(points))[::-1])


def test_mirroring_a_profile_mirrors_theta(seen):
    points, sensor, expected = seen
    found = measured(points * (-1, 1), sensor)[::-1]
    assert_alike(found, expected)
    assert_same_rows(found, expected, np.arange(len(points)))
    for one, other in zip(found, expected, strict=True):
        assert abs(turn_between(one.theta, -other.theta)) <= SAME_SIGMAS * other.theta_std
        sigma = math.sqrt(other.covariance[0, 0])
        assert abs(one.centre[0] + other.centre[0]) <= SAME_SIGMAS * sigma


def test_lost_rows_between_the_columns_change_nothing(seen):
    points, sensor, expected = seen
    places = np.random.default_rng(8).integers(0, len(points), len(points) // 4)
    rows = np.insert(np.arange(len(points)), places, -1)
    found = measured(np.where((rows < 0)[:, None], np.nan, points[rows]), sensor)
    assert_alike(found, expected, 0.0)
    assert_same_rows(found, expected, rows)


def test_lost_columns_more_at_both_ends_change_nothing(seen):
    points, sensor, expected = seen
    lost = np.full((20, 2), np.nan)
    found = measured(np.concatenate([lost, points, lost]), sensor)
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.indices - 20, other.indices)
        assert one.radius == other.radius


@pytest.mark.parametrize("shift", [(50.0, 0.0), (0.0, -100.0), (-1234.5, 678.9)])
def test_moving_a_profile_moves_the_centre_and_nothing_else(name, shift):
    points, expected = SCENES[name], measured(SCENES[name])
    found = measured(points + shift)
    assert_alike(found, expected)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.indices, other.indices)
        np.testing.assert_allclose(one.centre, np.add(other.centre, shift), atol=1e-3)


@pytest.mark.parametrize("shift", [(50.0, 0.0), (0.0, -100.0), (-1234.5, 678.9)])
def test_moving_a_profile_with_its_sensor_moves_the_centre_and_nothing_else(name, shift):
    points, expected = SCENES[name], measured(SCENES[name], SENSOR)
    found = measured(points + shift, ProfileSensor(range_std=0.03, origin=shift))
    assert_alike(found, expected)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.indices, other.indices)


@pytest.mark.parametrize("scale", [0.25, 2.0, 10.0])
def test_scaling_a_profile_scales_every_length(name, scale):
    points, expected = SCENES[name], measured(SCENES[name])
    found = measured(points * scale)
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.indices, other.indices)
        assert abs(one.radius / scale - other.radius) <= SAME_SIGMAS * other.radius_std
        assert one.radius_std == pytest.approx(scale * other.radius_std, rel=1e-3)
        assert one.phi == pytest.approx(other.phi, abs=SAME_SIGMAS * other.phi_std)
        assert turn_between(one.theta, other.theta) == pytest.approx(
            0, abs=SAME_SIGMAS * other.theta_std
        )


@pytest.mark.parametrize("angle_deg", [-10.0, 3.0, 10.0])
def test_turning_a_profile_about_its_sensor_turns_theta_and_nothing_else(name, angle_deg):
    points, expected = SCENES[name], measured(SCENES[name], SENSOR)
    angle = math.radians(angle_deg)
    found = measured(turn_about(points, angle), SENSOR)
    assert_alike(found, expected, FEW_SIGMAS)
    for one, other in zip(found, expected, strict=True):
        off = turn_between(other.theta + angle, one.theta)
        assert abs(off) <= FEW_SIGMAS * other.theta_std
        moved = turn_about(np.array([other.centre]), angle)[0]
        sigma = np.sqrt(np.trace(other.covariance[:2, :2]))
        assert math.dist(one.centre, moved) <= FEW_SIGMAS * sigma
