"""Files as they should be, from which spoilt ones are made; all made here."""

import functools
import io
import json
import tempfile
from pathlib import Path

import cv2
import numpy as np
import pyarrow
import pyarrow.parquet

from lsvision.calibration.hand_eye_result import HandEye
from lsvision.calibration.observations import RejectedPose, Sphere
from lsvision.geometry import Plane, Pose
from lsvision.io.hand_eye_file import save_hand_eye
from lsvision.sensors.camera import Camera
from lsvision.sensors.light_section import LightSection

ANGLE = np.linspace(2.6, 0.5, 40)
PIPE = 20 * np.column_stack([np.cos(ANGLE), np.sin(ANGLE)]) - [0, 400]


def pipe_points(count=90, radius=20.0):
    angle = np.linspace(2.6, 0.5, count)
    noise = np.random.default_rng(1).normal(0, 0.03, (count, 2))
    return radius * np.column_stack([np.cos(angle), np.sin(angle)]) - [0, 400] + noise


def _text(points, separator=",", head=""):
    return (head + "\n".join(separator.join(f"{x:.3f}" for x in row) for row in points)).encode()


def _saved(write):
    stream = io.BytesIO()
    write(stream)
    return stream.getvalue()


def _opencv(suffix, key, array):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a.{suffix}"
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        storage.write(key, array)
        storage.release()
        return path.read_bytes()


@functools.cache
def profile_files():
    x, z = PIPE.T
    xyz = np.column_stack([x, np.repeat([0.0, 1.0], 20), z])
    cloud = np.rec.fromarrays(xyz.astype("<f4").T, names="x,y,z").tobytes()
    pcd = (
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 20\nHEIGHT 2\n"
        "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 40\nDATA "
    )
    ply = (
        "ply\nformat {}\ncomment a\nelement vertex 40\nproperty float x\nproperty float y\n"
        "property float z\nelement face 0\nproperty list uchar int v\nend_header\n"
    )
    gocator = "Info\nCSV Version,1\nEnd\nPart\nY\\X," + ",".join(map(str, x)) + "\n"
    gocator += "0.5," + ",".join(map(str, z)) + "\nEnd\nProfile\nA,Axis,1,2,3\n0,X,1,2,3\n0,Z,4,5,6"
    table = pyarrow.table({"x": x, "z": z, "scan": np.repeat([0, 1], 20)})
    lists = pyarrow.table({"x": [list(x), list(x)], "z": [list(z), None]})
    record = np.rec.fromarrays(PIPE.T, names="x,z")
    return (
        _text(PIPE),
        _text(PIPE, ";", "x [mm];z [mm]\n").replace(b".", b","),
        _text(PIPE, "\t", "# profile 7\n# units: um\nx\tz\n"),
        _text(xyz, " ", "x y z\n"),
        _text(PIPE, "  ", "40\n"),
        _text(np.column_stack([np.repeat([1, 2], 20), PIPE]), ",", "scan,x,range [m]\n"),
        _text(np.array([x, z]), ","),
        _text(PIPE).replace(b"\n", b"\r\n").decode().encode("utf-16"),
        b"\n".join(b",".join([b"32768"] * 800) for _ in range(2)),
        gocator.encode(),
        b"frame,x0,z0,x1,z1\n0,1,2,3,4\n1,1,2,3,\n",
        _saved(lambda s: np.save(s, PIPE)),
        _saved(lambda s: np.save(s, PIPE.astype("i2"))),
        _saved(lambda s: np.save(s, np.stack([PIPE, PIPE]))),
        _saved(lambda s: np.save(s, record)),
        _saved(lambda s: np.savez(s, x=x, z=z)),
        _saved(lambda s: np.savez_compressed(s, points=PIPE)),
        (pcd + "binary\n").encode() + cloud,
        (pcd + "ascii\n").encode() + _text(xyz, " "),
        ply.format("ascii 1.0").encode() + _text(xyz, " "),
        ply.format("binary_little_endian 1.0").encode() + cloud,
        _saved(lambda s: pyarrow.parquet.write_table(table, s)),
        _saved(lambda s: pyarrow.parquet.write_table(lists, s, compression="none")),
        *(_opencv(suffix, "points", PIPE) for suffix in ("yml", "xml", "json")),
        *(
            _opencv(suffix, "m", PIPE.reshape(-1, 1, 2).astype("f4"))
            for suffix in ("yml", "xml", "json")
        ),
        b"%YAML:1.0\n---\nscan_line: [" + ",".join(map(str, xyz.ravel())).encode() + b"]\n",
        json.dumps({"x": list(x), "z": list(z)}).encode(),
        json.dumps(PIPE.tolist()).encode(),
        json.dumps([{"x": a, "z": b} for a, b in PIPE]).encode(),
        b"header:\n  seq: 1\nangle_min: -1.5\nangle_max: 1.5\nangle_increment: 0.1\n"
        b"range_max: 10.0\nranges: [" + b"1.5, " * 30 + b"1.5]\n",
        b"header:\n  seq: 1\nangle_min: -1.5\nangle_increment: 0.1\nranges:\n"
        + b"- 1.5\n- .inf\n" * 15,
        b"%time,field.angle_min,field.angle_increment,field.ranges0,field.ranges1\n"
        b"1,-0.5,0.1,1.5,inf\n2,-0.5,0.1,1.6,1.7\n",
        b"# invalid: -9999\n" + _text(PIPE, ";", "X [1/10 mm];Z [1/10 mm]\n") + b"\n3;-9999\nEND",
        _text(PIPE, ",", "x,z\num,um\n").replace(b"-400", b"-999.9999"),
        b"x,z,part\n" + b"".join(b'"%d,5",-400.25,P7\n' % k for k in range(40)),
        _text(np.tile(z, (5, 1)), ",", "# unit: um\n"),
        _text(np.tile(-z, (5, 1)), ",", ",".join(f"range_{k}" for k in range(40)) + "\n"),
        _text(np.tile(z, (5, 1)), ",", ",".join(map(str, range(40))) + "\n"),
        _text(np.column_stack([np.arange(40), z]), ",", ",z\n"),
        _text(np.column_stack([x, np.repeat([10, 20], 20), z]), ",", "x [mm],Encoder_pos,z\n"),
        cv2.imencode(".png", np.full((5, 40), 700, np.uint16))[1].tobytes(),
        cv2.imencode(".tif", np.full((5, 40), 7.5, np.float32))[1].tobytes(),
        *_bags(),
        b"",
        b"\x89PNG\r\n\x1a\n",
        b"PK\x05\x06" + bytes(18),
    )


