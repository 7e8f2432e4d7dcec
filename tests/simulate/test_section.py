"""Simulated sections: rays, noise, losses, jumps, labels and truth."""

import dataclasses
import math

import numpy as np
import pytest

from lsvision.geometry import Cylinder, Pose
from lsvision.profile import PointNoise
from lsvision.sensors.profile_sensor import ProfileSensor
from lsvision.simulate import (
    BentTube,
    Prism,
    Scene,
    SectionSettings,
    Tube,
    simulate_scan,
    simulate_section,
)
from lsvision.simulate.scene import find_longest_run

MACHINE = 1e-9  # mm
FIVE_SIGMA = 5.0  # a right simulator fails such a test once in a million seeds
SENSOR = ProfileSensor(range_std=0.05, columns=401, max_range=600.0, width_at_max_range=360.0)
IDEAL = SectionSettings.ideal()
TUBE = Tube.of(radius=25.0, theta=0.7, phi=0.5, centre=(8.0, -420.0))
PLATE = Prism([[-300.0, -500.0], [300.0, -480.0]])
SCENE = Scene((TUBE, PLATE))


def look(scene=SCENE, settings=IDEAL, sensor=SENSOR, seed=1, pose=None):
    rng = np.random.default_rng(seed)
    return simulate_section(scene, sensor, settings, rng=rng, base_from_section=pose)


def only(**changes):
    return dataclasses.replace(IDEAL, **changes)


def standard_errors(settings, seeds=40):
    """Errors along the ray over the sensor's sigma, and across it in mm."""
    along, across = [], []
    for seed in range(seeds):
        section = look(settings=settings, seed=seed)
        exact = section.truth.points
        ranges = np.linalg.norm(exact, axis=1)
        ray = exact / ranges[:, None]
        error = section.profile.points - exact
        sigma = 0.05 * (ranges / 400.0) ** 2
        along.append((error * ray).sum(axis=1) / sigma)
        across.append(error[:, 0] * ray[:, 1] - error[:, 1] * ray[:, 0])
    return np.array(along), np.array(across)


def test_without_errors_the_profile_is_the_truth():
    section = look()
    np.testing.assert_array_equal(section.profile.points, section.truth.points)
    own = section.truth.tubes[0].ellipse.to_ellipse_frame(
        section.profile.points[section.truth.labels == 1]
    )
    np.testing.assert_allclose(
        np.hypot(own[:, 0] * math.cos(0.5), own[:, 1]), 25.0, rtol=0, atol=1e-8
    )


def test_fan_rays_start_at_the_origin_with_equal_pitch_at_the_far_limit():
    plate = Scene((Prism([[-500.0, -599.9999999], [500.0, -599.9999999]]),))
    x = look(plate).profile.points[:, 0]
    np.testing.assert_allclose(x, np.linspace(-180.0, 180.0, 401), rtol=0, atol=1e-6)


def test_parallel_columns_have_equal_pitch_and_noise_along_y_only():
    section = look(settings=only(rays="parallel", noise_factor=1.0))
    x, y = (section.profile.points - section.truth.points).T
    assert np.abs(np.diff(section.profile.points[:, 0]) - 0.9).max() < MACHINE
    assert np.abs(x).max() == 0.0
    assert isinstance(section.profile.noise, PointNoise)
    sigma = np.sqrt(section.profile.noise.point_covariances[:, 1, 1])
    assert np.std(y / sigma) == pytest.approx(1.0, abs=FIVE_SIGMA / math.sqrt(2 * 401))


def test_noise_lies_along_the_ray_and_grows_with_range_squared():
    along, across = standard_errors(only(noise_factor=1.0))
    count = along.size
    assert np.abs(across).max() < MACHINE
    assert np.mean(along) == pytest.approx(0.0, abs=FIVE_SIGMA / math.sqrt(count))
    assert np.var(along) == pytest.approx(1.0, abs=FIVE_SIGMA * math.sqrt(2 / count))
    # Column by column too, near tube and far plate alike: no trend is left.
    by_column = np.var(along, axis=0)
    assert np.abs(by_column - 1).max() < 6 * math.sqrt(2 / 40)


def test_the_noise_model_of_the_profile_agrees_with_the_noise():
    section = look(settings=only(noise_factor=1.0))
    exact = section.truth.points
    ray = exact / np.linalg.norm(exact, axis=1, keepdims=True)
    covariances = section.profile.noise.covariances(exact)
    std = np.sqrt(np.einsum("ni,nij,nj->n", ray, covariances, ray))
    expected = 0.05 * (np.linalg.norm(exact, axis=1) / 400.0) ** 2
    # The model adds 5 % of sigma across the ray, 0.13 % along it.
    np.testing.assert_allclose(std, expected, rtol=2e-3)


