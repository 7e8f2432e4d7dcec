"""Options, the report on a file, and the notes on what looks wrong."""

import dataclasses

import numpy as np
import numpy.testing as npt
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import (
    ReadOptions,
    ReadSettings,
    inspect_profiles,
    read_profile,
    read_profiles,
)


def test_flip_overrides_the_header_both_ways(write):
    path = write("x,range\n0,400\n1,399\n")
    assert read_profile(path).points[0, 1] == -400.0
    assert read_profile(path, flip=False).points[0, 1] == 400.0
    assert read_profile(write("0,400\n1,399\n"), flip=True).points[0, 1] == -400.0


def test_units_override_the_header(write):
    path = write("x [mm],z [mm]\n1,2\n3,4\n")
    npt.assert_allclose(read_profile(path, units="in").points, [[25.4, 50.8], [76.2, 101.6]])


def test_the_report_says_reader_units_and_lost_points(write):
    file = inspect_profiles(write("x [um],range [um]\n0,400\n1,\n2000,399\n"))
    assert (file.reader, file.units, file.units_assumed) == ("text", "um", False)
    assert (file.flipped, file.lost, len(file.profiles)) == (True, 1, 1)
    assert file.summary == "text, um, 1 profile, 1 of 3 points lost, heights turned"


def test_the_summary_says_what_is_assumed(write):
    file = inspect_profiles(write("scan x z\n0 0 1\n0 9 2\n1 0 1\n1 9 nan\n"))
    assert file.summary == "text, mm (assumed), 2 profiles, 1 of 4 points lost"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("p.csv", "x;z_in;z_out\n0;400;390\n1;399;391\n"),
        ("p.json", '{"x": [0, 1, 2], "z_in": [400, 399, 400], "z_out": [390, 391, 390]}'),
    ],
)
def test_in_beside_out_is_not_read_as_inches(write, name, content):
    path = write(content, name)
    with pytest.raises(UnreadableFile, match=r"z_in beside z_out: .*--units mm or --units in"):
        read_profile(path)
    assert abs(read_profile(path, units="mm").points[0, 1]) == 400.0
    inches = write(content.replace("z_out", "width_in"), name)
    assert abs(read_profile(inches).points[0, 1]) == pytest.approx(400 * 25.4)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("p.json", '{"x": [0, 1, 2], "z": [400, 399, 400]}'),
        ("p.yaml", "x: [0, 1, 2]\nz: [400, 399, 400]\n"),
        ("p.csv", "x,z\n0,400\n1,399\n"),
        ("p.npy", None),
    ],
)
def test_options_of_another_kind_of_file_are_rejected(write, name, content):
    path = write(content or "", name)
    if content is None:
        np.save(path, np.column_stack([np.arange(9.0), np.full((9, 2), [1.0, 400.0])])[:, [0, 2]])
    for options, words in [
        ({"dx": 0.5}, "--dx is for heights without x"),
        ({"x_pitch": 5.0}, "--x-start and --x-pitch are for raw counts of Keyence"),
        ({"topic": "/scan"}, "--topic is for ROS bags"),
    ]:
        with pytest.raises(UnreadableFile, match=words):
            read_profile(path, **options)
    assert len(read_profile(path)) >= 2


def test_names_that_say_nothing_are_noted(write):
    file = inspect_profiles(write("u,v\n0,400\n9,399\n"))
    assert file.notes == ("u and v read as x and height",)


def test_units_that_nobody_states_are_reported_as_assumed(write):
    assert inspect_profiles(write("0,400\n9,399\n")).units_assumed
    assert not inspect_profiles(write("0,400\n9,399\n"), units="mm").units_assumed


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("0,-400000\n10000,-399000\n", "--units um"),
        ("0,-0.4\n0.01,-0.399\n", "--units m"),
        ("x,y,z\n" + "0,1,5\n4,1,6\n" * 3 + "0,2,\n4,2,\n" * 3, "1 of 2 profiles hold no point"),
    ],
)
def test_what_looks_wrong_is_noted_with_its_remedy(write, text, hint):
    assert any(hint in note for note in inspect_profiles(write(text)).notes)


def test_a_good_profile_has_nothing_noted(write):
    assert inspect_profiles(write("x [mm],z [mm]\n0,-400\n9,-399\n")).notes == ()


def test_a_file_of_one_profile_reads_alike_both_ways(write):
    path = write("0,1\n2,3\n")
    npt.assert_array_equal(read_profiles(path)[0].points, read_profile(path).points)


def test_a_hundred_thousand_points_are_read_whole(write):
    points = np.random.default_rng(1).normal(0, 50, (100_000, 2)).round(4)
    text = "\n".join(f"{x},{z}" for x, z in points.tolist())
    npt.assert_array_equal(read_profile(write(text)).points, points)


def test_the_keywords_are_the_fields_of_the_settings():
    fields = [field.name for field in dataclasses.fields(ReadSettings)]
    assert list(ReadOptions.__annotations__) == fields


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"format": "xls"}, "expected format among text, matrix, .*, got 'xls'"),
        ({"units": "furlong"}, "expected units among nm, um, mm, .*, got 'furlong'"),
        ({"dx": 0.0}, "expected dx other than 0, got 0"),
        ({"x0": 3.0}, "expected dx beside x0"),
        ({"columns": (0,)}, r"expected columns of x and height .*, got \(0,\)"),
        ({"columns": (0, -1)}, r"expected columns .* from 0, got \(0, -1\)"),
        ({"columns": "0,-1"}, "expected columns .* from 0, got '0,-1'"),
        ({"columns": "x,x"}, "all different, .* got 'x,x'"),
        ({"z_unit": -50}, "expected z_unit above 0, got -50"),
    ],
)
def test_a_slip_in_the_options_is_rejected(options, message):
    with pytest.raises(ValueError, match=message):
        ReadSettings(**options)


def test_markers_may_be_an_array():
    assert ReadSettings(lost=np.array([-9999.0, 0.0])).lost_values == (-9999.0, 0.0)  # type: ignore[arg-type] # what a user may pass


def test_a_column_that_is_no_whole_number_is_rejected():
    with pytest.raises(TypeError, match="'float' object"):
        ReadSettings(columns=(0.5, 1))  # type: ignore[arg-type] # what a user may pass


def test_an_empty_name_is_not_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "a.csv").write_text("1,2\n2,3\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnreadableFile, match="a directory: name a file in it"):
        read_profiles("")
    assert len(read_profiles(".")) == 1
