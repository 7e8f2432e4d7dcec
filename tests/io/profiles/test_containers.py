"""Arrays, point clouds, OpenCV storage and Parquet: written by other code, read back the same."""

import decimal
import io

import cv2
import numpy as np
import numpy.testing as npt
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles, read_profile, read_profiles

RNG = np.random.default_rng(7)
POINTS = np.column_stack([np.arange(40.0), RNG.normal(-400, 3, 40)]).astype(np.float32)
POINTS = POINTS.astype(np.float64)  # values that single precision holds exactly
POINTS[[0, 17]] = np.nan
IN_SPACE = np.column_stack([POINTS[:, 0], np.full(40, 12.5), POINTS[:, 1]])


def saved(save, *args, **arrays) -> bytes:
    stream = io.BytesIO()
    save(stream, *args, **arrays)
    return stream.getvalue()


def ply(points, order="<", extra=""):
    kind = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}[order]
    head = (
        f"ply\nformat {kind} 1.0\ncomment made here\nelement vertex {len(points)}\n"
        f"property float x\nproperty float y\nproperty float z\n{extra}end_header\n"
    )
    if order == "":
        body = "\n".join(" ".join(map(repr, row)) for row in points.tolist()).encode()
    else:
        body = points.astype(order + "f4").tobytes()
    return head.encode() + body


def pcd(points, data, height=1):
    head = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z intensity\n"
        f"SIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH {len(points) // height}\n"
        f"HEIGHT {height}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA {data}\n"
    )
    full = np.column_stack([points, np.ones(len(points))])
    if data == "ascii":
        return head.encode() + "\n".join(" ".join(map(repr, r)) for r in full.tolist()).encode()
    return head.encode() + full.astype("<f4").tobytes()


def stored(flags, name, write_it) -> bytes:
    storage = cv2.FileStorage(name, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | flags)
    write_it(storage)
    return storage.releaseAndGetString().encode()


def as_list(storage):
    storage.startWriteStruct("scan_line", cv2.FileNode_SEQ | cv2.FileNode_FLOW)
    for value in IN_SPACE.ravel().tolist():
        storage.write("", value)
    storage.endWriteStruct()


def as_matrix(storage):
    storage.write("profile", POINTS)


def parquet(**columns) -> bytes:
    return saved(lambda stream: pq.write_table(pa.table(columns), stream))


STRUCTURED = np.zeros(40, dtype=[("x", "f8"), ("z", "f8")])
STRUCTURED["x"], STRUCTURED["z"] = POINTS.T

FILES = {
    "npy": saved(np.save, POINTS),
    "npy single precision": saved(np.save, POINTS.astype(np.float32)),
    "npy transposed": saved(np.save, POINTS.T),
    "npy in space": saved(np.save, IN_SPACE),
    "npy with names": saved(np.save, STRUCTURED),
    "npz": saved(np.savez, POINTS),
    "npz x z": saved(np.savez_compressed, x=POINTS[:, 0], z=POINTS[:, 1]),
    "npz range in um": saved(np.savez, x_mm=POINTS[:, 0], range_um=-1000 * POINTS[:, 1]),
    "ply ascii": ply(IN_SPACE, ""),
    "ply little endian": ply(IN_SPACE, "<"),
    "ply big endian": ply(IN_SPACE, ">", extra="element face 0\nproperty list uchar int i\n"),
    "ply in the plane z = 0": ply(IN_SPACE[:, [0, 2, 1]] - [0, 0, 12.5]),
    "pcd ascii": pcd(IN_SPACE, "ascii"),
    "pcd binary": pcd(IN_SPACE, "binary"),
    "yaml list": stored(cv2.FILE_STORAGE_FORMAT_YAML, ".yml", as_list),
    "yaml matrix": stored(cv2.FILE_STORAGE_FORMAT_YAML, ".yml", as_matrix),
    "xml list": stored(cv2.FILE_STORAGE_FORMAT_XML, ".xml", as_list),
    "xml matrix": stored(cv2.FILE_STORAGE_FORMAT_XML, ".xml", as_matrix),
    "json list": stored(cv2.FILE_STORAGE_FORMAT_JSON, ".json", as_list),
    "parquet points": parquet(x_mm=POINTS[:, 0], z_mm=POINTS[:, 1]),
    "parquet scan": parquet(scan=[3], x=[POINTS[:, 0]], z=[POINTS[:, 1]]),
}


