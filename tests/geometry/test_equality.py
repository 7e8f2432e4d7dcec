"""Values with arrays are compared by what they hold."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lsvision
from lsvision.geometry import Cylinder, Plane, Pose
from lsvision.geometry.equality import ComparedByValue
from lsvision.profile import PointNoise, Profile
from tests.strategies import PROPERTY

POINTS = [[0.0, -400.0], [np.nan, 0.0], [1.0, -401.0]]
VALUES = {
    "pose": lambda: Pose(translation=(1.0, 2.0, 3.0)),
    "plane": lambda: Plane((0.0, 0.6, 0.8), 100.0),
    "cylinder": lambda: Cylinder((0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 19.0),
    "profile": lambda: Profile(POINTS, PointNoise(np.ones((3, 2, 2)))),
}
PUBLIC_VALUES = [
    name
    for name in lsvision.__all__
    if dataclasses.is_dataclass(getattr(lsvision, name))
    and isinstance(getattr(lsvision, name), type)
]


@pytest.mark.parametrize("make", VALUES.values(), ids=VALUES)
def test_the_same_content_is_equal_and_has_the_same_hash(make):
    one, other = make(), make()
    assert one == other
    assert hash(one) == hash(other)
    assert one == copy.deepcopy(one) == pickle.loads(pickle.dumps(one))
    assert len({one, other}) == 1


def test_other_content_is_not_equal():
    assert Profile(POINTS) != Profile(POINTS[:2])
    assert Profile(POINTS) != Profile(POINTS, PointNoise(np.ones((3, 2, 2))))
    assert Pose() != Pose(translation=(0.0, 0.0, 1e-12))
    assert Plane((0.0, 0.0, 1.0), 1.0) != Plane((0.0, 0.0, 1.0), 2.0)


def test_another_class_is_not_equal():
    assert Pose() != Plane((0.0, 0.0, 1.0), 1.0)
    assert (Pose() == "pose", Pose() == np.eye(4)) == (False, False)


@dataclasses.dataclass(frozen=True, eq=False)
class WithOptionalArray(ComparedByValue):
    covariance: np.ndarray | None


@pytest.mark.parametrize("other", [None, 1.0])
def test_a_value_with_an_array_differs_from_one_without(other):
    assert WithOptionalArray(np.eye(2)) != WithOptionalArray(other)
    assert WithOptionalArray(other) != WithOptionalArray(np.eye(2))


def test_the_two_zeros_are_equal_and_have_one_hash():
    one, other = Pose(translation=(0.0, 0.0, 1.0)), Pose(translation=(-0.0, 0.0, 1.0))
    assert one == other
    assert hash(one) == hash(other)


def test_rigs_are_compared_with_their_provenance():
    camera = lsvision.Camera([[600, 0, 32], [0, 600, 24], [0, 0, 1]], [], (64, 48))
    plane = Plane((0.0, 0.866, 0.5), 150.0)
    rigs = [lsvision.LightSection(camera, plane, {"date": day}) for day in ("1", "1", "2")]
    assert rigs[0] == rigs[1] != rigs[2]
    assert len(set(rigs)) == 2


@PROPERTY
@given(st.lists(st.floats(-1e3, 1e3) | st.just(float("nan")), min_size=2, max_size=8))
def test_equality_is_that_of_the_points(numbers):
    points = np.resize(np.array(numbers), (4, 2))
    changed = points.copy()
    changed[2] = [7e3, 1.0]
    profile, copy, other = (Profile(p, lost=()) for p in (points, points.copy(), changed))
    assert profile == copy
    assert hash(profile) == hash(copy)
    assert profile != other


@pytest.mark.parametrize("name", PUBLIC_VALUES)
def test_assignment_to_any_attribute_of_a_public_value_is_rejected_plainly(name):
    kind = getattr(lsvision, name)
    bare = object.__new__(kind)
    for attribute in ("radius", "anything", *(field.name for field in dataclasses.fields(kind))):
        with pytest.raises(dataclasses.FrozenInstanceError, match=f"field '{attribute}'"):
            setattr(bare, attribute, 1.0)
