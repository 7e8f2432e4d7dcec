import numpy as np
import pytest

from lsvision import PointNoise, Profile, ProfileSensor
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import build_range_image, find_connected_components
from tests.detection.scenes import PITCH, flat, line


def components_of(profile, smallest=3):
    return find_connected_components(build_range_image(profile), smallest)


def exact(points, noise_mm=1e-3):
    """Return exact points with a given noise."""
    return prepare_profile(
        Profile(points), PointNoise(np.tile(np.diag([0, noise_mm**2]), (len(points), 1, 1)))
    )


def test_a_smooth_line_is_one_component_of_all_its_points():
    profile = line(flat(0, 60))
    (only,) = components_of(profile)
    np.testing.assert_array_equal(only, np.arange(100))


@pytest.mark.parametrize(("lost", "pieces"), [(1, 1), (5, 1), (6, 2), (20, 2)])
def test_a_few_lost_columns_are_bridged_and_many_cut(lost, pieces):
    points = flat(0, 60)
    points[40 : 40 + lost] = np.nan
    components = components_of(exact(points))
    assert len(components) == pieces
    assert sum(len(component) for component in components) == 100 - lost


@pytest.mark.parametrize(("height", "pieces"), [(0.3, 1), (10.0, 2), (-10.0, 2)])
def test_steps_cut_and_noise_does_not(height, pieces):
    assert len(components_of(line(flat(0, 30), flat(30, 60, y=-440 + height)))) == pieces


def test_a_step_cuts_at_the_step():
    left, right = components_of(line(flat(0, 30), flat(30, 60, y=-420)))
    np.testing.assert_array_equal(left, np.arange(50))
    np.testing.assert_array_equal(right, np.arange(50, 100))


@pytest.mark.parametrize("jumped", [[50], [50, 51], [30, 60, 90]], ids=["one", "two", "three"])
def test_points_that_jumped_away_lie_alone_and_do_not_cut(jumped):
    points = flat(0, 60)
    points[jumped, 1] += 15.0
    (only,) = components_of(line(points))
    np.testing.assert_array_equal(only, np.setdiff1d(np.arange(100), jumped))


@pytest.mark.parametrize(("slope", "pieces"), [(3.5, 1), (-3.5, 1), (4.5, 0), (-4.5, 0)])
def test_a_slope_of_76_degrees_is_followed(slope, pieces):
    assert len(components_of(exact(flat(0, 60, slope=slope)))) == pieces


@pytest.mark.parametrize("turn_deg", [-15.0, 8.0])
def test_rotation_about_the_origin_of_the_sensor_changes_neither_pitch_nor_connections(turn_deg):
    sensor = ProfileSensor()
    slopes = np.linspace(-8.0, 8.0, 120)  # some are connected, others are not
    points = np.column_stack([np.arange(120.0), -400 + slopes.cumsum()])
    cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    origin = np.array(sensor.origin)
    rotated = (points - origin) @ np.array([[cos, sin], [-sin, cos]]) + origin
    before, after = (prepare_profile(Profile(p), sensor) for p in (points, rotated))
    assert after.pitch == pytest.approx(before.pitch)
    connected = build_range_image(before).connected
    assert 0.2 < connected.mean() < 0.9
    np.testing.assert_array_equal(build_range_image(after).connected, connected)


@pytest.mark.parametrize(("sigmas", "stays"), [(5.0, True), (7.0, False)])
def test_six_sigma_are_no_jump(sigmas, stays):
    points = flat(0, 60)
    points[50, 1] += sigmas * 100.0
    (only,) = components_of(exact(points, noise_mm=100.0))
    assert (50 in only) == stays


@pytest.mark.parametrize(("pitches", "stays"), [(0.4, True), (0.6, False)])
def test_a_crest_of_half_a_pitch_is_no_jump(pitches, stays):
    points = flat(0, 60)
    points[50, 1] += pitches * PITCH
    (only,) = components_of(exact(points))
    assert (50 in only) == stays


def test_points_far_out_do_not_coarsen_the_rest():
    points = flat(0, 60)
    points[17] = (10.0, 1e8)
    (only,) = components_of(exact(points))
    np.testing.assert_array_equal(only, np.setdiff1d(np.arange(100), [17]))


@pytest.mark.parametrize("count", [0, 1])
def test_a_profile_without_a_line_has_no_components(count):
    assert components_of(prepare_profile(Profile(flat(0, 60)[:count]), None)) == []


def test_small_components_are_left_out():
    profile = line(flat(0, 30), flat(30, 33, y=-420), flat(33, 60))
    assert len(components_of(profile, smallest=3)) == 3
    assert len(components_of(profile, smallest=10)) == 2
