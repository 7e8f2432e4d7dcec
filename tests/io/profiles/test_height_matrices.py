"""Matrices of heights, one profile per row, in every container, and long tables in Parquet."""

import io

import cv2
import numpy as np
import numpy.testing as npt
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import ReadSettings, inspect_profiles, read_profiles

X = -15 + 0.1 * np.arange(300)
HEIGHTS = np.stack([-150 + np.sqrt(np.maximum(225 - X**2, 0)) - k for k in range(3)]).round(3)
HEIGHTS[:, ::7] = np.nan


def saved(save, *args, **named):
    stream = io.BytesIO()
    save(stream, *args, **named)
    return stream.getvalue()


def tiff(image):
    done, data = cv2.imencode(".tiff", image)
    assert done
    return data.tobytes()


def counts(kind, lost, scale=0.005, offset=0.0):
    values = np.where(np.isnan(HEIGHTS), lost, np.round((HEIGHTS - offset) / scale))
    return values.astype(kind)


TEXT = "\n".join(",".join("" if np.isnan(v) else f"{v}" for v in row) for row in HEIGHTS)
MATRICES = {
    "npy": (saved(np.save, HEIGHTS), {}),
    "npy single precision": (saved(np.save, HEIGHTS.astype("f4")), {}),
    "npy counts": (saved(np.save, counts("i4", -(2**31))), {"z_unit": "5um"}),
    "npy 16 bit": (saved(np.save, counts("i2", -(2**15))), {"z_unit": "0.005mm"}),
    "npz with unit": (saved(np.savez, HEIGHTS * 1000, unit="um"), {}),
    "csv": (TEXT, {}),
    "csv in um": ("# unit: um\n" + TEXT.replace(".", "").replace("-", "-"), {}),
    "csv with a header": (",".join(f"c{k}" for k in range(300)) + "\n" + TEXT, {}),
    "tiff float": (tiff(HEIGHTS.astype("f4")), {}),
    "tiff float, lost": (tiff(np.nan_to_num(HEIGHTS, nan=-9999).astype("f4")), {}),
    "keyence number": (saved(np.save, counts("i4", -(2**31))), {"z_unit": 500}),
}


@pytest.mark.parametrize("name", [name for name in MATRICES if name != "csv in um"])
def test_rows_of_heights_are_profiles(write, name):
    content, options = MATRICES[name]
    file = inspect_profiles(write(content, "heights"), x0=-15, dx=0.1, **options)
    assert len(file.profiles) == 3
    for profile, row in zip(file.profiles, HEIGHTS, strict=True):
        lost = np.isnan(row)
        npt.assert_array_equal(np.isnan(profile.points[:, 0]), lost)
        npt.assert_allclose(profile.points[~lost], np.column_stack([X, row])[~lost], atol=3e-3)


@pytest.mark.parametrize("before", [[], ["Nr"], ["Time [s]"], ["Nr", "Time"]])
def test_columns_before_the_heights_are_no_heights(write, before):
    cells = {"Nr": "7", "Time [s]": "0.5", "Time": "12:00:07"}
    rows = [[cells[name] for name in before] + [f"{v}" for v in row] for row in HEIGHTS]
    names = [*before, *(f"Z_{k} [mm]" for k in range(300))]
    text = "\n".join(map(";".join, [names, *rows])).replace("nan", "ERR")
    file = inspect_profiles(write(text, "p.csv"), x0=-15, dx=0.1)
    npt.assert_allclose(file.profiles[1].points[1], [X[1], HEIGHTS[1, 1]])
    assert [len(profile) for profile in file.profiles] == [300] * 3
    assert any("left out" in note for note in file.notes) == bool(before)
    if before == []:
        text = "\n".join(f"12:00:0{k};{line}" for k, line in enumerate(text.splitlines()[1:]))
        file = inspect_profiles(write(text, "times.csv"), x0=-15, dx=0.1)
        npt.assert_allclose(file.profiles[1].points[1], [X[1], HEIGHTS[1, 1]])


