"""Arc of a sphere in a profile: accuracy in clutter, symmetries, errors."""

import numpy as np
import pytest

from lsvision.calibration.sphere_arc import SphereArcSettings, find_sphere_arc
from lsvision.errors import CalibrationFailed, LsvisionError
from lsvision.profile import Profile
from lsvision.sensors.profile_sensor import ProfileSensor
from lsvision.simulate.hand_eye import SectionView, simulate_sphere_profile

EXACT = 1e-8  # mm
CENTRE, RADIUS = np.array([3.0, -300.0, 8.0]), 20.0
CIRCLE = np.array([3.0, -300.0, np.sqrt(RADIUS**2 - 8.0**2)])


def profile(std, seed=0):
    return simulate_sphere_profile(
        CENTRE, RADIUS, SectionView(range_std=std), np.random.default_rng(seed)
    )


def cluttered(std, seed=0):
    """Sphere beside a plate, with half of the columns scattered."""
    rng = np.random.default_rng(seed)
    points = np.array(profile(std, seed).points)
    lost = np.isnan(points[:, 0])
    x = np.linspace(-40, 40, len(points))
    plate = np.column_stack([x, np.full(len(x), -325.0)])
    points[lost] = plate[lost]
    stray = rng.random(len(points)) < 0.4
    stray &= lost | (rng.random(len(points)) < 0.3)
    points[stray, 1] = rng.uniform(-340, -260, stray.sum())
    return Profile(points)


def test_a_clean_arc_is_exact():
    np.testing.assert_allclose(find_sphere_arc(profile(0.0)).circle, CIRCLE, rtol=0, atol=EXACT)


@pytest.mark.parametrize("seed", range(5))
def test_the_arc_is_found_in_clutter_within_its_covariance(seed):
    arc = find_sphere_arc(cluttered(0.05, seed), max_radius=RADIUS)
    error = arc.circle - CIRCLE
    # 0.05 mm range noise; a few strays within the gate add less than their own sigma.
    assert error @ np.linalg.solve(arc.covariance, error) < 30


def test_points_are_weighted_by_the_noise_model():
    sensor = ProfileSensor(range_std=0.05, reference_range=300.0)
    known = Profile(profile(0.05).points, sensor)
    assert find_sphere_arc(known).circle == pytest.approx(CIRCLE, abs=0.1)


def test_shifting_the_profile_shifts_the_circle():
    shift = np.array([5.0, 7.0])
    here = find_sphere_arc(profile(0.05))
    there = find_sphere_arc(Profile(profile(0.05).points + shift))
    np.testing.assert_allclose(there.circle[:2], here.circle[:2] + shift, rtol=0, atol=1e-7)


PLATE = np.column_stack([np.linspace(-40, 40, 400), np.full(400, -300.0)])
NOISE = np.random.default_rng(0).uniform(-40, 40, (300, 2))
REJECTED = {
    "nothing": (np.full((100, 2), np.nan), "has 0 points"),
    "plate": (PLATE + np.random.default_rng(1).normal(0, 0.02, PLATE.shape), "covers . deg"),
    "concave": (np.array(profile(0.0).points) * (1, -1), "best arc"),
}


@pytest.mark.parametrize("case", REJECTED)
def test_a_profile_without_a_sphere_is_rejected(case):
    points, message = REJECTED[case]
    with pytest.raises(LsvisionError, match=message):
        find_sphere_arc(Profile(points))


def test_an_arc_that_is_too_short_is_rejected_with_its_angle():
    angle = np.radians(90 + np.linspace(-12.5, 12.5, 200))
    points = np.column_stack([15 * np.cos(angle), 15 * np.sin(angle) - 300])
    with pytest.raises(CalibrationFailed, match="covers 24 deg and 30 deg are needed"):
        find_sphere_arc(Profile(points))


@pytest.mark.parametrize(
    "numbers",
    [
        {"tolerance": 0.0},
        {"tolerance": np.nan},
        {"max_incidence": -1.0},
        {"trials": 0},
        {"min_coverage": np.nan},
        {"min_radius": -1.0},
        {"seed": -1},
    ],
)
def test_settings_that_find_no_arc_are_rejected(numbers):
    with pytest.raises(ValueError, match=f"expected .*{next(iter(numbers))}.*, got Sphere"):
        SphereArcSettings(**numbers)
