"""Closed sections: the arc that faces the sensor is extended to all points of its ellipse."""

import math

import numpy as np
import pytest

from lsvision import Ellipse, PointNoise, Profile, measure_cylinders
from lsvision.detection.arcs import IdentifiedArc
from lsvision.detection.closed_section import complete_closed_section
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.measure import measure_profiles

RADIUS, CENTRE, NOISE = 20.0, (3.0, -150.0), 0.05
TILTED = Ellipse(CENTRE, RADIUS / math.cos(math.radians(30)), RADIUS, 0.7)
CIRCLE = Ellipse(CENTRE, RADIUS, RADIUS, 0.0)


def around(rng, ellipse=TILTED, *, gaps_deg=(), start_deg=200.0, count=240):
    """Noisy points all around an ellipse, without those in the gaps (from, to)."""
    turn_deg = (start_deg + np.arange(count) * 360 / count) % 360
    kept = np.ones(count, dtype=bool)
    for first, last in gaps_deg:
        kept &= ~((turn_deg > first) & (turn_deg < last))
    exact = ellipse.points_at(np.radians(turn_deg[kept]) - ellipse.theta)
    return exact + NOISE * rng.normal(size=exact.shape)


def completed(points, ellipse=TILTED, noise=None):
    """The closed section of the arc of the points that face +Y and are on the ellipse."""
    profile = prepare_profile(Profile(points), noise)
    up = (profile.points[:, 1] > ellipse.centre[1]).nonzero()[0]
    return complete_closed_section(profile, IdentifiedArc(up, ellipse))


def test_all_points_are_measured_as_well_as_they_allow():
    """The bound of b is that of the residuals dm - dp cos 2t - dq sin 2t of a circle, nearly."""
    profiles = [Profile(around(np.random.default_rng([1, k]))) for k in range(100)]
    pipes = [pipe for m in measure_profiles(profiles) for pipe in m.cylinders]
    assert [len(pipe.indices) for pipe in pipes] == pytest.approx([240] * 100, abs=6)
    errors = np.array([pipe.radius - RADIUS for pipe in pipes])
    bound = NOISE * math.sqrt((1 + 2) / 240)
    assert np.sqrt(np.mean(errors**2)) < 1.2 * bound
    assert np.mean([pipe.radius_std for pipe in pipes]) == pytest.approx(bound, rel=0.2)
    intervals = np.array([pipe.interval("radius") for pipe in pipes])
    held = (intervals[:, 0] < RADIUS) & (intervals[:, 1] > RADIUS)
    assert held.mean() >= 0.9


@pytest.mark.parametrize("start_deg", [0.0, 90.0, 200.0, 290.0])
def test_neither_the_first_point_nor_the_order_matters(start_deg):
    points = around(np.random.default_rng(2))
    (pipe,) = measure_cylinders(points).cylinders
    first = round(start_deg / 1.5)
    for same in (np.roll(points, first, axis=0), points[::-1], points[points[:, 0].argsort()]):
        (again,) = measure_cylinders(same).cylinders
        assert again.radius == pytest.approx(pipe.radius, abs=0.05 * pipe.radius_std)
        assert len(again.indices) == len(pipe.indices)


@pytest.mark.parametrize("turn_deg", [20.0, 90.0, 180.0])
def test_rotating_the_points_rotates_the_section(turn_deg):
    """Its errors are isotropic, and no side of it is special."""
    points = around(np.random.default_rng(3)) - CENTRE
    cos, sin = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    rotated = points @ np.array([[cos, sin], [-sin, cos]])
    (pipe,) = measure_cylinders(points + CENTRE).cylinders
    (again,) = measure_cylinders(rotated + CENTRE).cylinders
    assert again.radius == pytest.approx(pipe.radius, abs=0.3 * pipe.radius_std)
    assert math.remainder(again.theta - pipe.theta, math.pi) == pytest.approx(
        math.remainder(math.radians(turn_deg), math.pi), abs=0.3 * pipe.theta_std
    )


