"""`fit_cylinder` on certified NIST data and simulated points; its invariants and errors."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lsvision.cylinder.fit import CylinderFittingSettings, fit_cylinder
from lsvision.cylinder.fit_result import format_axis_cells
from lsvision.ellipse.problem import RadiusPrior
from lsvision.errors import DegenerateGeometry, FitFailed, TooFewPoints
from lsvision.geometry import Cylinder, Pose

NIST = Path(__file__).parents[2].parent / "shared" / "real" / "nist-cylinders"
NIST_DIAMETER = 1e-6  # in the unit of the certificate
NIST_AXIS_DEG = 1e-5
MACHINE = 1e-9  # mm, rad: noise-free geometry below a metre
SIGMAS = 4.0  # one false alarm in 16 000 for each number
TURN = np.linspace(0.2, 2.6, 60)


def surface(cylinder: Cylinder, heights: np.ndarray, turns: np.ndarray = TURN) -> np.ndarray:
    """Points of a cylinder, computed independently of the tested code."""
    u = cylinder.direction
    side = np.cross(u, (1.0, 0.0, 0.0) if abs(u[0]) < 0.9 else (0.0, 1.0, 0.0))
    side /= np.linalg.norm(side)
    other = np.cross(u, side)
    round_ = np.outer(np.cos(turns), side) + np.outer(np.sin(turns), other)
    rings = [cylinder.point + h * u + cylinder.radius * round_ for h in heights]
    return np.concatenate(rings)


PIPE = Cylinder((30.0, -400.0, 12.0), (0.3, -0.2, 0.9), 19.0)


def axis_deg(first: np.ndarray, second: np.ndarray) -> float:
    return math.degrees(math.asin(min(1.0, float(np.linalg.norm(np.cross(first, second))))))


@pytest.mark.skipif(not NIST.is_dir(), reason="the NIST sets are not beside the repository")
@pytest.mark.parametrize("number", range(1, 16))
def test_nist_data_are_fitted_without_an_initial_guess(number: int) -> None:
    points = np.loadtxt(NIST / f"cyl{number}.ds", skiprows=1)
    answer = np.loadtxt(NIST / f"cyl{number}.fit").ravel()
    fit = fit_cylinder(points)
    assert abs(2 * fit.radius - answer[6]) < NIST_DIAMETER
    assert axis_deg(fit.direction, answer[3:6]) < NIST_AXIS_DEG


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("covered", [1.0, 2.4, 2 * math.pi])
def test_noise_free_points_yield_the_cylinder(scale: float, covered: float) -> None:
    turns = np.linspace(0.3, 0.3 + covered, 40, endpoint=False)
    points = surface(PIPE, np.array([-8.0, 0.0, 9.0]), turns) * scale
    fit = fit_cylinder(points)
    assert abs(fit.radius / scale - PIPE.radius) < 10 * MACHINE
    assert axis_deg(fit.direction, PIPE.direction) < math.degrees(MACHINE)
    assert np.abs(PIPE.signed_distances(fit.point / scale) + PIPE.radius) < 100 * MACHINE


def test_the_cylinder_transforms_with_the_points() -> None:
    rng = np.random.default_rng(3)
    points = surface(PIPE, np.array([0.0, 10.0])) + rng.normal(0, 0.05, (120, 3))
    cos, sin = math.cos(1.1), math.sin(1.1)
    pose = Pose([[1, 0, 0], [0, cos, -sin], [0, sin, cos]], (500.0, -20.0, 7.0))
    still, moved = fit_cylinder(points), fit_cylinder(pose.apply(points))
    expected = still.cylinder.transformed(pose)
    assert abs(moved.radius - expected.radius) < MACHINE
    assert axis_deg(moved.direction, expected.direction) < math.degrees(MACHINE)
    assert abs(moved.direction_std - still.direction_std) < 1e-6 * still.direction_std


def noisy(rng: np.random.Generator, std: float) -> tuple[np.ndarray, np.ndarray]:
    """Covariances of errors along the ray from the origin, as of a profile sensor."""
    exact = surface(PIPE, np.linspace(0.0, 20.0, 10))
    rays = exact / np.linalg.norm(exact, axis=1, keepdims=True)
    points = exact + rng.normal(0, std, len(exact))[:, None] * rays
    points += rng.normal(0, 0.05 * std, points.shape)
    return points, std**2 * (rays[:, :, None] * rays[:, None, :] + 0.0025 * np.eye(3))


def test_errors_agree_with_the_covariance() -> None:
    rng = np.random.default_rng(4)
    nees = []
    for _ in range(120):
        fit = fit_cylinder(*noisy(rng, 0.05), initial_guess=PIPE)
        off = fit.tangent_basis @ (PIPE.point - fit.point)
        errors = np.array([*off, *(fit.tangent_basis @ PIPE.direction), PIPE.radius - fit.radius])
        # The reference point of the fit is a different point of the axis.
        errors[:2] -= errors[2:4] * float((PIPE.point - fit.point) @ fit.direction)
        nees.append(errors @ np.linalg.solve(fit.covariance, errors) / 5)
    # 600 degrees of freedom: one sigma of the mean is 0.058.
    assert 0.8 < np.mean(nees) < 1.25


def test_curvature_does_not_bias_the_radius() -> None:
    rng = np.random.default_rng(5)
    fits = [fit_cylinder(*isotropic(rng, 1.0), initial_guess=PIPE) for _ in range(40)]
    left_in = 1.0**2 / (2 * PIPE.radius)
    bias = np.mean([fit.radius for fit in fits]) - PIPE.radius
    assert abs(bias) < SIGMAS * fits[0].radius_std / math.sqrt(40) < left_in / 2


def isotropic(rng: np.random.Generator, std: float) -> tuple[np.ndarray, np.ndarray]:
    exact = surface(PIPE, np.linspace(0, 60, 40), np.linspace(0, 2 * math.pi, 180, endpoint=False))
    return exact + rng.normal(0, std, exact.shape), np.tile(std**2 * np.eye(3), (len(exact), 1, 1))


def two_sections(
    rng: np.random.Generator, arc: tuple[float, float], outliers: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Points of two sections, 40 mm apart, and covariances of errors along X, the ray."""
    exact = surface(Cylinder((0, 0, 0), (0, 0, 1), 19.0), np.array([0.0, 40.0]), np.linspace(*arc))
    points = exact + rng.normal(0, [0.05, 0.0025, 0.0025], exact.shape)
    points[rng.choice(len(points), outliers, replace=False), 0] += rng.uniform(1, 3, outliers)
    return points, np.tile(np.diag([0.05, 0.0025, 0.0025]) ** 2, (len(points), 1, 1))


