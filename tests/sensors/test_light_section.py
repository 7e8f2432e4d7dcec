import copy
import json
import math
import pickle
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest

from lsvision.errors import DegenerateGeometry, LsvisionError, UnreadableFile, UnwritableFile
from lsvision.geometry import Plane
from lsvision.laser_line.extraction import extract_laser_line
from lsvision.laser_line.line_blur import correct_line_blur
from lsvision.sensors.camera import Camera
from lsvision.sensors.light_section import LightSection

MACHINE = 1e-9  # mm: noise-free geometry below a metre
MATRIX = np.array([[2264.0, 0.0, 639.5], [0.0, 2264.0, 511.5], [0.0, 0.0, 1.0]])
LENS = np.array([-0.12, 0.1, 0.001, -0.0005, 0.0])
CAMERA = Camera(MATRIX, LENS, (1280, 1024))
PLANES = {
    "level line": Plane((0.0, math.cos(math.pi / 6), 0.5), 150.0),
    "upright line": Plane((0.806, -0.029, 0.592), 173.8),
    "line from below": Plane((0.0, -math.cos(math.pi / 6), 0.5), 150.0),
    "slanted": Plane((0.5, 0.6, 0.62), 140.0),
    "normal turned": Plane((0.0, -math.cos(math.pi / 6), -0.5), -150.0),
}
each_plane = pytest.mark.parametrize("plane", PLANES.values(), ids=PLANES.keys())


@dataclass
class Line:
    """What `profile_from_line` needs of a LaserLine."""

    pixels: np.ndarray
    std: np.ndarray
    direction: str = "columns"


def points_in(plane, seed=0, count=60):
    """Points of the plane in view, camera frame: rays of random pixels of a bare pinhole."""
    rng = np.random.default_rng(seed)
    rays = np.column_stack([rng.uniform(-0.2, 0.2, (count, 2)), np.ones(count)])
    depth = plane.distance / (rays @ plane.normal)
    return (rays * depth[:, None])[(depth > 100) & (depth < 2000)]


def pixels_by_cv2(points):
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), MATRIX, LENS)[0].reshape(-1, 2)


@each_plane
def test_projected_points_are_recovered_from_their_pixels(plane):
    truth = points_in(plane)
    section = LightSection(CAMERA, plane)
    found = section.points_from_pixels(pixels_by_cv2(truth))
    back = section.camera_from_section.apply(found)
    np.testing.assert_allclose(back, truth, rtol=0, atol=1e3 * MACHINE)
    np.testing.assert_allclose(section.project(found), pixels_by_cv2(truth), rtol=0, atol=1e-6)


@each_plane
def test_section_frame_keeps_its_conventions(plane):
    pose = LightSection(CAMERA, plane).camera_from_section
    x, y, z = pose.rotation.T
    np.testing.assert_allclose(np.abs(z @ plane.normal), 1, atol=MACHINE)
    np.testing.assert_allclose(np.cross(x, y), z, atol=MACHINE)
    # Origin: the plane's point nearest to the camera.
    np.testing.assert_allclose(pose.translation, plane.normal * plane.distance, atol=MACHINE)
    # Y towards the camera: farther points have smaller y.
    section = LightSection(CAMERA, plane)
    truth = points_in(plane)
    depth_along_y = np.polyfit(
        section.points_from_pixels(pixels_by_cv2(truth))[:, 1], truth[:, 2], 1
    )[0]
    assert depth_along_y < 0
    assert y[2] < 0
    # X along the line on a facing surface, growing with u (or v).
    assert abs(x[2]) < MACHINE
    assert x[np.argmax(np.abs(x))] > 0


def test_a_point_nearer_to_the_sensor_has_a_larger_y():
    section = LightSection(CAMERA, PLANES["level line"])
    near, far = section.points_from_pixels(pixels_by_cv2(points_in(section.laser_plane))[[0, 1]])
    depths = section.camera_from_section.apply(np.stack([near, far]))[:, 2]
    assert (near[1] > far[1]) == (depths[0] < depths[1])
    assert max(near[1], far[1]) < 0


def test_a_plane_that_faces_the_camera_has_y_up_in_the_image():
    pose = LightSection(CAMERA, Plane((0.05, -0.1, 1.0), 300.0)).camera_from_section
    assert pose.rotation[0, 0] > 0.99
    assert pose.rotation[1, 1] < -0.98


