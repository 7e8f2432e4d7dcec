"""Form deviations of simulated tubes: size, uncertainty and significance."""

import math

import numpy as np
import pytest

from lsvision.errors import DegenerateGeometry
from lsvision.geometry import Pose
from lsvision.scan import CylinderShape, measure_scan, measure_shape
from lsvision.simulate import SCENE_SENSOR, BentTube, Prism, Scene, Tube
from tests.scan.scans import feed, profiles_of

NOISE = 0.02  # mm
SIGMAS = 4.0
RUNS = 16


def shape_of(scene: Scene, count: int, step: float, seed: int = 1) -> CylinderShape:
    poses = feed(count, step)
    scan = measure_scan(profiles_of(scene, poses, NOISE, seed), poses)
    return measure_shape(scan.cylinders[0])


def test_a_bend_radius_of_five_metres_is_measured() -> None:
    bend = BentTube(19.0, (5000.0, -400.0, 250.0), (0.0, 1.0, 0.05), 5000.0)
    shape = shape_of(Scene((bend,)), 26, 20.0)
    assert shape.bow.p_value < 1e-6
    assert abs(shape.bow_radius - 5000.0) < SIGMAS * shape.bow_radius_std
    assert not shape.ovality_terms.is_significant(1e-3)


def test_the_section_centres_follow_the_bend() -> None:
    bend = BentTube(19.0, (5000.0, -400.0, 250.0), (0.0, 1.0, 0.0), 5000.0)
    centres = shape_of(Scene((bend,)), 11, 50.0).centres
    along = centres.along - centres.along.mean()
    curvature, *_ = np.polyfit(along, centres.deviations, 2)
    assert np.linalg.norm(curvature) == pytest.approx(1 / 10_000, rel=0.02)
    bowed = centres.deviations @ curvature / np.linalg.norm(curvature)
    np.testing.assert_allclose(np.ptp(bowed), 250.0**2 / 10_000, rtol=0, atol=0.2)
    assert (centres.deviations_std < 0.1).all()


def test_an_ovality_of_half_a_percent_is_measured() -> None:
    t = np.linspace(0, 2 * math.pi, 2001)
    long, short = 19.0 * 1.0025 * np.cos(t), 19.0 * 0.9975 * np.sin(t)
    x, y = 0.8 * long - 0.6 * short, 0.6 * long + 0.8 * short
    shape = shape_of(Scene((Prism(np.column_stack([x, y - 400.0])),)), 20, 1.0)
    assert shape.ovality_terms.is_significant(0.01)
    assert abs(shape.ovality - 0.005) < SIGMAS * shape.ovality_std


def test_a_straight_round_tube_has_no_significant_deviation(pipe: Tube) -> None:
    shape = shape_of(Scene((pipe,)), 12, 4.0)
    for deviation in (shape.bow, shape.taper, shape.ovality_terms):
        assert not deviation.is_significant(1e-3)
    assert abs(shape.radius - 19.0) < 0.05


def test_p_values_of_straight_round_tubes_are_uniform(pipe: Tube) -> None:
    shapes = [shape_of(Scene((pipe,)), 6, 6.0, seed) for seed in range(12)]
    values = [d.p_value for s in shapes for d in (s.bow, s.taper, s.ovality_terms)]
    # The mean of 36 uniform numbers has a standard deviation of 0.048.
    assert abs(np.mean(values) - 0.5) < SIGMAS * 0.048


def test_the_section_centres_of_a_straight_tube_deviate_as_they_state(pipe: Tube) -> None:
    squares = []
    for seed in range(12):
        centres = shape_of(Scene((pipe,)), 6, 6.0, seed).centres
        for deviation, covariance in zip(
            centres.deviations, centres.deviation_covariances, strict=True
        ):
            squares.append(deviation @ np.linalg.solve(covariance, deviation) / 2)
    # The error of the radius is common to the sections of a tube: 12 independent values.
    assert np.mean(squares) < 1 + SIGMAS * math.sqrt(2 / 12)