def test_noise_factor_scales_the_noise_and_correlation_keeps_its_variance():
    along, _ = standard_errors(only(noise_factor=2.0, correlation_columns=2.0))
    # Errors blended over 2 columns: 2 sqrt(pi) * 2 = 7 columns act as one.
    spread = FIVE_SIGMA * math.sqrt(2 * 7.1 / along.size)
    assert np.var(along) / 4 == pytest.approx(1.0, abs=spread)
    neighbours = np.mean(along[:, 1:] * along[:, :-1]) / 4
    assert neighbours == pytest.approx(math.exp(-1 / 16), abs=spread)


def test_points_are_multiples_of_the_quantum():
    sensor = dataclasses.replace(SENSOR, quantum=0.1)
    points = look(sensor=sensor, settings=only(noise_factor=1.0)).profile.points
    np.testing.assert_allclose(points * 10, np.round(points * 10), rtol=0, atol=1e-9)
    assert np.abs(points - look(sensor=sensor).truth.points).max() < 0.05 + 5 * 0.08


@pytest.mark.parametrize(("fraction", "columns"), [(0.03, 401), (0.5, 401)])
def test_the_fraction_of_lost_columns(fraction, columns):
    lost = [look(settings=only(lost_fraction=fraction), seed=s).profile.lost for s in range(30)]
    spread = math.sqrt(fraction * (1 - fraction) / (30 * columns))
    assert np.sum(lost) / (30 * columns) == pytest.approx(fraction, abs=FIVE_SIGMA * spread)


def test_lost_columns_have_no_point_and_no_label():
    section = look(settings=SectionSettings())
    nan = np.isnan(section.profile.points[:, 0])
    assert nan.any()
    assert (section.truth.labels[nan] == -1).all()
    np.testing.assert_array_equal(nan, np.isnan(section.truth.points[:, 0]))


def test_runs_of_columns_can_be_lost_together():
    section = look(settings=only(lost_runs=1, lost_run_columns=6), seed=5)
    lost = np.flatnonzero(np.isnan(section.profile.points[:, 0]))
    assert 2 <= len(lost) <= 6
    assert (np.diff(lost) == 1).all()


def test_jumps_are_several_mm_along_the_ray_and_labelled():
    settings = only(jump_fraction=0.02, jump_mm=(3.0, 5.0))
    sections = [look(settings=settings, seed=seed) for seed in range(30)]
    labels = np.array([section.truth.labels for section in sections])
    error = np.array([s.profile.points - s.truth.points for s in sections])
    size = np.linalg.norm(error, axis=2)
    assert ((size[labels == -1] > 3 - MACHINE) & (size[labels == -1] < 5 + MACHINE)).all()
    assert size[labels >= 0].max() == 0.0
    # Pairs jump together, which makes the count a little more uneven than a coin's.
    spread = 1.3 * math.sqrt(0.02 / labels.size)
    assert np.mean(labels == -1) == pytest.approx(0.02, abs=FIVE_SIGMA * spread)


def test_beyond_the_grazing_limit_every_point_is_lost_and_none_well_before():
    section = look(settings=only(grazing_limit_deg=70.0, grazing_ramp_deg=5.0))
    full = look()
    on_tube = full.truth.labels == 1
    points = full.truth.points[on_tube]
    ellipse = full.truth.tubes[0].ellipse
    # Outward normal of the tube itself, from the 3-D gradient of its distance function.
    cylinder = Cylinder((8.0, -420.0, 0.0), full.truth.tubes[0].cylinder.direction, 25.0)
    relative = np.column_stack([points, np.zeros(len(points))]) - cylinder.point
    normal = relative - np.outer(relative @ cylinder.direction, cylinder.direction)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    ray = points / np.linalg.norm(points, axis=1, keepdims=True)
    incidence = np.degrees(np.arccos(-(normal[:, :2] * ray).sum(axis=1)))
    kept = ~np.isnan(section.profile.points[on_tube, 0])
    assert ellipse.radius == pytest.approx(25.0)
    assert not kept[incidence > 70.0].any()
    assert kept[incidence < 65.0].all()


def test_points_outside_the_measuring_range_are_lost():
    near, far = Prism([[-50.0, -150.0], [0.0, -150.0]]), Prism([[0.0, -601.0], [200.0, -599.0]])
    section = look(Scene((near, far)))
    y = section.truth.points[:, 1]
    assert np.nanmax(y) < -590.0
    assert np.nanmin(y) >= -600.0


def test_points_hidden_from_a_camera_are_lost():
    step = Scene((Prism([[-300.0, -400.0], [0.0, -400.0], [0.0, -450.0], [300.0, -450.0]]),))
    # From (-100, 0) past the edge (0, -400) one sees the lower plane from x = 12.5 on.
    x = look(step, only(camera=(-100.0, 0.0, 0.0))).profile.points[:, 0]
    hidden = x[np.isfinite(x) & (x > 0.0)]
    assert hidden.min() == pytest.approx(12.5, abs=0.8)
    assert look(step).profile.points[:, 0][201] < 1.0