@pytest.mark.parametrize(("gap_deg", "is_closed"), [(80.0, True), (100.0, False)])
def test_a_gap_of_90_deg_is_not_closed(gap_deg, is_closed, rng):
    gap = 270 - gap_deg / 2, 270 + gap_deg / 2
    assert (completed(around(rng, CIRCLE, gaps_deg=[gap]), CIRCLE) is not None) is is_closed


def test_three_sensors_around_a_pipe_are_a_closed_section(rng):
    gaps = [(5, 25), (125, 145), (245, 265)]
    (pipe,) = measure_cylinders(around(rng, gaps_deg=gaps)).cylinders
    assert len(pipe.indices) > 190
    assert abs(pipe.radius - RADIUS) < 4 * pipe.radius_std < 0.08


def test_noise_of_one_and_a_half_per_cent_does_not_hide_the_other_side():
    """The other side is searched within a tenth of the radius from the ellipse of the arc."""
    noise = 0.015 * RADIUS / NOISE
    exact = CIRCLE.points_at(np.radians(np.arange(80) * 4.5))
    for seed in range(20):
        rng = np.random.default_rng([7, seed])
        (pipe,) = measure_cylinders(exact + noise * NOISE * rng.normal(size=(80, 2))).cylinders
        assert len(pipe.indices) >= 76


def test_both_sides_of_a_wall_of_12_per_cent_are_closed_sections(rng):
    inner = Ellipse(CENTRE, 0.88 * RADIUS, 0.88 * RADIUS, 0.0)
    points = np.concatenate([around(rng, CIRCLE, start_deg=0), around(rng, inner, start_deg=0)])
    pipes = measure_cylinders(points).cylinders
    radii = sorted(pipe.radius for pipe in pipes)
    assert radii == pytest.approx([0.88 * RADIUS, RADIUS], abs=0.03)
    assert max(pipe.radius_std for pipe in pipes) < 0.01


def test_a_pipe_in_a_gutter_of_another_radius_is_no_closed_section(rng):
    turn = np.radians(np.arange(2, 180, 1.5))
    up = RADIUS * np.column_stack([np.cos(turn), np.sin(turn)])
    for ratio in (1.01, 1.05, 1.2):
        down = ratio * RADIUS * np.column_stack([np.cos(turn), 1 - 1 / ratio - np.sin(turn)])
        points = np.concatenate([up, down]) + CENTRE
        points += 0.4 * NOISE * rng.normal(size=points.shape)
        assert completed(points, CIRCLE) is None
        (pipe,) = measure_cylinders(points).cylinders
        low, high = pipe.interval("radius", 0.999)
        assert low < RADIUS < high


def test_outliers_are_left_out(rng):
    points = around(rng)
    outliers = rng.choice(240, 12, replace=False)
    points[outliers] += rng.uniform(0.1, 0.4, size=(12, 1)) * (points[outliers] - CENTRE)
    (pipe,) = measure_cylinders(points).cylinders
    assert not set(pipe.indices) & set(outliers)
    assert abs(pipe.radius - RADIUS) < 4 * pipe.radius_std < 0.03


def test_a_few_points_below_a_pipe_are_no_closed_section(rng):
    points = around(rng, CIRCLE, gaps_deg=[(181, 240), (248, 292), (300, 359)])
    below = points[:, 1] < CENTRE[1] - 5
    assert 0 < np.count_nonzero(below) < 12
    found = completed(points[~below], CIRCLE)
    assert found is None


def test_a_given_noise_is_kept(rng):
    points = around(rng)
    sensor = PointNoise(np.tile(np.diag([1e-4, 4e-4]), (len(points), 1, 1)))
    found = completed(points, noise=sensor)
    assert found.points.deviator == pytest.approx(-1.5e-4)
    assert completed(points).points.deviator == pytest.approx(0.0)


def test_the_lower_half_alone_is_concave(rng):
    points = around(rng, CIRCLE, gaps_deg=[(0, 180)])
    measurement = measure_cylinders(points)
    assert measurement.cylinders == ()
    assert "concave towards the sensor" in measurement.reason