@pytest.mark.parametrize("kind", ["u2", "i2"])
def test_counts_in_a_tiff_need_their_size(write, kind):
    raised = 0.0 if kind == "i2" else -200.0
    lost = 0 if kind == "u2" else -(2**15)
    image = counts(kind, lost, offset=raised)
    path = write(tiff(image) if kind == "u2" else saved(np.save, image), "map.tif")
    if kind == "u2":
        with pytest.raises(UnreadableFile, match=r"--z-unit 0\.5um or --units um"):
            inspect_profiles(path, dx=0.1)
    file = inspect_profiles(path, x0=-15, dx=0.1, z_unit="5um")
    assert file.lost == np.isnan(HEIGHTS).sum()
    assert not file.units_assumed
    npt.assert_allclose(
        np.nanmax(file.profiles[1].points[:, 1]), np.nanmax(HEIGHTS[1]) - raised, atol=3e-3
    )


def test_a_height_map_of_too_many_pixels_is_rejected_before_it_is_unpacked(write):
    content = bytearray(cv2.imencode(".png", np.zeros((4, 4), np.uint16))[1].tobytes())
    content[16:24] = (1_000_000).to_bytes(4, "big") * 2
    with pytest.raises(UnreadableFile, match="at most 100 megapixels, got 1000000 x 1000000 px"):
        read_profiles(write(bytes(content), "m.png"), dx=0.1, z_unit="1um")


def test_an_image_of_colours_is_no_height_map(write):
    for image in (np.zeros((4, 4), "u1"), np.zeros((4, 4, 3), "u2")):
        with pytest.raises(UnreadableFile, match="no height map"):
            inspect_profiles(write(tiff(image)), dx=0.1, z_unit="um")
    with pytest.raises(UnreadableFile, match="cannot decode"):
        inspect_profiles(write(b"II*\0rubbish"), dx=0.1)


def test_transposed_arrays_are_read(write):
    path = write(saved(np.save, HEIGHTS.T), "heights")
    profiles = read_profiles(path, x0=-15, dx=0.1, transpose=True)
    npt.assert_allclose(profiles[2].points[1], [X[1], HEIGHTS[2, 1]])


def test_a_wrong_size_of_a_count_is_rejected():
    assert ReadSettings(z_unit="0.4 um").height_scale == pytest.approx(4e-4)
    assert ReadSettings(z_unit=40).height_scale == pytest.approx(4e-4)
    with pytest.raises(ValueError, match=r"expected z_unit as a number of 0\.01 um or as a length"):
        ReadSettings(z_unit="px")
    with pytest.raises(ValueError, match="expected a finite dx"):
        ReadSettings(dx=float("nan"))


def parquet(table):
    return saved(lambda stream: pq.write_table(table, stream))


def test_a_long_table_in_parquet_is_as_many_profiles(write, arc):
    three = [arc - [0, k] for k in range(3)]
    table = pa.table({
        "Profile_ID": np.repeat(["a", "b", "a2"], 80).tolist(),
        "part": np.repeat(["P1", "P1", "P2"], 80).tolist(),
        "encoder_counts": np.repeat([10, 20, 30], 80),
        "X_mm": np.concatenate(three)[:, 0],
        "Z_um": 1000 * np.concatenate(three)[:, 1],
        "grey": np.arange(240),
    })  # fmt: skip
    file = inspect_profiles(write(parquet(table)))
    assert len(file.profiles) == 3
    npt.assert_allclose(file.profiles[2].points, three[2])
    assert file.attributes[2]["part"] == "P2"
    assert file.ignored == ("grey",)


def test_a_profile_a_row_in_parquet_keeps_its_other_columns(write, arc):
    table = pa.table({
        "part": ["P1", "P2"], "encoder": [1.5, 2.5],
        "x": [arc[:, 0]] * 2, "z": [arc[:, 1], arc[:, 1] - 1],
    })  # fmt: skip
    file = inspect_profiles(write(parquet(table)))
    assert file.attributes[1] == {"part": "P2", "encoder": 2.5}


def test_units_in_the_metadata_of_parquet_count(write, arc):
    table = pa.table({"x": arc[:, 0] * 1000, "z": arc[:, 1] * 1000})
    whole = table.replace_schema_metadata({"unit": "um"})
    field = pa.field("x", pa.float64(), metadata={"unit": "um"})
    columns = table.cast(pa.schema([field, field.with_name("z")]))
    for stated in (whole, columns):
        file = inspect_profiles(write(parquet(stated)))
        npt.assert_allclose(file.profiles[0].points, arc)
        assert not file.units_assumed


