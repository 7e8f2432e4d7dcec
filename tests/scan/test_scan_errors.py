"""Poses and uncertainties of impossible size are rejected."""

import numpy as np
import pytest

from lsvision import Pose, Profile, Settings, fit_cylinder, measure_scan
from lsvision.errors import DegenerateGeometry
from lsvision.scan.joint_fit import JointFitSettings
from lsvision.scan.tracks import TrackSettings

ANGLE = np.linspace(2.6, 0.5, 60)
PIPE = Profile(20 * np.column_stack([np.cos(ANGLE), np.sin(ANGLE)]) - [0, 400])


@pytest.mark.parametrize("step", [1e10, 1e200, 1e308])
def test_poses_that_are_too_far_are_rejected(step):
    with pytest.raises(ValueError, match=r"expected finite coordinates within 1e\+09 mm"):
        measure_scan([PIPE, PIPE], [Pose(), Pose.along((0, 0, 1), step)])


@pytest.mark.parametrize(
    "errors", [{"pose_std": 1e9}, {"pose_std": np.nan}, {"feed_std": 10.0}, {"feed_std": -1.0}]
)
def test_uncertainties_that_are_none_are_rejected(errors):
    with pytest.raises(ValueError, match=r"expected (pose|feed)_std from 0 to 1"):
        measure_scan([PIPE, PIPE], [Pose(), Pose.along((0, 0, 1), 5.0)], **errors)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"calibration": Pose()}, "calibration as HandEye.load or .* returns it, got Pose"),
     ({"pose_std": (0.1, 0.1, 0.1)}, r"pose_std as a number in mm, got \(0.1, 0.1, 0.1\)"),
     ({"settings": Settings()}, r"expected ScanSettings, got Settings: .* ScanSettings\(section=")],
    ids=["calibration", "pose_std", "settings"],
)  # fmt: skip
def test_an_argument_of_another_type_is_rejected(arguments, message):
    with pytest.raises(TypeError, match=message):
        measure_scan([PIPE, PIPE], [Pose(), Pose.along((0, 0, 1), 5.0)], **arguments)


@pytest.mark.parametrize(
    ("settings", "values"),
    [(JointFitSettings, {"max_iterations": 0}), (JointFitSettings, {"trial_sections": 0}),
     (TrackSettings, {"window": 0})],
)  # fmt: skip
def test_settings_with_which_nothing_is_done_are_rejected(settings, values):
    with pytest.raises(ValueError, match="at least one"):
        settings(**values)


def test_an_uncertain_feed_needs_a_feed():
    poses = [Pose.along((0, 0, 1), z) for z in (0.0, 5.0, 0.0)]
    with pytest.raises(ValueError, match=r"feed_std 0.01 rad without a feed"):
        measure_scan([PIPE] * 3, poses, feed_std=0.01)


@pytest.mark.parametrize("scale", [1e-12, 1e-100, 1e-300])
def test_points_at_one_place_are_no_cylinder(scale):
    rng = np.random.default_rng(0)
    with pytest.raises(DegenerateGeometry, match="points lie within 1e-09 mm"):
        fit_cylinder(rng.normal(size=(20, 3)) * scale, np.tile(np.eye(3), (20, 1, 1)))
