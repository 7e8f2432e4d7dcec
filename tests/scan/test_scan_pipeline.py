"""`measure_scan` against simulated truth, its invariants, and its errors."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from lsvision.errors import DegenerateGeometry
from lsvision.geometry import Pose
from lsvision.measure import Measurement, measure_cylinders
from lsvision.profile import Profile
from lsvision.scan import ScannedCylinder, fit_sections_jointly, measure_scan, measure_sections
from lsvision.sensors.profile_sensor import ProfileSensor
from lsvision.simulate import SCENE_SENSOR, Scene, Tube
from lsvision.simulate.clutter import build_bar, build_ground
from tests.scan.scans import feed, profiles_of

SIGMAS = 4.0
"""Largest error in standard uncertainties: one false alarm in 16 000 for each number."""
GROSS_DEG, GROSS_RADIUS = 2.0, 0.05  # a larger error counts as a gross failure
MACHINE = 1e-6  # mm, rad: the same data in another frame, through an iteration


def assert_agrees(found: ScannedCylinder, truth: Tube) -> None:
    cylinder = truth.cylinder
    sine = np.linalg.norm(np.cross(found.direction, cylinder.direction))
    assert abs(found.radius - cylinder.radius) < SIGMAS * found.radius_std
    assert sine < SIGMAS * found.direction_std
    assert abs(cylinder.signed_distances(found.point[None])[0] + cylinder.radius) < (
        SIGMAS * found.position_std
    )
    assert found.radius_std < GROSS_RADIUS * cylinder.radius
    assert found.direction_std < math.radians(GROSS_DEG)


@pytest.mark.parametrize("phi_deg", [0.0, 5.0, 20.0, 40.0])
@pytest.mark.parametrize("theta_deg", [0.0, 75.0, 170.0])
def test_two_sections_determine_axis_and_radius(phi_deg: float, theta_deg: float) -> None:
    tube = Tube.of(19.0, math.radians(theta_deg), math.radians(phi_deg), (0.0, -400.0))
    scan = measure_scan(profiles_of(Scene((tube,)), feed(2, 10.0)), feed(2, 10.0))
    assert len(scan.cylinders) == 1
    assert_agrees(scan.cylinders[0], tube)
    assert not scan.cylinders[0].ambiguous


def test_unknown_noise_is_estimated(pipe: Tube) -> None:
    profiles = [Profile(p.points) for p in profiles_of(Scene((pipe,)), feed(8, 3.0))]
    (found,) = measure_scan(profiles, feed(8, 3.0)).cylinders
    assert_agrees(found, pipe)


def test_crossing_tubes_are_measured_separately() -> None:
    first = Tube.of(14.0, 0.0, math.radians(35.0), (-40.0, -400.0))
    second = Tube.of(14.0, math.pi, math.radians(35.0), (60.0, -450.0))
    scan = measure_scan(profiles_of(Scene((first, second)), feed(16, 6.0)), feed(16, 6.0))
    assert len(scan.cylinders) == 2
    for found, truth in zip(scan.cylinders, (first, second), strict=True):
        assert_agrees(found, truth)


@pytest.mark.parametrize("name", ["scan_welded_pair", "scan_crossing_pair"])
def test_tubes_of_the_fixtures_are_measured(fixture_scan, name: str) -> None:
    profiles, poses, truth = fixture_scan(name)
    scan = measure_scan(profiles, poses, sensor=SCENE_SENSOR)
    assert len(scan.cylinders) == len(truth["tubes_in_base"])
    for found, tube in zip(scan.cylinders, truth["tubes_in_base"], strict=True):
        assert abs(found.radius - tube["radius_mm"]) < SIGMAS * found.radius_std
        sine = np.linalg.norm(np.cross(found.direction, tube["direction"]))
        assert sine < SIGMAS * found.direction_std


def test_a_tube_that_ends_has_no_sections_beyond_its_end(fixture_scan) -> None:
    profiles, poses, _ = fixture_scan("scan_crossing_pair")
    whole, ending = measure_scan(profiles, poses, sensor=SCENE_SENSOR).cylinders
    assert whole.sections == tuple(range(20))
    assert ending.sections == tuple(range(18))


def test_an_occluded_tube_is_one_cylinder(pipe: Tube) -> None:
    profiles = profiles_of(Scene((pipe, build_ground(500.0, (0.0, -500.0)))), feed(16, 2.0))
    hidden = [Profile(p.points + np.array([0.0, 300.0]), p.noise) if 5 <= k < 9 else p
              for k, p in enumerate(profiles)]  # fmt: skip
    (found,) = measure_scan(hidden, feed(16, 2.0), radius=(10.0, 40.0)).cylinders
    assert found.sections == (0, 1, 2, 3, 4, 9, 10, 11, 12, 13, 14, 15)
    assert_agrees(found, pipe)


def test_a_section_in_which_detection_misses_the_arc_is_used(pipe: Tube) -> None:
    profiles = profiles_of(Scene((pipe,)), feed(6, 4.0))
    mine = np.flatnonzero(np.isfinite(profiles[2].points[:, 0]))
    cut = profiles[2].points.copy()
    cut[mine[12:]] = np.nan  # a flank is left: too short an arc for a cylinder of its own
    profiles[2] = Profile(cut, profiles[2].noise)
    scan = measure_scan(profiles, feed(6, 4.0))
    assert not scan.measurements[2].cylinders
    assert 2 in scan.cylinders[0].sections


def test_lost_profiles_are_skipped(pipe: Tube) -> None:
    profiles = profiles_of(Scene((pipe,)), feed(5, 4.0))
    profiles[1] = Profile(np.full((376, 2), np.nan), profiles[1].noise)
    profiles[3] = Profile(np.zeros((0, 2)), profiles[3].noise)
    (found,) = measure_scan(profiles, feed(5, 4.0)).cylinders
    assert found.sections == (0, 2, 4)


def test_profiles_without_cylinders_yield_no_cylinder() -> None:
    scene = Scene((build_bar(60.0, 8.0, (0.0, -450.0), 0.2), build_ground(500.0, (0.0, -500.0))))
    scan = measure_scan(profiles_of(scene, feed(3, 4.0)), feed(3, 4.0))
    assert scan.cylinders == ()
    assert len(scan.measurements) == 3


def test_lost_profiles_only_yield_no_cylinder() -> None:
    lost = [Profile(np.full((9, 2), np.nan))] * 3
    assert measure_scan(lost, feed(3, 1.0)).cylinders == ()


def test_one_section_yields_both_twins(pipe: Tube) -> None:
    profiles = profiles_of(Scene((pipe,)), feed(1, 1.0), noise=0.02)
    (found,) = measure_scan(profiles, feed(1, 1.0)).cylinders
    assert found.ambiguous
    assert found.twin is not None
    both = np.array([found.direction, found.twin.direction])
    sines = np.linalg.norm(np.cross(both, pipe.cylinder.direction), axis=1)
    assert sines.min() < SIGMAS * found.direction_std
    assert sines.max() > math.sin(math.radians(30.0))  # twins are 2 phi apart


def test_results_transform_with_the_base_frame(pipe: Tube) -> None:
    profiles, still = profiles_of(Scene((pipe,)), feed(4, 5.0)), feed(4, 5.0)
    cos, sin = math.cos(2.0), math.sin(2.0)
    base = Pose([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], (900.0, -300.0, 1200.0))
    base = base @ Pose([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    (here,) = measure_scan(profiles, still).cylinders
    (there,) = measure_scan(profiles, [base @ pose for pose in still]).cylinders
    expected = here.cylinder.transformed(base)
    np.testing.assert_allclose(there.direction, expected.direction, rtol=0, atol=MACHINE)
    np.testing.assert_allclose(there.point, expected.point, rtol=0, atol=100 * MACHINE)
    assert abs(there.direction_std - here.direction_std) < 1e-3 * here.direction_std


def test_direction_is_positive_along_the_feed(pipe: Tube) -> None:
    profiles, poses = profiles_of(Scene((pipe,)), feed(4, 5.0)), feed(4, 5.0)
    (forth,) = measure_scan(profiles, poses).cylinders
    (back,) = measure_scan(profiles[::-1], poses[::-1]).cylinders
    assert forth.direction[2] > 0
    np.testing.assert_allclose(back.direction, -forth.direction, rtol=0, atol=MACHINE)


def test_point_is_the_axis_point_nearest_to_the_first_origin(pipe: Tube) -> None:
    poses = feed(4, 5.0)
    (found,) = measure_scan(profiles_of(Scene((pipe,)), poses), poses).cylinders
    assert abs((found.point - poses[0].translation) @ found.direction) < MACHINE


def test_a_prior_radius_is_kept(pipe: Tube) -> None:
    profiles, poses = profiles_of(Scene((pipe,)), feed(2, 10.0)), feed(2, 10.0)
    (found,) = measure_scan(profiles, poses, known_radius=(19.0, 1e-4)).cylinders
    assert abs(found.radius - 19.0) < 1e-3
    assert_agrees(found, pipe)


def test_a_vague_radius_leaves_that_of_points_without_a_noise_model(pipe: Tube) -> None:
    poses = feed(3, 10.0)
    points = [profile.points for profile in profiles_of(Scene((pipe,)), poses)]
    (free,) = measure_scan(points, poses).cylinders
    (found,) = measure_scan(points, poses, known_radius=(free.radius + 0.5, 1.0)).cylinders
    assert abs(found.radius - free.radius) < 0.2 * free.radius_std
    assert found.radius_std == pytest.approx(free.radius_std, rel=0.1)


def test_inputs_are_not_changed(pipe: Tube) -> None:
    profiles, poses = profiles_of(Scene((pipe,)), feed(3, 5.0)), feed(3, 5.0)
    before = [p.points.copy() for p in profiles]
    measure_scan(profiles, poses)
    for profile, points in zip(profiles, before, strict=True):
        np.testing.assert_array_equal(profile.points, points)


ONE = [Profile([[0.0, -400.0]])]
ALONG_X = [Pose(translation=(10.0 * k, 5.0 * k, 0.0)) for k in range(3)]


@pytest.mark.parametrize(
    ("profiles", "poses", "error", "message"),
    [
        (ONE * 3, feed(2, 1.0), ValueError, "got 3 profiles and 2 poses"),
        ([], [], ValueError, "got 0 profiles and 0 poses"),
        (ONE, [np.eye(3)], TypeError, "pose 0: expected a Pose or a 4x4 matrix"),
        (ONE * 3, [Pose()] * 3, DegenerateGeometry, "all 3 sections lie in one plane"),
        (ONE * 3, ALONG_X, DegenerateGeometry, "move the sensor out of its laser plane"),
    ],
    ids=["count", "none", "matrix", "identical", "in the plane"],
)
def test_invalid_poses_raise_errors(
    profiles: Sequence[Profile], poses: Sequence[Pose], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        measure_scan(profiles, poses)


def test_a_profile_with_few_points_does_not_count_as_a_section(pipe: Tube) -> None:
    poses = feed(2, 5.0)
    profiles = profiles_of(Scene((pipe,)), poses)
    few = Profile(profiles[1].points[~np.isnan(profiles[1].points[:, 0])][20:25])
    (found,) = measure_scan([profiles[0], few], poses).cylinders
    assert found.ambiguous


def test_an_arc_in_one_section_only_is_rejected_with_the_reason(pipe: Tube) -> None:
    profiles = profiles_of(Scene((pipe, build_ground(500.0, (0.0, -500.0)))), feed(3, 5.0))
    flat = profiles_of(Scene((build_ground(500.0, (0.0, -500.0)),)), feed(3, 5.0))
    scan = measure_scan([profiles[0], flat[1], flat[2]], feed(3, 5.0))
    assert not scan.cylinders
    assert scan.rejections[0].sections == (0,)
    assert "in section 0 alone" in scan.rejections[0].reason


def test_a_scan_without_arcs_says_why(pipe: Tube) -> None:
    profiles, poses = profiles_of(Scene((pipe,)), feed(3, 4.0)), feed(3, 4.0)
    scan = measure_scan(profiles, poses, known_radius=0.85 * pipe.cylinder.radius)
    assert not scan.cylinders
    assert "contradicts the points" in scan.reason
    assert str(scan) == f"no cylinder found: {scan.reason}"
    assert measure_scan(profiles, poses).reason == ""


def test_a_known_radius_that_only_all_sections_together_contradict_is_rejected(pipe: Tube) -> None:
    """2.6 % too large: within the uncertainty of each section, but 30 times that of the scan."""
    profiles, poses = profiles_of(Scene((pipe,)), feed(5, 10.0)), feed(5, 10.0)
    wrong = 1.026 * pipe.cylinder.radius
    assert any(measure_cylinders(profile, known_radius=wrong).cylinders for profile in profiles)
    scan = measure_scan(profiles, poses, known_radius=(wrong, 0.01))
    assert not scan.cylinders
    assert "contradicts the points" in scan.reason


def test_a_cylinder_detected_in_few_sections_is_rejected(pipe: Tube) -> None:
    profiles, poses = profiles_of(Scene((pipe,)), feed(6, 4.0)), feed(6, 4.0)
    measurements = measure_sections(profiles)
    unseen = [m if k < 2 else Measurement((), ()) for k, m in enumerate(measurements)]
    scan = fit_sections_jointly(profiles, poses, unseen)
    assert not scan.cylinders
    assert scan.rejections[0].reason.startswith("recognised in 2 of 6 sections")


def test_a_cylinder_with_large_residuals_is_rejected_with_their_rms(pipe: Tube) -> None:
    profiles, poses = profiles_of(Scene((pipe,)), feed(4, 4.0), noise=0.3), feed(4, 4.0)
    overconfident = [Profile(p.points, ProfileSensor(range_std=0.01)) for p in profiles]
    measurements = measure_sections(profiles)
    scan = fit_sections_jointly(overconfident, poses, measurements)
    assert not scan.cylinders
    assert "times the noise, limit 4.0" in scan.rejections[0].reason
