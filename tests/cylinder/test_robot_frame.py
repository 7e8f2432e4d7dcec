"""Cylinders of a section in the base frame, and Monte Carlo tests of their covariance."""

import math
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lsvision.calibration.hand_eye_result import HandEye
from lsvision.cylinder.robot_frame import place_section
from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import Cylinder, Pose
from lsvision.profile import Arc
from tests.ellipse.arcs import SENSOR, about, measured, pipe, upper_arc

MACHINE = 1e-9  # mm, rad: noise-free geometry below a metre
RUNS = 200
SPREAD = 4 * math.sqrt(1 / (2 * RUNS))  # four sigma of a standard deviation from RUNS numbers
NEES = 4 * math.sqrt(2 / (6 * RUNS))  # likewise of the mean of chi^2 / 6
FLANGE = Pose(Rotation.from_rotvec([0.4, -0.9, 1.7]).as_matrix(), (820.0, -150.0, 500.0))
SECTION = Pose(Rotation.from_rotvec([0.3, 1.1, -0.2]).as_matrix(), (35.0, -60.0, 210.0))


def mount(pose=SECTION, scale=1.0, robot_std=(0.0, 0.0)):
    """Correlated errors, about 0.2 mm and 1 mrad, as of 12 poses before a sphere."""
    root = np.tril(np.random.default_rng(5).normal(size=(6, 6))) + 3 * np.eye(6)
    root *= scale * np.array([0.05, 0.05, 0.05, 3e-4, 3e-4, 3e-4])[:, None]
    return SimpleNamespace(flange_from_section=pose, covariance=root @ root.T, robot_std=robot_std)


def section_of(points, truth):
    fit = fit_ellipse(points, about(truth), SENSOR.covariances(points))
    return CylinderSection(fit, Arc(0, len(points)), np.arange(len(points)))


def moved(pose, error):
    """Apply a calibration error: R -> exp([w]x) R, about the section's origin."""
    turned = Rotation.from_rotvec(error[3:]).as_matrix() @ pose.rotation
    return Pose(turned, pose.translation + error[:3])


def error_of(found, truth):
    """Point, direction across, radius; by the true cylinder in the same frame."""
    turn = found.tangent_basis @ (found.direction - truth.direction)
    return np.r_[found.point - truth.point, turn, found.radius - truth.radius]


@cache
def sections_of(phi_deg):
    """Noisy sections of a pipe; every calibration places the same ones."""
    rng, truth = np.random.default_rng(11), pipe(phi_deg)
    return [section_of(measured(upper_arc(truth), rng), truth) for _ in range(RUNS)]


def runs_of(phi_deg, calibration, twin):
    rng, truth = np.random.default_rng(12), pipe(phi_deg)
    true = Cylinder.twins(truth)[twin].transformed(FLANGE @ SECTION)
    root = np.linalg.cholesky(calibration.covariance)
    for section in sections_of(phi_deg):
        wrong = SimpleNamespace(**vars(calibration))
        wrong.flange_from_section = moved(SECTION, root @ rng.normal(size=6))
        robot = rng.normal(size=6) * np.repeat(calibration.robot_std, 3)
        placed = place_section(section, wrong, moved(FLANGE, robot))[twin]
        yield placed, error_of(placed, true)


@pytest.mark.parametrize(
    ("scale", "robot_std", "twin"),
    [(0.1, (0, 0), 0), (1, (0, 0), 1), (10, (0, 0), 1), (0.1, (0.3, 1e-3), 0)],
    ids=["fit", "both", "calibration", "robot"],
)
def test_errors_agree_with_the_covariance(scale, robot_std, twin):
    calibration = mount(scale=scale, robot_std=robot_std)
    placed, errors = zip(*runs_of(35.0, calibration, twin), strict=True)
    squared = [e @ np.linalg.solve(p.covariance, e) for p, e in zip(placed, errors, strict=True)]
    assert np.mean(squared) / 6 == pytest.approx(1.0, abs=NEES)
    stated = np.sqrt(np.mean([np.diag(p.covariance) for p in placed], axis=0))
    np.testing.assert_allclose(np.std(errors, axis=0), stated, rtol=SPREAD)


