"""A file of robot poses where a profile is expected: the message says so, and what to do."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import read_profiles

RNG = np.random.default_rng(2)
PLACES = RNG.uniform(-900, 900, (12, 3)).round(4)
TURNS = Rotation.random(12, random_state=4)
TO_DO = r"the poses of their flange as --poses FILE --convention NAME; .* with --columns"


def written(path, rows, header=""):
    np.savetxt(path, rows, fmt="%.6f", header=header, comments="", delimiter=",")
    return path


def matrices():
    rows = np.tile(np.eye(4), (12, 1, 1))
    rows[:, :3, :3], rows[:, :3, 3] = TURNS.as_matrix(), PLACES
    return rows.reshape(12, 16)


@pytest.mark.parametrize(
    ("rows", "header", "message"),
    [
        (np.hstack([PLACES, TURNS.as_euler("ZYX", degrees=True)]), "", r"6 look .* three angles"),
        (np.hstack([PLACES / 1000, TURNS.as_rotvec()]), "", r"6 look .* three angles"),
        (np.hstack([PLACES, TURNS.as_quat()]), "", r"7 look .* quaternion"),
        (np.hstack([PLACES, TURNS.as_rotvec()]), "x,y,z,rx,ry,rz", "columns x, y, z, rx, ry, rz"),
        (np.hstack([PLACES, TURNS.as_quat()]), "x,y,z,qx,qy,qz,qw", "x, y, z, qx, qy, qz, qw"),
        (matrices(), "", "each row is a 4x4 matrix"),
    ],
    ids=["degrees", "rotation vector", "quaternion", "named", "named quaternion", "matrix"],
)
def test_poses_are_named_and_the_option_for_them(tmp_path, rows, header, message):
    path = written(tmp_path / "poses.csv", rows, header)
    with pytest.raises(UnreadableFile, match=f"{message}.*{TO_DO}"):
        read_profiles(path)


@pytest.mark.parametrize("extra", ["normals", "colours"])
def test_points_in_space_are_not_taken_for_poses(tmp_path, extra):
    normals = TURNS.as_matrix()[:, 0]
    more = normals if extra == "normals" else RNG.integers(0, 256, (12, 3))
    path = written(tmp_path / "points.csv", np.hstack([PLACES, more]))
    with pytest.raises(UnreadableFile, match="column 1 does not separate profiles"):
        read_profiles(path)


def test_profiles_with_the_attitude_of_the_sensor_are_read(tmp_path):
    x = np.tile(np.arange(20.0), 3)
    y = np.repeat([0.0, 1.0, 2.0], 20)
    rows = np.column_stack([x, y, np.sin(x) - 200, 0.1 * y, 0.2 * y, 0.3 * y])
    path = written(tmp_path / "scan.csv", rows, "x,y,z,roll,pitch,yaw")
    assert len(read_profiles(path)) == 3
