"""Whatever a profile holds: no undocumented exception, no NaN, no input changed."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lsvision import Profile, ProfileSensor, measure_cylinders
from lsvision.studies.chen_liu_2016 import measure_cylinders_paper
from tests.strategies import PROPERTY, random_profiles

# Random profiles are of any size, also of one that no sensor sees.
pytestmark = pytest.mark.filterwarnings(
    "ignore:expected a profile in mm:UserWarning",
    "ignore:.* looks like a marker of lost points:UserWarning",
)
SENSORS = st.sampled_from([None, ProfileSensor(), ProfileSensor(range_std=1.0, quantum=0.1)])


def assert_sound(measurement, profile):
    """Every number is one, inside its range; indices are points that are there."""
    for cylinder in measurement.cylinders:
        numbers = (*cylinder.centre, cylinder.radius, cylinder.theta, cylinder.phi,
                   cylinder.radius_std, cylinder.theta_std, cylinder.phi_std)  # fmt: skip
        assert np.isfinite(numbers).all()
        assert np.isfinite(cylinder.covariance).all()
        assert cylinder.radius > 0
        assert 0 <= cylinder.theta < math.pi
        assert 0 <= cylinder.phi < math.pi / 2
        assert min(cylinder.radius_std, cylinder.theta_std, cylinder.phi_std) > 0
        assert np.isfinite(profile.points[cylinder.indices]).all()
        low, high = cylinder.interval("radius")
        assert low <= cylinder.radius <= high
    for rejection in measurement.rejections:
        assert 0 <= rejection.arc.start < rejection.arc.stop <= len(profile)
        assert "nan" not in rejection.reason


@PROPERTY
@given(random_profiles(), SENSORS)
def test_any_profile_is_measured_without_breaking(profile, sensor):
    before = profile.points.copy()
    assert_sound(measure_cylinders(profile, sensor=sensor), profile)
    np.testing.assert_array_equal(profile.points, before)


@PROPERTY
@given(random_profiles())
def test_a_search_range_or_known_radius_never_breaks(profile):
    assert_sound(measure_cylinders(profile, radius=(5.0, 50.0)), profile)
    assert_sound(measure_cylinders(profile, known_radius=(20.0, 1.0)), profile)


@pytest.mark.slow
@PROPERTY
@given(random_profiles())
def test_the_papers_chain_never_breaks(profile):
    measure_cylinders_paper(profile, radius=(5.0, 50.0))


def test_a_hundred_thousand_points_are_measured(rng):
    x = np.linspace(-150, 150, 100_000)
    height = np.sqrt(np.maximum(400.0 - x * x, 0)) - 440
    points = np.column_stack([x, height + 0.05 * rng.normal(size=len(x))])
    (pipe,) = measure_cylinders(Profile(points), radius=(15, 25)).cylinders
    assert pipe.radius == pytest.approx(20.0, abs=5 * pipe.radius_std)
