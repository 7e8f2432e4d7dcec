"""Two cylinders that fit the same points: arcs on opposite sides, in different planes."""

import numpy as np
import pytest

from lsvision.cylinder.alternatives import (
    CylinderComparison,
    angle_between_axes,
    build_in_plane_covariances,
    find_equivalent,
)
from lsvision.cylinder.fit import CylinderFittingSettings, fit_cylinder
from lsvision.cylinder.other_minima import find_other_minima
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import Cylinder, Pose

SIGMAS = 4.0  # one false alarm in 16 000 for each number
RADIUS, GAP = 25.0, 10.0  # mm
TUBE = Cylinder((0, 0, 0), (0, 0, 1), RADIUS)
TWIN_RADIUS = np.hypot(RADIUS, GAP / 2)
TWIN_TILT = np.arctan2(GAP, 2 * RADIUS)


def opposite_arcs(
    rng: np.random.Generator, arc_deg: float, std: float = 0.02, count: int = 60
) -> tuple[np.ndarray, np.ndarray]:
    """Top of the tube in the plane z = 0, bottom in z = 10; errors along the rays, -Y and +Y."""
    turns = np.radians(np.linspace(-arc_deg, arc_deg, count)) / 2
    x, y = RADIUS * np.sin(turns), RADIUS * np.cos(turns)
    top = np.column_stack([x, y + rng.normal(0, std, count), np.zeros(count)])
    bottom = np.column_stack([x, -y + rng.normal(0, std, count), np.full(count, GAP)])
    covariances = np.tile(np.diag([0.0, std**2, 0.0]), (2 * count, 1, 1))
    return np.concatenate([top, bottom]), covariances


@pytest.mark.parametrize("known_noise", [True, False])
@pytest.mark.parametrize("arc_deg", [60.0, 90.0, 120.0])
def test_opposite_arcs_are_measured_rightly_or_rejected(arc_deg: float, known_noise: bool) -> None:
    rejected = 0
    for seed in range(8):
        points, covariances = opposite_arcs(np.random.default_rng(seed), arc_deg)
        try:
            fit = fit_cylinder(points, covariances if known_noise else None)
        except DegenerateGeometry:
            rejected += 1
        else:
            assert abs(fit.radius - RADIUS) < SIGMAS * fit.radius_std
    assert (rejected == 8) if arc_deg == 60 else (rejected < 8)
    assert arc_deg < 120 or rejected == 0


def test_the_rejection_names_both_cylinders_and_what_decides() -> None:
    points, covariances = opposite_arcs(np.random.default_rng(0), 60.0)
    with pytest.raises(DegenerateGeometry, match=r"radii of 2\d\.\d+ mm and 2\d\.\d+ mm and 1\d"):
        fit_cylinder(points)
    fit = fit_cylinder(points, covariances, known_radius=(RADIUS, 0.02))
    assert angle_between_axes(fit.cylinder, TUBE) < SIGMAS * fit.direction_std
    fit = fit_cylinder(points, covariances, initial_guess=TUBE)
    assert abs(fit.radius - RADIUS) < SIGMAS * fit.radius_std


def test_a_third_section_decides() -> None:
    points, _ = opposite_arcs(np.random.default_rng(1), 60.0)
    third = points[:60] + np.array([0.0, 0.0, 2 * GAP])
    fit = fit_cylinder(np.concatenate([points, third]))
    assert abs(fit.radius - RADIUS) < SIGMAS * fit.radius_std


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (800.0, -400.0, 90.0)])
def test_the_other_minimum_is_found_from_either_cylinder(shift: tuple[float, ...]) -> None:
    points = opposite_arcs(np.random.default_rng(2), 60.0, std=0.002)[0] + shift
    second = Cylinder((0, 0, GAP / 2), (0, np.sin(TWIN_TILT), np.cos(TWIN_TILT)), TWIN_RADIUS)
    pair = [c.transformed(Pose(np.eye(3), shift)) for c in (TUBE, second)]
    for start, expected in (pair, pair[::-1]):
        found = find_other_minima(points, start, None)
        assert any(
            angle_between_axes(other, expected) < 0.02 and abs(other.radius - expected.radius) < 0.1
            for other in found
        )


def test_a_long_arc_has_no_equivalent_cylinder() -> None:
    points, covariances = opposite_arcs(np.random.default_rng(3), 150.0)
    fit = fit_cylinder(points, covariances)
    others = find_other_minima(points, fit.cylinder, None)
    assert find_equivalent(fit, others, CylinderComparison(points, covariances, True)) is None


def test_outliers_do_not_hide_the_other_cylinder() -> None:
    points, covariances = opposite_arcs(np.random.default_rng(4), 60.0)
    points[::9, 1] += 1.5
    with pytest.raises(DegenerateGeometry, match="two cylinders fit the points"):
        fit_cylinder(points, covariances, settings=CylinderFittingSettings(truncation=3.0))


def test_points_of_planes_have_errors_within_them() -> None:
    rng = np.random.default_rng(5)
    points, _ = opposite_arcs(rng, 60.0)
    pose = Pose(np.linalg.qr(rng.normal(size=(3, 3)))[0] * [1, 1, 1], (900.0, 20.0, -300.0))
    covariances = build_in_plane_covariances(points)
    assert covariances is not None
    np.testing.assert_allclose(covariances / covariances[0, 0, 0], [np.diag([1, 1, 0])] * 120)
    assert build_in_plane_covariances(points @ pose.rotation.T + pose.translation) is not None
    assert build_in_plane_covariances(points + rng.normal(0, 1e-3, points.shape)) is None
    assert build_in_plane_covariances(points[[*range(60), 60, 61, 62]]) is None


def one_sided_arcs(rng: np.random.Generator, arc_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Two sections of one side, 40 mm apart; a fifth of the points lies 1 to 3 mm inside."""
    turns = np.tile(np.radians(np.linspace(-arc_deg, arc_deg, 50)) / 2, 2)
    errors = rng.normal(0, 0.02, 100)
    outliers = rng.choice(100, 20, replace=False)
    errors[outliers] -= rng.uniform(1, 3, 20)
    y = 19 * np.cos(turns) + errors
    points = np.column_stack([19 * np.sin(turns), y, np.repeat([0.0, 40.0], 50)])
    return points, np.tile(np.diag([0.0, 0.02**2, 0.0]), (100, 1, 1))


@pytest.mark.parametrize("known_noise", [True, False])
@pytest.mark.parametrize("arc_deg", [40.0, 60.0])
def test_truncation_finds_short_arcs_of_one_side_among_outliers(
    arc_deg: float, known_noise: bool
) -> None:
    """A cylinder between both planes has half of the points nearby, too."""
    robust = CylinderFittingSettings(truncation=3.0)
    for seed in range(5):
        points, covariances = one_sided_arcs(np.random.default_rng(seed), arc_deg)
        fit = fit_cylinder(points, covariances if known_noise else None, settings=robust)
        assert abs(fit.radius - 19) < SIGMAS * fit.radius_std < 1
        assert 70 <= fit.inliers.sum() <= 82


def test_outliers_in_arcs_not_exactly_in_planes_are_measured_rightly_or_rejected() -> None:
    rng, robust = np.random.default_rng(6), CylinderFittingSettings(truncation=3.0)
    for seed in range(4):
        points, _ = one_sided_arcs(np.random.default_rng(seed), 40.0)
        try:
            fit = fit_cylinder(points + rng.normal(0, 1e-3, points.shape), settings=robust)
        except DegenerateGeometry:
            continue
        assert abs(fit.radius - 19) < SIGMAS * fit.radius_std
