"""Errors of the poses: what they do to the result is what the covariance says."""

import math

import numpy as np
import pytest

from lsvision.scan import PoseErrors, ScannedCylinder, measure_scan
from lsvision.shapes import Pose
from lsvision.simulate import Scene, Tube
from tests.scan.scans import feed, profiles_of

RUNS = 24
SHARE = 0.45  # three sigma of a standard deviation from 2 x 24 numbers


def errors_deg(found: list[ScannedCylinder], truth: Tube) -> float:
    """Root mean square angle to the truth."""
    sines = [np.linalg.norm(np.cross(c.direction, truth.cylinder.direction)) for c in found]
    return math.degrees(float(np.sqrt(np.mean(np.square(sines)))))


def test_feed_std_foretells_what_a_wrong_feed_does(pipe: Tube) -> None:
    rng = np.random.default_rng(1)
    std = math.radians(0.5)
    found = []
    for run in range(RUNS):
        profiles = profiles_of(Scene((pipe,)), feed(4, 15.0), seed=run)
        wrong = [Pose.along((*rng.normal(0, std, 2), 1.0), 15.0 * k) for k in range(4)]
        found += measure_scan(profiles, wrong, feed_std=std).cylinders
    stated = math.degrees(found[0].direction_std)
    assert stated > 0.5
    assert errors_deg(found, pipe) == pytest.approx(stated, rel=SHARE)


def test_a_wrong_feed_does_not_show_in_the_residuals(pipe: Tube) -> None:
    profiles = profiles_of(Scene((pipe,)), feed(4, 15.0))
    wrong = [Pose.along((math.radians(0.5), 0.0, 1.0), 15.0 * k) for k in range(4)]
    (right,), (off,) = (measure_scan(profiles, p).cylinders for p in (feed(4, 15.0), wrong))
    assert off.fit.rms < 1.05 * right.fit.rms  # in one scan, chance makes as much
    assert np.linalg.norm(np.cross(off.direction, right.direction)) > math.radians(0.35)


def test_pose_std_foretells_what_wavering_poses_do(pipe: Tube) -> None:
    rng = np.random.default_rng(2)
    found = []
    for run in range(RUNS):
        profiles = profiles_of(Scene((pipe,)), feed(5, 8.0), noise=0.02, seed=run)
        poses = [
            Pose(translation=(*rng.normal(0, 0.1, 2), rng.normal(8.0 * k, 0.1))) for k in range(5)
        ]
        found += measure_scan(profiles, poses, pose_std=0.1).cylinders
    stated = math.degrees(float(np.median([c.direction_std for c in found])))
    assert errors_deg(found, pipe) == pytest.approx(stated, rel=SHARE)


@pytest.mark.parametrize("slip", [{"pose_std": -1.0}, {"feed_std": math.nan}])
def test_errors_below_nothing_are_refused(slip: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"want {next(iter(slip))} >= 0"):
        PoseErrors(**slip)
