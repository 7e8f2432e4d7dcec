import copy
import math
import pickle

import numpy as np
import pytest

from lsvision import Arc, NoiseModel, PointNoise, Profile, ProfileSensor
from lsvision.geometry.noisy_points import NoisyPoints
from lsvision.profile import PreparedProfile

NAN, INF = math.nan, math.inf
THREE = [[0.0, -400.0], [NAN, NAN], [1.2, -399.8]]


@pytest.mark.parametrize(
    "row",
    [(NAN, -400.0), (0.0, NAN), (INF, -400.0), (0.0, -INF), (NAN, INF)],
    ids=["x lost", "z lost", "x infinite", "z infinite", "both"],
)
def test_a_row_with_one_lost_coordinate_is_lost_whole(row):
    profile = Profile([[0.0, -400.0], row, [1.0, -400.0]])
    np.testing.assert_array_equal(np.isnan(profile.points), [[0, 0], [1, 1], [0, 0]])
    assert (len(profile), profile.lost) == (3, 1)


def test_the_order_of_the_columns_is_kept():
    points = [[3.0, 1.0], [NAN, NAN], [-2.0, 5.0], [3.0, 1.0]]
    np.testing.assert_array_equal(Profile(points).points, points)


def test_a_profile_copies_what_it_is_given():
    given = np.array(THREE)
    profile = Profile(given)
    given[0] = 7.0
    np.testing.assert_array_equal(profile.points, THREE)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_a_copy_of_a_profile_is_read_only(copied):
    noise = PointNoise(np.tile(np.eye(2), (3, 1, 1)))
    profile = copied(Profile(THREE, noise))
    assert profile == Profile(THREE, noise)
    assert not profile.points.flags.writeable
    assert not profile.noise.point_covariances.flags.writeable


def test_a_profile_leaves_infinite_input_as_it_was():
    given = np.array([[0.0, INF]])
    Profile(given)
    np.testing.assert_array_equal(given, [[0.0, INF]])


def test_a_profile_cannot_be_changed():
    profile = Profile(THREE)
    with pytest.raises(ValueError, match="read-only"):
        profile.points[0, 0] = 1.0
    with pytest.raises(AttributeError):
        profile.points = np.zeros((1, 2))


def test_integers_and_lists_are_points_too():
    assert Profile([[1, 2]]).points.dtype == np.float64


@pytest.mark.parametrize("empty", [np.empty((0, 2)), [[NAN, NAN]] * 4], ids=["no rows", "all lost"])
def test_an_empty_profile_is_a_profile(empty):
    profile = Profile(empty)
    assert len(profile) == profile.lost == len(empty)


@pytest.mark.parametrize(
    ("points", "got"),
    [
        pytest.param([], r"\(0,\)", id="empty list"),
        pytest.param([1.0, 2.0], r"\(2,\)", id="one point"),
        pytest.param(np.zeros((5, 3)), r"\(5, 3\)", id="three columns"),
        pytest.param(np.zeros((2, 2, 2)), r"\(2, 2, 2\)", id="stack"),
    ],
)
def test_what_is_no_profile_is_rejected(points, got):
    with pytest.raises(ValueError, match=rf"expected points of shape \(n, 2\), got {got}"):
        Profile(points)


def test_words_are_no_profile():
    with pytest.raises(TypeError, match=r"array of numbers in mm, got list \[\['x', 'z'\]\]"):
        Profile([["x", "z"]])


def test_an_arc_is_half_open_and_keeps_lost_points():
    arc = Arc(1, 3)
    assert len(arc) == 2
    np.testing.assert_array_equal(arc.of(Profile(THREE)), THREE[1:3])


def test_arcs_are_compared_by_their_spans():
    assert {Arc(1, 3), Arc(1, 3), Arc(1, 4)} == {Arc(1, 3), Arc(1, 4)}


@pytest.mark.parametrize(("start", "stop"), [(3, 3), (4, 3), (-1, 3)])
def test_what_is_no_span_is_rejected(start, stop):
    with pytest.raises(ValueError, match=rf"expected 0 <= start < stop, got \[{start}, {stop}\)"):
        Arc(start, stop)


def test_point_noise_gives_what_it_was_given():
    values = np.tile(np.diag([0.01, 0.04]), (3, 1, 1))
    noise = PointNoise(values)
    values[:] = 0
    np.testing.assert_array_equal(noise.covariances(np.array(THREE))[1], np.diag([0.01, 0.04]))


def test_point_noise_belongs_to_its_points_only():
    with pytest.raises(ValueError, match="expected 2 points, got 3"):
        PointNoise(np.zeros((2, 2, 2))).covariances(np.array(THREE))


def test_point_noise_is_two_by_two():
    with pytest.raises(
        ValueError, match=r"expected covariances of shape \(n, 2, 2\), got \(3, 2\)"
    ):
        PointNoise(np.zeros((3, 2)))


def test_noise_models_are_known_by_what_they_can():
    assert isinstance(ProfileSensor(), NoiseModel)
    assert isinstance(PointNoise(np.zeros((0, 2, 2))), NoiseModel)
    assert not isinstance(Profile(THREE), NoiseModel)


@pytest.mark.parametrize(("value", "lost"), [(0.8e9, 0), (1.2e9, 1), (-1.2e9, 1)])
def test_a_point_further_away_than_a_thousand_kilometres_is_lost(value, lost):
    assert Profile([[0.0, -400.0], [value, -400.0], [0.0, 0.0]]).lost == lost
    assert Profile([[0.0, -400.0], [0.0, value]]).lost == lost


def max_noise_factor(radius, min_variance_factor, noise_std=0.1):
    nothing = np.empty((0, 2))
    profile = PreparedProfile(
        points=nothing,
        noisy_points=NoisyPoints.of(nothing, np.empty((0, 2, 2))),
        valid_indices=np.empty(0, dtype=int),
        sensor_columns=np.empty(0, dtype=int),
        noise_std=noise_std,
        pitch=0.6,
        min_variance_factor=min_variance_factor,
        ray=1j,
    )
    assert profile.noise_is_estimated == (min_variance_factor < 1)
    return profile.max_noise_factor(radius)


def test_estimated_noise_may_be_more_wrong_than_a_given_model():
    assert max_noise_factor(1.0, min_variance_factor=1.0) == 3.0
    assert max_noise_factor(1.0, min_variance_factor=0.25) == 4.0


def test_points_may_leave_their_ellipse_by_a_hundredth_of_the_radius_whatever_the_noise():
    assert max_noise_factor(100.0, 1.0, noise_std=1e-3) * 1e-3 == pytest.approx(1.0)
    assert max_noise_factor(100.0, 0.25, noise_std=1e-3) * 1e-3 == pytest.approx(1.0)


@pytest.mark.parametrize("lost", [INF, -INF, NAN, (-9999, INF)])
def test_a_marker_that_is_not_finite_removes_no_valid_point(lost):
    assert Profile([[0.0, -400.0], [0.6, INF], [1.2, -399.8]], lost=lost).lost == 1


def test_the_marker_0_removes_no_point_at_x_0():
    points = [[-1.0, -400.0], [0.0, 0.0], [0.0, -399.0], [1.0, 0.0]]
    assert np.isnan(Profile(points, lost=0).points[:, 0]).tolist() == [False, True, False, True]
