"""Statements on the direction of heights, and texts that are no tables."""

import numpy as np
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles, read_profile

ROWS = "-5.5,300.25\n0.5,290.25\n5.5,300.25\n"


def read(tmp_path, text, **options):
    path = tmp_path / "profile.txt"
    path.write_text(text)
    return inspect_profiles(path, **options)


@pytest.mark.parametrize(
    "line",
    [
        "# z axis points away from the sensor",
        "# Z positive down",
        "# heights increase away from the scanner",
        "# z-Achse zeigt vom Sensor weg",
    ],
)
def test_a_stated_direction_turns_the_heights(tmp_path, line):
    file = read(tmp_path, f"{line}\nx,z\n{ROWS}")
    assert file.flipped
    assert file.profiles[0].points[0, 1] == -300.25
    assert not read(tmp_path, f"{line}\nx,z\n{ROWS}", flip=False).flipped


@pytest.mark.parametrize(
    "line",
    [
        "# z = 200 mm away from the sensor",
        "# y axis away from the sensor",
        "# z towards the sensor",
    ],
)
def test_other_statements_do_not(tmp_path, line):
    assert not read(tmp_path, f"{line}\nx,z\n{ROWS}").flipped


def test_contradicting_directions_are_rejected(tmp_path):
    lines = "# z axis away from the sensor\n# z axis points towards the sensor\n"
    with pytest.raises(UnreadableFile, match="away from the sensor, and towards it: use --flip"):
        read(tmp_path, f"{lines}x,z\n{ROWS}")


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("Ort,Abstand", "{x}.5,{z}.25"),
        ("foo,distance [mm],intensity", "{x}.5,{z}.25,7"),
        ("x,measuring range", "{x}.5,{z}.25"),
        ("x [mm],distance to target [mm]", "{x}.5,{z}.25"),
        ("foo,distance,intensity", "{x}.5,{z}.25,{x}"),
        ("foo,bar,range", "{x}.5,{scan},{z}.25"),
    ],
)
def test_a_range_beside_columns_of_other_names_turns_the_heights(tmp_path, header, row):
    rows = [row.format(x=x, scan=scan, z=300 + x) for scan in (1, 2) for x in range(20)]
    file = read(tmp_path, "\n".join([header, *rows]))
    assert file.flipped
    assert file.profiles[0].points[0].tolist() == [0.5, -300.25]


@pytest.mark.parametrize(
    "row", ["X=-60.25 Z=-289.9", "G1 X-60.25 Z-289.9", "(-60.25, -289.9)", "-60.25 mm,-289.9 mm"]
)
def test_a_text_without_a_table_is_quoted(tmp_path, row):
    with pytest.raises(UnreadableFile) as error:
        read(tmp_path, f"{row}\n" * 9)
    assert repr(row) in str(error.value)


@pytest.mark.parametrize(
    "start", ["<table><tr><td>1</td></tr>", "<!DOCTYPE svg>", "<svg height='9'>"]
)
def test_markup_is_named(tmp_path, start):
    with pytest.raises(UnreadableFile, match="a web page or an XML file"):
        read(tmp_path, f"{start}\n1 2\n3 4\n5 6\n")


def test_comments_behind_numbers_are_left_out(tmp_path):
    text = "".join(f"{x:.2f},{-x * x - 200:.2f} # ok {x}\n" for x in np.arange(-5, 5.5, 0.5))
    (tmp_path / "remarks.csv").write_text(text)
    assert read_profile(tmp_path / "remarks.csv").points.shape == (21, 2)