def test_the_noise_tells_two_arcs_from_a_cylinder_across_them() -> None:
    fits = [fit_cylinder(*two_sections(np.random.default_rng(k), (0.8, 2.0))) for k in range(8)]
    for fit in fits:
        assert abs(fit.radius - 19) < SIGMAS * fit.radius_std < 0.5
        assert fit.variance_factor < 2


def test_two_short_arcs_without_covariances_are_measured_rightly_or_rejected() -> None:
    """Errors within the planes hardly change the distances from a cylinder between them."""
    rejected = 0
    for k in range(20):
        points, covariances = two_sections(np.random.default_rng(k), (-0.55, 0.55))
        try:
            fit = fit_cylinder(points)
        except DegenerateGeometry:
            rejected += 1
            fit = fit_cylinder(points, covariances)
        assert abs(fit.radius - 19) < SIGMAS * fit.radius_std
    assert 4 <= rejected < 20


def test_the_rejection_of_two_short_arcs_says_what_to_add() -> None:
    points, _ = two_sections(np.random.default_rng(1), (-0.35, 0.35))
    with pytest.raises(DegenerateGeometry, match=r"two cylinders fit.* covariances, an initial gu"):
        fit_cylinder(points)


def test_a_known_radius_is_a_number_a_pair_or_a_prior() -> None:
    points, covariances = two_sections(np.random.default_rng(2), (0.8, 2.0))
    as_prior = fit_cylinder(points, covariances, known_radius=RadiusPrior(19.0, 0.01))
    assert fit_cylinder(points, covariances, known_radius=(19, 0.01)).radius == as_prior.radius
    assert abs(fit_cylinder(points, covariances, known_radius=19).radius - 19) < 1e-4
    with pytest.raises(ValueError, match="expected a positive known radius in mm, got nan"):
        fit_cylinder(points, known_radius=float("nan"))
    with pytest.raises(TypeError, match="known_radius"):
        fit_cylinder(points, known_radius="19")  # type: ignore[arg-type]


