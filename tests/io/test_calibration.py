import json

import cv2
import numpy as np
import pytest

from lsvision.calibration.bundle_adjustment_problem import LaserView
from lsvision.calibration.intrinsics import CameraSettings, fit_camera
from lsvision.calibration.laser_plane import fit_laser_plane
from lsvision.calibration.target import TargetView
from lsvision.errors import UnreadableFile, UnwritableFile
from lsvision.geometry import Plane
from lsvision.io.calibration import (
    build_provenance,
    write_calibration,
)
from lsvision.io.camera_file import read_camera, read_camera_covariance, write_camera_yaml
from lsvision.sensors.camera import Camera
from lsvision.sensors.light_section import LightSection
from lsvision.simulate.boards import BoardScene, simulate_boards

MATRIX = [[514.5, 0.0, 329.25], [0.0, 685.75, 237.5], [0.0, 0.0, 1.0]]
LENS = [-0.35, 0.125, 0.0005, -0.25e-3, 0.0]
CAMERA = Camera(MATRIX, LENS, (640, 480))

ROS_FILE = """image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [514.5, 0., 329.25, 0., 685.75, 237.5, 0., 0., 1.]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.35, 0.125, 0.0005, -2.5e-04, 0.000000]
rectification_matrix:
  rows: 3
  cols: 3
  data: [9., 0., 0., 0., 9., 0., 0., 0., 9.]
"""
ROS1_MESSAGE = """header:
  frame_id: "cam"
height: 480
width: 640
distortion_model: "plumb_bob"
D: [-0.35, 0.125, 0.0005, -0.00025, 0.0]
K: [514.5, 0.0, 329.25, 0.0, 685.75, 237.5, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
"""
ROS2_MESSAGE = """header:
  stamp:
    sec: 1
height: 480
width: 640
distortion_model: plumb_bob
d:
- -0.35
- 0.125
- 0.0005
- -0.00025
- 0.0
k:
- 514.5
- 0.0
- 329.25
- 0.0
- 685.75
- 237.5
- 0.0
- 0.0
- 1.0
r:
- 1.0
---
"""
OPENCV_NAMELESS = """%YAML:1.0
M1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.145e+02, 0., 3.2925e+02, 0.,
       685.75, 2.375e+02, 0., 0., 1. ]
D1: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.35, 0.125, 5.0e-04, -2.5e-04, 0. ]
"""


def assert_same_camera(got, want):
    np.testing.assert_array_equal(got.matrix, want.matrix)
    np.testing.assert_array_equal(got.distortion, want.distortion)
    assert got.size == want.size


@pytest.mark.parametrize("text", [ROS_FILE, ROS1_MESSAGE, ROS2_MESSAGE], ids=["file", "1", "2"])
def test_ros_camera_info_is_read(text, tmp_path):
    (tmp_path / "camera.yaml").write_text(text)
    assert_same_camera(read_camera(tmp_path / "camera.yaml"), CAMERA)


def test_opencv_file_without_size_is_read_when_given_the_size(tmp_path):
    path = tmp_path / "intrinsics.yml"
    path.write_text(OPENCV_NAMELESS)
    assert_same_camera(read_camera(path, size=(640, 480)), CAMERA)
    with pytest.raises(UnreadableFile, match=r"intrinsics.yml .* give size="):
        read_camera(path)


def test_file_written_by_this_opencv_is_read(tmp_path):
    path = str(tmp_path / "cv.yaml")
    storage = cv2.FileStorage(path, cv2.FileStorage_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", np.array(MATRIX))
    storage.write("distortion_coefficients", np.array(LENS))
    storage.release()
    assert_same_camera(read_camera(path), CAMERA)


def test_opencv_reads_the_yaml_we_write(tmp_path):
    path = str(tmp_path / "camera.yaml")
    write_camera_yaml(path, CAMERA)
    storage = cv2.FileStorage(path, cv2.FileStorage_READ)
    np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), MATRIX)
    lens = storage.getNode("distortion_coefficients").mat()
    np.testing.assert_array_equal(lens.ravel(), LENS)
    assert_same_camera(read_camera(path), CAMERA)


@pytest.fixture(scope="module")
def boards():
    return simulate_boards(BoardScene(), 4, rng=np.random.default_rng(5))


@pytest.fixture(scope="module")
def camera_calibration(boards):
    return fit_camera(
        [TargetView(board.points, board.pixels, (1280, 1024)) for board in boards],
        CameraSettings(radial_terms=1),
    )


def test_camera_calibration_carries_camera_and_evidence(camera_calibration, tmp_path):
    path = tmp_path / "camera.json"
    write_calibration(path, camera_calibration, {"method": "test"})
    assert_same_camera(read_camera(path), camera_calibration.camera)
    written = json.loads(path.read_text())
    assert written["schema"] == "lsvision/camera-calibration/1"
    assert written["units"]["length"] == "mm"
    assert written["std"]["fx"] == camera_calibration.std["fx"]
    assert len(written["views"][3]["residuals"]) == 70
    assert written["provenance"] == {"method": "test"}


def test_laser_plane_calibration_carries_plane_and_evidence(boards, camera_calibration, tmp_path):
    views = [
        LaserView(board.points, board.pixels, board.line_pixels, np.full(100, 0.1))
        for board in boards
    ]
    calibration = fit_laser_plane(camera_calibration.camera, views)
    path = tmp_path / "laser.json"
    write_calibration(path, calibration, {})
    written = json.loads(path.read_text())
    assert written["laser_plane"]["distance"] == calibration.plane.distance
    np.testing.assert_array_equal(written["covariance"], calibration.covariance)
    assert_same_camera(read_camera(path), calibration.light_section.camera)


