"""Chunks of a file hold what the whole file holds."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles
from lsvision.io.profiles.streaming import iterate_profiles
from tests.batch.sources import profiles, write_nested, write_parquet


def joined(chunks):
    return [profile for chunk in chunks for profile in chunk.file.profiles]


@pytest.mark.parametrize("at_once", [1, 2, 5, 100])
def test_parquet_in_chunks_is_parquet_as_a_whole(tmp_path, at_once):
    path = tmp_path / "a.parquet"
    write_parquet(path)
    chunks = list(iterate_profiles(path, at_once=at_once))
    assert joined(chunks) == list(inspect_profiles(path).profiles)
    assert [chunk.first for chunk in chunks] == list(range(0, 5, at_once))
    assert all(len(chunk.file.profiles) <= at_once for chunk in chunks)
    columns = pa.concat_tables([chunk.columns for chunk in chunks])
    assert columns.equals(pq.read_table(path, columns=["part_id", "station", "taken"]))


def test_arrays_in_chunks_are_arrays_as_a_whole(tmp_path):
    points = np.array([p[:200] for p in profiles(5)])
    cube, heights = tmp_path / "cube.npy", tmp_path / "heights.npy"
    np.save(cube, points)
    np.save(heights, points[:, :, 1])
    assert joined(iterate_profiles(cube, at_once=2)) == list(inspect_profiles(cube).profiles)
    options = {"x0": -3.0, "dx": 0.25}
    chunks = list(iterate_profiles(heights, at_once=2, **options))
    assert joined(chunks) == list(inspect_profiles(heights, **options).profiles)
    assert len(chunks) == 3


def test_a_table_of_points_and_a_text_are_one_chunk(tmp_path):
    points = profiles(1)[0]
    long, text = tmp_path / "long.parquet", tmp_path / "a.csv"
    pq.write_table(pa.table({"x": points[:, 0], "z": points[:, 1]}), long)
    np.savetxt(text, points, delimiter=",")
    for path in (long, text):
        (chunk,) = iterate_profiles(path, at_once=3)
        assert list(chunk.file.profiles) == list(inspect_profiles(path).profiles)


def test_a_lost_marker_counts_in_all_chunks_after_the_one_that_shows_it(tmp_path):
    points = np.array(
        [np.column_stack([np.arange(60.0), np.linspace(-300.0, -250.0, 60)]) for _ in range(4)]
    )
    points[0, ::2, 1] = -9999.0
    points[2, 7, 1] = -9999.0  # alone it would be a stray point
    path = tmp_path / "a.npy"
    np.save(path, points)
    lost = [profile.lost for profile in joined(iterate_profiles(path, at_once=2))]
    assert lost == [30, 0, 1, 0]
    lost = [profile.lost for profile in joined(iterate_profiles(path, at_once=2, lost="none"))]
    assert lost == [0, 0, 0, 0]


def test_a_broken_file_is_reported_with_its_first_bad_profile(tmp_path):
    path = tmp_path / "a.parquet"
    write_parquet(path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(UnreadableFile, match=r"a\.parquet: pyarrow cannot read it"):
        list(iterate_profiles(path))
    np.save(tmp_path / "a.npy", np.zeros((3, 4, 2)))
    content = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(content[:-8])
    with pytest.raises(UnreadableFile, match="NumPy cannot read it"):
        list(iterate_profiles(tmp_path / "a.npy"))
    with pytest.raises(UnreadableFile, match="no such file"):
        list(iterate_profiles(tmp_path / "none.npy"))


@pytest.mark.parametrize("at_once", [2, 100])
def test_a_file_whose_points_are_all_lost_is_an_error(tmp_path, at_once):
    np.save(tmp_path / "a.npy", np.full((3, 40, 2), np.nan))
    with pytest.raises(UnreadableFile, match=r"a\.npy: all .*are lost: check exposure"):
        list(iterate_profiles(tmp_path / "a.npy", at_once=at_once))


@pytest.mark.parametrize("columns", [1, 2, 3])
def test_an_array_of_few_columns_is_one_chunk(tmp_path, columns):
    path = tmp_path / "a.npy"
    np.save(
        path,
        np.column_stack([np.arange(9.0), np.zeros(9), -400 - np.arange(9.0) ** 2 / 9])[
            :, 3 - columns :
        ],
    )
    spacing = {"dx": 0.5} if columns == 1 else {}
    (chunk,) = iterate_profiles(path, at_once=2, **spacing)
    assert chunk.file.profiles == inspect_profiles(path, **spacing).profiles
    if not spacing:  # the array has x
        with pytest.raises(UnreadableFile, match="--dx is for heights without x"):
            list(iterate_profiles(path, at_once=2, dx=0.5))


def test_columns_that_the_user_names_make_an_array_one_chunk(tmp_path):
    np.save(tmp_path / "a.npy", np.random.default_rng(1).normal(size=(9, 30)))
    (chunk,) = iterate_profiles(tmp_path / "a.npy", at_once=2, columns=(0, 2))
    assert [len(profile) for profile in chunk.file.profiles] == [9]
    with pytest.raises(UnreadableFile, match="--dx is for heights without x"):
        list(iterate_profiles(tmp_path / "a.npy", at_once=2, dx=0.5, columns=(0, 2)))


def test_a_file_without_profiles_is_reported_as_when_read_whole(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((0, 40, 2)))
    lists = pa.array([], pa.list_(pa.float64()))
    pq.write_table(pa.table({"x": lists, "z": lists}), tmp_path / "a.parquet")
    for name in ("a.npy", "a.parquet"):
        with pytest.raises(UnreadableFile) as whole:
            inspect_profiles(tmp_path / name)
        with pytest.raises(UnreadableFile) as in_chunks:
            list(iterate_profiles(tmp_path / name))
        assert str(in_chunks.value) == str(whole.value)
        if name == "a.parquet":
            assert "a.parquet: the table has no row, so no profile: export it" in str(whole.value)


def test_two_columns_of_one_name_are_rejected(tmp_path):
    lists, numbers = pa.array([[1.0, 2.0]]), pa.array([7])
    names = ["x", "z", "id", "id"]
    pq.write_table(
        pa.Table.from_arrays([lists, lists, numbers, numbers], names), tmp_path / "a.parquet"
    )
    with pytest.raises(UnreadableFile, match="got several 'id': rename them"):
        list(iterate_profiles(tmp_path / "a.parquet"))


def test_a_chunk_of_no_profile_is_a_slip_of_the_caller(tmp_path):
    with pytest.raises(ValueError, match="expected at_once of at least 1, got 0"):
        list(iterate_profiles(tmp_path / "a.npy", at_once=0))


def test_attributes_of_chunks_are_those_of_the_whole_array(tmp_path):
    cube = np.zeros((5, 9, 3))
    cube[:, :, 0], cube[:, :, 1] = np.arange(9.0), np.arange(5.0)[:, np.newaxis]
    cube[:, :, 2] = -400 - cube[:, :, 0] ** 2 / 9
    np.save(tmp_path / "a.npy", cube)
    whole = inspect_profiles(tmp_path / "a.npy").attributes
    chunks = iterate_profiles(tmp_path / "a.npy", at_once=2)
    assert [row for chunk in chunks for row in chunk.file.attributes] == list(whole)
    assert list(whole) == [{"y": float(y)} for y in range(5)]


@pytest.mark.parametrize("at_once", [1, 2, 100])
def test_columns_of_any_type_come_along_and_those_of_points_are_named(tmp_path, at_once):
    names = write_nested(tmp_path / "a.parquet")
    chunks = list(iterate_profiles(tmp_path / "a.parquet", at_once=at_once))
    columns = pa.concat_tables([chunk.columns for chunk in chunks])
    assert columns.to_pylist() == pq.read_table(tmp_path / "a.parquet", columns=names).to_pylist()
    assert {chunk.point_columns for chunk in chunks} == {("intensity",)}


def test_a_column_of_points_in_the_first_chunk_remains_one(tmp_path):
    points = np.column_stack([np.arange(9.0), -400 - np.arange(9.0)])
    table = pa.table(
        {
            "x": [points[:, 0]] * 3,
            "z": [points[:, 1]] * 3,
            "a": [list(range(9)), [1], None],
            "b": pa.array([None, list(range(9)), [1]]),
        }
    )
    pq.write_table(table, tmp_path / "a.parquet")
    chunks = list(iterate_profiles(tmp_path / "a.parquet", at_once=1))
    assert {(chunk.point_columns, *chunk.columns.column_names) for chunk in chunks} == {
        (("a",), "b")
    }
