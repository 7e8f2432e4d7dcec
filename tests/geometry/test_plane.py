import math

import numpy as np
import pytest
from hypothesis import given

from lsvision import Plane
from tests.strategies import PROPERTY, directions, lengths, poses
from tests.tolerances import MACHINE


def test_a_normal_is_normalised_together_with_the_distance():
    plane = Plane((0, 0, 2), 10.0)
    np.testing.assert_array_equal(plane.normal, (0, 0, 1))
    assert plane.distance == 5.0


def test_distance_is_positive_on_the_side_of_the_normal():
    np.testing.assert_allclose(
        Plane((0, 1, 0), 3.0).signed_distances([[9, 5, 9], [0, 0, 0]]), [2, -3]
    )


@PROPERTY
@given(directions(), lengths, poses())
def test_transforming_preserves_distances(normal, distance, a_from_b):
    plane = Plane(normal, distance)
    points = np.array([[1.0, 2.0, 3.0], [-100.0, 50.0, 7.0]])
    seen = plane.transformed(a_from_b).signed_distances(a_from_b.apply(points))
    np.testing.assert_allclose(seen, plane.signed_distances(points), atol=MACHINE)


@pytest.mark.parametrize(
    ("normal", "distance", "message"),
    [
        ((0, 0, 0), 1.0, "a finite, non-zero normal"),
        ((0, math.nan, 1), 1.0, "a finite, non-zero normal"),
        ((0, 0, 1), math.inf, "a finite distance in mm, got inf"),
        ((0, 0, 1e-9), 1e300, r"a finite distance in mm, got 1e\+300"),
    ],
    ids=["no normal", "nan", "endless", "overflow"],
)
def test_an_invalid_plane_raises_an_error(normal, distance, message):
    with pytest.raises(ValueError, match=message):
        Plane(normal, distance)
