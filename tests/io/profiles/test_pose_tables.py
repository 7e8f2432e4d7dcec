"""A file of robot poses where a profile is expected: the message says so, and what to do."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import read_profiles

RNG = np.random.default_rng(2)
PLACES = RNG.uniform(-900, 900, (12, 3)).round(4)
TURNS = Rotation.random(12, random_state=4)
STAMPS = 1.7e9 + np.arange(12.0)[:, None]
QUATERNION = ",".join(
    [f"position.{axis}" for axis in "xyz"] + [f"orientation.{axis}" for axis in "xyzw"]
)
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
        (matrices(), "", r"rows of 16 look .*4x4 matrices"),
        (matrices()[:, :12], "", r"rows of 12 look .*3x4 matrices"),
        (matrices().reshape(-1, 4), "", r"rows of 4 look .*4x4 matrices"),
        (np.hstack([STAMPS, PLACES, TURNS.as_quat()]), "", r"8 look .* quaternion"),
        (np.hstack([PLACES, TURNS.as_quat()]), QUATERNION, "columns position.x, .*orientation.w"),
        (np.hstack([PLACES, PLACES]), "j1,j2,j3,j4,j5,j6", "columns j1, j2, j3, j4, j5, j6"),
    ],
    ids=[
        *("degrees", "rotation vector", "quaternion", "named", "named quaternion", "matrix"),
        *("KITTI", "blocks", "TUM", "named as in ROS", "joints"),
    ],
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


def test_a_cloud_with_intensity_and_colour_is_read(tmp_path):
    x = np.linspace(-15, 15, 60)
    colour = RNG.integers(0, 256, (60, 3))
    rows = np.column_stack([x, 0 * x, np.sqrt(400 - x**2) - 300, np.full(60, -1200), colour])
    path = tmp_path / "cloud.pts"
    np.savetxt(path, rows, fmt="%.4f %.4f %.4f %d %d %d %d", header="60", comments="")
    assert len(read_profiles(path)[0]) == 60


def paths():
    """Poses of a robot that moves in a plane, or along a line with constant rotation."""
    along = np.linspace(-0.8, 0.8, 12)
    bow = [500 + 200 * np.sin(along), np.zeros(12), 700 + 200 * np.cos(along)]
    line = [400 + 100 * along, np.full(12, 120.0), 350 + RNG.normal(0, 0.01, 12)]
    yield np.column_stack([*bow, np.zeros(12), np.degrees(along), np.zeros(12)])
    yield np.column_stack([*line, np.tile([12.0, 3.0, 178.0], (12, 1))])


@pytest.mark.parametrize("order", [[0, 1, 2], [0, 2, 1]], ids=["constant y", "constant z"])
@pytest.mark.parametrize("names", ["x,y,z,a,b,c", "x,y,z,rx,ry,rz", "x,y,z,roll,pitch,yaw", ""])
@pytest.mark.parametrize("rows", list(paths()), ids=["turning", "straight"])
def test_paths_in_a_plane_are_no_profile(tmp_path, rows, names, order):
    path = written(tmp_path / "path.csv", rows[:, [*order, 3, 4, 5]], names)
    with pytest.raises(UnreadableFile, match=f"robot poses.*{TO_DO}"):
        read_profiles(path)


def test_a_profile_with_a_constant_attitude_is_read(tmp_path):
    x = np.linspace(-15, 15, 60)
    rows = np.column_stack([x, 0 * x, np.sqrt(400 - x**2) - 300, np.tile([1.0, 2.0, 3.0], (60, 1))])
    path = written(tmp_path / "profile.csv", rows, "x,y,z,roll,pitch,yaw")
    assert read_profiles(path)[0].lost == 0


POSE = "{X 512.5, Y -20.25, Z 300.5, A 12.5, B 3.25, C 178.5}"
SIX = ", ".join(f"{number:.3f}" for number in [*PLACES[0], 12.5, 3.25, 178.5])
PROGRAMS = {
    "kuka": f"DEF a()\nPTP {POSE}\nLIN {POSE}\nEND\n",
    "fanuc": "/PROG A\n/POS\nP[1]{\n GP1:\n UF : 0, UT : 1, CONFIG : 'N U T, 0, 0, 0',\n"
    " X = 512.5 mm, Y = -20.2 mm, Z = 300.5 mm,\n W = 12.5 deg, P = 3.2 deg, R = 178.5 deg\n};\n",
    "abb": "MODULE m\nCONST robtarget p1:=[[512.5,-20.2,300.5],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,"
    "9E9,9E9,9E9]];\nENDMODULE\n",
    "ur": f"def a():\n  movel(p[{SIX}], a=1.2)\n  movel(p[{SIX}], a=1.2)\nend\n",
    "yaskawa": f"/JOB\n//POS\n///RECTAN\nC00000={SIX.replace(' ', '')}\n//INST\nEND\n",
    "mitsubishi": f"P1=({SIX})(7,0)\nP2=({SIX})(7,0)\n",
    "kawasaki": ".PROGRAM a()\n.END\n.TRANS\np1 1.5 2.5 3.5 4.5 5.5 6.5\n.END\n",
}


@pytest.mark.parametrize("maker", PROGRAMS)
def test_robot_programs_are_named(tmp_path, maker):
    path = tmp_path / "program.txt"
    path.write_text(PROGRAMS[maker])
    with pytest.raises(UnreadableFile, match=rf"robot .* as --poses FILE --convention {maker}"):
        read_profiles(path)


@pytest.mark.parametrize(
    "text",
    [
        "poses:\n" + f"- [{SIX}]\n" * 5,
        "poses:\n" + "- x: 1.5\n  y: 2.5\n  z: 3.5\n  rx: 0.5\n  ry: 0.25\n  rz: 0.75\n" * 5,
        "header:\n  seq: 1\npose:\n  position:\n    x: 1.5\n  orientation:\n    x: 0.5\n---\n",
        "%YAML:1.0\n---\nbase2gripper: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n"
        f"   data: [{', '.join(map(str, np.eye(4).ravel()))}]\n",
        f"p[{SIX}]\n" * 5,
        "((1.25, 0.5, -0.75), (0.5, 0.5, -0.5, 0.5))\n",
    ],
    ids=["rows", "mappings", "ROS", "OpenCV", "brackets", "Python"],
)
def test_poses_in_texts_are_named(tmp_path, text):
    path = tmp_path / "poses.yaml"
    path.write_text(text)
    with pytest.raises(UnreadableFile, match=r"robot poses and no profile: .* as --poses FILE"):
        read_profiles(path)


MATRICES = matrices().reshape(12, 4, 4)


@pytest.mark.parametrize(
    "document",
    [
        np.hstack([PLACES, TURNS.as_rotvec()]).tolist(),
        {"poses": np.hstack([PLACES, TURNS.as_quat()]).tolist()},
        MATRICES.tolist(),
        MATRICES[0].tolist(),
        {"frames": [{"file_path": "1.png", "transform_matrix": MATRICES[0].tolist()}]},
        [{"position": {"x": 1.0, "y": 2.0, "z": 3.0}, "orientation": {"w": 1.0}}],
        [
            [place.tolist(), turn.tolist()]
            for place, turn in zip(PLACES, TURNS.as_quat(), strict=True)
        ],
    ],
    ids=["rows", "key", "matrices", "matrix", "frames", "ROS", "nested"],
)
def test_poses_in_json_are_named(tmp_path, document):
    path = tmp_path / "poses.json"
    path.write_text(json.dumps(document))
    with pytest.raises(UnreadableFile, match=r"robot poses.* as --poses FILE"):
        read_profiles(path)


@pytest.mark.parametrize(
    "arrays",
    [
        {"arr_0": MATRICES},
        {"poses": MATRICES[:, :3]},
        {"R": TURNS.as_matrix(), "t": PLACES},
        {"translation": PLACES, "rotation": TURNS.as_quat()},
    ],
)
def test_poses_in_arrays_are_named(tmp_path, arrays):
    np.savez(tmp_path / "poses.npz", **arrays)
    np.save(tmp_path / "poses.npy", MATRICES)
    for name in ("poses.npz", "poses.npy"):
        with pytest.raises(UnreadableFile, match=r"robot poses.* as --poses FILE"):
            read_profiles(tmp_path / name)


@pytest.mark.parametrize("cell", ["x=-60.25", "P(12", "-170.5*5A"])
def test_numbers_within_text_are_not_left_out(tmp_path, cell):
    lines = [f"{cell[:-1]}{k},{k + 0.5},{k * k % 7 + 0.25}" for k in range(9)]
    path = tmp_path / "glued.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(UnreadableFile, match="column 0 holds numbers with other text"):
        read_profiles(path)
