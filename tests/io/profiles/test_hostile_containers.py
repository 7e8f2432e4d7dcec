"""Headers that promise more than the file holds are rejected before anything is allocated."""

import io
import json
import zipfile

import cv2
import numpy as np
import numpy.testing as npt
import pyarrow
import pyarrow.parquet
import pytest

from lsvision.errors import UnreadableFile
from lsvision.files.limited_reading import limit_file_size
from lsvision.io.profiles import read_profile, read_profiles

POINTS = np.column_stack([np.arange(200.0), -400 - np.arange(200.0) ** 0.5])


def pcd(**changes):
    header = {
        "VERSION": ".7", "FIELDS": "x y z", "SIZE": "4 4 4", "TYPE": "F F F", "COUNT": "1 1 1",
        "WIDTH": "2", "HEIGHT": "1", "DATA": "binary",
    } | changes  # fmt: skip
    return "".join(f"{key} {value}\n" for key, value in header.items()).encode() + bytes(24)


def npy(shape, descr="<f8"):
    text = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape}, }}"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def npz(**members):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


def parquet_of_many_values():
    table = pyarrow.table({"x": pyarrow.array(np.zeros(100_000)), "z": np.zeros(100_000)})
    stream = io.BytesIO()
    pyarrow.parquet.write_table(table, stream)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (pcd(COUNT="0 0 0"), "a PCD file with a broken header"),
        (pcd(COUNT="0 0 0", WIDTH="9" * 30), "a PCD file with a broken header"),
        (pcd(COUNT="1 1 99999999999"), "a PCD file with a broken header"),
        (pcd(WIDTH="-2", HEIGHT="-1"), "a PCD file without points"),
        (pcd(WIDTH="9" * 5000), "a PCD file with a broken header"),
        (pcd(WIDTH="9" * 30), "truncated"),
        (npy((10**15,)), "NumPy cannot read it .*an array of shape"),
        (npy((10**9, 10**9, 10**9)), "NumPy cannot read it .*an array of shape"),
        (npy((-5, 2)), "NumPy cannot read it"),
        (npy("(" * 2000), "NumPy cannot read it"),
        (npy("1(2)"), "NumPy cannot read it"),
        (npz(**{"a.npy": b"hello"}), "NumPy cannot read it .*not an NPY array"),
        (npz(a=b"hello"), "a zip archive of a: unpack it"),
        (npz(**{"x.npy": npy(()) + bytes(8), "z.npy": npy(()) + bytes(8)}), "x, z is neither"),
        (npy((1,), [("x", "<f8", (2, 2)), ("z", "<f8", (2, 2))]) + bytes(64), "x, z is neither"),
    ],
)
def test_a_header_that_promises_too_much_is_rejected(write, content, message):
    with pytest.raises(UnreadableFile, match=message) as error:
        read_profiles(write(content))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", [npz(**{"a.npy": bytes(10**6)}), parquet_of_many_values()])
def test_what_unpacks_to_more_than_the_limit_is_rejected(write, content):
    assert len(content) < 100_000
    with limit_file_size(500_000), pytest.raises(UnreadableFile, match=r"--max-size"):
        read_profiles(write(content))


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
@pytest.mark.parametrize("layout", ["two columns", "two channels", "three columns", "float"])
def test_matrices_of_opencv_are_read_without_opencv(tmp_path, suffix, layout):
    matrix = {
        "two columns": POINTS,
        "two channels": POINTS.reshape(-1, 1, 2),
        "three columns": np.insert(POINTS, 1, 0.0, axis=1),
        "float": POINTS.astype(np.float32),
    }[layout]
    matrix = matrix.copy()
    matrix[7] = np.nan
    storage = cv2.FileStorage(str(tmp_path / f"m.{suffix}"), cv2.FILE_STORAGE_WRITE)
    storage.write("points", matrix)
    storage.release()
    points = read_profile(tmp_path / f"m.{suffix}").points
    assert np.isnan(points[7]).all()
    npt.assert_allclose(np.delete(points, 7, 0), np.delete(POINTS, 7, 0), rtol=1e-6)


MATRIX = {"type_id": "opencv-matrix", "rows": 2, "cols": 2, "dt": "d", "data": [1, 2, 3, 4]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cols": None}, "a matrix with a bad or missing 'cols'"),
        ({"dt": None}, "a matrix with a bad or missing 'dt'"),
        ({"data": None}, "a matrix with a bad or missing 'data'"),
        ({"rows": 10**9}, "a matrix of 1000000000 x 2 x 1 numbers, got 4"),
        ({"rows": -2, "cols": -1}, "a matrix with a bad or missing sizes"),
        ({"dt": "999d"}, "a matrix of 2 x 2 x 999 numbers, got 4"),
        ({"dt": "x"}, "a matrix with a bad or missing dt 'x'"),
        ({"data": "abcd"}, "a matrix with a bad or missing data, which is no list"),
        ({"sizes": [1] * 99}, "a matrix with a bad or missing sizes"),
    ],
)
def test_a_matrix_whose_size_is_wrong_is_rejected(write, change, message):
    node = {key: value for key, value in (MATRIX | change).items() if value is not None}
    with pytest.raises(UnreadableFile, match=message):
        read_profile(write(json.dumps({"points": node})))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a":' * 100_000, "levels of nesting"),
        ("%YAML:1.0\n---\na: " + "[" * 200_000, "not YAML"),
        ("%YAML:1.0\n---\na: " + "- " * 200_000, "not a FileStorage of OpenCV"),
        ("<opencv_storage>" + "<a>" * 200_000, "at most 64 levels of nesting"),
        ("<opencv_storage><a></opencv_storage>", "no XML"),
        (
            "<?xml version='1.0'?><!DOCTYPE a [<!ENTITY b 'c'>]><opencv_storage>&b;"
            "</opencv_storage>",
            "without DOCTYPE",
        ),
        ("{" + "\n" * 300_000, "not a FileStorage of OpenCV"),
    ],
)
def test_deep_or_expanding_text_is_rejected(write, text, message):
    with pytest.raises(UnreadableFile, match=message):
        read_profile(write(text), format="opencv")
