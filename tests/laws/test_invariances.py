"""What must hold whatever the numbers are: rotate, translate, scale, mirror, reverse.

No noise model is given: the noise is then isotropic, estimated, and turns with the profile.
"""

import math

import numpy as np
import pytest

from lsvision import Profile, measure_cylinders
from lsvision.simulate import random_section
from tests.alike import turn_between

SAME = 1e-5  # relative and in units of the result's own sigma: other rounding, same points
SAME_SIGMAS = 0.25  # where the pixel grid falls otherwise a point at an arc's end may come or go

CASES = [("single", 1), ("single", 4), ("welded_pair", 7), ("planar", 3)]


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]} {case[1]}", scope="module")
def seen(request):
    points = random_section(*request.param, noise_mm=0.03).profile.points
    found = measure_cylinders(Profile(points)).cylinders
    assert found
    return points, found


def measured(points):
    return measure_cylinders(Profile(points)).cylinders


def turn_about(points, angle, pivot):
    cos, sin = math.cos(angle), math.sin(angle)
    return (points - pivot) @ np.array([[cos, sin], [-sin, cos]]) + pivot


def assert_alike(found, expected, sigmas):
    """Radius and phi alike, within a share of their own sigma."""
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        assert abs(one.radius - other.radius) <= sigmas * other.radius_std
        assert abs(one.phi - other.phi) <= sigmas * other.phi_std


@pytest.mark.parametrize("angle_deg", [-10.0, 3.0, 8.0])
def test_turning_a_profile_turns_theta_and_nothing_else(seen, angle_deg):
    points, expected = seen
    pivot = np.array([0.0, -420.0])
    angle = math.radians(angle_deg)
    found = measured(turn_about(points, angle, pivot))
    assert_alike(found, expected, SAME_SIGMAS)
    for one, other in zip(found, expected, strict=True):
        off = turn_between(other.theta + angle, one.theta)
        assert abs(off) <= SAME_SIGMAS * other.theta_std
        moved = turn_about(np.array([other.centre]), angle, pivot)[0]
        assert math.dist(one.centre, moved) <= SAME_SIGMAS * np.sqrt(
            np.trace(other.covariance[:2, :2])
        )


@pytest.mark.parametrize("shift", [(50.0, 0.0), (0.0, -100.0), (-1234.5, 678.9)])
def test_moving_a_profile_moves_the_centre_and_nothing_else(seen, shift):
    points, expected = seen
    found = measured(points + shift)
    assert_alike(found, expected, SAME_SIGMAS)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.indices, other.indices)
        np.testing.assert_allclose(one.centre, np.add(other.centre, shift), atol=1e-3)


@pytest.mark.parametrize("scale", [0.25, 2.0, 10.0])
def test_scaling_a_profile_scales_every_length(seen, scale):
    points, expected = seen
    found = measured(points * scale)
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.indices, other.indices)
        assert one.radius == pytest.approx(scale * other.radius, rel=SAME)
        assert one.radius_std == pytest.approx(scale * other.radius_std, rel=1e-3)
        assert one.phi == pytest.approx(other.phi, abs=SAME)
        assert turn_between(one.theta, other.theta) == pytest.approx(0, abs=1e-3)


def test_mirroring_a_profile_mirrors_theta(seen):
    points, expected = seen
    found = measured(points * (-1, 1))[::-1]
    assert_alike(found, expected, SAME_SIGMAS)
    for one, other in zip(found, expected, strict=True):
        assert abs(turn_between(one.theta, -other.theta)) <= SAME_SIGMAS * other.theta_std
        assert one.centre[0] == pytest.approx(-other.centre[0], abs=0.05)


def test_reversing_the_columns_reverses_the_indices_only(seen):
    points, expected = seen
    found = measured(points[::-1])
    assert_alike(found, expected, SAME_SIGMAS)
    for one, other in zip(found, expected, strict=True):
        back = set((len(points) - 1 - one.indices).tolist())
        common, either = back & set(other.indices.tolist()), back | set(other.indices.tolist())
        assert len(common) >= 0.97 * len(either)


def test_lost_columns_more_at_both_ends_change_nothing(seen):
    points, expected = seen
    lost = np.full((20, 2), np.nan)
    found = measured(np.concatenate([lost, points, lost]))
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.indices - 20, other.indices)
        assert one.radius == other.radius
