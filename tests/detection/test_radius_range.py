import math

import numpy as np
import pytest

from lsvision import Profile
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.radius_range import find_radius_range
from lsvision.ellipse.problem import RadiusPrior
from tests.detection.scenes import flat

LINE = prepare_profile(Profile(flat(0, 150)), None)


@pytest.mark.parametrize(
    ("radius", "known", "expected"),
    [
        pytest.param((10, 40), None, (10.0, 40.0), id="range"),
        pytest.param(20.0, None, (16.0, 24.0), id="nominal"),
        pytest.param(20, None, (16.0, 24.0), id="whole number"),
        pytest.param(None, RadiusPrior(20.0), (16.0, 24.0), id="known exactly"),
        pytest.param(None, RadiusPrior(20.0, 1.0), (13.0, 27.0), id="known about"),
        pytest.param(None, RadiusPrior(20.0, 50.0), (4.0, 174.0), id="known hardly"),
        pytest.param((10.0, 40.0), RadiusPrior(5.0), (10.0, 40.0), id="range before known"),
    ],
)
def test_the_range_is_what_was_asked_for(radius, known, expected):
    assert find_radius_range(radius, known, LINE) == pytest.approx(expected)


def test_without_a_wish_the_range_follows_the_profile():
    low, high = find_radius_range(None, None, LINE)
    assert low == pytest.approx(math.sqrt(150 * 0.6) / 3, rel=0.01)
    assert high == pytest.approx(75 / math.sin(math.radians(19)), rel=0.01)


@pytest.mark.parametrize(
    ("count", "pitches"), [(150, 4.08), (400, 6.67), (4000, 21.1)], ids=["coarse", "usual", "fine"]
)
def test_the_smallest_radius_follows_the_number_of_points(count, pitches):
    x = 0.2 * np.arange(count)
    profile = prepare_profile(Profile(np.column_stack([x, 0 * x])), None)
    assert find_radius_range(None, None, profile)[0] == pytest.approx(0.2 * pitches, rel=0.01)


@pytest.mark.parametrize("points", [np.empty((0, 2)), [[1.0, 2.0]], [[1.0, 2.0]] * 5])
def test_profiles_without_an_extent_still_have_a_range(points):
    low, high = find_radius_range(None, None, prepare_profile(Profile(points), None))
    assert 0 < low < high < math.inf


@pytest.mark.parametrize(
    ("radius", "message"),
    [
        pytest.param(
            (40.0, 10.0), "expected a radius range 0 < min < max in mm, got 40 to 10", id="reversed"
        ),
        pytest.param((-5.0, 10.0), "got -5 to 10", id="negative"),
        pytest.param((0.0, 10.0), "got 0 to 10", id="from zero"),
        pytest.param((10.0, 10.0), "got 10 to 10", id="empty"),
        pytest.param((10.0, math.inf), "got 10 to inf", id="endless"),
        pytest.param((math.nan, 10.0), "got nan to 10", id="nan"),
        pytest.param(-19.0, "expected a positive radius in mm, got -19", id="negative nominal"),
        pytest.param(0.0, "positive radius", id="zero nominal"),
        pytest.param(math.nan, "got nan", id="nan nominal"),
        pytest.param(math.inf, "got inf", id="endless nominal"),
    ],
)
def test_what_is_no_radius_is_rejected(radius, message):
    with pytest.raises(ValueError, match=message):
        find_radius_range(radius, None, LINE)
