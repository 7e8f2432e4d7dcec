"""What cannot be read gives one line that names the file and the remedy."""

import io
import os
from pathlib import Path

import numpy as np
import pytest

from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.io.profiles import inspect_profiles, read_profile, read_profiles

SLANTED = "".join(f"{x / 3} {x / 7} {x * x / 5}\n" for x in range(20))
RUBBISH = bytes(range(256)) * 4


def saved(*arrays, **named) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, *arrays, **named)
    return stream.getvalue()


def npy(array) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "the file is empty: expected x and height in mm"),
        (" \n\t\n", "the file is empty"),
        (RUBBISH, "binary data of no known format: export the profile as text"),
        (
            "a text of words\nand more of 3 apples\n",
            "expected x and height .* got no line",
        ),
        ("1\n2\n3\n", "one column in it: expected x and height, or .* --x0 and --dx"),
        ("nan,nan\n1,nan\n2,inf\n", "all 3 points are lost: check exposure"),
        ("1,2\n", "one valid point in it, no profile"),
        ("1,2\nend of data\n3,4\n", "line 2 has 1 cells, expected 2"),
        ("1,2\n3,4\n\n5,six\n", "line 4: 'six' is not a number: remove such lines"),
        ("1;2\n3;4,5\n6;7.5\n", "line 2: '4,5' is not a number"),
        (
            SLANTED,
            r"1 does not separate profiles \(20 values in 20 points\): name the .* with --columns",
        ),
        ("angle [deg],range\n0,400\n1,399\n", "an angle and no x in its columns: convert"),
        ("x y z\n" + SLANTED, "column y does not separate profiles"),
        (" ".join(["1"] * 30), "1 row of 30 heights without x: .* --x0 and --dx"),
        ("www.micro-epsilon.com\nscanCONTROL Tools\n", "log of results, not of profiles: export"),
        (b"RIFF\0\0\0\0AVI LIST", "a video container .*: export its profiles as CSV"),
        (b"\x89HDF\r\n\x1a\n", "HDF5 is not read: write its points as NPZ or CSV"),
        (b"#ROSBAG V2.0\n", "a ROS bag"),
        (b"\x1f\x8b\x08", "a gzip archive: unpack it first"),
        (b"\x89PNG\r\n", "an image: .* its rig, lsvision measure --light-section"),
        (b"\x93NUMPY\x01\x00rubbish", "NumPy cannot read it"),
        (b"PK\x03\x04rubbish", "NumPy cannot read it"),
        (npy(np.array([{}], dtype=object)), "NumPy cannot read it .*: save plain arrays"),
        (npy(np.array(["a", "b"])), "an array of <U1: expected numbers"),
        (
            npy(np.zeros((2, 2, 2, 2))),
            r"an array of shape \(2, 2, 2, 2\): expected points of shape",
        ),
        (saved(a=np.zeros(3), b=np.zeros(4)), "no column of heights among a, b: expected x and z"),
        (saved(x=np.zeros(3), z=np.zeros(4)), r"equal length, .*got x \(3\), z \(4\)"),
        (saved(x=np.zeros(3), z=np.zeros((2, 4))), "x and z differ in length"),
        (saved(x=np.zeros((3, 4)), z=np.zeros((2, 4))), "3 rows of x and 2 of heights"),
        (b"PAR1rubbish", "pyarrow cannot read it"),
        (b"RIFF\x10\0\0\0WEBPVP8 ", "an image: read it with LightSection"),
        (b"RIFF\x10\0\0\0AVI LIST", "a video container"),
        (b"\xff\xd8\xff\xe0", "heights must be a TIFF or PNG of more than 8 bit"),
        ("ply\nformat ascii 1.0\n", "a PLY file with a broken header"),
        ("ply\nformat ascii 1.0\nelement face 1\nend_header\n", "begins with 1 face"),
        (
            "ply\nformat ascii 1.0\nelement vertex x\nend_header\n",
            "whose vertices are not plain numbers",
        ),
        (
            "ply\nformat ascii 1.0\nelement vertex 2\nproperty int x\nproperty int y\n"
            "property int z\nend_header\n1 2 3\n",
            "truncated: its header announces 2 points",
        ),
        (
            "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty int x\n"
            "property int y\nend_header\n",
            "expected points with x, y and z, got x, y: export the cloud with its coordinates",
        ),
        (
            "# .PCD v0.7\nDATA binary_compressed\n",
            "expected PCD with DATA ascii or binary: convert",
        ),
        ("VERSION 0.7\nFIELDS x y z\nDATA ascii\n", "a PCD file with a broken header"),
        ("VERSION 0.7\nFIELDS x\nSIZE 4\nTYPE F\nWIDTH 0\nDATA ascii\n", "without points"),
        (
            "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 9\nHEIGHT 1\nDATA binary\n12",
            "truncated: its header announces 9 points",
        ),
        ("%YAML:1.0\n---\nname: tube\n", r"no list of points among its keys \(name\)"),
        (
            "%YAML:1.0\n---\nline: [ 1, 2, 3, 4, 5, 6, 7 ]\n",
            "expected pairs or triples, .* got 7 numbers",
        ),
        ("%YAML:1.0\n---\nscan_line: 5\n", r"no list of points among its keys \(scan_line\)"),
        ("%YAML:1.0\n---\nsize: [ 1., 2., 3., 0., 0., 1. ]\n", r"no list of points .*\(size\)"),
        (
            "%YAML:1.0\n---\npose: [ 1., 2., 3., 0., 0., 1. ]\n",
            "it holds robot poses and no profile",
        ),
        ("%YAML:1.0\n---\nscan_line: [ 1, b, 3, 4 ]\n", "'b' is not a number"),
        (
            "%YAML:1.0\n---\n\t: : [",
            "not a FileStorage of OpenCV .*: write it again",
        ),
        ("Info\nCSV Version,\nEnd\n", r"without profiles \(it has Info\): export it in profile"),
        ("frame,x0,z0\n", "a header without a profile"),
    ],
)
def test_bad_content_is_rejected_with_file_and_remedy(write, content, message):
    path = write(content)
    with pytest.raises(UnreadableFile, match=message) as error:
        read_profile(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["a.rec", "a.gprec", "a.llt", "a.AVI"])
