"""Two sections at right angles that cross on the axis: two cylinders fit them."""

import numpy as np
import pytest

from lsvision.geometry import Pose
from lsvision.scan import measure_scan
from lsvision.simulate import SCENE_SENSOR, Scene, Tube
from lsvision.simulate.hand_eye import rotation_from_vector
from tests.scan.scans import profiles_of

CENTRE = np.array([0.0, -400.0, 0.0])


def crossing(angle_deg: float) -> list[Pose]:
    """Two sections turned about X to both sides of the base frame's, about a point of the tube."""
    rotations = [
        rotation_from_vector([np.radians(sign * angle_deg / 2), 0.0, 0.0]) for sign in (-1, 1)
    ]
    return [Pose(rotation, CENTRE - rotation @ CENTRE) for rotation in rotations]


def angle_deg(first, second) -> float:
    return float(np.degrees(np.arccos(min(1.0, abs(first @ second)))))


@pytest.mark.parametrize("sensor", [None, SCENE_SENSOR], ids=["estimated noise", "stated noise"])
@pytest.mark.parametrize("seed", [5, 6, 7])
def test_sections_at_right_angles_in_the_axis_have_a_twin(seed, sensor):
    tube = Tube.of(19.0, np.radians(90.0), np.radians(10.0), tuple(CENTRE[:2]))
    poses = crossing(90.0)
    (found,) = measure_scan(
        profiles_of(Scene((tube,)), poses, seed=seed), poses, sensor=sensor
    ).cylinders
    assert found.ambiguous
    # The twin is the mirror image about the normal of one section, and so of the other.
    axis = tube.cylinder.direction
    mirrored = poses[0].rotation @ np.diag([-1.0, -1.0, 1.0]) @ poses[0].rotation.T @ axis
    errors = sorted(angle_deg(axis, pipe.direction) for pipe in (found, found.twin))
    assert errors[0] < 0.5
    assert errors[1] == pytest.approx(angle_deg(axis, mirrored), abs=0.5)


@pytest.mark.parametrize("degrees", [15.0, 40.0, 60.0])
def test_sections_that_cross_at_other_angles_determine_the_axis(degrees):
    tube = Tube.of(19.0, np.radians(90.0), np.radians(10.0), tuple(CENTRE[:2]))
    poses = crossing(degrees)
    (found,) = measure_scan(profiles_of(Scene((tube,)), poses, seed=8), poses).cylinders
    assert not found.ambiguous
    assert angle_deg(found.direction, tube.cylinder.direction) < np.degrees(4 * found.direction_std)