@pytest.mark.parametrize(
    ("count", "step", "errors"),
    [(3, 12.0, {"pose_std": 0.1}), (4, 10.0, {"pose_std": 0.1}), (6, 8.0, {"feed_std": 0.02})],
)
def test_stated_errors_of_the_poses_make_no_deviation_significant(count, step, errors) -> None:
    """With the poses taken as exact, half of the tubes have a p-value below 0.0001."""
    rng = np.random.default_rng(7)
    pose_std, feed_std = errors.get("pose_std", 0.0), errors.get("feed_std", 0.0)
    squares = {"bow": [], "taper": [], "ovality_terms": [], "centres": []}
    for seed in range(RUNS):
        tube = Tube.of(15.0, rng.uniform(0, math.pi), rng.uniform(0.2, 0.4), (0.0, -400.0))
        tilt = rng.normal(0.0, feed_std, 2)
        true = [
            Pose.along((*tilt, 1.0), step * k) @ Pose(translation=rng.normal(0, pose_std, 3))
            for k in range(count)
        ]
        profiles = profiles_of(Scene((tube,)), true, NOISE, seed)
        shape = measure_shape(measure_scan(profiles, feed(count, step), **errors).cylinders[0])
        for name in ("bow", "taper", "ovality_terms"):
            deviation = getattr(shape, name)
            values = np.atleast_1d(deviation.values)
            statistic = values @ np.linalg.solve(deviation.covariance, values)
            squares[name].append(statistic / len(values))
            assert deviation.p_value > 1e-4
        for values, covariance in zip(
            shape.centres.deviations, shape.centres.deviation_covariances, strict=True
        ):
            squares["centres"].append(values @ np.linalg.solve(covariance, values) / 2)
    for name, mean in ((name, np.mean(values)) for name, values in squares.items()):
        assert mean < 1 + SIGMAS * math.sqrt(2 / RUNS), name
    # They are not far too large, either.
    assert np.mean(squares["bow"]) > 1 - SIGMAS * math.sqrt(1 / RUNS)


def test_a_bend_is_significant_beside_smaller_errors_of_the_poses() -> None:
    bend = BentTube(19.0, (5000.0, -400.0, 250.0), (0.0, 1.0, 0.05), 5000.0)
    poses = feed(11, 50.0)
    profiles = profiles_of(Scene((bend,)), poses, NOISE)
    exact, stated = (
        measure_shape(measure_scan(profiles, poses, pose_std=std).cylinders[0])
        for std in (0.0, 0.1)
    )
    assert stated.bow.p_value < 1e-6
    assert stated.bow.size == exact.bow.size
    assert stated.bow.size_std > 3 * exact.bow.size_std


def test_a_scan_that_is_too_short_shows_no_deviation() -> None:
    """Neither its fit nor its p-values are led astray: without the limit, 1 of 9 is significant."""
    values = []
    for seed in range(40):
        rng = np.random.default_rng([5, seed])
        tube = Tube.of(
            rng.uniform(8.0, 25.0), rng.uniform(0.0, math.pi), rng.uniform(0.1, 0.8), (0.0, -400.0)
        )
        poses = feed(int(rng.integers(3, 6)), float(rng.choice([0.5, 1.0])))
        profiles = profiles_of(Scene((tube,)), poses, float(rng.uniform(0.02, 0.15)), seed)
        shape = measure_shape(measure_scan(profiles, poses).cylinders[0])
        values += [shape.bow.p_value, shape.taper.p_value, shape.ovality_terms.p_value]
    assert min(values) > 1e-3
    assert np.mean(np.array(values) < 0.05) < 0.1


def test_two_sections_raise_an_error(fixture_scan) -> None:
    profiles, poses, _ = fixture_scan("scan_bent_pipe")
    scan = measure_scan(profiles[:2], poses[:2], sensor=SCENE_SENSOR)
    with pytest.raises(DegenerateGeometry, match="at 3 different positions along it, got 2"):
        measure_shape(scan.cylinders[0])


def test_two_sections_at_one_position_count_once() -> None:
    poses = [Pose.along((0.0, 0.0, 1.0), z) for z in (0.0, 10.0, 10.0)]
    scene = Scene((Tube.of(19.0, 0.0, 0.0, (0.0, -400.0)),))
    (found,) = measure_scan(profiles_of(scene, poses), poses).cylinders
    with pytest.raises(DegenerateGeometry, match="at 3 different positions along it, got 2"):
        measure_shape(found)


def test_sections_that_differ_by_less_than_the_noise_raise_an_error(pipe: Tube) -> None:
    """The ovality of a round tube would be significant, and its mean radius negative."""
    with pytest.raises(DegenerateGeometry, match="sections apart from each other, got points"):
        shape_of(Scene((pipe,)), 3, 0.001)


def test_the_bend_of_the_fixture_is_measured(fixture_scan) -> None:
    profiles, poses, truth = fixture_scan("scan_bent_pipe")
    (found,) = measure_scan(profiles, poses, sensor=SCENE_SENSOR).cylinders
    shape = measure_shape(found)
    bend = truth["tubes_in_base"][0]["bend_radius_mm"]
    assert abs(shape.bow_radius - bend) < SIGMAS * shape.bow_radius_std
    assert abs(shape.radius - truth["tubes_in_base"][0]["radius_mm"]) < 0.1
