"""Covariance of scanned cylinders under simulated errors of the poses."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lsvision.cylinder.fit import CylinderFittingSettings
from lsvision.cylinder.robot_frame import place_section
from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import Pose
from lsvision.inspection.job_tables import Part
from lsvision.inspection.quantities import measure_quantity
from lsvision.measure import measure_cylinders
from lsvision.profile import Profile
from lsvision.scan import PoseErrors, ScannedCylinder, ScanSettings, measure_scan
from lsvision.scan.joint_fit import JointFitSettings
from lsvision.simulate import Scene, Tube
from lsvision.simulate.hand_eye import perturb_pose
from tests.scan.scans import feed, profiles_of

RUNS = 24
RELATIVE_TOLERANCE = 0.45  # three sigma of a standard deviation from 2 x 24 numbers


def errors_deg(found: list[ScannedCylinder], truth: Tube) -> float:
    """Root mean square angle to the truth."""
    sines = [np.linalg.norm(np.cross(c.direction, truth.cylinder.direction)) for c in found]
    return math.degrees(float(np.sqrt(np.mean(np.square(sines)))))


def test_feed_std_predicts_the_effect_of_a_wrong_feed(pipe: Tube) -> None:
    rng = np.random.default_rng(1)
    std = math.radians(0.5)
    found = []
    for run in range(RUNS):
        profiles = profiles_of(Scene((pipe,)), feed(4, 15.0), seed=run)
        wrong = [Pose.along((*rng.normal(0, std, 2), 1.0), 15.0 * k) for k in range(4)]
        found += measure_scan(profiles, wrong, feed_std=std).cylinders
    stated = math.degrees(found[0].direction_std)
    assert stated > 0.5
    assert errors_deg(found, pipe) == pytest.approx(stated, rel=RELATIVE_TOLERANCE)


def test_a_wrong_feed_does_not_show_in_the_residuals(pipe: Tube) -> None:
    profiles = profiles_of(Scene((pipe,)), feed(4, 15.0))
    wrong = [Pose.along((math.radians(0.5), 0.0, 1.0), 15.0 * k) for k in range(4)]
    (right,), (off,) = (measure_scan(profiles, p).cylinders for p in (feed(4, 15.0), wrong))
    assert off.fit.rms < 1.05 * right.fit.rms  # in one scan, chance makes as much
    assert np.linalg.norm(np.cross(off.direction, right.direction)) > math.radians(0.35)


def test_pose_std_predicts_the_effect_of_noisy_poses(pipe: Tube) -> None:
    rng = np.random.default_rng(2)
    found = []
    for run in range(RUNS):
        profiles = profiles_of(Scene((pipe,)), feed(5, 8.0), noise=0.02, seed=run)
        poses = [
            Pose(translation=(*rng.normal(0, 0.1, 2), rng.normal(8.0 * k, 0.1))) for k in range(5)
        ]
        found += measure_scan(profiles, poses, pose_std=0.1).cylinders
    stated = math.degrees(float(np.median([c.direction_std for c in found])))
    assert errors_deg(found, pipe) == pytest.approx(stated, rel=RELATIVE_TOLERANCE)


@pytest.mark.parametrize("slip", [{"pose_std": -1.0}, {"feed_std": math.nan}])
def test_negative_errors_raise_an_error(slip: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"expected {next(iter(slip))} from 0 to"):
        PoseErrors(**slip)


MOUNT = Pose(Rotation.from_rotvec([0.3, 1.1, -0.2]).as_matrix(), (35.0, -60.0, 210.0))
CALIBRATED = [20, pytest.param(80, marks=pytest.mark.slow)]


def calibration(pose: Pose = MOUNT, robot_std: tuple[float, float] = (0.0, 0.0)) -> SimpleNamespace:
    """Correlated errors, about 0.2 mm and 1 mrad: well above the noise of the points."""
    root = np.tril(np.random.default_rng(5).normal(size=(6, 6))) + 3 * np.eye(6)
    root *= np.array([0.05, 0.05, 0.05, 3e-4, 3e-4, 3e-4])[:, None]
    return SimpleNamespace(flange_from_section=pose, covariance=root @ root.T, robot_std=robot_std)


def miscalibrated(
    rng: np.random.Generator, robot_std: tuple[float, float] = (0.0, 0.0)
) -> SimpleNamespace:
    """A calibration with an error of its covariance, R -> exp([w]x) R from the left."""
    error = np.linalg.cholesky(calibration().covariance) @ rng.normal(size=6)
    turned = Rotation.from_rotvec(error[3:]).as_matrix() @ MOUNT.rotation
    return calibration(Pose(turned, MOUNT.translation + error[:3]), robot_std)


def sections_about(tilt: float, count: int = 4) -> list[Pose]:
    """Sections along the pipe, each turned about its point there; the flange turns with it."""
    turns = np.random.default_rng(8).uniform(-tilt, tilt, (count, 3))
    poses = []
    for k, turn in enumerate(turns):
        rotation = Rotation.from_rotvec(turn).as_matrix()
        middle = np.array([0.0, -400.0, 12.0 * k])
        poses.append(Pose(rotation, middle - rotation @ (0.0, -400.0, 0.0)))
    return poses


def error_of(found: ScannedCylinder, truth: Tube) -> np.ndarray:
    """Point and direction across the axis, radius."""
    axis, across = truth.cylinder, found.fit.tangent_basis
    away = found.point - axis.point
    away = away - axis.direction * (away @ axis.direction)
    turn = found.direction - axis.direction * np.sign(found.direction @ axis.direction)
    return np.r_[across @ away, across @ turn, found.radius - axis.radius]


@pytest.mark.parametrize("runs", CALIBRATED)
@pytest.mark.parametrize("robot_std", [(0.0, 0.0), (0.05, 3e-4)], ids=["exact", "robot"])
@pytest.mark.parametrize("tilt", [0.0, 0.25], ids=["moved", "turned"])
def test_the_covariance_of_the_calibration_predicts_the_effect_of_its_error(
    pipe: Tube, tilt: float, robot_std: tuple[float, float], runs: int
) -> None:
    rng, squared, sections = np.random.default_rng(4), [], sections_about(tilt)
    for run in range(runs):
        wrong = miscalibrated(rng, robot_std)
        flanges = [perturb_pose(pose @ MOUNT.inverse(), *robot_std, rng) for pose in sections]
        poses = [flange @ wrong.flange_from_section for flange in flanges]
        profiles = profiles_of(Scene((pipe,)), sections, seed=run)
        (found,) = measure_scan(profiles, poses, calibration=wrong).cylinders
        error = error_of(found, pipe)
        squared.append(error @ np.linalg.solve(found.covariance, error) / 5)
    four_sigma = 4 * math.sqrt(2 / (5 * runs))  # of the mean of chi^2 / 5
    assert np.mean(squared) == pytest.approx(1.0, abs=four_sigma)


def test_a_single_section_moves_with_its_calibration(pipe: Tube) -> None:
    (profile,) = profiles_of(Scene((pipe,)), feed(1, 1.0))
    mount = calibration(robot_std=(0.05, 3e-4))
    (found,) = measure_scan([profile], [Pose()], calibration=mount).cylinders
    placed, _ = place_section(measure_single_section(profile), mount, MOUNT.inverse())
    across = np.zeros((5, 6))
    across[:2, :3], across[2:, 3:] = found.fit.tangent_basis, np.eye(3)
    there = found.fit.with_reference_point(placed.point).covariance
    np.testing.assert_allclose(there, across @ placed.covariance @ across.T, rtol=1e-6, atol=1e-12)
    assert found.includes_calibration


def measure_single_section(profile: Profile) -> CylinderSection:
    (section,) = measure_cylinders(profile).cylinders
    return section


def test_the_axial_range_includes_the_calibration_errors(pipe: Tube) -> None:
    profiles = profiles_of(Scene((pipe,)), feed(3, 10.0))
    (exact,) = measure_scan(profiles, feed(3, 10.0)).cylinders
    (found,) = measure_scan(profiles, feed(3, 10.0), calibration=calibration()).cylinders
    assert not exact.includes_calibration
    assert min(found.axial_range_std) > 0.1 + max(exact.axial_range_std)


@pytest.mark.parametrize("robot_std", [(0.0, 0.0), (0.4, 0.0)], ids=["exact", "robot"])
def test_the_length_seen_includes_errors_of_the_poses_as_far_as_they_change_it(
    pipe: Tube, robot_std: tuple[float, float]
) -> None:
    rng, sections = np.random.default_rng(6), feed(3, 10.0)
    profiles = profiles_of(Scene((pipe,)), sections)
    lengths, part = [], Part(name="pipe", order=1)
    for _ in range(RUNS):
        wrong = miscalibrated(rng, robot_std)
        flanges = [perturb_pose(pose @ MOUNT.inverse(), *robot_std, rng) for pose in sections]
        poses = [flange @ wrong.flange_from_section for flange in flanges]
        (found,) = measure_scan(profiles, poses, calibration=wrong).cylinders
        lengths.append(measure_quantity(found, part, "length_seen_mm", 0.95))
    spread = float(np.std([length.value for length in lengths]))
    (exact,) = measure_scan(profiles, sections).cylinders
    noise_std = measure_quantity(exact, part, "length_seen_mm", 0.95).std
    stated = math.sqrt(lengths[0].std ** 2 - noise_std**2)
    assert stated == pytest.approx(spread, rel=RELATIVE_TOLERANCE, abs=0.05)


def ends_covariance(found: ScannedCylinder) -> np.ndarray:
    (first, last), between = found.axial_range_std, found.axial_range_covariance
    return np.array([[first**2, between], [between, last**2]])


@pytest.mark.parametrize("error", ["feed", "calibration"])
def test_the_errors_of_the_ends_are_those_of_points_and_direction_together(
    pipe: Tube, error: str
) -> None:
    """The sum over wrong poses, one for each error of one standard deviation."""
    sections, std = feed(4, 12.0), 0.002
    profiles = profiles_of(Scene((pipe,)), sections)
    (exact,) = measure_scan(profiles, sections).cylinders
    if error == "feed":
        wrong = [[Pose.along((*lateral, 1.0), 12.0 * k) for k in range(4)]
                 for lateral in ((std, 0.0), (0.0, std))]  # fmt: skip
        (stated,) = measure_scan(profiles, sections, feed_std=std).cylinders
    else:
        mount = calibration()
        wrong = []
        for column in np.linalg.cholesky(mount.covariance).T:
            turned = Rotation.from_rotvec(column[3:]).as_matrix() @ MOUNT.rotation
            moved = Pose(turned, MOUNT.translation + column[:3])
            wrong.append([section @ MOUNT.inverse() @ moved for section in sections])
        (stated,) = measure_scan(profiles, sections, calibration=mount).cylinders
    changes = []
    for poses in wrong:
        (found,) = measure_scan(profiles, poses).cylinders
        origin = (poses[0].translation - sections[0].translation) @ found.direction
        changes.append(np.array(found.axial_range) + origin - exact.axial_range)
    added = ends_covariance(stated) - ends_covariance(exact)
    expected = np.transpose(changes) @ changes
    assert added == pytest.approx(expected, rel=0.1)
    length = np.array([-1, 1])
    assert length @ added @ length == pytest.approx(length @ expected @ length, rel=0.1)


def test_a_truncated_fit_keeps_its_covariance_beside_negligible_errors(pipe: Tube) -> None:
    profiles, poses = profiles_of(Scene((pipe,)), feed(4, 12.0)), feed(4, 12.0)
    fitting = CylinderFittingSettings(truncation=2.0)
    settings = ScanSettings(joint_fit=JointFitSettings(fitting=fitting))
    exact, negligible = (
        measure_scan(profiles, poses, settings=settings, pose_std=std).cylinders[0].covariance
        for std in (0.0, 1e-9)
    )
    np.testing.assert_allclose(negligible, exact, rtol=1e-6)


def test_the_only_section_with_points_moves_with_the_feed(pipe: Tube) -> None:
    (profile,) = profiles_of(Scene((pipe,)), feed(1, 1.0))
    empty = Profile(np.full((20, 2), np.nan))
    (exact,) = measure_scan([empty, profile], feed(2, 100.0)).cylinders
    (found,) = measure_scan([empty, profile], feed(2, 100.0), feed_std=0.01).cylinders
    moved = found.fit.with_reference_point((0, -400, 100)).covariance
    before = exact.fit.with_reference_point((0, -400, 100)).covariance
    assert np.diag(moved - before)[:2].max() == pytest.approx(1.0, rel=0.01)  # 100 mm x 0.01


def test_the_ends_deviate_as_the_direction_does() -> None:
    tube = Tube.of(19.0, 0.3, 0.05, (0.0, -400.0))
    found = [
        measure_scan(profiles_of(Scene((tube,)), feed(4, 10.0), seed=run), feed(4, 10.0)).cylinders
        for run in range(RUNS)
    ]
    spread = np.std([pipe.axial_range for (pipe,) in found], axis=0)
    stated = np.mean([pipe.axial_range_std for (pipe,) in found], axis=0)
    assert stated == pytest.approx(spread, rel=RELATIVE_TOLERANCE)


def test_a_known_radius_keeps_its_std_beside_errors_of_the_poses() -> None:
    rng, prior_std, pose_std = np.random.default_rng(9), 0.01, 0.1
    normalised = []
    for run in range(RUNS):
        radius = 19 + rng.normal(0, prior_std)
        scene = Scene((Tube.of(radius, 0.3, 0.35, (0.0, -400.0)),))
        poses = [perturb_pose(pose, pose_std, 0.0, rng) for pose in feed(4, 10.0)]
        (found,) = measure_scan(
            profiles_of(scene, feed(4, 10.0), seed=run), poses,
            known_radius=(19.0, prior_std), pose_std=pose_std,
        ).cylinders  # fmt: skip
        assert found.radius_std < 1.5 * prior_std  # 3 if the poses made it less certain
        normalised.append((found.radius - radius) / found.radius_std)
    assert np.mean(np.square(normalised)) < 1 + 4 * math.sqrt(2 / RUNS)


def test_an_uncertain_feed_of_exact_points_is_printed() -> None:
    """The position at the first section does not depend on the feed: rounding made it negative."""
    angles = np.linspace(-1.2, 1.2, 100)
    circle = np.column_stack([19 * np.sin(angles), 19 * np.cos(angles) - 400])
    scan = measure_scan([circle] * 5, feed(5, 10.0), feed_std=0.01)
    assert scan.cylinders[0].position_std < 1e-6
    assert "19.0" in str(scan)