def test_short_arcs_of_two_opposite_sensors_are_measured() -> None:
    for k in range(10):
        one, _ = two_sections(np.random.default_rng(k), (-0.35, 0.35))
        other, _ = two_sections(np.random.default_rng(100 + k), (np.pi - 0.35, np.pi + 0.35))
        fit = fit_cylinder(np.concatenate([one, other]))
        assert abs(fit.radius - 19) < SIGMAS * fit.radius_std < 0.2


@pytest.mark.parametrize("known_noise", [False, True])
@pytest.mark.parametrize("outliers", [0, 6, 25])
def test_truncation_finds_the_cylinder_of_most_points(outliers: int, known_noise: bool) -> None:
    settings = CylinderFittingSettings(truncation=3.0)
    for seed in range(4):
        points, noise = two_sections(np.random.default_rng(seed), (0.3, 2.4), outliers)
        fit = fit_cylinder(points, noise if known_noise else None, settings=settings)
        assert abs(fit.radius - 19) < SIGMAS * fit.radius_std < 0.25
        assert fit.inliers.sum() <= 100 - outliers


def test_truncation_excludes_clutter() -> None:
    rng = np.random.default_rng(6)
    points, covariances = noisy(rng, 0.05)
    outward = points[::7] - PIPE.point
    outward -= np.outer(outward @ PIPE.direction, PIPE.direction)
    points[::7] += outward * rng.uniform(0.05, 0.3, (len(outward), 1))
    robust = CylinderFittingSettings(truncation=3.5)
    fit = fit_cylinder(points, covariances, initial_guess=PIPE, settings=robust)
    assert abs(fit.radius - PIPE.radius) < SIGMAS * fit.radius_std
    assert not fit.inliers[::7].any()


@pytest.mark.parametrize("known_noise", [True, False])
@pytest.mark.parametrize("truncation", [1.5, 2.0, 1e300])
def test_a_truncated_fit_deviates_as_its_covariance_states(
    truncation: float, known_noise: bool
) -> None:
    rng, count = np.random.default_rng(8), 60
    settings = CylinderFittingSettings(truncation=truncation)
    exact = surface(PIPE, np.linspace(0, 30, 4), np.linspace(0.2, 2.6, 50))
    covariances = np.tile(0.02**2 * np.eye(3), (len(exact), 1, 1)) if known_noise else None
    chi2 = 0.0
    for _ in range(count):
        points = exact + rng.normal(0, 0.02, exact.shape)
        fit = fit_cylinder(points, covariances, initial_guess=PIPE, settings=settings)
        tilt = fit.tangent_basis @ PIPE.direction
        errors = np.array([*tilt, fit.radius - PIPE.radius])
        stds = np.sqrt(fit.covariance.diagonal()[2:])
        chi2 += float((errors / stds) @ (errors / stds))
    assert chi2 / (3 * count) < 1 + SIGMAS * math.sqrt(2 / (3 * count))


def test_a_prior_radius_reduces_the_error_of_the_axis() -> None:
    points, covariances = noisy(np.random.default_rng(7), 0.05)
    free = fit_cylinder(points, covariances, initial_guess=PIPE)
    bound = fit_cylinder(points, covariances, initial_guess=PIPE, known_radius=RadiusPrior(19.0))
    assert bound.radius_std < 1e-4
    assert bound.position_std < free.position_std


@pytest.mark.parametrize("known_noise", [True, False])
@pytest.mark.parametrize("prior_std", [0.01, 0.05])
def test_a_prior_radius_keeps_its_std_beside_points_with_correlated_errors(
    prior_std: float, known_noise: bool
) -> None:
    rng, count, neighbours = np.random.default_rng(3), 40, 6
    turns, heights = np.linspace(0, 1, 40), np.linspace(0, 30, 5)
    normalised = []
    for _ in range(count):
        tube = Cylinder(PIPE.point, PIPE.direction, 19 + rng.normal(0, prior_std))
        points = surface(tube, heights, turns)
        normals = (surface(Cylinder(PIPE.point, PIPE.direction, 20.0), heights, turns)
                   - surface(PIPE, heights, turns))  # fmt: skip
        noise = rng.normal(0, 0.02, len(points) + neighbours - 1)
        smooth = np.convolve(noise, np.ones(neighbours) / math.sqrt(neighbours), "valid")
        covariances = np.tile(0.02**2 * np.eye(3), (len(points), 1, 1)) if known_noise else None
        fit = fit_cylinder(
            points + smooth[:, None] * normals, covariances,
            initial_guess=PIPE, known_radius=RadiusPrior(19.0, prior_std),
        )  # fmt: skip
        assert fit.radius_std < 1.001 * prior_std
        normalised.append((fit.radius - tube.radius) / fit.radius_std)
    assert np.mean(np.square(normalised)) < 1 + SIGMAS * math.sqrt(2 / count)