def test_without_errors_the_cylinder_is_exact():
    truth = pipe(20.0)
    section = section_of(upper_arc(truth), truth)
    for placed, twin in zip(place_section(section, SECTION, FLANGE), (0, 1), strict=True):
        true = Cylinder.twins(truth)[twin].transformed(FLANGE @ SECTION)
        np.testing.assert_allclose(error_of(placed, true), 0, atol=1e3 * MACHINE)


def some_section():
    truth = pipe(25.0)
    return section_of(measured(upper_arc(truth), np.random.default_rng(2)), truth)


def test_the_twins_are_those_of_the_section():
    section = some_section()
    twins = [placed.direction for placed in place_section(section, Pose(), Pose())]
    np.testing.assert_allclose(twins, section.axis_twins, atol=MACHINE)


def test_without_a_robot_pose_the_result_is_in_the_flange_frame():
    section = some_section()
    (in_flange, _), (in_base, _) = (
        place_section(section, mount(), *pose) for pose in ((), (FLANGE,))
    )
    assert (in_flange.frame, in_base.frame) == ("flange", "base")
    np.testing.assert_allclose(FLANGE.apply_one(in_flange.point), in_base.point, atol=MACHINE)
    assert in_flange.direction_std == pytest.approx(in_base.direction_std)
    assert np.linalg.norm(in_flange.point_std) == pytest.approx(np.linalg.norm(in_base.point_std))


def test_a_pose_as_calibration_is_exact():
    section = some_section()
    exact, _ = place_section(section, SECTION, FLANGE)
    calibrated, _ = place_section(section, mount(), FLANGE)
    assert (exact.includes_calibration, calibrated.includes_calibration) == (False, True)
    assert (exact.point_std < calibrated.point_std).all()
    assert exact.direction_std < calibrated.direction_std
    assert exact.radius_std == calibrated.radius_std == pytest.approx(section.radius_std)


def test_the_robot_error_is_included_in_the_base_frame_only():
    section = some_section()
    still, shaky = mount(), mount(robot_std=(0.3, 1e-3))
    for frame, larger in (((), False), ((FLANGE,), True)):
        stds = [place_section(section, each, *frame)[0].point_std for each in (still, shaky)]
        assert (stds[1] > stds[0]).all() == larger


def test_direction_std_near_a_circle_is_phi_std():
    truth = pipe(0.0)
    section = section_of(measured(upper_arc(truth), np.random.default_rng(2)), truth)
    for placed in place_section(section, SECTION, FLANGE):
        assert section.phi_std / 2 < placed.direction_std < 2 * section.phi_std + section.phi


def test_radius_std_near_a_circle_is_that_of_the_section():
    """Linear propagation is invalid here, because of the kink of b = m - |(p, q)|."""
    truth = pipe(0.0)
    section = section_of(measured(upper_arc(truth), np.random.default_rng(2)), truth)
    assert section.radius_std != pytest.approx(math.sqrt(section.covariance[3, 3]), rel=0.02)
    for placed in place_section(section, SECTION, FLANGE):
        assert placed.radius_std == pytest.approx(section.radius_std)


def test_a_calibration_of_another_kind_raises_an_error():
    camera = HandEye(
        mount_from_sensor=SECTION, covariance=np.eye(6), residuals=[0.0],
        leave_one_out_residuals=[0.0], rejected=(), target=Pose(), working_point=(0, 0, 300),
        robot_std=(0.0, 0.0),
        ambiguity_ratio=9.0, least_determined_std=0.1, least_determined_direction="none",
        mounting="eye_in_hand", sensor="camera",
    )  # fmt: skip
    with pytest.raises(ValueError, match="expected a calibration of a section, eye in hand"):
        place_section(some_section(), camera)
