import math

import numpy as np
import pytest
from hypothesis import given

from lsvision import Cylinder, Plane, Pose
from lsvision.geometry.pose import as_pose, as_poses
from tests.alike import assert_same_pose
from tests.strategies import PROPERTY, poses
from tests.tolerances import MACHINE

QUARTER_TURN = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]  # X to Y


@PROPERTY
@given(poses(), poses(), poses())
def test_composing_is_associative(a, b, c):
    assert_same_pose((a @ b) @ c, a @ (b @ c), atol=MACHINE)


@PROPERTY
@given(poses())
def test_a_pose_and_its_inverse_cancel_on_both_sides(pose):
    assert_same_pose(pose @ pose.inverse(), Pose(), atol=MACHINE)
    assert_same_pose(pose.inverse() @ pose, Pose(), atol=MACHINE)


@PROPERTY
@given(poses(), poses())
def test_a_product_applies_its_right_factor_first(a_from_b, b_from_c):
    points = np.array([[1.0, 2.0, 3.0], [-40.0, 5.0, 60.0]])
    one_by_one = a_from_b.apply(b_from_c.apply(points))
    np.testing.assert_allclose((a_from_b @ b_from_c).apply(points), one_by_one, atol=MACHINE)


@PROPERTY
@given(poses())
def test_a_pose_preserves_distances_and_handedness(pose):
    points = np.eye(3) * 100
    moved = pose.apply(points) - pose.translation
    np.testing.assert_allclose(moved @ moved.T, points @ points.T, atol=1e-9 * 100**2)
    assert np.linalg.det(moved) > 0


def test_a_rotation_by_90_deg_transforms_x_to_y():
    pose = Pose(QUARTER_TURN, (10, 20, 30))
    np.testing.assert_allclose(pose.apply([[1, 0, 0]]), [[10, 21, 30]], atol=MACHINE)


@PROPERTY
@given(poses())
def test_points_of_two_columns_lie_in_the_section_plane(pose):
    flat = np.array([[3.0, -400.0], [-5.0, -380.0]])
    in_space = np.column_stack([flat, np.zeros(2)])
    np.testing.assert_allclose(pose.apply(flat), pose.apply(in_space), atol=MACHINE)


@PROPERTY
@given(poses())
def test_from_matrix_inverts_matrix(pose):
    assert_same_pose(Pose.from_matrix(pose.matrix), pose, atol=0)
    np.testing.assert_array_equal(pose.matrix[3], (0, 0, 0, 1))


def test_feed_does_not_depend_on_the_length_of_the_direction():
    pose = Pose.along((0, 3, 4), 10.0)
    np.testing.assert_allclose(pose.translation, (0, 6, 8), atol=MACHINE)
    np.testing.assert_array_equal(pose.rotation, np.eye(3))


def test_a_long_product_stays_orthonormal():
    turn = 1e-3
    step = Pose([[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0],
                 [0, 0, 1]])  # fmt: skip
    chain = Pose()
    for _ in range(2000):
        chain = chain @ step
    np.testing.assert_allclose(chain.rotation.T @ chain.rotation, np.eye(3), atol=1e-14)


def test_a_pose_stores_read_only_copies():
    rotation, translation = np.eye(3), np.zeros(3)
    pose = Pose(rotation, translation)
    rotation[0, 0] = translation[0] = 5
    assert_same_pose(pose, Pose(), atol=0)
    with pytest.raises(ValueError, match="read-only"):
        pose.translation[0] = 1.0


SKEW = np.eye(3) + 1e-3 * np.ones((3, 3))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        pytest.param(lambda: Pose(np.eye(2)), r"rotation of shape \(3, 3\), got", id="2x2"),
        pytest.param(lambda: Pose(SKEW), "orthonormal rotation, got R'R off by 0.002", id="skew"),
        pytest.param(lambda: Pose(np.full((3, 3), np.nan)), "orthonormal", id="nan rotation"),
        pytest.param(lambda: Pose(np.diag([1, 1, -1])), "a reflection", id="mirror"),
        pytest.param(lambda: Pose(translation=(0, 0)), r"translation of shape \(3\)", id="flat"),
        pytest.param(lambda: Pose(translation=(0, math.inf, 0)), "finite translation", id="inf"),
        pytest.param(lambda: Pose.along((0, 0, 0), 1.0), "non-zero feed direction", id="no feed"),
        pytest.param(lambda: Pose.from_matrix(np.eye(3)), r"matrix of shape \(4, 4\)", id="3x3"),
        pytest.param(
            lambda: Pose.from_matrix(2 * np.eye(4)),
            "expected last row 0 0 0 1, got 0 0 0 2",
            id="scaled matrix",
        ),
        pytest.param(
            lambda: Pose().apply([1.0, 2.0, 3.0]), r"shape \(n, 3\) or \(n, 2\)", id="one point"
        ),
    ],
)  # fmt: skip
def test_an_invalid_pose_raises_an_error(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_pose_composes_with_poses_only():
    with pytest.raises(TypeError, match=r"expected a Pose after @, got str: Pose\.from_matrix"):
        Pose() @ "flange"
    with pytest.raises(TypeError, match=r"expected a Pose before @, got ndarray: Pose\.from_m"):
        np.eye(4) @ Pose()


def test_a_matrix_is_taken_for_a_pose():
    pose = Pose.from_matrix([[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]])
    assert as_pose(pose) is pose
    assert as_pose(pose.matrix) == as_pose(pose.matrix.tolist()) == pose
    assert as_poses(np.stack([pose.matrix, np.eye(4)])) == (pose, Pose())
    plane = Plane((0.0, 0.0, 1.0), 2.0)
    assert plane.transformed(pose.matrix) == plane.transformed(pose)
    cylinder = Cylinder((1.0, 2.0, 3.0), (0.0, 0.6, 0.8), 4.0)
    assert cylinder.transformed(pose.matrix) == cylinder.transformed(pose)


@pytest.mark.parametrize(
    ("values", "kind", "message"),
    [
        ([np.eye(3)], TypeError, r"pose 0: expected a Pose or a 4x4 matrix .*shape \(3, 3\)"),
        ([Pose(), "flange"], TypeError, "pose 1: expected a Pose or a 4x4 matrix .* got str"),
        (np.eye(4), TypeError, r"pose 0: .* got ndarray of shape \(4,\)"),
        (Pose(), TypeError, "expected a sequence of poses, got one Pose"),
        ([Pose(), 2 * np.eye(4)], ValueError, "pose 1: expected last row 0 0 0 1"),
    ],
    ids=["3x3", "word", "one matrix", "one pose", "scaled"],
)
def test_what_are_no_poses_is_rejected_with_its_place(values, kind, message):
    with pytest.raises(kind, match=message):
        as_poses(values)