def test_with_reference_point_propagates_the_covariance() -> None:
    points, covariances = noisy(np.random.default_rng(8), 0.05)
    fit = fit_cylinder(points, covariances)
    there = fit.with_reference_point(fit.point + 1000.0 * fit.direction)
    assert there.position_std > 900 * fit.direction_std
    np.testing.assert_allclose(
        there.with_reference_point(fit.point).covariance, fit.covariance, rtol=1e-6
    )


def test_reversing_the_direction_twice_changes_nothing() -> None:
    fit = fit_cylinder(*noisy(np.random.default_rng(9), 0.05))
    again = fit.with_reversed_direction().with_reversed_direction()
    np.testing.assert_allclose(again.covariance, fit.covariance, rtol=1e-12)
    np.testing.assert_array_equal(again.direction, fit.direction)


RINGS = surface(PIPE, np.array([0.0, 10.0]))


@pytest.mark.parametrize(
    ("points", "error", "message"),
    [
        (RINGS[:5], TooFewPoints, "a cylinder has 5 points and needs 6"),
        (RINGS[:, :2], ValueError, r"expected points of shape \(n, 3\)"),
        (np.full((9, 3), np.nan), ValueError, "expected finite points"),
        (np.outer(np.arange(9.0), [1, 2, 3]), DegenerateGeometry, "on one straight line"),
        (
            surface(PIPE, np.array([0.0])),
            DegenerateGeometry,
            "the twins, fit one section: add a second section",
        ),
        (np.ones((9, 3)), DegenerateGeometry, "all 9 points lie within 1e-09 mm"),
        (RINGS * 1e12, ValueError, r"expected finite coordinates within 1e\+09 mm"),
    ],
    ids=["five", "flat", "nan", "line", "one section", "one point", "far"],
)
def test_invalid_points_raise_errors(
    points: np.ndarray, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        fit_cylinder(points)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"initial_guess": 19}, "expected initial_guess as lsvision.Cylinder, got int"),
        ({"settings": 3}, "expected settings as lsvision.CylinderFittingSettings, got int"),
        ({"settings": None}, "expected settings as lsvision.CylinderFittingSettings, got NoneType"),
    ],
)
def test_arguments_of_another_type_raise_an_error(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(TypeError, match=message):
        fit_cylinder(RINGS, **wrong)


def few_points(rng: np.random.Generator, count: int) -> np.ndarray:
    """Points of two rings with errors of 0.05 mm."""
    turns = np.linspace(0, 2.4, 4)
    exact = surface(PIPE, np.array([0.0, 20.0]), turns)
    return (exact + rng.normal(0, 0.05, exact.shape))[:count]


def test_the_noise_of_less_than_8_points_is_not_estimated() -> None:
    rng = np.random.default_rng(1)
    for count in (6, 7):
        with pytest.raises(TooFewPoints, match=rf"without covariances has {count} .* needs 8"):
            fit_cylinder(few_points(rng, count), initial_guess=PIPE)
    with pytest.raises(TooFewPoints, match=r"without covariances has 6 .* needs 7"):
        fit_cylinder(few_points(rng, 6), initial_guess=PIPE, known_radius=19.0)
    covariances = np.tile(0.05**2 * np.eye(3), (6, 1, 1))
    assert fit_cylinder(few_points(rng, 6), covariances, initial_guess=PIPE).radius_std > 0.02
    exact = surface(PIPE, np.array([0.0, 20.0]), np.linspace(0, 2.4, 3))
    assert fit_cylinder(exact).radius == pytest.approx(19, abs=1e-6)


def test_intervals_of_8_points_hold_the_radius() -> None:
    rng, count = np.random.default_rng(2), 100
    held = 0
    for _ in range(count):
        low, high = fit_cylinder(few_points(rng, 8), initial_guess=PIPE).interval("radius")
        held += low < PIPE.radius < high
    assert held >= 0.95 * count - SIGMAS * math.sqrt(0.95 * 0.05 * count)


def test_a_wrong_number_of_covariances_raises_an_error() -> None:
    with pytest.raises(ValueError, match=r"expected covariances of shape \(120, 3, 3\)"):
        fit_cylinder(RINGS, np.zeros((5, 3, 3)))


def test_the_initial_guess_selects_the_twin_of_one_section() -> None:
    tilted = Cylinder((0, 0, 0), (0.0, 0.4, 1.0), 10.0)
    section = tilted.section()
    points = np.column_stack([section.points_at(TURN), np.zeros(len(TURN))])
    for twin in Cylinder.twins(section):
        fit = fit_cylinder(points, initial_guess=twin)
        assert axis_deg(fit.direction, twin.direction) < 1e-3


def test_an_initial_guess_far_from_the_axis_leads_to_the_same_fit(rng) -> None:
    points = surface(PIPE, np.linspace(0.0, 60.0, 6), np.linspace(0.0, 4.0, 40))
    points += rng.normal(0, 0.05, points.shape)
    near = fit_cylinder(points, initial_guess=PIPE)
    for side in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
        far = Cylinder(PIPE.point, PIPE.direction + 0.6 * np.array(side), 25.0)
        fit = fit_cylinder(points, initial_guess=far)
        assert abs(fit.radius - near.radius) < 1e-6 * near.radius_std
        assert axis_deg(fit.direction, near.direction) < 1e-6 * math.degrees(near.direction_std)


def test_a_noisy_plane_raises_an_error() -> None:
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-50, 50, (200, 2)), np.zeros(200)])
    points[0, 2] = 1e-3
    with pytest.raises((FitFailed, DegenerateGeometry)):
        fit_cylinder(points)