@pytest.mark.parametrize("name", FILES)
def test_a_profile_comes_back_as_it_was_written(write, name):
    path = write(FILES[name], "file")
    npt.assert_allclose(read_profile(path).points, POINTS, rtol=1e-12)
    assert inspect_profiles(path).lost == 2


@pytest.mark.parametrize(
    "content",
    [
        saved(np.save, np.stack([POINTS, POINTS + 1])),
        saved(np.savez, x=POINTS[:, 0], z=np.stack([POINTS[:, 1], POINTS[:, 1] + 1])),
        pcd(np.vstack([IN_SPACE, IN_SPACE + 1]), "binary", height=2),
        ply(np.vstack([IN_SPACE, IN_SPACE + 1])),
        parquet(x=[POINTS[:, 0]] * 2, z=[POINTS[:, 1], POINTS[:, 1] + 1]),
        parquet(x=[POINTS[:, 0], POINTS[:30, 0]], z=[POINTS[:, 1], POINTS[:30, 1] + 1]),
        parquet(
            y=np.repeat([0.0, 2.0], 40),
            x=np.tile(POINTS[:, 0], 2),
            z=np.concatenate([POINTS[:, 1], POINTS[:, 1] + 1]),
        ),
    ],
    ids=["npy", "npz", "pcd rows", "ply by y", "parquet", "parquet of unlike lengths", "by y"],
)
def test_many_profiles_in_a_file_keep_their_order(write, content):
    first, second = read_profiles(write(content, "file"))
    npt.assert_allclose(first.points, POINTS)
    npt.assert_allclose(second.points[1:17, 1], POINTS[1:17, 1] + 1)


def test_a_scan_line_is_triples_though_its_y_wanders(write):
    triples = np.column_stack([POINTS[1:17, 0], np.repeat([1.0, 2.0], 8), POINTS[1:17, 1]])
    numbers = ", ".join(map(repr, triples.ravel().tolist()))
    first, second = read_profiles(write(f"%YAML:1.0\n---\nscan_line: [ {numbers} ]\n"))
    npt.assert_array_equal(np.vstack([first.points, second.points]), POINTS[1:17])


def test_two_triples_are_two_points(write):
    numbers = ", ".join(map(repr, [1.0, 0.0, 7.0, 2.0, 0.0, 6.5]))
    profile = read_profile(write(f"%YAML:1.0\n---\nscan_line: [ {numbers} ]\n"))
    npt.assert_array_equal(profile.points, [[1, 7], [2, 6.5]])


def test_pairs_in_json_are_points(write):
    path = write('{"from": "a paper", "scale": [1, 2], "dots": [[1, 7], [2, 6.5], [5, 8]]}')
    npt.assert_array_equal(read_profile(path).points, [[1, 7], [2, 6.5], [5, 8]])


def test_counts_in_parquet_take_their_x_from_the_options(write):
    words = pa.array([[100, 200, 300]], type=pa.list_(pa.uint16(), 3))
    points = read_profile(write(parquet(z_um=words)), x0=1.0, dx=0.5).points
    npt.assert_allclose(points, [[1.0, 0.1], [1.5, 0.2], [2.0, 0.3]])


@pytest.mark.parametrize("write_it", [ply, lambda points: saved(np.save, points)])
def test_a_signalling_nan_is_a_lost_point(write, write_it):
    points = IN_SPACE.astype("<f4")
    points.view("<u4")[5, 2] = 0x7F810000
    assert read_profile(write(write_it(points))).lost == 3