def test_a_camera_at_the_origin_of_the_rays_sees_all_points():
    assert look(settings=only(camera=(0.0, 0.0, 0.0))).profile.lost == 0


def test_truth_contains_the_tube_and_its_visible_arc():
    (tube,) = look().truth.tubes
    assert (tube.radius, tube.theta, tube.phi) == pytest.approx((25.0, 0.7, 0.5))
    assert tube.centre == pytest.approx((8.0, -420.0))
    assert tube.points == tube.arc_points == int((look().truth.labels == 1).sum())
    # A fan sees a little less than half of a tube.
    assert math.radians(160) < tube.arc < math.radians(180)
    assert tube.visible


def test_a_tube_behind_a_bar_is_not_visible():
    bar = Prism([[-15.0, -380.0], [60.0, -380.0]])
    (tube,) = look(Scene((TUBE, bar))).truth.tubes
    assert 0 < tube.points < 20
    assert not tube.visible


def test_a_bar_in_front_splits_a_tube_into_two_arcs():
    bar = Prism([[4.0, -380.0], [12.0, -380.0]])
    (tube,) = look(Scene((TUBE, bar))).truth.tubes
    assert tube.arc_points < 0.6 * tube.points
    assert tube.arc < math.radians(80)


def test_the_longest_run_spans_losses_but_no_other_object():
    labels = np.array([1, 1, -1, 1, 0, 1, 1, -1, -1, 1, 1, 2, 1])
    assert find_longest_run(labels, 1).tolist() == [5, 6, 9, 10]
    assert find_longest_run(labels, 3).tolist() == []


def test_moving_sensor_and_scene_together_changes_nothing():
    turn = Pose([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]], (5.0, -7.0, 30.0))
    local = TUBE.cylinder
    moved = Scene((Tube(local.transformed(turn)),))
    here, there = look(Scene((TUBE,))), look(moved, pose=turn)
    np.testing.assert_allclose(here.profile.points, there.profile.points, rtol=0, atol=1e-8)
    assert there.truth.tubes[0].ellipse.centre == pytest.approx(TUBE.cylinder.section().centre)


def test_the_centre_moves_along_the_axis_in_a_scan():
    poses = [Pose.along((0.0, 0.0, 1.0), 10.0 * k) for k in range(3)]
    rng = np.random.default_rng(1)
    sections = simulate_scan(SCENE, poses, SENSOR, IDEAL, rng=rng)
    axis = TUBE.cylinder.direction
    for k, section in enumerate(sections):
        expected = np.array([8.0, -420.0]) + 10.0 * k * axis[:2] / axis[2]
        np.testing.assert_allclose(section.truth.tubes[0].centre, expected, rtol=0, atol=MACHINE)


def test_the_seed_determines_the_bytes():
    first, again, other = (look(settings=SectionSettings(), seed=seed) for seed in (3, 3, 4))
    assert first.profile.points.tobytes() == again.profile.points.tobytes()
    assert first.truth.labels.tobytes() == again.truth.labels.tobytes()
    assert first.profile.points.tobytes() != other.profile.points.tobytes()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rays": "both"}, "'fan' or 'parallel'"),
        ({"lost_fraction": 1.5}, "lost_fraction in"),
        ({"jump_fraction": -0.1}, "jump_fraction in"),
        ({"noise_factor": -1.0}, "noise_factor >= 0"),
        ({"correlation_columns": math.nan}, "correlation_columns >= 0"),
        ({"jump_mm": (5.0, 2.0)}, "jump_mm"),
        ({"camera": (5.0, 2.0)}, r"camera \(x, y, z\) in mm, got \(5.0, 2.0\)"),
        ({"jump_mm": (1.0, math.inf)}, "jump_mm"),
        ({"grazing_limit_deg": math.nan}, "grazing_limit_deg >= 0"),
    ],
)
def test_invalid_settings_raise_errors(changes, message):
    with pytest.raises(ValueError, match=message):
        SectionSettings(**changes)


def test_a_camera_beside_a_bent_tube_sees_its_near_side():
    """Columns without a point have no ray to the camera."""
    tube = BentTube(25.0, (0.0, -1420.0, 0.0), (1.0, 0.0, 0.0), 1000.0)
    everything, seen = (
        np.isfinite(look(Scene((tube,)), only(camera=camera)).profile.points[:, 0])
        for camera in (None, (400.0, -420.0, 0.0))
    )
    points = look(Scene((tube,))).profile.points
    assert seen.any()
    assert (everything & ~seen).any()
    assert points[seen, 0].min() > points[everything & ~seen, 0].min()
