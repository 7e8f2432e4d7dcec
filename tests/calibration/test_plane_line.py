"""Line of a plane in a profile: accuracy in clutter, errors."""

import numpy as np
import pytest

from lsvision.calibration.hand_eye import calibrate_hand_eye_plane
from lsvision.calibration.plane_line import find_plane_line
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
