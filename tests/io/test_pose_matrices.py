"""Matrices of poses as programs print them; poses of Staubli robots."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lsvision.errors import UnreadableFile
from lsvision.io.pose_matrices import find_printed_matrices
from lsvision.io.pose_numbers import numbers_from_pose
from lsvision.io.robot_poses import read_robot_poses

RNG = np.random.default_rng(8)
MATRICES = [np.eye(4) for _ in range(4)]
for matrix in MATRICES:
    matrix[:3, :3] = Rotation.from_rotvec(RNG.normal(0, 0.5, 3)).as_matrix()
    matrix[:3, 3] = RNG.uniform(-500, 500, 3)
PRINTED = 1e-3  # `print` rounds to 8 digits
ROWS = [[" ".join(f"{v:.6f}" for v in row) for row in matrix] for matrix in MATRICES]


@pytest.mark.parametrize(
    "text",
    [
        "\n".join(map(str, MATRICES)),
        "\n".join(map(repr, MATRICES)),
        str(np.array(MATRICES)),
        str(MATRICES),
        str(np.array(MATRICES).tolist()),
        "\n".join(f"pose {k}:\n{matrix}" for k, matrix in enumerate(MATRICES)),
        "\n".join(f"T{k} = {matrix}" for k, matrix in enumerate(MATRICES)),
        "\n\n".join("\n".join(rows) for rows in ROWS),
        "# in mm\n" + "\n".join(f"[{'; '.join(rows)}]" for rows in ROWS),
    ],
)
def test_printed_matrices_are_read(tmp_path, text):
    path = tmp_path / "poses.txt"
    path.write_text(text)
    poses = read_robot_poses(path, "matrix")
    np.testing.assert_allclose([pose.matrix for pose in poses], MATRICES, rtol=0, atol=PRINTED)
    with pytest.raises(
        UnreadableFile, match=r"'kuka', got 4 4x4 matrices: use --convention matrix"
    ):
        read_robot_poses(path, "kuka")


@pytest.mark.parametrize(
    "text",
    [
        "0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 1\n",  # times, positions and quaternions
        "1 0 0 5\n0 1 0 6\n0 0 1 7\n",  # without the last row
        "1 0 0 0\n0 1 0 0\n0 0 1 0\n5 6 7 1\n",  # column by column
        "x y z w\n1 0 0 5\n0 1 0 6\n0 0 1 7\n0 0 0 1\n",
        "p[1, 2, 3, 0, 0, 1]\n",
        "",
    ],
)
def test_other_numbers_are_no_matrices(text):
    assert find_printed_matrices(text) is None


@pytest.mark.parametrize("line", ["{{{}}}", "trsf p1 = {{{}}}", "pPick[0].trsf = {{{}}}"])
def test_poses_of_staubli_are_read(tmp_path, line):
    expected = [[100.0, 20.0, 500.0, 90.0, 10.0, -30.0], [150.0, 0.0, 450.0, 45.0, 0.0, 10.0]]
    path = tmp_path / "poses.txt"
    path.write_text("\n".join(line.format(", ".join(map(str, row))) for row in expected))
    poses = read_robot_poses(path, "staubli")
    numbers = [numbers_from_pose(pose, "staubli") for pose in poses]
    np.testing.assert_allclose(numbers, expected, atol=1e-9)


def test_a_data_file_of_staubli_is_named(tmp_path):
    path = tmp_path / "poses.dtx"
    path.write_text('<Value key="0" x="1" y="2" z="3" rx="4" ry="5" rz="6" fatherId="world[0]"/>')
    with pytest.raises(UnreadableFile, match="a Staubli data file, which is not read: write x y z"):
        read_robot_poses(path, "staubli")


def test_degrees_under_the_names_of_ur_name_the_robots_that_have_them(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("x,y,z,rx,ry,rz\n0.1,0.2,0.3,90,10,-30\n0.2,0.2,0.3,80,0,10\n")
    with pytest.raises(UnreadableFile, match="same columns use --convention yaskawa or staubli"):
        read_robot_poses(path, "ur")
