"""A direction or an offset in the text of a file is used or noted: never dropped in silence."""

import json

import numpy as np
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles

TURN = np.linspace(2.7, 0.45, 60)
PIPE = 20 * np.column_stack([np.cos(TURN), np.sin(TURN)]) + [1.0, 170.0]
ROWS = "".join(f"{x:.4f},{z:.4f}\n" for x, z in PIPE)


def read(write, line, name="a.csv", **options):
    return inspect_profiles(write(f"{line}\nx,z\n{ROWS}", name), **options)


@pytest.mark.parametrize(
    "line",
    [
        "# Z increases with distance",
        "# z grows with the distance to the sensor",
        "# z nimmt mit dem Abstand zu",
        "# z decreases towards the sensor",
        "# larger z = further away",
        "# Z axis: downwards",
        "# z_direction = down",
        "# +z = away",
        "# z points from the sensor to the object",
        "# z is positive in the direction of the laser beam",
        "# z = distance from sensor",
        "# heights are ranges measured from the sensor",
        "# z: depth",
        "# distance values (z)",
        "# depth axis z",
        "# z: larger is deeper",
        "# heights measured downwards",
        "# z axis along the viewing direction",
        "# z denotes the range from the scanner",
        "# z positif vers le bas",
        "Z direction;away from sensor",
        "# near is small, far is large",
        "# small values are near the sensor",
        "# close = low, far = high",
        "# large z = far",
        "# higher values are further away",
        "# kleine Werte nah, große Werte fern",
    ],
)
def test_a_direction_in_other_words_turns_the_heights(write, line):
    file = read(write, line)
    assert file.flipped
    assert not file.notes
    np.testing.assert_allclose(file.profiles[0].points[:, 1], -PIPE[:, 1], atol=1e-4)
    assert not read(write, line, flip=False).flipped


@pytest.mark.parametrize(
    "label",
    [
        "z (distance from sensor)",
        "z (away from sensor)",
        "z [mm] (distance)",
        "z(range)",
        "-z",
        "-z [mm]",
        "-z_mm",
        "y_down",
        "z_neg",
    ],
)
def test_a_remark_behind_the_name_turns_the_heights(write, label):
    assert inspect_profiles(write(f"x,{label}\n{ROWS}")).flipped


@pytest.mark.parametrize(
    "line",
    [
        "# z decreases with distance",
        "# larger z = closer",
        "# z up",
        "# z is negative away from the sensor",
        "# z range: 60 to 200 mm",
        "# height data from the sensor LJ-V7080",
        "# measured away from the sensor mount",
        "# z values are the distance above table",
        "# height: distance between belt and part",
        "# z axis noise increases with distance",
        "# sensor mounted upside down",
        "# distance to the sensor 170 mm",
        "# near is large, far is small",
        "# large part, near edge",
        "# invert_z = 0",
        "# mirror x: true",
        "# z = height above table",
        "# range x: -20 - 20",
    ],
)
def test_other_statements_do_not(write, line):
    file = read(write, line)
    assert not file.flipped
    assert not file.notes


@pytest.mark.parametrize(
    "line",
    [
        "# z axis is inverted",
        "# z measured from the sensor",
        "# distance to sensor decreases with z",
        "# second column: distance to sensor",
        "# z_sign: -1",
        "# invert z: true",
        "# Z invertiert",
        "# z = Z0 - value",
        "# height = 400-z",
        "# z = -raw",
        "# zero at sensor",
        "# z up: no",
    ],
)
def test_a_direction_that_is_not_understood_is_noted(write, line):
    (note,) = read(write, line).notes
    assert (
        note == f"the line {line!r} may state the direction of heights: state --flip or --no-flip"
    )
    assert not read(write, line, flip=True).notes


def test_opposite_directions_are_rejected(write):
    with pytest.raises(UnreadableFile, match="use --flip or --no-flip"):
        read(write, "# z increases with distance\n# z increases towards the sensor")


@pytest.mark.parametrize(
    "entries",
    [
        {"z_direction": "away from sensor"},
        {"note": "z axis points away from the sensor"},
        {"meta": {"zDirection": "down"}},
        {"axes": {"z": {"direction": "away from sensor"}}},
        {"z_down": True},
    ],
)
def test_json_and_yaml_state_directions(write, entries):
    x, z = PIPE.round(4).T.tolist()
    document = json.dumps({**entries, "x": x, "z": z})
    assert inspect_profiles(write(document, "a.json")).flipped
    assert not inspect_profiles(write(document, "a.json"), flip=False).flipped
    assert inspect_profiles(write(json.dumps([json.loads(document)] * 2), "a.json")).flipped
    comment = f"# z increases with distance\nx: {x}\nz: {z}\n"
    assert inspect_profiles(write(comment, "a.yaml")).flipped


@pytest.mark.parametrize(
    "entries",
    [{"invert_z": True}, {"settings": {"flipZ": True}}, {"reversed": True}, {"z_up": False}],
)
def test_a_setting_in_json_that_may_turn_the_heights_is_noted(write, entries):
    x, z = PIPE.round(4).T.tolist()
    (note,) = inspect_profiles(write(json.dumps({**entries, "x": x, "z": z}), "a.json")).notes
    assert "may state the direction of heights: state --flip or --no-flip" in note
    off = {"invert_z": False, "mirror_x": True, "valid": True, "x": x, "z": z}
    assert not inspect_profiles(write(json.dumps(off), "a.json")).notes


@pytest.mark.parametrize(
    "entries",
    [
        {"resolution_mm": 0.01},
        {"z_resolution": 0.01},
        {"resolution": {"z": "10 um"}},
        {"encoding": "fixed-point", "resolution": 0.5},
    ],
)
def test_a_resolution_without_a_unit_of_the_heights_is_noted(write, entries):
    x, z = PIPE.round(4).T.tolist()
    document = {**entries, "x": x, "z": z}
    path = write(json.dumps(document), "a.json")
    (note,) = inspect_profiles(path).notes
    assert "resolution" in note or "fixed-point" in note
    assert "may state the length of a count: state --units" in note
    assert not inspect_profiles(path, units="mm").notes
    assert not inspect_profiles(write(json.dumps({"unit": "mm", **document}), "a.json")).notes
    for line in ("# resolution: 0.01 mm", "# pixel size 0.1 mm", "# increments: 0.1"):
        (note,) = read(write, line).notes
        assert "may state the length of a count" in note
    for line in ("# x resolution: 0.1 mm", "# resolution: 640 x 480", "# resolution 1280"):
        assert not read(write, line).notes


@pytest.mark.parametrize(
    "line",
    [
        "# z_offset = -120 mm",
        "# Z-Offset [mm]: -120",
        "OffsetZ;-120.0",
        "# offset z -120",
        "# Nullpunkt z: -120 mm",
        "# add -120 to z",
        "# z values relative to -120 mm",
    ],
)
def test_an_offset_is_noted(write, line):
    (note,) = read(write, line).notes
    assert note == f"the line {line!r} states an offset, which is not added to the points"


@pytest.mark.parametrize(
    "line", ["# z_offset = 0", "# trigger offset 5", "# working distance: 120 mm", "# z offset"]
)
def test_other_lines_are_no_offset(write, line):
    assert not read(write, line).notes


@pytest.mark.parametrize("entries", [{"z_offset": -120}, {"meta": {"offset": [0, -120]}}])
def test_an_offset_in_json_is_noted(write, entries):
    x, z = PIPE.round(4).T.tolist()
    file = inspect_profiles(write(json.dumps({**entries, "x": x, "z": z}), "a.json"))
    assert "offset: -120" in "".join(file.notes)