def _bags():
    """ROS bags of two scans in each format; none where rosbags is not installed."""
    try:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        return ()
    contents = []
    for suffix in (".bag", ".db3", ".mcap"):
        store = get_typestore(Stores.ROS1_NOETIC if suffix == ".bag" else Stores.ROS2_HUMBLE)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"b{suffix if suffix == '.bag' else ''}"
            if suffix == ".bag":
                writer, serialize = rosbag1.Writer(path), store.serialize_ros1
            else:
                plugin = rosbag2.StoragePlugin
                storage = plugin.MCAP if suffix == ".mcap" else plugin.SQLITE3
                writer = rosbag2.Writer(path, version=9, storage_plugin=storage)
                serialize, path = store.serialize_cdr, path / f"b{suffix}"
            with writer:
                kind = "sensor_msgs/msg/LaserScan"
                connection = writer.add_connection("/scan", kind, typestore=store)
                for number in range(2):
                    writer.write(connection, number + 1, serialize(_scan(store, number), kind))
            contents.append(path.read_bytes())
    return tuple(contents)


def _scan(store, number):
    time = store.types["builtin_interfaces/msg/Time"](number, 0)
    head = store.types["std_msgs/msg/Header"]
    names = {"seq": number} if "seq" in head.__dataclass_fields__ else {}
    ranges = np.linspace(0.4, 0.5, 30, dtype=np.float32)
    return store.types["sensor_msgs/msg/LaserScan"](
        head(stamp=time, frame_id="a", **names), -0.1, 0.1, 0.2 / 29, 0.0, 0.1, 0.05, 10.0, ranges,
        np.zeros(0, np.float32),
    )  # fmt: skip


def pose_rows():
    return [[500.0 + 10 * k, 20.0 * k, 300.0, 10.0 * k, 5.0, 180.0 - 2 * k] for k in range(4)]