def test_the_radius_of_a_plane_is_reported_in_any_unit_as_a_multiple_of_the_extent() -> None:
    x, z = np.random.default_rng(1).uniform(-50, 50, (2, 200))
    beside = Cylinder((0.0, -50.0, 0.0), (0.0, 0.0, 1.0), 50.0)
    with pytest.raises(FitFailed, match=r"radius \d\S+ times their extent"):
        fit_cylinder(np.column_stack([x, 0 * x, z]), initial_guess=beside)


@pytest.mark.parametrize(
    ("slip", "message"),
    [
        ({"reweightings": 0}, "at least one reweighting"),
        ({"truncation": 0.5}, "truncation above 1"),
    ],
)
def test_settings_out_of_range_raise_an_error(slip: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        CylinderFittingSettings(**slip)


@pytest.mark.parametrize("radius", [0.5, 1.0, 19.0, 5000.0])
@pytest.mark.parametrize("length", [0.1, 2.0, 10.0, 30.0, 100.0])
def test_slender_and_short_pipes_are_fitted_without_an_initial_guess(radius, length) -> None:
    """Two and three rings, which a cylinder across the long axis nearly fits as well."""
    rng = np.random.default_rng([int(10 * radius), int(10 * length)])
    for rings in (2, 3):
        axis, offset = rng.normal(size=3), rng.normal(size=3) * 1000
        pipe = Cylinder(offset, axis / np.linalg.norm(axis), radius)
        turns = np.linspace(0.0, 2.0, 30) + rng.uniform(0, 6)
        fit = fit_cylinder(surface(pipe, np.linspace(0, length * radius, rings), turns))
        assert abs(fit.radius / radius - 1) < 1e-6
        assert axis_deg(fit.direction, pipe.direction) < 1e-4


@pytest.mark.parametrize("std", [0.02, 0.1, 1.0])
def test_a_known_radius_weighs_as_its_std_says_also_without_covariances(rng, std):
    points = RINGS + rng.normal(0, 0.05, RINGS.shape)
    covariances = np.tile(0.05**2 * np.eye(3), (len(points), 1, 1))
    known = RadiusPrior(PIPE.radius + std, std)
    given, estimated = (fit_cylinder(points, c, known_radius=known) for c in (covariances, None))
    assert estimated.radius == pytest.approx(given.radius, abs=0.3 * given.radius_std)
    assert estimated.radius_std == pytest.approx(given.radius_std, rel=0.3)


def test_a_coordinate_that_is_rounded_to_zero_has_no_minus() -> None:
    fit = SimpleNamespace(
        radius=19.0, radius_std=0.1, direction=(-1e-9, 0.0, 1.0), direction_std=0.01,
        point=(-0.01, -400.0, -0.2), position_std=12.0,
    )  # fmt: skip
    cells = format_axis_cells(fit)
    assert cells[1] == "+0.000 +0.000 +1.000"
    assert cells[3] == "0 -400 0"
