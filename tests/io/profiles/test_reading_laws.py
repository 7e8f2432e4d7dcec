"""Whatever the bytes, a reader gives profiles or says why not."""

import math
import tempfile
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lsvision.errors import LsvisionError
from lsvision.io.profiles import FORMATS, read_profile, read_profiles

STARTS = {
    "nothing": b"",
    "npy": b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (4,2), }",
    "zip": b"PK\x03\x04",
    "parquet": b"PAR1",
    "ply": b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
    b"property float z\nend_header\n",
    "pcd": b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA binary\n",
    "yaml": b"%YAML:1.0\n---\nscan_line: [",
    "json": b"{",
    "xml": b"<?xml version='1.0'?><opencv_storage>",
    "gocator": b"Info\nCSV Version,\nEnd\nPart\nY\\X,1,2\n",
    "profile": b"Info\nCSV Version,\nEnd\nProfile\nY,Axis,1,2\n",
    "points": b"frame,x0,z0\n",
    "utf-16": b"\xff\xfe",
    "header": b"x [mm],y,z [um]\n",
}
NUMBER_LIKE = st.text(alphabet="0123456789.,;- \t\nexnaif[]m#:{}\"'", max_size=200)
COORDINATE = st.floats(-1e4, 1e4).map(lambda value: round(value, 4))
# None that marks lost points.
MEASURED = st.floats(-900.0, 900.0).map(lambda value: round(value, 4))


def read_or_reject(content: bytes, **options) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "profile"
        path.write_bytes(content)
        try:
            profiles = read_profiles(path, **options)
        except LsvisionError as reason:
            profiles, message = [], str(reason)
        else:
            message = ""
        assert "\n" not in message
        assert not any(np.isinf(profile.points).any() for profile in profiles)


@pytest.mark.parametrize("start", STARTS)
@settings(max_examples=40, deadline=None)
@given(rest=st.binary(max_size=300) | NUMBER_LIKE.map(str.encode))
def test_any_bytes_after_any_start_are_read_or_rejected(start, rest):
    read_or_reject(STARTS[start] + rest)


@settings(max_examples=150, deadline=None)
@given(content=st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")))
def test_any_text_is_read_or_rejected(content):
    read_or_reject(content)


@settings(max_examples=150, deadline=None)
@given(
    content=NUMBER_LIKE.map(str.encode) | st.binary(max_size=60),
    name=st.sampled_from(FORMATS),
    dx=st.none() | st.floats(0.1, 1.0),
)
def test_any_bytes_are_read_or_rejected_in_any_format_asked_for(content, name, dx):
    read_or_reject(content, format=name, dx=dx, x_start=1.0, x_pitch=1.0, z_unit=1.0)


@settings(max_examples=60, deadline=None)
@given(
    rows=st.lists(st.tuples(MEASURED, MEASURED | st.just(math.nan)), min_size=5, max_size=40),
    separator=st.sampled_from([",", ";", "\t", " "]),
    decimal=st.sampled_from([".", ","]),
    header=st.sampled_from(["", "x{0}z", "# a remark", "X [mm]{0}Z [mm]"]),
)
def test_written_text_comes_back(rows, separator, decimal, header):
    if decimal == separator or np.isfinite(np.array(rows)).all(axis=1).sum() < 2:
        return
    lines = [header.format(separator)]
    lines += [separator.join(f"{v:.4f}".replace(".", decimal) for v in row) for row in rows]
    points = np.array(rows)
    lost = np.isnan(points[:, 1])
    zero = (points == 0).all(axis=1)
    lost |= zero & (zero.sum() > 1)
    points[lost] = np.nan
    if (~lost).sum() < 2:
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "profile.txt"
        path.write_text("\n".join(lines))
        npt.assert_array_equal(read_profile(path).points, points)
