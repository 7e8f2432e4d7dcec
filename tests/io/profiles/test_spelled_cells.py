"""Ids come out as they stand in the file, and no part takes the points of another."""

import json

import numpy as np
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles

TURN = np.linspace(2.7, 0.45, 60)
PIPE = (20 * np.column_stack([np.cos(TURN), np.sin(TURN)]) + [1.0, -170.0]).round(3)


def text_of(ids, name="part_id", separator=","):
    """Return a table with the points of a pipe for each id."""
    rows = [f"{part}{separator}{x}{separator}{z}" for part in ids for x, z in PIPE.tolist()]
    return "\n".join([separator.join([name, "x", "z"]), *rows, ""])


def text_of_rows(ids):
    """Return a table of two pipes with an id for each point."""
    points = [*PIPE.tolist(), *PIPE.tolist()]
    rows = [f"{part},{x},{z}" for part, (x, z) in zip(ids, points, strict=True)]
    return "\n".join(["part_id,x,z", *rows, ""])


@pytest.mark.parametrize(
    "ids",
    [
        ("007", "008"),
        ("007", "7"),
        ("1e5", "1e6"),
        ("1D3", "1D4"),
        ("1.1", "1.10"),
        ("12", "12_3"),
        ("007", "0A1"),
        ("0A1", "007"),
        ("A7", "12"),
        ("REF", *map(str, range(1, 20))),
        (*map(str, range(1, 20)), "REF"),
        ("12345678901234567890", "12345678901234567891"),
    ],
)
@pytest.mark.parametrize("separator", [",", ";", "\t", "  "])
def test_ids_come_out_as_they_stand(write, ids, separator):
    file = inspect_profiles(write(text_of(ids, separator=separator)))
    names = [str(row["part_id"]).removesuffix(".0") for row in file.attributes]
    assert names == list(ids)
    for profile in file.profiles:
        assert np.allclose(profile.points, PIPE)


def test_quoted_ids_come_out_as_they_stand(write):
    file = inspect_profiles(write(text_of(['"007"', '"008"'])))
    assert [row["part_id"] for row in file.attributes] == ["007", "008"]


def test_attributes_come_out_as_they_stand(write):
    assert inspect_profiles(write(text_of(["0012"], "serial"))).attributes == ({"serial": "0012"},)
    assert inspect_profiles(write(text_of(["21.50"], "temp"))).attributes == ({"temp": 21.5},)
    assert inspect_profiles(write(text_of(["1e+05"], "gain"))).attributes == ({"gain": 1e5},)


@pytest.mark.parametrize("form", ["objects", "columns", "names", "pandas"])
def test_ids_in_json_come_out_as_they_stand(write, form):
    rows = [[part, x, z] for part in ("007", "1e5") for x, z in PIPE.tolist()]
    part, x, z = map(list, zip(*rows, strict=True))
    columns = {"part": part, "x": x, "z": z}
    document = {
        "objects": [dict(zip(columns, row, strict=True)) for row in rows],
        "columns": columns,
        "names": {"columns": list(columns), "data": rows},
        "pandas": {k: {str(row): v for row, v in enumerate(c)} for k, c in columns.items()},
    }[form]
    file = inspect_profiles(write(json.dumps(document), "a.json"))
    assert file.attributes == ({"part": "007"}, {"part": "1e5"})
    assert all(np.allclose(profile.points, PIPE) for profile in file.profiles)


@pytest.mark.parametrize("ids", [("7", "8"), ("007", "008"), ("A", "B")])
@pytest.mark.parametrize("gap", ["inside", "below first rows", "of lost points"])
def test_rows_without_an_id_that_is_evident_are_read(write, ids, gap):
    first, second = ids
    column = {
        "inside": [first] * 20 + [""] * 3 + [first] * 37 + [second] * 60,
        "below first rows": [first, *[""] * 59, second, *[""] * 59],
        "of lost points": [first] * 60 + [second] * 60,
    }[gap]
    text = text_of_rows(column)
    text += ",,\n,,\n" if gap == "of lost points" else ""
    file = inspect_profiles(write(text))
    assert [str(row["part_id"]).removesuffix(".0") for row in file.attributes] == list(ids)
    assert all(np.allclose(profile.points[:60], PIPE) for profile in file.profiles)


@pytest.mark.parametrize("ids", [("7", "8"), ("007", "008"), ("A", "B")])
@pytest.mark.parametrize("gap", ["between", "in front", "at the end"])
def test_points_that_may_belong_to_no_part_are_rejected(write, ids, gap):
    first, second = ids
    column = {
        "between": [first] * 55 + [""] * 10 + [second] * 55,
        "in front": [""] * 60 + [second] * 60,
        "at the end": [first] * 60 + [""] * 60,
    }[gap]
    with pytest.raises(UnreadableFile, match="points that may belong to no part"):
        inspect_profiles(write(text_of_rows(column)))


def test_words_of_a_summary_below_the_table_are_no_ids(write):
    text = text_of(["1", "2"]) + "mean,1.5,-160\nmax,2,-150\n"
    file = inspect_profiles(write(text))
    assert len(file.profiles) == 2
    assert file.notes == ("2 lines after the numbers left out: 'mean,1.5,-160'",)


@pytest.mark.parametrize("scans", [[1] * 60 + [2] * 60, [1] * 120])
def test_profiles_with_points_of_a_part_and_of_none_are_rejected(write, scans):
    parts = ["A"] * 60 + ["B"] * 30 + [""] * 30
    points = [*PIPE.tolist(), *PIPE.tolist()]
    rows = [f"{s},{p},{x},{z}" for s, p, (x, z) in zip(scans, parts, points, strict=True)]
    with pytest.raises(UnreadableFile, match="part is empty in 30 points that may belong to no"):
        inspect_profiles(write("\n".join(["scan,part,x,z", *rows])))


@pytest.mark.parametrize("name", ["barcode", "Teil", "id", "sample", "SerialNo"])
@pytest.mark.parametrize("ids", [("0071", "0072"), ("K-71", "K-72"), ("71", "1e5")])
def test_a_column_of_any_name_that_changes_where_x_starts_again_separates(write, name, ids):
    file = inspect_profiles(write(text_of(ids, name)))
    assert [row[name.lower()] for row in file.attributes] == list(ids)
    assert all(np.allclose(profile.points, PIPE) for profile in file.profiles)
    assert f"{name.lower()} changes where x starts again: it separates profiles" in file.notes


def test_a_column_that_changes_elsewhere_separates_no_profiles(write):
    file = inspect_profiles(write(text_of_rows(["A"] * 50 + ["B"] * 70).replace("part_id", "lane")))
    assert len(file.profiles) == 1
    assert any("x starts again 1 times" in note for note in file.notes)


@pytest.mark.parametrize("parts", [["A", "B"] * 60, ["A"] * 30 + ["B"] * 60 + ["A"] * 30])
def test_parts_that_separate_no_profiles_are_noted(write, parts):
    notes = inspect_profiles(write(text_of_rows(parts))).notes
    assert any("part_id has several values and separates no profiles" in note for note in notes)


def test_an_id_in_the_first_row_of_its_part_is_that_of_all_its_profiles(write):
    ids = iter(["A"] + [""] * 119)
    rows = [f"{next(ids)},{k},{x},{z}" for k in (1, 2) for x, z in PIPE.tolist()]
    file = inspect_profiles(write("\n".join(["part,frame,x,z", *rows])))
    assert file.attributes == ({"part": "A", "frame": 1.0}, {"part": "A", "frame": 2.0})