def test_recordings_of_makers_are_rejected_with_advice(write, name):
    with pytest.raises(UnreadableFile, match=r"a (Gocator|scanCONTROL) recording.*CSV"):
        read_profile(write("some text", name))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(UnreadableFile, match=r"none.csv: no such file: check the name"):
        read_profile(tmp_path / "none.csv")


def test_a_directory_is_rejected(tmp_path):
    with pytest.raises(UnreadableFile, match="a directory: name a file in it"):
        read_profile(tmp_path)


def test_a_name_that_is_no_path_is_rejected():
    with pytest.raises(UnreadableFile, match="no file can have this name"):
        read_profile("pro\0file.csv")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission_is_rejected(write):
    path = write("1,2\n3,4\n")
    path.chmod(0)
    with pytest.raises(UnreadableFile, match="no permission to read it: check its owner"):
        read_profile(path)


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (PermissionError(13, "denied"), "no permission to read it: check its owner and mode"),
        (
            OSError(5, "Input/output error"),
            r"cannot be read \(Input/output error\): check the disk",
        ),
    ],
)
def test_an_error_of_the_system_becomes_one_line(write, monkeypatch, error, message):
    def fail(*_):
        raise error

    monkeypatch.setattr(os, "open", fail)
    with pytest.raises(UnreadableFile, match=message):
        read_profile(write("1,2\n"))


def test_several_profiles_are_not_read_as_one(write):
    path = write("scan,x,z\n0,1,2\n0,2,3\n1,1,2\n1,2,3\n")
    with pytest.raises(LsvisionError, match="it holds 2 profiles: read them with read_profiles"):
        read_profile(path)
    assert len(read_profiles(path)) == 2


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ((0, 5), "no column 5 in it: expected 0 to 1, see --columns"),
        ("x,depth", r"no column named 'depth' in it \(it has x, z\): see --columns"),
    ],
)
def test_columns_that_are_not_there_are_named(write, columns, message):
    with pytest.raises(UnreadableFile, match=message):
        read_profile(write("x,z\n1,2\n3,4\n"), columns=columns)


def test_without_pyarrow_the_message_says_what_to_install(write, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(UnreadableFile, match=r"pip install 'lsvision\[batch\]'"):
        read_profile(write(b"PAR1"))


def test_a_wrong_format_by_hand_is_rejected_not_crashed(write):
    path = write("1,2\n3,4\n")
    for name in ("npy", "npz", "ply", "pcd", "parquet", "gocator", "gocator-points", "opencv"):
        with pytest.raises(UnreadableFile):
            inspect_profiles(path, format=name)


@pytest.mark.parametrize(
    "content",
    [
        "x,z\n" + "nan,nan\n" * 3,
        "NaN;NaN\n" * 3,
        "x;z\n" + ";\n" * 3,
        "# sensor 7\nx z\n" + "NaN NaN\n" * 3,
        "---\t---\n" * 3,
        "x,z\n1,nan\n2,nan\n3,\n",
    ],
)
def test_a_table_without_a_number_says_that_all_points_are_lost(write, content):
    with pytest.raises(UnreadableFile, match="all 3 points are lost: check exposure and range"):
        read_profile(write(content))


def test_a_word_over_two_lines_is_reported_in_one(write):
    with pytest.raises(UnreadableFile) as failure:
        read_profile(write("%YAML:1.0\n---\nscan_line: [!\n!]", "a.yml"))
    assert "\n" not in str(failure.value)


def test_a_folder_that_may_not_be_listed_is_reported_by_name(tmp_path, monkeypatch):
    def iterdir(path):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", iterdir)
    with pytest.raises(UnreadableFile, match=r"cannot be listed \(Permission denied\): check its"):
        read_profiles(tmp_path)
