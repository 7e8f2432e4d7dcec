"""Results of a batch as a table: the columns of the input beside those of the result."""

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pyarrow import csv

import lsvision as lsv
from lsvision.batch.measure_file import BatchJob, FileTask, measure_file
from lsvision.batch.result_table import build_result_table
from lsvision.io.profiles.streaming import iterate_profiles
from tests.batch.sources import profiles, write_nested, write_parquet


@pytest.fixture
def chunk(tmp_path):
    """Two profiles of a file, one after the other."""
    path = tmp_path / "a.npy"
    np.save(path, np.stack(profiles(2)))
    (chunk,) = iterate_profiles(path)
    return chunk


def table_of(chunk):
    return build_result_table("a", chunk, [lsv.measure_cylinders(p) for p in chunk.file.profiles])


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        (({}, {"part": "A"}), [None, "A"]),
        (({"part": "A"}, {"part": 7}), ["A", "7"]),
        (({"part": 1}, {"part": 7}), [1, 7]),
        (({"part": 1}, {"part": 10**25}), ["1", str(10**25)]),
    ],
)
def test_an_attribute_may_be_missing_or_of_another_type_in_a_profile(chunk, attributes, expected):
    table = table_of(replace(chunk, file=replace(chunk.file, attributes=attributes)))
    assert dict(zip(*table.select(["profile", "part"]).to_pydict().values(), strict=True)) == dict(
        enumerate(expected)
    )


def test_no_column_of_the_file_is_lost_by_its_name(chunk):
    columns = pa.table({"source": ["x", "y"], "source_in_file": [1, 2], "radius_mm": [3, 4]})
    row = table_of(replace(chunk, columns=columns)).to_pylist()[-1]
    names = ("source", "source_in_file", "source_in_file_in_file", "radius_mm_in_file")
    assert [row[name] for name in names] == ["a", 2, "y", 4]


def test_a_file_without_other_columns_adds_none(chunk):
    names = table_of(chunk).column_names
    assert names[:3] == ["source", "profile", "cylinder"]
    assert names[-2:] == ["reason", "rejections"]
    assert len(set(names)) == len(names)


def test_nested_columns_are_in_the_results_and_columns_of_points_are_noted(tmp_path):
    names = write_nested(tmp_path / "a.parquet")
    task = FileTask(tmp_path / "a.parquet", tmp_path / "out.parquet", "a.parquet", BatchJob())
    outcome = measure_file(task)
    assert outcome.error == ""
    assert "intensity: one value per point, not repeated in the results" in outcome.notes
    found = pq.read_table(tmp_path / "out.parquet")
    given = pq.read_table(tmp_path / "a.parquet").select(names)
    taken = given.take(found["profile"])
    assert found.select(names).to_pylist() == taken.to_pylist()
    assert [found.schema.field(name).type for name in names] == [
        given.schema.field(name).type for name in names
    ]


def test_a_column_with_another_name_in_the_results_is_noted(tmp_path):
    write_parquet(tmp_path / "a.parquet")
    table = pq.read_table(tmp_path / "a.parquet")
    table = table.rename_columns(["radius_mm", "x", "z", "radius_mm_in_file", "taken"])
    pq.write_table(table, tmp_path / "a.parquet")
    task = FileTask(tmp_path / "a.parquet", tmp_path / "out.parquet", "a.parquet", BatchJob())
    new_name = "radius_mm_in_file_in_file"
    assert (
        f"radius_mm is a column of the results: that of the file is {new_name} there"
    ) in measure_file(task).notes
    found = pq.read_table(task.output)
    assert found[new_name].to_pylist() == table["radius_mm"].take(found["profile"]).to_pylist()


def results_of(path, content):
    """The outcome of a file of two pipes, of which `content` makes one, and its rows."""
    content(path)
    task = FileTask(path, path.with_name("out.parquet"), path.name, BatchJob())
    outcome = measure_file(task)
    return outcome, pq.read_table(task.output) if not outcome.error else None


def points_with_ids(ids, name="part_id"):
    points = profiles(2)
    rows = np.repeat(np.arange(2), [len(p) for p in points])
    x, z = np.concatenate(points).T
    return pa.table({name: pa.array([ids[row] for row in rows]), "x": x, "z": z})


def write_csv(table):
    return lambda path: csv.write_csv(table, path)


@pytest.mark.parametrize("ids", [[7, 8], [2**53 - 2, 2**53 - 1]])
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_whole_numbers_of_parts_are_integers(tmp_path, ids, suffix):
    table = points_with_ids(ids)
    write = write_csv(table) if suffix == ".csv" else lambda path: pq.write_table(table, path)
    outcome, found = results_of(tmp_path / f"a{suffix}", write)
    assert outcome.error == ""
    assert found["part_id"].to_pylist() == [ids[k] for k in found["profile"].to_pylist()]
    assert found["part_id"].type == pa.int64()


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("name", ["part_id", "token"])
def test_ids_that_a_float_would_round_remain_exact(tmp_path, suffix, name):
    ids = [10**18 + 123, 10**18 + 124] if name == "part_id" else [10**18 + 123] * 2
    table = points_with_ids(ids, name)
    write = write_csv(table) if suffix == ".csv" else lambda path: pq.write_table(table, path)
    outcome, found = results_of(tmp_path / f"a{suffix}", write)
    assert outcome.error == ""
    assert set(found[name].to_pylist()) == set(map(str, ids))


def test_ids_that_a_float_would_round_are_rejected_in_json(tmp_path):
    table = points_with_ids([10**18 + 123, 10**18 + 124])
    path = tmp_path / "a.json"
    outcome, _ = results_of(path, lambda path: path.write_text(json.dumps(table.to_pydict())))
    assert "part_id: numbers above 2^53 would be rounded, and different ones bec" in outcome.error
    table = points_with_ids([10**18 + 123] * 2, "token")
    outcome, _ = results_of(path, lambda path: path.write_text(json.dumps(table.to_pydict())))
    assert "token: numbers above 2^53 are rounded" in outcome.notes


def test_ids_with_leading_zeros_join_with_the_input(tmp_path):
    table = points_with_ids(["007", "7"])
    outcome, found = results_of(tmp_path / "a.csv", write_csv(table))
    assert (outcome.error, outcome.profiles) == ("", 2)
    assert set(found["part_id"].to_pylist()) == {"007", "7"}
