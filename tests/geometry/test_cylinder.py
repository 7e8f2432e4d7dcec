import math

import numpy as np
import pytest
from hypothesis import given

from lsvision import Cylinder
from lsvision.geometry import orthogonal_residuals
from tests.alike import assert_same_axis, assert_same_ellipse
from tests.strategies import PROPERTY, cylinders, ellipses, poses
from tests.tolerances import MACHINE


def points_in_the_plane(cylinder, count=40):
    """Intersections of the cylinder's generatrices with z = 0, computed without an ellipse."""
    axis = cylinder.direction
    across = np.linalg.svd(axis[None])[2][1:]
    turn = np.linspace(0, 2 * math.pi, count, endpoint=False)
    ring = cylinder.radius * (np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1])
    start = cylinder.point + ring
    return (start - start[:, 2:] / axis[2] * axis)[:, :2]


@PROPERTY
@given(cylinders())
def test_the_section_contains_the_intersections_of_the_generatrices(cylinder):
    section = cylinder.section()
    far = np.hypot(*section.centre) + section.semi_major
    off = orthogonal_residuals(points_in_the_plane(cylinder), section)
    np.testing.assert_allclose(off, 0, atol=1e-12 * far + MACHINE)
    assert section.radius == cylinder.radius


@PROPERTY
@given(cylinders())
def test_one_of_the_twins_of_a_section_is_the_cylinder(cylinder):
    twins = Cylinder.twins(cylinder.section())
    sines = [np.linalg.norm(np.cross(twin.direction, cylinder.direction)) for twin in twins]
    # arccos(b / a) loses half the digits near b = a.
    assert_same_axis(twins[int(np.argmin(sines))].direction, cylinder.direction, atol=3e-8)


@PROPERTY
@given(ellipses())
def test_both_twins_have_the_same_section(ellipse):
    for twin in Cylinder.twins(ellipse):
        assert_same_ellipse(twin.section(), ellipse, atol=1e-7)


@PROPERTY
@given(cylinders(), poses())
def test_transforming_preserves_the_surface(cylinder, a_from_b):
    points = np.array([[1.0, 2.0, 3.0], [-100.0, 50.0, 7.0]])
    seen = cylinder.transformed(a_from_b).signed_distances(a_from_b.apply(points))
    np.testing.assert_allclose(seen, cylinder.signed_distances(points), atol=MACHINE)


def test_distance_is_positive_outside():
    rod = Cylinder((0, 0, 0), (0, 0, 2), 10.0)
    np.testing.assert_allclose(rod.signed_distances([[13, 0, 99], [0, 4, -5]]), [3, -6])
    np.testing.assert_allclose(rod.direction, (0, 0, 1))


def test_an_axis_in_the_section_plane_has_no_section():
    with pytest.raises(ValueError, match="parallel to it"):
        Cylinder((0, 0, 0), (1, 0, 0), 10.0).section()


@pytest.mark.parametrize(
    ("direction", "radius", "message"),
    [
        pytest.param((0, 0, 0), 1.0, "non-zero direction", id="no axis"),
        pytest.param((0, 0, math.nan), 1.0, "non-zero direction", id="nan"),
        pytest.param((0, 0, 1), 0.0, "expected a positive radius in mm, got 0", id="no radius"),
        pytest.param((0, 0, 1), -3.0, "got -3", id="negative"),
        pytest.param((0, 0, 1), math.inf, "got inf", id="endless"),
        pytest.param((0, 1), 1.0, r"direction of shape \(3\)", id="flat"),
    ],
)
def test_an_invalid_cylinder_raises_an_error(direction, radius, message):
    with pytest.raises(ValueError, match=message):
        Cylinder((0, 0, 0), direction, radius)


@pytest.mark.parametrize("coordinate", [math.nan, math.inf])
def test_a_point_that_is_not_finite_raises_an_error(coordinate):
    with pytest.raises(ValueError, match="expected a finite point in mm"):
        Cylinder((0, coordinate, 0), (0, 0, 1), 1.0)
