"""The search for other cylinders of the same points, from tilted initial guesses."""

import numpy as np
import pytest

from lsvision.cylinder.alternatives import (
    angle_between_axes,
    refine_cylinder,
    select_distinct_cylinders,
)
from lsvision.cylinder.other_minima import TILTS_DEG, find_other_minima
from lsvision.ellipse.problem import RadiusPrior
from lsvision.errors import FitFailed
from lsvision.geometry import Cylinder, build_tangent_frame

RADIUS = 25.0  # mm
MAX_INCREASE = 100.0  # of chi^2: above it a minimum is no candidate, and a fit may end elsewhere
SAME_ANGLE = np.radians(0.1)


def arcs(rng: np.random.Generator, arc_deg: float, gap: float, std: float, count: int):
    """Sections of a tube along Z, on top and below in turn."""
    turns = np.radians(np.linspace(-arc_deg, arc_deg, 40)) / 2
    x, y = RADIUS * np.sin(turns), RADIUS * np.cos(turns)
    return np.concatenate(
        [
            np.column_stack([x, (-1) ** k * y + rng.normal(0, std, 40), np.full(40, k * gap)])
            for k in range(count)
        ]
    )


def minima_one_by_one(points, cylinder, known_radius):
    """Other minima from the same tilts, about any two axes, by MINPACK."""
    origin = points.mean(axis=0)
    e_phi, e_theta, direction = build_tangent_frame(cylinder.direction)
    pivot = cylinder.point - origin
    pivot -= (pivot @ direction) * direction
    found = [Cylinder(cylinder.point - origin, direction, cylinder.radius)]
    for tilt in np.radians(TILTS_DEG):
        for side in (e_phi, e_theta, -e_phi, -e_theta):
            tilted = np.cos(tilt) * direction + np.sin(tilt) * side
            try:
                guess = Cylinder(pivot, tilted, cylinder.radius)
                found.append(refine_cylinder(points - origin, guess, known_radius))
            except FitFailed:
                continue
    return [
        Cylinder(other.point + origin, other.direction, other.radius)
        for other in select_distinct_cylinders(found)[1:]
    ]


@pytest.mark.parametrize("known_radius", [None, RadiusPrior(RADIUS, 0.3)])
@pytest.mark.parametrize("seed", range(12))
def test_fits_that_advance_together_find_the_minima_of_fits_one_by_one(seed, known_radius):
    rng = np.random.default_rng([5, seed])
    # The principal axes are those of the frame, X and Y, by symmetry.
    std, gap = 0.01, rng.uniform(6.0, 16.0)
    points = arcs(rng, rng.uniform(45.0, 75.0), gap, std, 2 + seed % 2)
    start = refine_cylinder(
        points - points.mean(axis=0), Cylinder((0, 0, 0), (0, 0, 1), RADIUS), None
    )
    start = Cylinder(start.point + points.mean(axis=0), start.direction, start.radius)

    def chi2(cylinder):
        return (cylinder.signed_distances(points) ** 2).sum() / std**2

    expected = [
        other
        for other in minima_one_by_one(points, start, known_radius)
        if chi2(other) < chi2(start) + MAX_INCREASE
    ]
    found = find_other_minima(points, start, known_radius)
    assert expected or seed % 2 or known_radius  # two sections have another minimum
    for other in expected:
        assert any(
            angle_between_axes(other, minimum) < SAME_ANGLE
            and minimum.radius == pytest.approx(other.radius, rel=1e-4)
            for minimum in found
        )


def test_exact_points_of_long_arcs_have_no_other_minimum_nearby():
    points = arcs(np.random.default_rng(0), 200.0, 10.0, 0.0, 3)
    tube = Cylinder((0, 0, 0), (0, 0, 1), RADIUS)
    for other in find_other_minima(points, tube, None):
        assert np.abs(other.signed_distances(points)).max() > 1.0


def test_points_of_a_plane_have_no_other_minimum():
    grid = np.stack(np.meshgrid(np.arange(8.0), np.arange(5.0), [0.0]), axis=-1).reshape(-1, 3)
    start = Cylinder((0, 0, -1e4), (1, 0, 0), 1e4)
    with np.errstate(all="raise"):
        found = find_other_minima(grid, start, None)
    assert all(np.isfinite([*other.point, other.radius]).all() for other in found)


def test_one_cylinder_is_returned_once_however_its_axis_points():
    tube = Cylinder((0, 0, 0), (0, 0, 1), RADIUS)
    reverse, tilted = Cylinder((0, 0, 0), (0, 0, -1), 20.0), Cylinder((0, 0, 0), (0, 0.01, 1), 20.0)
    assert select_distinct_cylinders([tube, reverse, tilted, tilted]) == [tube, tilted]
    assert select_distinct_cylinders([]) == []