@functools.cache
def find_pose_files():
    rows = pose_rows()
    named = [dict(zip("xyzabc", row, strict=True)) for row in rows]
    matrices = [Pose.along((1, 2, 3), 40.0 * k).matrix.ravel().tolist() for k in range(4)]
    return (
        (".csv", _text(rows)),
        (".txt", _text(rows, " ", "# kuka\nX Y Z A B C\n")),
        (".csv", _text(rows, ";").replace(b".", b",")),
        (".json", json.dumps(rows).encode()),
        (".json", json.dumps({"poses": named}).encode()),
        (".yaml", ("poses:\n" + "".join(f"- {row}\n" for row in rows)).encode()),
        (
            ".yml",
            "".join(
                "- {" + ", ".join(f"{k}: {v}" for k, v in row.items()) + "}\n" for row in named
            ).encode(),
        ),
        (".csv", _text(matrices)),
        (".txt", b"x [m],y [m],z [m],rx,ry,rz\n1,2,3,0.1,0.2,0.3\n1,2,4,0.1,0.2,0.5\n"),
        (
            ".src",
            b"; DECL\nDECL E6POS P1={X 1.5,Y 2,Z 300,A 10,B 0,C 180,S 2,T 1} ; a\n"
            b"P2={FRAME: X 90,Y 2,Z 300,A 0,B 0,C 90}\n",
        ),
        (
            ".ls",
            b'/POS\nP[1:"a"]{\n GP1:\n UF : 0, UT : 1,\n X = 1.5 mm, Y = 2 mm, Z = 300 mm,\n'
            b" W = 10 deg, P = 0 deg, R = 180 deg\n};\nP[2]{ GP1: UF : 0, UT : 1, X = 90 mm, "
            b"Y = 2 mm, Z = 300 mm, W = 0 deg, P = 0 deg, R = 90 deg };\n/END\n",
        ),
        (".rob", json.dumps({"RobPoses": rows, "n": 1}).encode()),
        (".txt", b"((0.1,0.2,0.3),(0,0,0,1))\n((0.1,0.3,0.3),(0,0.6,0,0.8))\n"),
        (".csv", _text(rows, ",", "# angles in deg, convention: kuka\nX,Y,Z,A,B,C\nmm,mm,mm,,,\n")),
        (".json", json.dumps({"unit": "mm", "angle_unit": "deg", "poses": rows}).encode()),
        (
            ".mod",
            b"CONST robtarget a:=[[1,2,300],[1,0,0,0],[0,0,0,0],[9E9]]; ! a\n"
            b"CONST robtarget b:=[[90,2,300],[0.6,0,0.8,0],[0,0,0,0],[9E9]];\n"
            b"MoveL a,v100,fine,t\\WObj:=w;\n",
        ),
        (".prg", b"P1=(+1,2,300,180,0,90)(7,0) ' a\nP2=(90.5,2,300,180,0,90,0,0)(7,0)\n"),
        (
            ".json",
            json.dumps(
                [
                    {
                        "position": {"x": 0.1, "y": 0.2, "z": 0.1 * k},
                        "orientation": {"x": 0, "y": 0, "z": 0, "w": 1},
                    }
                    for k in range(3)
                ]
            ).encode(),
        ),
    )


@functools.cache
def rig():
    camera = Camera([[900, 0, 160], [0, 900, 120], [0, 0, 1]], [-0.1, 0.05, 0, 0], (320, 240))
    return LightSection(camera, Plane((0.0, 0.866, 0.5), 150.0), {"method": "made"}, 0.5)


def _document(write):
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / "a.json")
        return json.loads((Path(folder) / "a.json").read_text())


@functools.cache
def rig_document():
    return _document(rig().save)


@functools.cache
def hand_eye_document():
    rotation = [[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]
    hand_eye = HandEye(
        mount_from_sensor=Pose(rotation, (10, 20, 30)),
        covariance=np.diag([1, 2, 3, 4, 5, 6]) * 1e-4,
        residuals=np.array([0.1, np.nan, 0.2]),
        leave_one_out_residuals=np.array([0.2, np.nan, 0.3]),
        rejected=(RejectedPose(1, "no sphere"),),
        target=Sphere((1, 2, 3), 20.0, 0.01),
        working_point=(0, -150, 0),
        robot_std=(0.05, 1e-4),
        ambiguity_ratio=9.0,
        least_determined_std=0.2,
        least_determined_direction="about Y",
        mounting="eye_in_hand",
        sensor="section",
        height_scale=(0.993, 0.001),
    )
    return _document(lambda path: save_hand_eye(hand_eye, path))


@functools.cache
def camera_files():
    yaml = (
        "image_width: 320\nimage_height: 240\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        "  data: [900., 0., 160., 0., 900., 120., 0., 0., 1.]\ndistortion_model: plumb_bob\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.1, 0.05, 0., 0., 0.]\n"
    )
    opencv = _opencv("yml", "camera_matrix", rig().camera.matrix)
    return (
        yaml.encode(),
        opencv + b"dist_coeffs: [0., 0., 0., 0.]\nimage_width: 9\nimage_height: 9\n",
        json.dumps(rig_document()).encode(),
    )


def line_image(height=60, width=90, dtype=np.uint8):
    rows = np.arange(height)[:, None]
    centre = height / 2 + 5 * np.sin(np.arange(width) / 15)
    level = 10 + 180 * np.exp(-0.5 * ((rows - centre) / 1.5) ** 2)
    return (level * (257 if dtype == np.uint16 else 1)).astype(dtype)


@functools.cache
def image_files():
    grey, deep = line_image(), line_image(dtype=np.uint16)
    colour = np.dstack([grey, grey // 2, grey // 3])
    made = [
        (".png", grey),
        (".png", deep),
        (".png", colour),
        (".tiff", deep),
        (".jpg", grey),
        (".jpg", colour),
        (".bmp", colour),
        (".pgm", grey),
        (".webp", colour),
    ]
    return tuple((suffix, cv2.imencode(suffix, image)[1].tobytes()) for suffix, image in made)