@each_plane
def test_covariance_is_that_of_pixels_with_simulated_noise(plane):
    rng = np.random.default_rng(3)
    pixel = pixels_by_cv2(points_in(plane))[:1].round()
    section = LightSection(CAMERA, plane)
    # Found row by row: v is whole and exact, u errs.
    pixel[:, 0] += 0.3
    shaken = pixel + rng.normal(0, 0.2, (20000, 1)) * (1, 0)
    profile = section.profile_from_line(Line(pixel, np.array([0.2]), "rows"))
    predicted = profile.noise.point_covariances[0]
    measured = np.cov(section.points_from_pixels(shaken).T)
    np.testing.assert_allclose(predicted, measured, rtol=0, atol=0.05 * np.trace(measured))


def test_noise_lies_along_v_for_a_line_with_a_point_in_each_column():
    section = LightSection(CAMERA, PLANES["level line"])
    line = Line(np.array([[500.0, 480.25], [640.0, 500.5]]), np.array([0.1, 0.2]))
    profile = section.profile_from_line(line)
    covariance = profile.noise.covariances(profile.points)
    assert (covariance[:, 1, 1] > 50 * covariance[:, 0, 0]).all()
    # dz = Z dv / (f sin 30 deg) at 300 mm: 0.1 px are 0.027 mm.
    middle = section.points_from_pixels([[639.5, 511.5]])
    assert middle[0, 1] == pytest.approx(-300 * math.cos(math.pi / 6), abs=1e-6)
    assert math.sqrt(covariance[0, 1, 1]) == pytest.approx(0.027, rel=0.1)


def test_lost_points_stay_lost_in_their_place():
    section = LightSection(CAMERA, PLANES["level line"])
    pixels = np.array([[np.nan, np.nan], [640.0, 500.5], [641.0, np.nan]])
    profile = section.profile_from_line(Line(pixels, np.full(3, 0.1)))
    assert len(profile) == 3
    assert profile.lost == 2
    assert np.isfinite(profile.points[1]).all()


def test_rays_that_miss_the_plane_are_lost():
    section = LightSection(CAMERA, Plane((1.0, 0.0, 0.005), 40.0))
    points = section.points_from_pixels([[1000.0, 500.0], [300.0, 500.0]])
    assert np.isnan(points[:, 0]).tolist() == [False, True]


@pytest.mark.parametrize(
    ("plane", "match"),
    [
        (
            Plane((0.0, 0.8, 0.6), 0.05),
            r"passes 0\.05 mm from the camera's centre .* move the laser",
        ),
        (Plane((0.0, 1.0, 0.0), 100.0), "parallel to the optical axis .* turn the laser"),
        (
            Plane((0.0, 0.5, 0.866), -150.0),
            "not in view .* check the plane's sign",
        ),
    ],
)
def test_unusable_planes_are_rejected_with_a_reason(plane, match):
    with pytest.raises(DegenerateGeometry, match=match):
        LightSection(CAMERA, plane)


def test_nearly_parallel_plane_of_a_real_rig_is_accepted():
    LightSection(CAMERA, Plane((0.99987, 0.01487, 0.00537), -39.34))


def test_an_image_of_another_size_is_rejected():
    section = LightSection(CAMERA, PLANES["level line"])
    with pytest.raises(
        LsvisionError, match="image is 640 x 480 px and the rig's camera 1280 x 1024"
    ):
        section.profile(np.zeros((480, 640), np.uint8))


def test_saved_rig_is_the_same_rig(tmp_path):
    section = LightSection(CAMERA, PLANES["slanted"], {"method": "test", "date": "today"})
    section.save(tmp_path / "rig.json")
    loaded = LightSection.load(tmp_path / "rig.json")
    np.testing.assert_array_equal(loaded.camera.matrix, CAMERA.matrix)
    np.testing.assert_array_equal(loaded.camera.distortion, CAMERA.distortion)
    assert loaded.camera.size == CAMERA.size
    np.testing.assert_allclose(loaded.laser_plane.normal, section.laser_plane.normal, atol=1e-15)
    assert loaded.laser_plane.distance == pytest.approx(section.laser_plane.distance, abs=MACHINE)
    assert dict(loaded.provenance) == {"method": "test", "date": "today"}


def test_rig_file_has_schema_and_units(tmp_path):
    LightSection(CAMERA, PLANES["slanted"]).save(tmp_path / "rig.json")
    values = json.loads((tmp_path / "rig.json").read_text())
    assert values["schema"] == "lsvision/light-section/1"
    assert values["units"] == {"length": "mm", "pixel": "px", "angle": "rad"}
    assert len(list(tmp_path.iterdir())) == 1