def test_a_long_list_in_yaml_is_read_in_linear_time(write):
    numbers = ", ".join(f"{x}., 0., 5." for x in range(50_000))
    assert len(read_profile(write(f"%YAML:1.0\n---\nscan_line: [ {numbers} ]\n"))) == 50_000


@pytest.mark.parametrize("kind", ["list", "large_list", "fixed"])
def test_nulls_of_parquet_are_lost_points_in_any_list_and_slice(tmp_path, kind):
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    number = pa.float32()
    kinds = {
        "list": pa.list_(number),
        "large_list": pa.large_list(number),
        "fixed": pa.list_(number, 6),
    }
    heights = [
        [-400.0, None, -399.0, -398.5, None, -398.0],
        [None] * 6,
        [-400.0 + k for k in range(6)],
    ]
    x = [[float(k) for k in range(6)]] * 3
    table = pa.table({"x": pa.array(x, kinds[kind]), "z": pa.array(heights, kinds[kind])})
    pq.write_table(table, tmp_path / "a.parquet")
    profiles = inspect_profiles(tmp_path / "a.parquet").profiles
    found = [
        [None if np.isnan(y) else y for y in profile.points[:, 1].tolist()] for profile in profiles
    ]
    assert found == heights


def test_an_array_that_python_2_wrote_is_read_without_a_warning(tmp_path):
    np.save(tmp_path / "a.npy", np.array([[0.0, -400.0], [1.0, -399.0], [2.0, -398.0]]))
    content = (tmp_path / "a.npy").read_bytes()
    assert b"(3, 2)" in content
    old = content.replace(b"(3, 2), }  ", b"(3L, 2L), }")
    assert len(old) == len(content)
    assert old != content
    (tmp_path / "a.npy").write_bytes(old)
    assert read_profile(tmp_path / "a.npy").points.tolist()[2] == [2.0, -398.0]


def test_units_of_each_axis_and_the_lost_marker_of_an_npz_count(write):
    stack = np.stack([POINTS[1:17], POINTS[18:34]])
    stack[0, 3, 1] = -401.5
    scalars = {"x_unit": "cm", "z_unit": "mm", "nodata": -401.5}
    file = inspect_profiles(write(saved(np.savez, points=stack, **scalars), "a.npz"))
    npt.assert_allclose(file.profiles[1].points, stack[1] * (10.0, 1.0))
    assert [profile.lost for profile in file.profiles] == [1, 0]


def test_an_array_of_an_npz_that_holds_no_numbers_is_named(write):
    arrays = {"x": POINTS[:, 0], "z": POINTS[:, 1], "label": np.array(["a", "b"])}
    with pytest.raises(UnreadableFile, match="an array 'label' of <U1: expected numbers"):
        read_profile(write(saved(np.savez, **arrays), "a.npz"))


def test_arrays_beside_the_points_of_an_npz_are_listed_as_ignored(write):
    arrays = {"x": POINTS[:, 0], "z": POINTS[:, 1], "camera": np.eye(3)}
    assert inspect_profiles(write(saved(np.savez, **arrays), "a.npz")).ignored == ("camera",)


def test_lists_of_different_length_beside_the_points_of_parquet_are_ignored(write):
    stream = io.BytesIO()
    lists = [[0.0] * (k % 3 + 1) for k in range(40)]
    pq.write_table(pa.table({"x": POINTS[:, 0], "z": POINTS[:, 1], "echo": lists}), stream)
    file = inspect_profiles(write(stream.getvalue(), "a.parquet"))
    npt.assert_array_equal(file.profiles[0].points, POINTS)
    assert file.ignored == ("echo",)


def test_the_lost_marker_beside_lists_of_opencv_counts(write):
    text = "%YAML:1.0\n---\nnodata: -401.5\nx: [1., 2., 3.]\nz: [-400., -401.5, -401.]\n"
    assert read_profile(write(text, "a.yml")).lost == 1


