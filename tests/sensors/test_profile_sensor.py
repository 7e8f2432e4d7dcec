import math

import numpy as np
import pytest

from lsvision import LPS36, LPS36HI, ProfileSensor
from lsvision.geometry.arrays import require_covariances
from lsvision.sensors.profile_sensor import LATERAL_STD_RATIO
from tests.tolerances import ROUNDING

SENSOR = ProfileSensor(range_std=0.05, reference_range=400.0)


def stds_along_and_across(sensor, point):
    covariance = sensor.covariances(np.array([point]))[0]
    ray = np.subtract(point, sensor.origin)
    ray = ray / np.linalg.norm(ray)
    across = np.array([-ray[1], ray[0]])
    assert ray @ covariance @ across == pytest.approx(0, abs=ROUNDING)
    return math.sqrt(ray @ covariance @ ray), math.sqrt(across @ covariance @ across)


@pytest.mark.parametrize("point", [(0.0, -400.0), (240.0, -320.0), (-400.0, 0.0)])
def test_noise_lies_along_the_ray(point):
    along, across = stds_along_and_across(SENSOR, point)
    assert along == pytest.approx(math.hypot(0.05, 0.05 * LATERAL_STD_RATIO))
    assert across == pytest.approx(0.05 * LATERAL_STD_RATIO)


@pytest.mark.parametrize("factor", [0.5, 2.0, 3.0])
def test_noise_grows_with_the_square_of_the_range(factor):
    near, _ = stds_along_and_across(SENSOR, (30.0, -399.0))
    far, _ = stds_along_and_across(SENSOR, (30.0 * factor, -399.0 * factor))
    assert far == pytest.approx(near * factor**2)


def test_rays_start_at_the_origin_of_the_sensor():
    moved = ProfileSensor(range_std=0.05, origin=(50.0, 20.0))
    np.testing.assert_allclose(
        moved.covariances(np.array([[60.0, -380.0]])),
        SENSOR.covariances(np.array([[10.0, -400.0]])),
    )


def test_quantising_adds_a_twelfth_of_the_squared_quantum_to_both_coordinates():
    rough = ProfileSensor(range_std=0.05, quantum=0.12)
    points = np.array([[10.0, -400.0], [-80.0, -300.0]])
    added = rough.covariances(points) - SENSOR.covariances(points)
    np.testing.assert_allclose(added, np.tile(0.12**2 / 12 * np.eye(2), (2, 1, 1)), atol=ROUNDING)


def test_quantisation_variance_is_that_of_simulated_rounding(rng):
    values = rng.uniform(0, 100, 20000)
    error = np.round(values / 0.1) * 0.1 - values
    added = ProfileSensor(quantum=0.1).covariances(np.array([[0.0, -400.0]])) - SENSOR.covariances(
        np.array([[0.0, -400.0]])
    )
    assert np.var(error) == pytest.approx(added[0, 0, 0], rel=0.05)


def test_lost_points_have_no_covariance_and_the_origin_a_finite_one():
    covariances = SENSOR.covariances(np.array([[math.nan, math.nan], [0.0, 0.0]]))
    assert np.isnan(covariances[0]).all()
    assert np.isfinite(covariances[1]).all()


def test_covariances_of_the_farthest_points_are_those_that_a_fit_takes():
    loud = ProfileSensor(range_std=1000.0, reference_range=1e-3)
    quiet = ProfileSensor(range_std=1e-6, reference_range=1e6)
    for sensor in (SENSOR, loud, quiet):
        covariances = sensor.covariances(np.array([[1e9, -1e9], [0.0, -400.0], [0.0, 0.0]]))
        require_covariances(covariances)


def test_no_points_have_no_covariances():
    assert SENSOR.covariances(np.empty((0, 2))).shape == (0, 2, 2)


@pytest.mark.parametrize(
    ("sensor", "resolution", "at_mm"),
    [
        pytest.param(LPS36HI, 0.9, 600.0, id="LPS 36 HI, far end"),
        pytest.param(LPS36HI, 0.1, 200.0, id="LPS 36 HI, near end"),
        pytest.param(LPS36, 3.0, 800.0, id="LPS 36, far end"),
    ],
)
def test_presets_have_the_resolution_of_the_data_sheet(sensor, resolution, at_mm):
    along, _ = stds_along_and_across(sensor, (0.0, -at_mm))
    quantising = sensor.quantum / math.sqrt(12)
    # A resolution cell is taken as uniform; the preset is rounded to three digits.
    assert math.sqrt(along**2 - quantising**2) * math.sqrt(12) == pytest.approx(
        resolution, rel=0.01
    )


def test_presets_have_the_pitch_and_ranges_of_the_data_sheet():
    assert LPS36HI.width_at_max_range / LPS36HI.columns == pytest.approx(0.6, abs=0.02)
    assert (LPS36HI.min_range, LPS36HI.max_range) == (200.0, 600.0)
    assert (LPS36.min_range, LPS36.max_range, LPS36.columns) == (200.0, 800.0, 376)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"range_std": 0.0}, "expected a positive range_std in mm, got 0"),
        ({"range_std": math.nan}, "got nan"),
        ({"range_std": 1e-300}, "expected range_std from 1e-06 to 1000 mm, got 1e-300"),
        ({"range_std": 1e200}, "expected range_std from 1e-06 to 1000 mm, got 1e.200"),
        ({"reference_range": 1e-20}, "expected reference_range from 0.001 to 1e.06 mm, got 1e-20"),
        ({"reference_range": -400.0}, "positive reference_range in mm, got -400"),
        ({"min_range": 0.0}, "positive min_range"),
        ({"width_at_max_range": math.inf}, "positive width_at_max_range"),
        ({"max_range": 100.0}, "expected min_range < max_range, got 200.0 and 100.0 mm"),
        ({"max_range": math.inf}, "expected min_range < max_range, got 200.0 and inf mm"),
        ({"quantum": -0.1}, "expected quantum >= 0 mm, got -0.1"),
        ({"quantum": math.nan}, "expected quantum >= 0 mm, got nan"),
        ({"quantum": math.inf}, "expected quantum >= 0 mm, got inf"),
        ({"quantum": 1e300}, "expected quantum >= 0 mm, got 1e.300 .at most 1e.08 mm"),
        ({"columns": 0}, "expected a whole number of columns >= 1, got 0"),
        ({"columns": 3.5}, "expected a whole number of columns >= 1, got 3.5"),
        ({"origin": (math.nan, 0.0)}, "expected an origin .x, y. in mm, got"),
    ],
)
def test_invalid_values_are_rejected(changes, message):
    with pytest.raises(ValueError, match=message):
        ProfileSensor(**changes)