def damaged(path, change):
    LightSection(CAMERA, PLANES["slanted"]).save(path)
    values = json.loads(path.read_text())
    change(values)
    path.write_text(json.dumps(values))


@pytest.mark.parametrize(
    ("change", "error", "match"),
    [
        (lambda v: v.update(schema="x/1"), UnreadableFile, "has schema 'x/1' and needs"),
        (lambda v: v["units"].update(length="m"), UnreadableFile, "has units .* convert"),
        (lambda v: v.pop("laser_plane"), UnreadableFile, "lacks 'laser_plane'"),
        (lambda v: v["camera"].pop("size"), UnreadableFile, "lacks 'size'"),
        (
            lambda v: v["camera"].update(matrix=[1]),
            UnreadableFile,
            "is damaged: expected camera matrix",
        ),
        (lambda v: v.update(camera=5), UnreadableFile, "is damaged"),
        (lambda v: v["laser_plane"].update(distance=0.0), DegenerateGeometry, "camera's centre"),
    ],
)
def test_damaged_rig_files_are_rejected_with_their_name(change, error, match, tmp_path):
    path = tmp_path / "rig.json"
    damaged(path, change)
    with pytest.raises(error, match=rf"rig\.json.*{match}"):
        LightSection.load(path)


def test_missing_and_foreign_files_are_rejected_with_their_name(tmp_path):
    with pytest.raises(UnreadableFile, match=r"none\.json: no such file"):
        LightSection.load(tmp_path / "none.json")
    (tmp_path / "image.json").write_bytes(b"\x89PNG")
    with pytest.raises(UnreadableFile, match=r"image\.json is not JSON"):
        LightSection.load(tmp_path / "image.json")
    with pytest.raises(UnwritableFile, match="its folder does not exist"):
        LightSection(CAMERA, PLANES["slanted"]).save(tmp_path / "gone" / "rig.json")


def test_provenance_cannot_be_changed_afterwards():
    given = {"method": "test"}
    section = LightSection(CAMERA, PLANES["slanted"], given)
    given["method"] = "other"
    assert section.provenance["method"] == "test"
    with pytest.raises(TypeError):
        section.provenance["method"] = "other"


def test_the_blur_of_the_rig_is_used_and_saved(tmp_path):
    camera = Camera([[900, 0, 160], [0, 900, 120], [0, 0, 1]], [], (320, 240))
    # Seen at 45 deg, the sheet's image has nearly the same thickness everywhere.
    plain = LightSection(camera, Plane((0.0, 0.7071, 0.7071), 212.0))
    stated = replace(plain, line_blur_px=0.7)
    rows = np.arange(240)[:, None]
    place = 100 + (np.arange(320) - 20) ** 2 / 1600
    bright = 200 * np.exp(-np.arange(320) / 160)
    image = (5 + bright * np.exp(-0.5 * ((rows - place) / 1.6) ** 2)).round().astype(np.uint8)
    raw = extract_laser_line(image)
    shifts = []
    for section, blur in ((plain, None), (stated, 0.7)):
        expected = correct_line_blur(raw, blur, *section._normal_in_image(raw.pixels))
        np.testing.assert_array_equal(section.line(image).pixels, expected.pixels)
        shifts.append(np.abs(expected.pixels - raw.pixels).max())
    # The line is as wide where it is steep as where it is level: it is not blurred.
    assert shifts[0] < 2e-4 < shifts[1]
    stated.save(tmp_path / "rig.json")
    assert LightSection.load(tmp_path / "rig.json").line_blur_px == 0.7


@pytest.mark.parametrize("name", PLANES)
def test_the_sheet_looks_thicker_where_its_normal_is_longer(name):
    section = LightSection(CAMERA, PLANES[name])
    pixels = np.array([[300.0, 200.0]])
    direction, growth = section._normal_in_image(pixels)
    ends = pixels + [[-1.0], [1.0]] * direction
    feet = section.camera_from_section.apply(section.points_from_pixels(ends))
    tips = section.camera.project(feet + 0.1 * section.laser_plane.normal)
    shorter, longer = np.hypot(*(tips - ends).T)
    # The distortion changes the length by a further 13 %.
    assert growth == pytest.approx(np.log(longer / shorter) / 2, rel=0.15, abs=2e-5)


def test_a_blur_of_single_precision_is_saved(tmp_path):
    camera = Camera([[900, 0, 160], [0, 900, 120], [0, 0, 1]], [], (320, 240))
    rig = LightSection(camera, Plane((0.0, 0.866, 0.5), 150.0), line_blur_px=np.float32(0.5))
    rig.save(tmp_path / "rig.json")
    assert LightSection.load(tmp_path / "rig.json") == rig


