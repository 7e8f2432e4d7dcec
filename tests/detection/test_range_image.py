import numpy as np
import pytest

from lsvision import Profile
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import (
    MAX_SIDE_PX,
    connected_components,
    rasterise,
)
from tests.detection.scenes import PITCH, flat, line


def components_of(profile, smallest=3):
    return connected_components(rasterise(profile), smallest)


def test_a_smooth_line_is_one_component_of_all_its_points():
    profile = line(flat(0, 60))
    (only,) = components_of(profile)
    np.testing.assert_array_equal(only, np.arange(100))


@pytest.mark.parametrize(("lost", "pieces"), [(1, 1), (3, 1), (8, 2)])
def test_a_few_lost_columns_are_bridged_and_many_cut(lost, pieces):
    points = flat(0, 60)
    points[50 : 50 + lost] = np.nan
    profile = prepare_profile(Profile(points), None)
    components = components_of(profile)
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


def test_a_slope_of_seventy_degrees_is_followed():
    assert len(components_of(line(flat(0, 60, slope=np.tan(np.radians(70)))))) == 1


def test_a_weighty_pixel_remembers_its_point():
    profile = line(flat(0, 60, slope=0.2))
    drawn = rasterise(profile)
    columns, rows = drawn.pixels.T
    assert (drawn.image[rows, columns] == 255).all()
    low = profile.points.min(axis=0)
    back = low + (drawn.pixels - 1) * drawn.pixel_mm
    assert np.abs(back - profile.points[drawn.indices]).max() <= drawn.pixel_mm / 2 + 1e-9


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_the_image_does_not_grow_with_the_profile(scale):
    rng = np.random.default_rng(2)
    points = np.column_stack([np.arange(3000) * PITCH, rng.uniform(-900, 900, 3000)]) * scale
    image = rasterise(prepare_profile(Profile(points), None)).image
    assert max(image.shape) <= MAX_SIDE_PX + 8


def test_rubbish_far_out_is_left_out():
    points = flat(0, 60)
    points[17] = (10.0, 1e12)
    drawn = rasterise(prepare_profile(Profile(points), None))
    assert 17 not in drawn.indices
    assert len(drawn.indices) == 99


@pytest.mark.parametrize("count", [0, 1])
def test_a_profile_without_a_line_has_an_empty_image(count):
    drawn = rasterise(prepare_profile(Profile(flat(0, 60)[:count]), None))
    assert len(drawn.indices) == 0
    assert connected_components(drawn, 1) == []


def test_small_components_are_left_out():
    profile = line(flat(0, 30), flat(30, 33, y=-420), flat(33, 60))
    assert len(components_of(profile, smallest=3)) == 3
    assert len(components_of(profile, smallest=10)) == 2