def test_a_column_of_another_length_than_the_profiles_is_reported_as_ignored(tmp_path):
    path = tmp_path / "profiles.npz"
    heights = np.arange(18.0).reshape(3, 6) % 5 - 100
    np.savez(path, x=np.arange(6.0), z=heights, exposure=np.arange(3.0), scale=np.arange(4.0))
    file = inspect_profiles(path)
    assert [attributes["exposure"] for attributes in file.attributes] == [0.0, 1.0, 2.0]
    assert file.ignored == ("scale",)


@pytest.mark.parametrize("columns", [5, 10, 20])
def test_few_columns_are_heights_if_their_spacing_is_given(write, columns):
    rows = HEIGHTS[:, 1:columns].copy()
    rows[:, 6:7] = -140.0
    text = "\n".join(",".join(map(str, row)) for row in rows)
    for content in (text, saved(np.save, rows)):
        profiles = read_profiles(write(content), x0=0.5, dx=0.1)
        assert [len(profile) for profile in profiles] == [columns - 1] * 3
        npt.assert_array_equal(profiles[1].points[:, 1], rows[1])


def test_the_size_of_a_count_is_that_of_heights_below_a_row_of_x(write):
    counts_of_profile = np.random.default_rng(2).integers(-9000, -8000, (3, 40))
    table = np.vstack([0.5 * np.arange(40), counts_of_profile])
    text = "\n".join(",".join(map(str, row)) for row in table)
    (first, *_) = read_profiles(write(text), z_unit="10um")
    npt.assert_allclose(first.points, np.column_stack([table[0], 0.01 * table[1]]), rtol=1e-12)


@pytest.mark.parametrize("line", ["# " + "word " * 30, "word " * 30])
def test_a_line_of_many_words_above_points_makes_no_matrix(write, line):
    file = inspect_profiles(write(f"{line}\n0,-400\n1,-399\n"))
    npt.assert_array_equal(file.profiles[0].points, [[0, -400], [1, -399]])
    assert file.reader == "text"


def test_a_wide_table_with_x_and_z_in_its_header_has_one_point_per_line(write):
    names = ["x", "z", *(f"c{k}" for k in range(25))]
    rows = np.random.default_rng(3).normal(size=(6, 27)).round(3)
    text = "\n".join([",".join(names), *(",".join(map(str, row)) for row in rows)])
    file = inspect_profiles(write(text))
    npt.assert_array_equal(file.profiles[0].points, rows[:, :2])
    assert file.ignored == tuple(names[2:])


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("beside_rows", [False, True])
def test_numbers_of_columns_above_heights_are_no_profile(write, start, beside_rows):
    rows = [[*range(start, start + 300)], *HEIGHTS.tolist()]
    if beside_rows:
        rows = [[cell, *row] for cell, row in zip(["", 0, 1, 2], rows, strict=True)]
    path = write("\n".join(",".join(map(str, row)) for row in rows))
    file = inspect_profiles(path, x0=-15, dx=0.1)
    assert len(file.profiles) == 3
    assert any("numbers the columns: left out" in note for note in file.notes)
    npt.assert_allclose(file.profiles[0].points[:, 1], HEIGHTS[0])
    npt.assert_allclose(file.profiles[0].points[[1, -1], 0], [-14.9, 14.9])
    with pytest.raises(UnreadableFile, match="without x" if beside_rows else "or is x in mm"):
        read_profiles(path)


def test_numbers_of_transposed_columns_are_no_points(write):
    text = "\n".join(",".join(map(str, row)) for row in [[0, 1, 2], *HEIGHTS.T.tolist()])
    profiles = read_profiles(write(text), transpose=True, x0=-15, dx=0.1)
    npt.assert_array_equal([profile.points[:, 1] for profile in profiles], HEIGHTS)


RANGES = np.nan_to_num(-HEIGHTS[:, 1:40:2], nan=140.25)
RANGE_FILES = {
    "numbered columns": "".join(f"range_{k}," for k in range(20)).strip(",")
    + "".join("\n" + ",".join(map(str, row)) for row in RANGES),
    "one column": "Distance [mm]\n" + "\n".join(map(str, RANGES[0])),
    "json": f'{{"ranges": {RANGES.tolist()}}}',
    "json in um": f'{{"range_um": {(1000 * RANGES).tolist()}}}',
    "yaml": f"range_mm: {RANGES[0].tolist()}",
    "npz": saved(np.savez, **{"range_um": 1000 * RANGES}),
}


