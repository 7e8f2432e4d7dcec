"""Line of a plane in a profile: accuracy in clutter, errors."""

import numpy as np
import pytest

from lsvision.calibration.hand_eye import calibrate_hand_eye_plane
from lsvision.calibration.plane_line import find_plane_line, select_inliers
from lsvision.errors import TooFewPoints
from lsvision.profile import Profile
from tests.calibration.hand_eye_scenes import FEW_TRIALS, plane_scene

X = np.linspace(-40, 40, 400)
SLOPE, HEIGHT = 0.2, -150.0


def line_with_clutter(std, rng):
    y = HEIGHT + SLOPE * X + rng.normal(0, std, len(X))
    y[:60] += 12.0  # a step: another surface
    stray = rng.random(len(X)) < 0.15
    y[stray] = rng.uniform(-200, -100, stray.sum())
    return Profile(np.column_stack([X, y]))


@pytest.mark.parametrize("seed", range(5))
def test_the_longest_line_is_found_beside_a_step_and_outliers(seed):
    line = find_plane_line(line_with_clutter(0.05, np.random.default_rng(seed)))
    across = np.array([-SLOPE, 1.0]) / np.hypot(SLOPE, 1)
    offset = across @ (line.midpoint[:2] - (0, HEIGHT))
    slope = across @ line.direction[:2]
    stds = np.sqrt(np.diag(line.covariance))
    assert abs(offset) < 5 * stds[0]
    assert abs(slope) < 5 * stds[1]


def points_with_a_border_case():
    """A line and, at the limit of its outliers, points that change the line's fit."""
    for seed in range(400):
        rng = np.random.default_rng([8, seed])
        x = np.linspace(-40, 40, 120)
        y = HEIGHT + SLOPE * x + rng.normal(0, 0.1, len(x))
        stray = rng.random(len(x)) < 0.1
        y[stray] += rng.normal(0, 1.0, stray.sum())
        yield np.column_stack([x, y])


def next_selection(points, inliers):
    """Points within 3.5 robust standard deviations of the line through others; written out."""
    centre = points[inliers].mean(axis=0)
    normal = np.linalg.svd(points[inliers] - centre)[2][1]
    distance = np.abs((points - centre) @ normal)
    return distance <= 3.5 * 1.4826 * np.median(distance[inliers])


def test_two_selections_that_alternate_give_one_line():
    alternating = 0
    for points in points_with_a_border_case():
        first = select_inliers(points, np.ones(len(points), bool))
        second = next_selection(points, first)
        if np.array_equal(first, second):
            continue
        alternating += 1
        assert np.array_equal(next_selection(points, second), first)
        assert np.array_equal(select_inliers(points, second), first)
    assert alternating > 0


def test_a_profile_without_a_line_is_rejected():
    with pytest.raises(TooFewPoints, match="profile of the plane has 0 points"):
        find_plane_line(Profile(np.full((50, 2), np.nan)))


def test_a_profile_without_a_plane_is_listed_as_rejected():
    profiles, flanges = plane_scene(1)
    profiles[4] = Profile(np.full((640, 2), np.nan))
    found = calibrate_hand_eye_plane(profiles, flanges, settings=FEW_TRIALS)
    assert [pose.index for pose in found.rejected] == [4]
    assert "no line found" in found.rejected[0].reason


def test_a_profile_of_one_repeated_point_is_rejected():
    with pytest.raises(TooFewPoints, match="all points are equal"):
        find_plane_line(Profile(np.tile([1.1, 2.3], (30, 1))))
