"""Columns that say which points are valid, and columns of flags whose meaning is not known."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lsvision.io.profiles import inspect_profiles

X = np.linspace(-15, 15, 120)
VALID = np.random.default_rng(4).random(len(X)) > 0.1
Z = np.sqrt(400 - X**2) - 300 + np.where(VALID, 0.0, 3.0)


def write_csv(path, name, cells):
    rows = [f"{x:.3f},{z:.3f},{cell}" for x, z, cell in zip(X, Z, cells, strict=True)]
    path.write_text("\n".join([f"x,z,{name}", *rows]))
    return path


def is_lost(path):
    return np.isnan(inspect_profiles(path).profiles[0].points[:, 1])


@pytest.mark.parametrize("name", ["valid", "Is_Valid", "Validity", "gültig"])
@pytest.mark.parametrize("words", ["01", ("False", "True")])
def test_points_that_are_not_valid_are_lost(tmp_path, name, words):
    path = write_csv(tmp_path / "valid.csv", name, [words[int(valid)] for valid in VALID])
    np.testing.assert_array_equal(is_lost(path), ~VALID)
    (note,) = inspect_profiles(path).notes
    assert note.endswith(f"is {words[0]} in {np.sum(~VALID)} points: read as lost points")


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("valid", 255, 0),
        ("valid", "ok", "NOK"),
        ("valid", "y", "n"),
        ("valid", "valid", "invalid"),
        ("z_valid", "WAHR", "FALSCH"),
        ("point ok", 1, 0),
        ("bValid", "TRUE", "FALSE"),
        ("validZ", 1, 0),
        ("valid_mask", 1, 0),
        ("out_of_range", 0, 1),
        ("invalid", 0, 1),
        ("is_invalid", "False", "True"),
        ("lost", 0, 255),
        ("quality", "good", "bad"),
        ("point_status", "OK", "Lost"),
        ("Status", "i.O.", "n.i.O."),
        ("mask", "valid", "invalid"),
    ],
)
def test_flags_and_words_of_any_kind_are_understood(tmp_path, name, good, bad):
    cells = [good if valid else bad for valid in VALID]
    path = write_csv(tmp_path / "flags.csv", name, cells)
    np.testing.assert_array_equal(is_lost(path), ~VALID)
    columns = {"x": [*X], "z": [*Z], name: cells}
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    for number, document in enumerate(
        (columns, rows, {"columns": [*columns], "data": [list(row.values()) for row in rows]})
    ):
        path = tmp_path / f"{number}.json"
        path.write_text(json.dumps(document))
        np.testing.assert_array_equal(is_lost(path), ~VALID)


@pytest.mark.parametrize(
    ("good", "bad"), [(1, ""), (1, -1), ("x", ""), ("+", "-"), (1, 2), ("A", "B")]
)
def test_a_validity_in_other_words_is_noted(tmp_path, good, bad):
    cells = [good if valid else bad for valid in VALID]
    file = inspect_profiles(write_csv(tmp_path / "flags.csv", "valid", cells))
    assert any("valid varies and is not used" in note for note in file.notes)


@pytest.mark.parametrize(
    ("good", "bad"), [(1, 0), (0, 1), (0, 5), ("yes", "no"), ("True", "False")]
)
def test_a_column_of_two_values_of_any_name_is_noted(tmp_path, good, bad):
    cells = [good if valid else bad for valid in VALID]
    file = inspect_profiles(write_csv(tmp_path / "flags.csv", "detected", cells))
    assert file.notes == (
        "detected varies and is not used: if it marks lost points, write a column valid of 1 and "
        "0, or nan as their height",
    )


def test_flags_below_a_point_in_json_are_used(tmp_path):
    points = [{"x": x, "z": z, "flags": {"valid": bool(valid)}}
              for x, z, valid in zip(X, Z, VALID, strict=True)]  # fmt: skip
    (tmp_path / "points.json").write_text(json.dumps({"points": points}))
    np.testing.assert_array_equal(is_lost(tmp_path / "points.json"), ~VALID)


def test_a_list_of_valid_indices_is_noted(tmp_path):
    document = {"x": [*X], "z": [*Z], "valid_indices": np.flatnonzero(VALID).tolist()}
    (tmp_path / "lists.json").write_text(json.dumps(document))
    (note,) = inspect_profiles(tmp_path / "lists.json").notes
    assert note.startswith("valid_indices is not used: if it marks lost points")


def test_null_beside_flags_in_json_is_noted(tmp_path):
    document = {"x": [*X], "z": [*Z], "valid": [bool(valid) or None for valid in VALID]}
    (tmp_path / "lists.json").write_text(json.dumps(document))
    (note,) = inspect_profiles(tmp_path / "lists.json").notes
    assert "valid varies and is not used" in note


@pytest.mark.parametrize("name", ["status", "ok", "pass"])
def test_a_verdict_on_each_part_loses_no_points(tmp_path, name):
    rows = [f"{k},{x:.3f},{z:.3f},{verdict}" for k, verdict in enumerate(["OK", "NOK"])
            for x, z in zip(X, Z, strict=True)]  # fmt: skip
    path = tmp_path / "parts.csv"
    path.write_text("\n".join([f"part,x,z,{name}", *rows]))
    file = inspect_profiles(path)
    assert (file.lost, file.notes) == (0, ())
    assert [row[name] for row in file.attributes] == ["OK", "NOK"]


def test_the_table_begins_above_the_first_invalid_point(tmp_path):
    cells = ["valid"] * 10 + ["invalid"] + ["valid"] * (len(X) - 11)
    file = inspect_profiles(write_csv(tmp_path / "flags.csv", "state", cells))
    assert (len(file.profiles[0]), file.lost) == (len(X), 1)


def test_also_in_json_parquet_and_structured_arrays(tmp_path):
    (tmp_path / "lists.json").write_text(
        json.dumps({"x": [*X], "z": [*Z], "valid": VALID.tolist()})
    )
    pq.write_table(pa.table({"x": X, "z": Z, "valid": VALID}), tmp_path / "table.parquet")
    records = np.rec.fromarrays([X, Z, VALID], names="x,z,valid")
    np.save(tmp_path / "records.npy", np.asarray(records))
    np.savez(tmp_path / "arrays.npz", x=X, z=Z, valid=VALID)
    for name in ("lists.json", "table.parquet", "records.npy", "arrays.npz"):
        np.testing.assert_array_equal(is_lost(tmp_path / name), ~VALID)


@pytest.mark.parametrize("name", ["quality", "Status", "mask", "error", "confidence"])
def test_flags_of_unknown_meaning_are_noted(tmp_path, name):
    file = inspect_profiles(write_csv(tmp_path / "flags.csv", name, VALID.astype(int)))
    assert file.lost == 0
    assert any(f"{name.lower()} varies and is not used" in note for note in file.notes)


def test_columns_without_a_choice_say_nothing(tmp_path):
    for name, cells in (
        *(("valid", [1] * 120), ("status", [0] * 120), ("valid", range(120))),
        ("state", ["NOK"] * 120),
    ):
        file = inspect_profiles(write_csv(tmp_path / "flags.csv", name, cells))
        assert (file.lost, file.notes) == (0, ())
