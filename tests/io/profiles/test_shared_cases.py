"""Small files that were read wrongly once; they lie beside the project and are not shipped."""

from pathlib import Path

import numpy as np
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles
from lsvision.measure import measure_cylinders

CASES = Path(__file__).parents[4] / "shared" / "cases" / "reading"
RADIUS_MM = 20.0

pytestmark = pytest.mark.skipif(
    not CASES.is_dir(), reason="cases are not shipped: put them in ../shared/cases"
)


def radius_of(name, **options):
    (profile,) = inspect_profiles(CASES / name, **options).profiles
    (cylinder,) = measure_cylinders(profile).cylinders
    return cylinder.radius, cylinder.radius_std


@pytest.mark.parametrize(
    ("name", "radius", "options"),
    [
        ("e01_tenth_mm.csv", RADIUS_MM, {}),
        ("e02_unit_row_um.csv", RADIUS_MM / 10, {}),
        ("e03_text_column.csv", RADIUS_MM, {}),
        ("e03_text_column.csv", RADIUS_MM, {"columns": "x,z"}),
        ("e04_count_after_comment.asc", RADIUS_MM, {}),
        ("e05_json_x_z.json", RADIUS_MM, {}),
        ("e06_quoted_decimal_comma.csv", RADIUS_MM, {}),
        ("e06_quoted_decimal_comma.csv", RADIUS_MM, {"columns": (0, 1)}),
        ("a40_lost30_-999.csv", RADIUS_MM, {}),
        ("a40_lost30_nan.csv", RADIUS_MM, {}),
        ("a46_footer.csv", RADIUS_MM, {}),
        ("a02_ljv_int_um_lost.csv", RADIUS_MM, {"units": "10nm"}),
        ("a20_lidar_xy_m.csv", 250.0, {"columns": "y,x", "flip": True, "units": "m"}),
    ],
)
def test_the_pipe_of_a_case_has_its_radius(name, radius, options):
    found, std = radius_of(name, **options)
    assert abs(found - radius) < max(5 * std, 1e-3 * radius)


def test_a_marker_reads_as_nan_does():
    marked, nan = (inspect_profiles(CASES / f"a40_lost30_{n}.csv") for n in ("-999", "nan"))
    np.testing.assert_array_equal(marked.profiles[0].points, nan.profiles[0].points)
    assert "(147 by -999.9999)" in marked.summary


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("e07_any_zip.xlsx", "a spreadsheet: save it as CSV"),
        ("e07_one_member.zip", "a zip archive of .*: unpack it"),
        ("a61_ljx_matrix_transposed.csv", "profiles may lie in columns, use --transpose"),
    ],
)
def test_a_case_that_is_not_read_says_what_to_do(name, message):
    with pytest.raises(UnreadableFile, match=message):
        inspect_profiles(CASES / name)


def test_the_laser_scan_of_a_case_is_turned_into_points():
    scan = inspect_profiles(CASES / "e08_ros_laserscan.yaml")
    assert scan.units == "m"
    np.testing.assert_allclose(
        scan.profiles[0].points[0], 144 * np.array([np.sin(-1.0), -np.cos(-1.0)])
    )


def test_what_looks_odd_in_a_case_is_noted():
    counts = inspect_profiles(CASES / "a02_ljv_int_um_lost.csv")
    assert counts.markers[0].text == "-2147483648"
    assert counts.unit_warnings[0].endswith("--units 10nm")
    lidar = inspect_profiles(CASES / "a20_lidar_xy_m.csv", columns="y,x", flip=True)
    assert any("use --units m" in note for note in lidar.notes)