def test_a_line_whose_middle_misses_the_laser_plane_has_points_beside_it():
    camera = Camera([[900, 0, 160], [0, 900, 120], [0, 0, 1]], [], (320, 240))
    section = LightSection(camera, Plane((0.995, 0.0, -0.1), 10.0))
    image = np.full((240, 320), 5, np.uint8)
    image[118:121] = 200
    points = section.profile(image).points
    assert 0 < np.isfinite(points[:, 0]).sum() < 320
    assert np.isnan(points[len(points) // 2]).all()


@pytest.mark.parametrize("blur", [-0.1, float("nan"), float("inf"), 1001.0])
def test_an_invalid_blur_is_rejected(blur):
    camera = Camera([[900, 0, 160], [0, 900, 120], [0, 0, 1]], [], (320, 240))
    with pytest.raises(ValueError, match="expected line_blur_px from 0 to 1000"):
        LightSection(camera, Plane((0.0, 0.866, 0.5), 150.0), {}, blur)


@pytest.mark.parametrize(
    ("image", "kind", "message"),
    [
        ("x.png", TypeError, r"image as an array, got 'x\.png': lsvision\.read_image\('x\.png'\)"),
        (np.zeros((1024, 1280, 4), np.uint8), ValueError, r"got \(1024, 1280, 4\): leave transp"),
        (np.zeros((1024, 1280), np.int32), TypeError, "uint8, uint16 or float, got int32"),
    ],
)
def test_what_is_no_image_is_reported_before_its_size(image, kind, message):
    with pytest.raises(kind, match=message):
        LightSection(CAMERA, PLANES["level line"]).profile(image)


def test_a_rig_goes_to_other_processes_and_is_copied():
    section = LightSection(CAMERA, PLANES["slanted"], {"method": "test"}, 0.4)
    for twin in (pickle.loads(pickle.dumps(section)), copy.deepcopy(section)):
        assert twin == section
        assert dict(twin.provenance) == {"method": "test"}
        with pytest.raises(TypeError):
            twin.provenance["method"] = "other"


DAMAGED = {
    "size": (["camera", "size"], [10**9, 4], "expected a size of 1 to 1048576 px"),
    "part of a pixel": (["camera", "size"], [640.9, 480], "expected a size .width, height. in px"),
    "focal length": (["camera", "matrix", 0, 0], 1e-300, "expected a focal length of at least"),
    "matrix": (["camera", "matrix", 0, 2], 1e300, "no number above 1e"),
    "lens": (["camera", "distortion", 0], 1e300, "no number above 1e"),
    "plane": (["laser_plane", "distance"], 1e300, "expected a plane within 1e"),
    "blur": (["line_blur_px"], 1e300, "expected line_blur_px from 0 to 1000"),
    "null": (["camera", "size"], None, "damaged"),
    "list": (["provenance"], [], "damaged"),
}


@pytest.mark.parametrize("case", DAMAGED)
def test_a_rig_whose_numbers_are_none_is_rejected(tmp_path, case):
    (*parents, last), value, message = DAMAGED[case]
    LightSection(CAMERA, PLANES["slanted"]).save(tmp_path / "rig.json")
    document = node = json.loads((tmp_path / "rig.json").read_text())
    for key in parents:
        node = node[key]
    node[last] = value
    (tmp_path / "rig.json").write_text(json.dumps(document))
    with pytest.raises(UnreadableFile, match=message):
        LightSection.load(tmp_path / "rig.json")


def test_nested_json_is_no_rig(tmp_path):
    (tmp_path / "rig.json").write_text("[" * 200_000)
    with pytest.raises(UnreadableFile, match="levels of nesting"):
        LightSection.load(tmp_path / "rig.json")


def test_a_rig_is_written_whole_and_follows_no_planted_link(tmp_path):
    (tmp_path / "victim").write_text("precious")
    (tmp_path / ".rig.json.part").symlink_to(tmp_path / "victim")
    LightSection(CAMERA, PLANES["slanted"]).save(tmp_path / "rig.json")
    assert (tmp_path / "victim").read_text() == "precious"
    assert LightSection.load(tmp_path / "rig.json").camera.size == CAMERA.size


def test_a_rig_that_could_not_be_loaded_is_not_saved(tmp_path):
    rig = LightSection(CAMERA, replace(PLANES["slanted"], distance=2e9))
    with pytest.raises(ValueError, match="expected a plane within 1e"):
        rig.save(tmp_path / "rig.json")
    assert not list(tmp_path.iterdir())