def test_columns_of_a_stack_count_from_its_last_axis(write):
    stack = np.stack([IN_SPACE[1:17], IN_SPACE[18:34]])
    stack[1, :, 1] += 1
    for array, columns in ((stack, (2, 0)), (stack, "z,x"), (stack[:, :, ::2], "1,0")):
        file = inspect_profiles(write(saved(np.save, array), "a.npy"), columns=columns)
        assert [len(profile) for profile in file.profiles] == [16, 16]
        npt.assert_array_equal(file.profiles[1].points, stack[1][:, [2, 0]])


def test_lists_and_units_of_opencv_xml_count(write, tmp_path):
    path = str(tmp_path / "a.xml")
    storage = cv2.FileStorage(path, cv2.FileStorage_WRITE)
    storage.write("unit", "0.1 mm")
    for name, numbers in (("x", (1.0, 2.0, 3.0)), ("z", (-400.0, -399.0, -398.0))):
        storage.startWriteStruct(name, cv2.FileNode_SEQ)
        for number in numbers:
            storage.write("", number)
        storage.endWriteStruct()
    storage.release()
    expected = [[0.1, -40], [0.2, -39.9], [0.3, -39.8]]
    npt.assert_allclose(read_profile(path).points, expected)
    matrix = (
        '<profile type_id="opencv-matrix"><rows>3</rows><cols>2</cols><dt>d</dt>'
        "<data>1 -400 2 -399 3 -398</data></profile>"
    )
    text = f"<?xml version='1.0'?><opencv_storage><unit>0.1 mm</unit>{matrix}</opencv_storage>"
    npt.assert_allclose(read_profile(write(text, "b.xml")).points, expected)


def test_decimal_columns_of_parquet_are_numbers(write, arc):
    columns = {
        name: pa.array([decimal.Decimal(f"{value:.3f}") for value in values])
        for name, values in zip("xz", arc.T.tolist(), strict=True)
    }
    npt.assert_allclose(read_profile(write(parquet(**columns), "p.parquet")).points, arc, atol=6e-4)


@pytest.mark.parametrize("kind", [pa.timestamp("us"), pa.duration("s")])
def test_times_of_parquet_that_python_cannot_represent_are_attributes(write, arc, kind):
    times = pa.array([9 * 10**18] * len(arc), kind)
    file = inspect_profiles(write(parquet(x=arc[:, 0], z=arc[:, 1], t=times), "p.parquet"))
    npt.assert_array_equal(file.profiles[0].points, arc)
    assert str(9 * 10**18) in file.attributes[0]["t"]


def test_a_null_beside_x_in_parquet_is_a_profile_without_a_valid_point(write, arc):
    x, z = arc.T.tolist()
    file = inspect_profiles(write(parquet(x=[x, x], z=[None, z]), "p.parquet"))
    assert [profile.lost for profile in file.profiles] == [len(x), 0]
    npt.assert_array_equal(file.profiles[1].points, arc)


@pytest.mark.parametrize("width", [2, 3])
def test_profiles_without_points_in_an_array_are_rejected_with_its_shape(write, width):
    content = saved(np.save, np.empty((3, 0, width)))
    with pytest.raises(UnreadableFile, match=rf"shape \(3, 0, {width}\)"):
        read_profile(write(content, "p.npy"))


def test_a_unit_in_bytes_in_an_npz_counts(write, arc):
    content = saved(np.savez, x=arc[:, 0] * 1e3, z=arc[:, 1] * 1e3, unit=np.array(b"um"))
    npt.assert_allclose(read_profile(write(content, "p.npz")).points, arc)


def test_arrays_beside_the_array_of_points_of_an_npz_are_ignored(write):
    content = saved(np.savez, profiles=np.stack([POINTS, POINTS]), time=np.arange(2.0), k=np.eye(3))
    assert inspect_profiles(write(content, "a.npz")).ignored == ("time", "k")
