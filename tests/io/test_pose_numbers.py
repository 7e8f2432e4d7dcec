"""The sensor's frame as numbers of each maker, with sigmas: truth from scipy's Rotation."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lsvision.calibration.hand_eye import calibrate_hand_eye_board
from lsvision.geometry import Pose
from lsvision.io.pose_numbers import format_frame_rows, numbers_from_pose, propagate_to_numbers
from lsvision.io.robot_conventions import CONVENTIONS, pose_from_numbers

MACHINE = 1e-9
SAMPLES = 20_000
STD_ERROR = 0.03  # relative, of the sigma of so many samples: six times its own
DEG, M = np.pi / 180, 1000.0

# Written out from the makers' manuals: sequence of scipy, unit of length, unit of angles.
EULER = {
    "kuka": "ZYX", "fanuc": "xyz", "yaskawa": "xyz", "mitsubishi": "xyz", "kawasaki": "ZYZ",
    "staubli": "XYZ",
}  # fmt: skip


def truth(numbers, convention):
    """Translation in mm and rotation that the maker means by the numbers."""
    head, rest = numbers[:3], numbers[3:]
    if convention == "matrix":
        matrix = np.reshape(numbers, (4, 4))
        return matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3])
    if convention == "ur":
        return head * M, Rotation.from_rotvec(rest)
    if convention == "ros":
        return head * M, Rotation.from_quat(rest)
    if convention == "abb":
        return head, Rotation.from_quat(rest, scalar_first=True)
    return head, Rotation.from_euler(EULER[convention], rest, degrees=True)


def random_poses(count, seed):
    rng = np.random.default_rng(seed)
    turns = Rotation.random(count, rng=rng)
    return [
        Pose(turn.as_matrix(), where)
        for turn, where in zip(turns, rng.uniform(-500, 500, (count, 3)), strict=True)
    ]


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_numbers_mean_the_pose_to_scipy_and_to_the_reader(convention):
    for pose in random_poses(40, 311):
        numbers = numbers_from_pose(pose, convention)
        position, rotation = truth(numbers, convention)
        np.testing.assert_allclose(position, pose.translation, rtol=0, atol=MACHINE)
        np.testing.assert_allclose(rotation.as_matrix(), pose.rotation, rtol=0, atol=MACHINE)
        again = pose_from_numbers(numbers, convention)
        np.testing.assert_allclose(again.matrix, pose.matrix, rtol=0, atol=MACHINE)


def spread_of(pose, covariance, convention, seed):
    """Sigmas of the numbers from samples of the pose; angles about their mean direction."""
    rng = np.random.default_rng(seed)
    errors = rng.multivariate_normal(np.zeros(6), covariance, SAMPLES)
    turned = Rotation.from_rotvec(errors[:, 3:]) * Rotation.from_matrix(pose.rotation)
    places = pose.translation + errors[:, :3]
    if convention == "ur":
        return np.r_[places.std(axis=0) / M, turned.as_rotvec().std(axis=0)]
    if convention == "matrix":
        rows = np.zeros((SAMPLES, 4, 4))
        rows[:, :3, :3], rows[:, :3, 3] = turned.as_matrix(), places
        return rows.reshape(SAMPLES, 16).std(axis=0)
    if convention in ("ros", "abb"):
        quaternions = turned.as_quat(canonical=True)
        quaternions *= np.sign(quaternions @ quaternions[0])[:, None]
        order = [3, 0, 1, 2] if convention == "abb" else [0, 1, 2, 3]
        scale = 1.0 if convention == "abb" else M
        return np.r_[places.std(axis=0) / scale, quaternions[:, order].std(axis=0)]
    angles = np.unwrap(turned.as_euler(EULER[convention], degrees=True), axis=0, period=360)
    return np.r_[places.std(axis=0), angles.std(axis=0)]


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_sigmas_are_the_spread_of_samples(convention):
    rng = np.random.default_rng(77)
    mix = rng.normal(size=(6, 6)) * ([0.1] * 3 + [0.02 * DEG] * 3)
    covariance = np.cov(mix, rowvar=False) + np.diag([1e-3] * 3 + [1e-8] * 3)
    pose = Pose(Rotation.from_euler("ZYX", [40, 25, -120], degrees=True).as_matrix(), (80, -20, 9))
    predicted = propagate_to_numbers(pose, covariance, convention)
    found = spread_of(pose, covariance, convention, 5)
    np.testing.assert_allclose(predicted, found, rtol=STD_ERROR, atol=MACHINE)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_half_a_turn_has_finite_sigmas_whichever_way_it_is_written(convention):
    covariance = np.diag([1e-4] * 3 + [1e-8] * 3)
    for turn in ([0, 0, 180], [180, 0, 0], [0, 0, -179.9999999]):
        pose = Pose(Rotation.from_euler("xyz", turn, degrees=True).as_matrix(), (1, 2, 3))
        std = propagate_to_numbers(pose, covariance, convention)
        rest = std[3:][np.isfinite(std[3:])] if convention == "kawasaki" else std[3:]
        assert (rest < 0.02).all(), turn  # 1e-4 rad are 0.006 deg


@pytest.mark.parametrize(
    ("convention", "angles"),
    [("kuka", (30, 90, 0)), ("fanuc", (0, 90, 30)), ("kawasaki", (9, 0, 0))],
)
def test_outer_angles_about_one_axis_have_no_sigma(convention, angles):
    pose = pose_from_numbers([1, 2, 3, *angles], convention)
    std = propagate_to_numbers(pose, np.eye(6) * 1e-8, convention)
    assert np.isnan(std[[3, 5]]).all()
    assert np.isfinite(std[[0, 1, 2, 4]]).all()
    again = pose_from_numbers(numbers_from_pose(pose, convention), convention)
    np.testing.assert_allclose(again.matrix, pose.matrix, rtol=0, atol=1e-7)


@pytest.fixture(scope="module")
def solved():
    """A camera on a flange, found on a board."""
    rng = np.random.default_rng(15)
    mount = Pose(Rotation.from_rotvec((0.2, -0.1, 1.0)).as_matrix(), (20.0, 30.0, 120.0))
    board = Pose(Rotation.from_rotvec((0.1, 0.2, 0.3)).as_matrix(), (700.0, 50.0, 200.0))
    seen = [
        Pose(Rotation.from_rotvec(rng.uniform(-0.6, 0.6, 3)).as_matrix(),
             (*rng.uniform(-40, 40, 2), 350.0))
        for _ in range(8)
    ]  # fmt: skip
    found = calibrate_hand_eye_board(
        seen, [board @ pose.inverse() @ mount.inverse() for pose in seen]
    )
    return replace(found, covariance=np.diag([0.04, 0.01, 0.09, 1e-6, 4e-6, 9e-6]))


TYPED = {
    "kuka": r"\{X \S+, Y \S+, Z \S+, A \S+, B \S+, C \S+\}",
    "fanuc": r"X \S+ Y \S+ Z \S+ W \S+ P \S+ R \S+",
    "ur": r"p\[\S+, \S+, \S+, \S+, \S+, \S+\]",
    "abb": r"\[\[\S+, \S+, \S+\], \[\S+, \S+, \S+, \S+\]\]",
    "ros": r"\S+(, \S+){6}",
    "staubli": r"\S+(, \S+){5}",
}


@pytest.mark.parametrize("convention", TYPED)
def test_what_is_typed_in_is_the_frame(solved, convention):
    rows = format_frame_rows(solved, convention)
    label, typed, unit = rows[-1]
    assert label == f"to type in, {convention}"
    assert re.fullmatch(TYPED[convention], typed)
    numbers = np.array(re.findall(r"-?\d+\.\d+", typed), dtype=float)
    position, rotation = truth(numbers, convention)
    np.testing.assert_allclose(position, solved.mount_from_sensor.translation, atol=6e-4)
    off = rotation * Rotation.from_matrix(solved.mount_from_sensor.rotation).inv()
    assert off.magnitude() < 3e-6  # 0.0001 deg and less
    assert unit == {"ur": "m, rad", "abb": "mm", "ros": "m"}.get(convention, "mm, deg")
    axes = "xyz" if convention in ("ur", "ros", "abb") else "XYZ"
    assert [name for name, _, _ in rows[:3]] == [f"flange_from_camera {axis}" for axis in axes]
    sigma = 0.2 / (M if unit.startswith("m,") or unit == "m" else 1)
    assert float(rows[0][1].split(" ± ")[1]) == pytest.approx(sigma)


def test_matrix_is_given_row_by_row_with_its_sigmas(solved):
    rows = format_frame_rows(solved, "matrix")
    matrix = np.array([[float(cell) for cell in text.split(",")] for _, text, _ in rows[:4]])
    np.testing.assert_allclose(matrix, solved.mount_from_sensor.matrix, atol=6e-4)
    assert rows[4][1:] == ("0.20, 0.10, 0.30", "mm")
    assert [float(cell) for cell in rows[5][1].split(",")] == pytest.approx(
        np.degrees([1e-3, 2e-3, 3e-3]), rel=0.05
    )


@pytest.mark.parametrize("convention", ["kuka", "ur", "matrix"])
def test_a_number_that_rounds_to_0_has_no_sign(solved, convention):
    tilted = Rotation.from_rotvec((-1e-10, -1e-10, -1e-10)).as_matrix()
    mount = Pose(tilted, (-1e-6, 5.0, -1e-7))
    rows = format_frame_rows(replace(solved, mount_from_sensor=mount), convention)
    texts = [text for name, text, _ in rows if ", row " in name or name.startswith("to type in")]
    assert texts
    assert not re.search(r"-0\.0+(?![0-9])", " ".join(texts))


def test_unknown_convention_is_a_slip_of_the_caller():
    with pytest.raises(ValueError, match="expected a pose convention, one of ur, kuka"):
        numbers_from_pose(Pose(), "kawasky")
