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
    assert note.endswith(f"is 0 in {np.sum(~VALID)} points: read as lost points")


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
    for name, cells in (("valid", [1] * 120), ("status", [0] * 120), ("valid", range(120))):
        file = inspect_profiles(write_csv(tmp_path / "flags.csv", name, cells))
        assert (file.lost, file.notes) == (0, ())