@pytest.mark.parametrize("name", RANGE_FILES)
def test_rows_of_ranges_are_turned(write, name):
    suffix = name.split()[0] if name[0] in "jyn" else "csv"
    file = inspect_profiles(write(RANGE_FILES[name], f"ranges.{suffix}"), x0=-15, dx=0.2)
    assert file.flipped
    npt.assert_allclose(file.profiles[0].points[:, 1], -RANGES[0])


def test_thousands_separators_among_heights_are_rejected(write):
    rows = [";".join(map(str, row)) for row in RANGES]
    rows[1] = rows[1].replace(";140.25;", ";1,140.25;", 1)
    with pytest.raises(UnreadableFile, match=r"line 2: .* has a thousands separator"):
        read_profiles(write("\n".join(rows)), dx=0.2)


def test_a_row_of_x_and_its_spacing_contradict_each_other(write):
    path = write("\n".join(",".join(map(str, row)) for row in [X.round(3), *HEIGHTS]))
    npt.assert_allclose(read_profiles(path)[0].points[1], (X[1], HEIGHTS[0, 1]))
    with pytest.raises(UnreadableFile, match="the first row is evenly spaced, as x: leave --dx"):
        read_profiles(path, dx=0.1)


@pytest.mark.parametrize("columns", [{}, {"index": np.arange(20)}])
def test_one_column_of_heights_in_parquet_needs_its_spacing(write, columns):
    path = write(parquet(pa.table({**columns, "range_um": 1000 * RANGES[0]})))
    with pytest.raises(UnreadableFile, match="--x0 and --dx"):
        read_profiles(path)
    (profile,) = read_profiles(path, x0=-15, dx=0.2)
    npt.assert_allclose(profile.points[1], (-14.8, -RANGES[0, 1]))


def rows_of_heights():
    x = np.linspace(-10, 10, 41)
    noise = np.random.default_rng(3).normal(0, 0.02, (4, 41))
    return x, np.sqrt(400 - x**2) - 220 + noise


@pytest.mark.parametrize(
    "first",
    [
        [["1"], ["2"], ["3"], ["4"]],
        [["0", "12.5"], ["1", "15"], ["2", "17.5"], ["3", "20"]],
        [["1700000000.5"], ["1700000001.25"], ["1700000002.5"], ["1700000003.5"]],
        [["41"]] * 4,
    ],
    ids=["numbers", "numbers and places", "times", "counts"],
)
def test_numbers_of_rows_are_no_heights(tmp_path, first):
    x, heights = rows_of_heights()
    path = tmp_path / "matrix.csv"
    lines = [",".join([*a, *(f"{z:.4f}" for z in b)]) for a, b in zip(first, heights, strict=True)]
    path.write_text("\n".join(lines))
    file = inspect_profiles(path, x0=-10.0, dx=0.5)
    np.testing.assert_allclose(file.profiles[2].points, np.column_stack([x, heights[2]]), atol=1e-4)
    assert any("beside the heights left out" in note for note in file.notes)


@pytest.mark.parametrize("corner", ["", "0"])
def test_places_of_rows_beside_a_row_of_x_are_left_out(tmp_path, corner):
    x, heights = rows_of_heights()
    path = tmp_path / "matrix.csv"
    rows = [[f"{2 * k + 1}", *(f"{z:.4f}" for z in row)] for k, row in enumerate(heights)]
    path.write_text("\n".join(map(",".join, [[corner, *(f"{a:.3f}" for a in x)], *rows])))
    points = inspect_profiles(path).profiles[3].points
    np.testing.assert_allclose(points, np.column_stack([x, heights[3]]), atol=1e-4)


def test_a_row_of_x_from_0_and_lost_edges_are_kept(tmp_path):
    x, heights = rows_of_heights()
    heights[:, 0] = -999
    path = tmp_path / "matrix.csv"
    np.savetxt(path, np.vstack([x + 10, heights]), fmt="%.4f", delimiter=",")
    file = inspect_profiles(path)
    assert [len(profile) for profile in file.profiles] == [41] * 4
    assert file.lost == 4