def test_camera_of_a_rig_file_is_read(tmp_path):
    LightSection(CAMERA, Plane((0, 0.8, 0.6), 100.0)).save(tmp_path / "rig.json")
    assert_same_camera(read_camera(tmp_path / "rig.json"), CAMERA)


def test_byte_order_mark_before_a_camera_is_skipped(tmp_path):
    path = tmp_path / "rig.json"
    LightSection(CAMERA, Plane((0, 0.8, 0.6), 100.0)).save(path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert_same_camera(read_camera(path), CAMERA)


def test_provenance_tells_the_inputs_apart(tmp_path):
    file = tmp_path / "a.png"
    file.write_bytes(b"one")
    first = build_provenance("test", [file])
    file.write_bytes(b"two")
    assert first["inputs"] == "a.png"
    assert first["inputs_sha256"] != build_provenance("test", [file])["inputs_sha256"]
    with pytest.raises(UnreadableFile, match=r"b\.png: no such file"):
        build_provenance("test", [tmp_path / "b.png"])


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (ROS_FILE.replace("plumb_bob", "equidistant"), "lens model is 'equidistant'"),
        (
            "left:\n" + ROS_FILE.replace("plumb_bob", "equidistant").replace("\n", "\n  "),
            "lens model is 'equidistant'",
        ),
        ("%YAML:1.0\n---\nfisheye_model: 1\n" + ROS_FILE, "lens model is 'fisheye'"),
        (ROS_FILE.replace("camera_matrix", "matrix"), "expected camera matrix under one of"),
        (ROS_FILE.replace("0., 0., 1.]", "0.]"), "matrix of 9 numbers, got 7"),
        (ROS_FILE.replace("distortion_coefficients", "x"), "expected distortion coefficients"),
        ('{"schema": "something"}', "has schema 'something'"),
        ("{ broken", "is not JSON"),
        ("\x89PNG", "holds no camera"),
    ],
)
def test_files_without_a_camera_are_rejected_by_name(text, match, tmp_path):
    path = tmp_path / "input.yaml"
    path.write_text(text)
    with pytest.raises(UnreadableFile, match=rf"input.yaml.*{match}"):
        read_camera(path)


def test_size_that_contradicts_the_file_is_rejected(tmp_path):
    (tmp_path / "a.yaml").write_text(ROS_FILE)
    with pytest.raises(UnreadableFile, match=r"images of 5 x 5 px, got .* 640 x 480 px: give"):
        read_camera(tmp_path / "a.yaml", size=(5, 5))
    LightSection(CAMERA, Plane((0, 0.8, 0.6), 100.0)).save(tmp_path / "a.json")
    with pytest.raises(UnreadableFile, match=r"a\.json .*images of 5 x 5 px, got"):
        read_camera(tmp_path / "a.json", size=(5, 5))


def test_missing_files_and_folders_are_named(camera_calibration, tmp_path):
    with pytest.raises(UnreadableFile, match=r"none\.json: no such file"):
        read_camera(tmp_path / "none.json")
    with pytest.raises(UnwritableFile, match="gone"):
        write_calibration(tmp_path / "gone" / "a.json", camera_calibration, {})


def test_the_covariance_of_a_camera_is_read_again_and_rejected_where_it_is_none(tmp_path):
    boards = simulate_boards(BoardScene(), 6, rng=np.random.default_rng(4))
    found = fit_camera([TargetView(b.points, b.pixels, BoardScene().size) for b in boards])
    path = tmp_path / "camera.json"
    write_calibration(path, found, {})
    np.testing.assert_allclose(read_camera_covariance(path), found.covariance, rtol=1e-12)
    document = json.loads(path.read_text())
    document["camera_covariance"] = [[1.0]]
    path.write_text(json.dumps(document))
    with pytest.raises(UnreadableFile, match=r"camera.json: camera_covariance: .* calibrate again"):
        read_camera_covariance(path)
    del document["camera_covariance"]
    path.write_text(json.dumps(document))
    assert read_camera_covariance(path) is None


ROWS = {
    "flow": "[[900.0, 0.0, 320.0], [0.0, 900.0, 240.0], [0.0, 0.0, 1.0]]",
    "rows": "\n- [900.0, 0.0, 320.0]\n- [0.0, 900.0, 240.0]\n- [0.0, 0.0, 1.0]",
    "block": "\n- - 900.0\n  - 0.0\n  - 320.0\n- - 0.0\n  - 900.0\n  - 240.0\n- - 0\n  - 0\n  - 1",
}


@pytest.mark.parametrize("form", ROWS)
def test_a_matrix_in_rows_and_the_size_beside_that_of_a_region_are_read(form, tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(
        f"camera_matrix: {ROWS[form]}\ndist_coeffs: [[-0.1, 0.05, 0, 0, 0]]\nheight: 480\n"
        "roi:\n  height: 0\n  width: 0\nwidth: 640\n"
    )
    camera = read_camera(path)
    assert (camera.size, camera.focal_length) == ((640, 480), 900.0)
    np.testing.assert_array_equal(camera.matrix[:2, 2], (320, 240))
    np.testing.assert_array_equal(camera.distortion, (-0.1, 0.05, 0, 0, 0))
