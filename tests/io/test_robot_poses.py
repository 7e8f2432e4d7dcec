"""Robot poses: each convention against rotation products written out by hand."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from lsvision.errors import UnreadableFile
from lsvision.geometry import Pose
from lsvision.io.robot_conventions import CONVENTIONS, pose_from_numbers
from lsvision.io.robot_poses import build_encoder_poses, read_robot_poses
from tests.alike import rotation_series

REAL = Path(__file__).parents[2] / "../shared/real"
MACHINE = 1e-12  # products of three rotations in float64


def about_x(deg):
    c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def about_y(deg):
    c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def about_z(deg):
    c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def from_quaternion(w, x, y, z):
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


EULER_TABLE = {
    "kuka": lambda a, b, c: about_z(a) @ about_y(b) @ about_x(c),
    "fanuc": lambda w, p, r: about_z(r) @ about_y(p) @ about_x(w),
    "yaskawa": lambda rx, ry, rz: about_z(rz) @ about_y(ry) @ about_x(rx),
    "mitsubishi": lambda a, b, c: about_z(c) @ about_y(b) @ about_x(a),
    "kawasaki": lambda o, a, t: about_z(o) @ about_y(a) @ about_z(t),
    "staubli": lambda rx, ry, rz: about_x(rx) @ about_y(ry) @ about_z(rz),
}


@pytest.mark.parametrize("convention", EULER_TABLE)
def test_euler_angles_are_the_product_the_maker_states(convention):
    rng = np.random.default_rng(1)
    for angles in rng.uniform(-180, 180, size=(50, 3)):
        pose = pose_from_numbers([1, 2, 3, *angles], convention)
        expected = EULER_TABLE[convention](*angles)
        np.testing.assert_allclose(pose.rotation, expected, rtol=0, atol=MACHINE)
        np.testing.assert_array_equal(pose.translation, [1, 2, 3])


def test_ur_is_a_rotation_vector_in_metres_and_radians():
    vector = (0.3, -1.1, 2.0)
    pose = pose_from_numbers([0.1, 0.2, 0.3, *vector], "ur")
    np.testing.assert_allclose(pose.rotation, rotation_series(vector), rtol=0, atol=MACHINE)
    np.testing.assert_allclose(pose.translation, [100, 200, 300], rtol=0, atol=MACHINE)


@pytest.mark.parametrize(("convention", "mm"), [("abb", 1.0), ("ros", 1000.0)])
def test_abb_has_w_first_in_mm_and_ros_w_last_in_metres(convention, mm):
    w, x, y, z = np.array([0.2, -0.4, 0.5, 0.7]) / np.linalg.norm([0.2, -0.4, 0.5, 0.7])
    quaternion = (w, x, y, z) if convention == "abb" else (x, y, z, w)
    pose = pose_from_numbers([1, 2, 3, *quaternion], convention)
    np.testing.assert_allclose(pose.rotation, from_quaternion(w, x, y, z), rtol=0, atol=MACHINE)
    np.testing.assert_allclose(pose.translation, np.array([1, 2, 3]) * mm, rtol=0, atol=MACHINE)


def test_matrix_is_row_major_in_mm():
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = about_z(30) @ about_x(10), (5, 6, 7)
    pose = pose_from_numbers(matrix.ravel(), "matrix")
    np.testing.assert_allclose(pose.matrix, matrix, rtol=0, atol=MACHINE)


def test_units_can_be_stated_where_a_file_departs_from_its_maker():
    pose = pose_from_numbers(
        [0.1, 0, 0, math.pi / 2, 0, 0], "kuka", length_unit="m", angle_unit="rad"
    )
    np.testing.assert_allclose(pose.rotation, about_z(90), rtol=0, atol=MACHINE)
    assert pose.translation[0] == pytest.approx(100, abs=MACHINE)


NUMBERS_REFUSED = [
    ([1, 2, 3, 4, 5, 6], "denso", "one of ur, kuka, fanuc"),
    ([1, 2, 3, 4, 5], "kuka", r"expected 6 numbers \(x y z a b c\)"),
    ([1, 2, 3, math.nan, 5, 6], "kuka", "finite"),
    ([1, 2, 3, 0.5, 0.5, 0.5, 0.6], "ros", "quaternion of length 1, got length 1.05"),
    (np.eye(4).ravel() * 2, "matrix", "column by column"),
    (np.diag([1, 1, -1, 1.0]).ravel(), "matrix", "a reflection"),
]


@pytest.mark.parametrize(("numbers", "convention", "message"), NUMBERS_REFUSED)
def test_numbers_that_are_no_pose_are_rejected(numbers, convention, message):
    with pytest.raises(ValueError, match=message):
        pose_from_numbers(numbers, convention)


ROWS = [[100.0, 0.0, 500.0, 170.0, 5.0, -20.0], [150.5, 30.25, 480.0, 160.0, -5.0, 45.0]]

FILES = {
    "poses.csv": "\n".join(",".join(map(str, row)) for row in ROWS),
    "header.csv": "x,y,z,a,b,c\n" + "\n".join(",".join(map(str, row)) for row in ROWS),
    "shuffled.csv": "time,a,b,c,x [mm],y,z\n"
    + "\n".join(",".join(map(str, [9.5, *row[3:], *row[:3]])) for row in ROWS),
    "comma.csv": "\n".join(";".join(str(v).replace(".", ",") for v in row) for row in ROWS),
    "blanks.txt": "# X Y Z A B C\n" + "\n".join(" ".join(map(str, row)) for row in ROWS) + "\n\n",
    "list.json": json.dumps(ROWS),
    "key.rob": json.dumps({"RobPoses": ROWS, "robot": "KR 6"}),
    "names.json": json.dumps([dict(zip("XYZABC", row, strict=True)) for row in ROWS]),
    "poses.yaml": "poses:\n" + "\n".join(f"  - {[row[:3], row[3:]]}" for row in ROWS),
}


@pytest.mark.parametrize("name", FILES)
def test_the_same_poses_come_out_of_every_kind_of_file(tmp_path, name):
    (tmp_path / name).write_text(FILES[name])
    poses = read_robot_poses(tmp_path / name, "kuka")
    for pose, row in zip(poses, ROWS, strict=True):
        np.testing.assert_array_equal(pose.matrix, pose_from_numbers(row, "kuka").matrix)


def test_leading_columns_can_be_left_out(tmp_path):
    path = tmp_path / "numbered.txt"
    path.write_text("\n".join(f"P{i} {' '.join(map(str, row))}" for i, row in enumerate(ROWS)))
    assert len(read_robot_poses(path, "kuka", skip_columns=1)) == 2


MM_AS_UR = "300 100 500 0.1 0.2 0.3\n310 100 500 0.1 0.3 0.3"
M_AS_KUKA = "0.3 0.1 0.5 10 20 30\n0.4 0.1 0.5 10 20 30"
REJECTED = {
    "empty": ("e.csv", "", "kuka", "no row with numbers"),
    "count": ("c.csv", "1,2,3,4,5,6,7", "kuka", "line 1: expected 6 numbers .* got 7"),
    "short": (
        "h.csv",
        "t,x,y,z,a,b,c\n0,1,2,3,4,5",
        "kuka",
        "line 2: expected a number under each",
    ),
    "words": ("w.csv", "1,2,3,4,5,6\n1,2,x,4,5,6", "kuka", "line 2: expected numbers only"),
    "nan": ("n.csv", "1,2,nan,4,5,6", "kuka", "pose 1: expected finite"),
    "json": ("j.json", "{", "kuka", "expected robot poses in json, got: Expecting"),
    "yaml": ("y.yaml", "a: [", "kuka", "expected robot poses in yaml, got: not YAML"),
    "alias": ("a.yaml", "a: &x [*x]", "kuka", "expected YAML without aliases"),
    "deep": ("d.yml", "- " * 900, "kuka", "expected at most 64 levels of nesting"),
    "deep json": ("d.json", "[" * 900 + "]" * 900, "kuka", "at most 64 levels of nesting"),
    "empty integer": ("i.yaml", '!!int ""', "kuka", "expected a list of poses, got str"),
    "empty number": ("n.yaml", '- [1, 2, 3, 4, 5, !!int ""]', "kuka", "could not convert"),
    "date": ("d.yaml", "- [2026-99-99, 1, 2, 3, 4, 5]", "kuka", "could not convert"),
    "null": ("z.yaml", "- [1, 2, \0]", "kuka", "not YAML: unacceptable character"),
    "400 digits": ("h.json", "[[" + "9" * 400 + "]]", "kuka", "at most 300 digits, got one of 400"),
    "nan json": ("nan.json", "[[NaN]]", "kuka", "expected finite numbers, got NaN"),
    "overflow": ("o.csv", "1e200,1,2,3,4,5", "kuka", r"expected numbers up to 1e\+09"),
    "null csv": ("null.csv", "1,2,3,4,5,\0", "kuka", "expected numbers only"),
    "two lists": ("t.json", '{"a": [1], "b": [2]}', "kuka", "one key, got 2 lists"),
    "no list": ("s.json", "3", "kuka", "expected a list of poses, got int"),
    "fields": ("f.json", '[{"x": 1}]', "kuka", "missing y z a b c"),
    "mm as m": ("m.txt", MM_AS_UR, "ur", "length_unit='mm'"),
    "m as mm": ("k.txt", M_AS_KUKA, "kuka", "length_unit='m'"),
    "radians": ("r.txt", "300 0 0 3.1 0 1\n350 0 0 3 0.1 1", "fanuc", "angle_unit='rad'"),
    "degrees": ("d.txt", ".3 0 0 90 0 0\n.4 0 0 80 0 0", "ur", "angle_unit='deg'"),
    "still": ("i.txt", "300 0 0 90 0 0\n300 0 0 90 0 0", "kuka", "did not move"),
    "norm": ("q.txt", "((1,0,0),(0,0,0,0.9))", "ros", "pose 1: expected a quaternion"),
}


@pytest.mark.parametrize("case", REJECTED)
def test_files_that_cannot_be_meant_are_rejected_by_name(tmp_path, case):
    name, text, convention, message = REJECTED[case]
    (tmp_path / name).write_text(text)
    with pytest.raises(UnreadableFile, match=message) as caught:
        read_robot_poses(tmp_path / name, convention)
    assert name in str(caught.value)


@pytest.mark.parametrize("case", ["mm as m", "m as mm", "radians", "degrees"])
def test_a_unit_can_be_stated_in_the_file_as_the_message_says(tmp_path, case):
    name, text, convention, _ = REJECTED[case]
    (tmp_path / name).write_text(text)
    with pytest.raises(UnreadableFile) as caught:
        read_robot_poses(tmp_path / name, convention)
    line = re.search(
        r"state the unit in a (?:header|first line), (.*) \(in Python", str(caught.value)
    )[1]
    (tmp_path / name).write_text(f"{line}\n{text}")
    reach = max(
        np.linalg.norm(p.translation) for p in read_robot_poses(tmp_path / name, convention)
    )
    assert 100 < reach < 5000


@pytest.mark.parametrize("name", ["p.json", "p.yaml"])
def test_where_a_file_cannot_state_units_the_message_says_so(tmp_path, name):
    (tmp_path / name).write_text(json.dumps([[0.3, 0, 0, 90, 0, 0], [0.35, 0, 0, 80, 0, 0]]))
    with pytest.raises(UnreadableFile, match="write the poses as CSV and state the unit in a "):
        read_robot_poses(tmp_path / name, "kuka")


@pytest.mark.parametrize("options", [{"length_unit": "cm"}, {"angle_unit": "grad"}])
def test_an_unknown_unit_is_a_slip_of_the_caller(tmp_path, options):
    (tmp_path / "p.csv").write_text("300,0,0,90,0,0\n350,0,0,80,0,0\n")
    with pytest.raises(ValueError, match=r"expected a unit, one of .*; got '(cm|grad)'"):
        read_robot_poses(tmp_path / "p.csv", "kuka", **options)
    with pytest.raises(ValueError, match=r"expected a unit, one of .*; got '(cm|grad)'"):
        pose_from_numbers([300, 0, 0, 90, 0, 0], "kuka", **options)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(UnreadableFile, match=r"nowhere\.csv"):
        read_robot_poses(tmp_path / "nowhere.csv", "kuka")


def test_a_convention_is_never_guessed(tmp_path):
    with pytest.raises(TypeError, match="convention"):
        read_robot_poses(tmp_path / "poses.csv")
    with pytest.raises(ValueError, match=", ".join(CONVENTIONS)):
        read_robot_poses(tmp_path / "poses.csv", "auto")


def test_an_encoder_axis_moves_the_section_in_equal_steps():
    poses = build_encoder_poses(4, (0, 3, 0), 0.25)
    assert poses[0] == Pose()
    np.testing.assert_allclose(poses[3].translation, (0, 0.75, 0), rtol=0, atol=MACHINE)
    np.testing.assert_allclose(poses[3].rotation, np.eye(3), rtol=0, atol=MACHINE)


@pytest.mark.parametrize(("count", "step"), [(0, 1.0), (3, 0.0), (3, math.nan)])
def test_an_encoder_that_does_not_move_is_rejected(count, step):
    with pytest.raises(ValueError, match="expected"):
        build_encoder_poses(count, (0, 0, 1), step)


@pytest.mark.skipif(not REAL.is_dir(), reason="real data not on this machine")
def test_real_files_of_two_robots_read():
    fanuc = read_robot_poses(REAL / "sphere-robot/main/RobPoses.rob", "fanuc")
    text = read_robot_poses(REAL / "sphere-robot/ball/robpose.txt", "fanuc")
    abb = read_robot_poses(REAL / "etna/data_calib3/pose0001.txt", "ros")
    assert (len(fanuc), len(text), len(abb)) == (15, 10, 1)
    assert abb[0].translation[0] == pytest.approx(1360.04, abs=0.01)


def test_names_of_pose_files_may_hold_digits_of_any_script(tmp_path):
    rows = {"1\u00b22.csv": "100,0,0,0,0,0", "1\u00b210.csv": "200,0,0,0,0,0"}
    for name, row in rows.items():
        (tmp_path / name).write_text(row)
    poses = read_robot_poses(tmp_path, "kuka")
    assert [pose.translation[0] for pose in poses] == [100.0, 200.0]


def test_a_name_that_no_file_can_have_is_rejected(tmp_path):
    with pytest.raises(UnreadableFile, match="the name is too long"):
        read_robot_poses(tmp_path / ("a" * 5000), "kuka")
