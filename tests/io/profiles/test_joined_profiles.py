"""Lists of profiles of which some lack an attribute, a position or points."""

import json

import numpy as np
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles

TURN = np.linspace(2.7, 0.45, 60)
PIPE = (20 * np.column_stack([np.cos(TURN), np.sin(TURN)]) + [1.0, -170.0]).round(4)
X, Z = PIPE.T.tolist()
POINTS = {"x": X, "z": Z}


def read(write, document):
    return inspect_profiles(write(json.dumps(document), "a.json"))


@pytest.mark.parametrize(
    ("document", "attributes"),
    [
        ([{"part": "A", **POINTS}, POINTS], ({"part": "A"}, {})),
        ([POINTS, {"part": 2, **POINTS}], ({}, {"part": 2})),
        ([{"part": "A", **POINTS}, {"batch": 7, **POINTS}], ({"part": "A"}, {"batch": 7})),
        ({"job": "J", "profiles": [POINTS, POINTS]}, ({"job": "J"}, {"job": "J"})),
        (
            {"part": "outer", "profiles": [{"part": "A", **POINTS}, POINTS]},
            ({"part": "A"}, {"part": "outer"}),
        ),
    ],
)
def test_attributes_of_some_profiles_are_kept(write, document, attributes):
    file = read(write, document)
    assert file.attributes == attributes
    assert [len(profile) for profile in file.profiles] == [60, 60]


@pytest.mark.parametrize(
    "empty",
    [
        {"part": "B", "x": [], "z": []},
        {"part": "B", "x": None, "z": None},
        {"part": "B", "points": []},
    ],
)
def test_an_item_without_points_keeps_its_place(write, empty):
    file = read(write, [{"part": "A", **POINTS}, empty])
    assert file.attributes == ({"part": "A"}, {"part": "B"})
    assert [profile.lost == len(profile) for profile in file.profiles] == [False, True]
    assert "1 of 2 profiles hold no point" in file.notes
    first = read(write, [empty, {"part": "A", "unit": "um", "x": X, "range": Z}])
    assert (first.units, first.flipped) == ("um", True)


@pytest.mark.parametrize("empty", [None, []])
def test_null_in_a_list_of_profiles_keeps_its_place(write, empty):
    file = read(write, [PIPE.tolist(), empty, PIPE.tolist()])
    assert [profile.lost == len(profile) for profile in file.profiles] == [False, True, False]


@pytest.mark.parametrize("cells", [(5.0, ""), ("", 5.0), ("A", "")])
def test_a_column_that_some_profiles_lack_is_an_attribute(write, cells):
    rows = [f"{k},{cell},{x},{z}" for k, cell in enumerate(cells) for x, z in PIPE.tolist()]
    file = inspect_profiles(write("\n".join(["scan,batch,x,z", *rows])))
    assert [row.get("batch") or None for row in file.attributes] == [c or None for c in cells]
    assert file.ignored == ()


def test_a_column_that_varies_in_one_profile_is_none(write):
    rows = [
        f"{k},{5 if k == 0 else number},{x},{z}"
        for k in (0, 1)
        for number, (x, z) in enumerate(PIPE.tolist())
    ]
    file = inspect_profiles(write("\n".join(["scan,peak,x,z", *rows])))
    assert file.ignored == ("peak",)


def test_positions_of_some_profiles_are_noted(write):
    travelled = [[x, y, z] for y in (1.0, 2.0) for x, z in PIPE.tolist()]
    file = read(write, [travelled, PIPE.tolist()])
    assert file.positions is None
    assert "positions along the travel left out: 1 of 3 profiles have none" in file.notes


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)])
def test_profiles_without_a_unit_have_that_of_the_others(write, order):
    um = {"x": [1000 * x for x in X], "z": [1000 * z for z in Z]}
    items = [{"unit": "um", **um}, um, um]
    file = read(write, [items[k] for k in order])
    assert file.units == "um"
    assert all(np.allclose(profile.points, PIPE) for profile in file.profiles)
    assert "2 of 3 profiles state no unit: taken as um" in file.notes
    with pytest.raises(UnreadableFile, match="differ in their units"):
        read(write, [*items, {"unit": "mm", **POINTS}])
