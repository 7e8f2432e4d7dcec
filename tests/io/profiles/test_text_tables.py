"""Tables as programs write them: quotes, words, counts, comments, footers, line ends."""

import numpy as np
import numpy.testing as npt
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles, read_profile
from lsvision.io.profiles.text_table import parse_table

LINE_ENDS = ["\n", "\r\n", "\r", "\v", "\f", "\u2028", "\u2029", "\x85"]


def lines_of(points, form="{x:.3f},{z:.3f}", comma=False):
    lines = [form.format(x=x, z=z, i=i) for i, (x, z) in enumerate(points.tolist())]
    return [line.replace(".", ",") for line in lines] if comma else lines


def assert_reads(write, lines, arc, **options):
    path = write("\n".join(lines) + "\n", "p.csv")
    npt.assert_array_equal(read_profile(path, **options).points, arc)


@pytest.mark.parametrize("end", LINE_ENDS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32"])
def test_every_line_end_and_encoding_reads_alike(write, arc, end, encoding):
    text = end.join(["x,z", *lines_of(arc)]) + end
    npt.assert_array_equal(read_profile(write(text.encode(encoding), "p.csv")).points, arc)


@pytest.mark.parametrize("separator", [",", ";", "\t", "|", " "])
@pytest.mark.parametrize("comma", [False, True])
@pytest.mark.parametrize("head", [[], ['"X"{0}"Z"'], ["X [mm]{0}Z [mm]"]])
def test_quoted_cells_hold_decimal_commas(write, arc, separator, comma, head):
    lines = lines_of(arc, f'"{{x:.3f}}"{separator}"{{z:.3f}}"')
    lines = [line.replace(".", ",") for line in lines] if comma else lines
    assert_reads(write, [*(line.format(separator) for line in head), *lines], arc)


@pytest.mark.parametrize(
    ("head", "form"),
    [
        ("time,x,z", "10:11:12,{x:.3f},{z:.3f}"),
        ("x,z,status", "{x:.3f},{z:.3f},OK"),
        ("x;label;z", "{x:.3f};edge;{z:.3f}"),
        ("date;time;x;z", "26.11.2026;10:11:12.5;{x:.3f};{z:.3f}"),
        ("x\tz\tnote", "{x:.3f}\t{z:.3f}\ta b c"),
        ("x|z|note", "{x:.3f}|{z:.3f}|ok"),
        ("time x z", "10:11:12 {x:.3f} {z:.3f}"),
        ("part,x,z", '"A, left",{x:.3f},{z:.3f}'),
        ("x,z,hash", "{x:.3f},{z:.3f},0x1F"),
        ("", "{x:.3f},{z:.3f},OK"),
        ("", "A7 {x:.3f} {z:.3f}"),
    ],
)
def test_words_beside_the_numbers_are_passed_over(write, arc, head, form):
    lines = ([head] if head else []) + lines_of(arc, form)
    assert_reads(write, lines, arc)
    if head:
        assert_reads(write, lines, arc, columns="x,z")
    assert_reads(
        write,
        lines,
        arc,
        columns=[
            c
            for c, w in enumerate(
                lines[-1].split(next(mark for mark in ("|", ";", "\t", ",", " ") if mark in form))
            )
            if _is_number(w)
        ][:2]
        if '"' not in form
        else (1, 2),
    )


def _is_number(word):
    try:
        float(word)
    except ValueError:
        return False
    return True


def test_a_status_in_few_rows_is_a_word_beside_the_numbers(write, arc):
    lines = lines_of(arc, "{x:.3f},{z:.3f},")
    lines[7] += "low"
    assert_reads(write, ["x,z,status", *lines], arc)
    assert_reads(write, lines, arc)


def test_words_are_read_with_decimal_commas(write, arc):
    lines = lines_of(arc, "{x:.3f};ok;{z:.3f}", comma=True)
    assert_reads(write, ["x;s;z", *lines], arc)


@pytest.mark.parametrize(
    "head",
    [
        ["80"],
        ["//X Y Z", "80"],
        ["80", "//X Y Z"],
        ["# made by", "", "80", "# x y z"],
        ["% 3 columns", "80 3", "x y z"],
        ["! remark", "sensor LPS 36", "serial 17", "80"],
    ],
)
def test_counts_and_comments_stand_in_any_order(write, arc, head):
    assert_reads(write, [*head, *lines_of(arc, "{x:.3f} 0 {z:.3f}")], arc)


@pytest.mark.parametrize(
    "footer",
    [
        ["END"],
        ["", "Total: 80 points"],
        ["# 80 points"],
        ["80"],
        ["mean;-145,2;rms;0,02"],
        ["Average,-145.2"],
        ["---- end of profile ----", "checksum A1B2", ""],
        ["\x1a"],
    ],
)
@pytest.mark.parametrize("head", [[], ["x,z"]])
def test_a_footer_is_reported_and_left_out(write, arc, head, footer):
    path = write("\n".join([*head, *lines_of(arc), *footer]), "p.csv")
    file = inspect_profiles(path)
    npt.assert_array_equal(file.profiles[0].points, arc)
    left_out = [line for line in footer if line.strip("\x1a \n") and line[0] != "#"]
    assert any("after the numbers left out" in note for note in file.notes) == bool(left_out)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (['"1,234.5";"-2,001.0"', '"1,235.5";"-2,002.0"'], "'1,234.5' has a thousands separator"),
        (["1.234,5;-2.001,0", "1.235,5;-2.002,0"], "'1.234,5' has a thousands separator"),
        (["1'234.5;-2'001", "1'235.5;-2'002"], "has a thousands separator"),
        (["1 234,5;-2 001,0", "1 235,5;-2 002,0"], "has a thousands separator"),
        (["1\u202f234,5;-2\u202f001,0", "1\u202f235,5;-2\u202f002,0"], "thousands separator"),
        (["1,234,567;-2", "1,234,568;-3"], "has a thousands separator"),
        (["x,z", '"999","-1,001"', *(f'"1,{k}","-2,{k}"' for k in range(100, 110))], "thousands"),
        (["1_000,2", "1_001,3"], "thousands"),
        (["x;z", *(f"{x:,};{x}".replace(",", ".") for x in range(-1200, 1300, 100))], "thousands"),
        ([f"{x:,}\t{2 * x}".replace(",", ".") for x in range(-1200, 1300, 100)], "'-1.000' may be"),
    ],
)
def test_thousands_separators_are_rejected_by_name(write, lines, message):
    with pytest.raises(UnreadableFile, match=message):
        read_profile(write("\n".join(lines) + "\n"))


def test_numbers_that_commas_cut_are_rejected(write, arc):
    for head in ([], ["x,z"]):
        lines = [*head, *lines_of(arc, "{x:.3f};{z:.3f}", comma=True)]
        with pytest.raises(UnreadableFile, match="split at their commas"):
            read_profile(write("\n".join(line.replace(";", ",") for line in lines), "p.csv"))


@pytest.mark.parametrize("head", [["z [mm]"], ["Range"]])
def test_one_column_of_decimal_commas_is_no_x_and_height(write, arc, head):
    heights = lines_of(arc, "{z:.3f}", comma=True)
    with pytest.raises(UnreadableFile, match="split at their commas"):
        read_profile(write("\n".join([*head, *heights]), "p.csv"))
    with pytest.raises(UnreadableFile, match=r"2 columns, but --dx .* decimals with a point"):
        read_profile(write("\n".join(heights), "p.csv"), x0=0.0, dx=0.1)


@pytest.mark.parametrize("lost", ["0", "-999"])
def test_three_decimals_beside_a_marker_of_lost_points_are_no_thousands(write, arc, lost):
    lines = [f"{20 + k / 1000:.3f};{z:.3f}" for k, z in enumerate(arc[:, 1])]
    lines[5] = f"20.005;{lost}"
    assert read_profile(write("\n".join(lines), "p.csv")).points[0, 0] == 20.0


@pytest.mark.parametrize("form", ["{x:.3f},{z:.3f}", "{x:.3f};0.5;{z:.3f}"])
def test_numbers_of_columns_are_no_point(write, arc, form):
    mark = ";" if ";" in form else ","
    head = mark.join(map(str, range(form.count(mark) + 1)))
    assert_reads(write, [head, *lines_of(arc, form)], arc)
    path = write("0,1\n1,1\n2,1.5\n3,2\n", "p.csv")  # a point
    assert len(read_profile(path)) == 4


def test_columns_are_effective_in_a_wide_table(write, arc):
    rows = np.column_stack([np.random.default_rng(1).normal(0, 1, (80, 30)), arc])
    lines = [",".join(f"{v:.3f}" for v in row) for row in rows]
    assert_reads(write, lines, arc, columns=(30, 31))
    head = ",".join([f"c{k}" for k in range(30)] + ["X [mm]", "Z [mm]"])
    for columns in ("x,z", "X [mm],Z [mm]", (30, 31)):
        assert_reads(write, [head, *lines], arc, columns=columns)


def test_a_column_of_words_that_is_asked_for_is_rejected(write, arc):
    path = write("\n".join(["time,x,z", *lines_of(arc, "10:11:12,{x},{z}")]))
    with pytest.raises(UnreadableFile, match="line 2: column time holds text: '10:11:12'"):
        read_profile(path, columns="time,z")


def test_columns_that_are_not_used_are_named(write, arc):
    file = inspect_profiles(
        write("\n".join(["i,x,z,grey", *lines_of(arc, "{i},{x:.3f},{z:.3f},{i}")]))
    )
    assert file.ignored == ("i", "grey")


def long_table(arc, ids, form, head, shuffled=False):
    rows = [
        form.format(id=name, k=k, x=x, z=z - k)
        for k, name in enumerate(ids)
        for x, z in arc.tolist()
    ]
    if shuffled:
        rows = [rows[i * 80 + j] for j in range(80) for i in range(len(ids))]
    return "\n".join([head, *rows]) + "\n"


@pytest.mark.parametrize(
    "name", ["scan", "profile_id", "ProfileID", "frame", "Frame No", "profile_number", "scan_id"]
)
@pytest.mark.parametrize("ids", [["7", "3", "12"], ["P1", "P0", "Q"], ["1.0", "2.0", "3.0"]])
@pytest.mark.parametrize("shuffled", [False, True])
def test_a_long_table_is_as_many_profiles(write, arc, name, ids, shuffled):
    text = long_table(
        arc, ids, "{id};{x:.3f};{z:.3f};part {k};{k}.5", f"{name};x;z;part;encoder", shuffled
    )
    file = inspect_profiles(write(text, "p.csv"))
    assert len(file.profiles) == 3
    for k, profile in enumerate(file.profiles):
        npt.assert_allclose(profile.points, arc - [0, k])
        assert file.attributes[k]["part"] == f"part {k}"
        assert file.attributes[k]["encoder"] == k + 0.5


def test_numbers_that_begin_anew_with_each_part_are_parted_by_it(write, arc):
    parts = [long_table(arc - [0, 10 * p], ["0", "1"], f"{p},{{id}},{{x:.3f}},{{z:.3f}}", "")
             for p in range(2)]  # fmt: skip
    file = inspect_profiles(write("part,scan,x,z\n" + "".join(p.lstrip("\n") for p in parts)))
    assert len(file.profiles) == 4
    assert [(a["part"], a["scan"]) for a in file.attributes] == [(0, 0), (0, 1), (1, 0), (1, 1)]


def test_a_running_number_of_points_parts_nothing(write, arc):
    lines = ["frame,x,z", *lines_of(arc, "{i},{x:.3f},{z:.3f}")]
    assert_reads(write, lines, arc)


@pytest.mark.parametrize("restarts", [False, True])
def test_numbers_of_points_beside_those_of_profiles_part_nothing(write, arc, restarts):
    rows = [f"{k},{i + (0 if restarts else k * len(arc))},{x:.3f},{z:.3f}"
            for k in range(2) for i, (x, z) in enumerate(arc.tolist())]  # fmt: skip
    file = inspect_profiles(write("\n".join(["profile,measurement,x,z", *rows])))
    assert [len(profile) for profile in file.profiles] == [len(arc)] * 2


def heights(rows=60, columns=400):
    x = np.linspace(-30, 30, columns)
    return x, np.stack([-150 + np.sqrt(np.maximum(400 - x**2, 0)) - k / 100 for k in range(rows)])


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_profiles_in_columns_are_hinted_at_and_transposed(write, separator):
    x, matrix = heights()
    text = "\n".join(separator.join(f"{v:.4f}" for v in row) for row in matrix.T)
    path = write(text)
    with pytest.raises(UnreadableFile, match=r"60 columns of 400.*--transpose"):
        inspect_profiles(path)
    wrong = inspect_profiles(path, x0=0, dx=1)
    assert any("--transpose" in note for note in wrong.notes)
    file = inspect_profiles(path, transpose=True, x0=-30, dx=x[1] - x[0])
    assert len(file.profiles) == 60
    npt.assert_allclose(file.profiles[3].points, np.column_stack([x, matrix[3]]), atol=1e-4)


def test_the_first_column_of_profiles_in_columns_can_be_x(write):
    x, matrix = heights()
    rows = np.column_stack([x, matrix.T])
    text = "\n".join(",".join(f"{v:.4f}" for v in row) for row in rows)
    for head in ("", ",".join(["x", *(f"p{k}" for k in range(60))]) + "\n"):
        file = inspect_profiles(write(head + text), transpose=True)
        npt.assert_allclose(file.profiles[3].points, np.column_stack([x, matrix[3]]), atol=1e-4)


def test_profiles_one_after_the_other_are_noted(write, arc):
    rising = arc[np.argsort(arc[:, 0])]
    text = "\n".join([*lines_of(rising), "", "", *lines_of(rising)])
    assert any("x starts again 1 times" in note for note in inspect_profiles(write(text)).notes)
    shuffled = np.random.default_rng(2).permutation(arc)
    assert inspect_profiles(write("\n".join(["x [mm],z [mm]", *lines_of(shuffled)]))).notes == ()


def test_profiles_measured_back_and_forth_are_noted(write, arc):
    rising = arc[np.argsort(arc[:, 0])]
    for parts, is_noted in ((2, False), (3, True)):
        lines = [line for part in range(parts) for line in lines_of(rising[:: (-1) ** part])]
        notes = inspect_profiles(write("\n".join(lines))).notes
        assert any("x goes back and forth, 3 times" in note for note in notes) == is_noted


@pytest.mark.parametrize("head", [["80 2"], ["2 80", "x z"]])
def test_the_size_of_the_table_is_no_point(write, arc, head):
    assert_reads(write, [*head, *lines_of(arc, "{x:.3f} {z:.3f}")], arc)


def test_an_empty_first_column_and_typeset_minus_signs_are_read(write, arc):
    assert_reads(write, lines_of(arc, ",{x:.3f},{z:.3f}"), arc)
    assert_reads(write, [line.replace("-", "−") for line in lines_of(arc)], arc)


def test_a_column_of_parts_alone_separates_profiles(tmp_path):
    rows = [f"{part},{x},{-400 + 0.1 * x * x}" for part in ("A7", "B2") for x in range(12)]
    path = tmp_path / "parts.csv"
    path.write_text("\n".join(["part_id,x,z", *rows]))
    file = inspect_profiles(path)
    assert [len(profile) for profile in file.profiles] == [12, 12]
    assert [attributes["part_id"] for attributes in file.attributes] == ["A7", "B2"]


@pytest.mark.parametrize("word", ["#N/A", "####"])
def test_a_row_that_begins_with_a_lost_point_is_no_comment(word):
    values = parse_table(f"x,z,i\n1,2,3\n{word},4,5\n6,7,8\n").values
    npt.assert_array_equal(values, [[1, 2, 3], [np.nan, 4, 5], [6, 7, 8]])


def test_an_indented_comment_among_cells_between_tabs_is_a_comment():
    table = parse_table("x\tz\n1\t2\n\t# pause\n\t#N/A\n3\t4\n")
    npt.assert_array_equal(table.values, [[1, 2], [np.nan, np.nan], [3, 4]])
    assert not table.invalid_cells


@pytest.mark.parametrize("form", ["{x:.1f},{z:.1f}", "{x:.1f},0.0,{z:.1f}", "{x:.1f}, {z:.1f}"])
def test_one_decimal_behind_a_comma_is_no_column(write, arc, form):
    with pytest.raises(UnreadableFile, match=r"split at their commas.*or name the columns"):
        read_profile(write("\n".join(lines_of(arc, form, comma=True))))


@pytest.mark.parametrize("last", ["1", "{i}"])
def test_whole_numbers_beside_a_flag_or_an_intensity_are_coordinates(write, arc, last):
    whole = (1000 * arc).round()
    lines = lines_of(whole, "{x:.0f},0,{z:.0f}," + last)
    npt.assert_allclose(read_profile(write("\n".join(lines)), units="um").points, arc)


def test_an_encoder_without_a_unit_has_no_positions(write, arc):
    lines = [f"{x},{e},{z}" for e in (100, 200) for x, z in arc.tolist()]
    names = {"encoder": None, "EncoderPos": None, "encoder [um]": (0.1, 0.2), "y": (100, 200)}
    for name, positions in names.items():
        file = inspect_profiles(write("\n".join([f"x [mm],{name},z", *lines])))
        assert file.positions == positions
        assert file.attributes[1] == {name.split()[0].lower(): 200}
        assert any("without a unit of length" in note for note in file.notes) == (not positions)


def test_an_encoder_that_runs_on_within_a_profile_separates_nothing(write, arc):
    lines = lines_of(arc, "{x},{i},{z}")
    assert_reads(write, ["x,encoder,z", *lines], arc)


def test_columns_of_an_unknown_unit_can_be_replaced_by_others(write, arc):
    path = write("\n".join(["x;z_raw;z_filtered", *lines_of(arc, "{x};9;{z}")]))
    with pytest.raises(UnreadableFile, match=r"'raw' is stated.*choose other columns, --columns"):
        read_profile(path)
    npt.assert_array_equal(read_profile(path, columns="x,z_filtered").points, arc)


@pytest.mark.parametrize(
    "head", ["index,z", "Pixel;z", ",z", ",0", "nr height", "column,range", "i;y", "scan,z"]
)
def test_numbers_of_the_points_are_no_x(write, arc, head):
    separator = next(mark for mark in ",; " if mark in head)
    lines = lines_of(arc, "{i}" + separator + "{z}")
    path = write("\n".join([head, *lines]))
    with pytest.raises(UnreadableFile, match=r"numbers the points: .*--x0 and --dx"):
        read_profile(path)
    if head != ",0":
        sign = -1 if "range" in head else 1
        profile = read_profile(path, x0=-5, dx=0.5)
        npt.assert_allclose(profile.points[:3], [[-5 + k / 2, sign * arc[k, 1]] for k in range(3)])


def test_heights_beside_another_quantity_are_no_x(write, arc):
    lines = ["z,intensity", *(f"{z},{k % 7}" for k, z in enumerate(arc[:, 1]))]
    with pytest.raises(UnreadableFile, match="columns z and intensity, and no x"):
        read_profile(write("\n".join(lines)))


def test_dx_is_rejected_beside_x(write, arc):
    with pytest.raises(UnreadableFile, match="--dx is for heights without x"):
        read_profile(write("\n".join(["x,z", *lines_of(arc)])), dx=0.1)


@pytest.mark.parametrize("head", [",0,1", ",x,z", "index,a,b"])
def test_numbers_of_rows_and_columns_are_left_out(write, arc, head):
    assert_reads(write, [head, *lines_of(arc, "{i},{x},{z}")], arc)


@pytest.mark.parametrize("head", ["   1.0e+03 *", "P =\n\n   1.0e+03 *\n"])
def test_numbers_as_matlab_displays_them_are_rejected(write, arc, head):
    lines = lines_of(arc / 1000, "   {x:.4f}   {z:.4f}")
    with pytest.raises(UnreadableFile, match=r"a factor of 1\.0e\+03: write them with writematrix"):
        read_profile(write("\n".join([head, "", *lines]), "p.txt"))


def test_an_encoder_as_x_needs_a_unit(write, arc):
    path = write("\n".join(["encoder,z", *lines_of(arc)]))
    with pytest.raises(UnreadableFile, match="encoder without a unit of length would be x"):
        read_profile(path)
    npt.assert_array_equal(read_profile(path, units="mm").points, arc)
    assert_reads(write, ["encoder_mm,z", *lines_of(arc)], arc)


@pytest.mark.parametrize("name", ["z distance", "Distance_Z [mm]", "Abstand Z", "measured range"])
def test_a_name_that_holds_the_word_of_a_range_is_one(write, arc, name):
    lines = [f"{x};{-z}" for x, z in arc.tolist()]
    assert_reads(write, [f"Pos. X;{name}", *lines], arc)
    assert inspect_profiles(write("\n".join(["x;distance_travelled", *lines]))).flipped is False


@pytest.mark.parametrize(
    ("head", "form"),
    [
        (["| x | z |", "|---|---|"], "| {x:.3f} | {z:.3f} |"),
        (["| x | z |", "|:---|---:|"], "| {x:.3f} | {z:.3f} |"),
        (["  x       z", "------  ------"], "{x:.3f} {z:.3f}"),
        (["x,z", "---,---"], "{x:.3f},{z:.3f}"),
    ],
)
def test_a_rule_below_the_names_is_no_lost_point(write, arc, head, form):
    assert_reads(write, [*head, *lines_of(arc, form)], arc)


def test_a_row_of_dashes_that_is_not_below_the_names_is_a_lost_point(write, arc):
    file = inspect_profiles(write("\n".join(["---,---", "---,---", *lines_of(arc)]), "p.csv"))
    assert file.lost == 2


@pytest.mark.parametrize("first", ["0, -150", "0, nan", "0 ,150", "0, ", "0,"])
@pytest.mark.parametrize("head", [[], ["x, z"]])
def test_a_blank_beside_a_comma_makes_it_no_decimal_mark(write, arc, first, head):
    path = write("\n".join([*head, first, *lines_of(arc, "{x:.3f}, {z:.3f}")]), "p.csv")
    points = read_profile(path).points
    assert len(points) == len(arc) + 1
    npt.assert_array_equal(points[1:], arc)


@pytest.mark.parametrize("form", ["{x:.3f}\t{z:.3f}", "{i}\t{x:.3f}\t{z:.3f}"])
def test_a_first_row_that_is_empty_behind_a_tab_is_a_lost_point(write, arc, form):
    rows = lines_of(arc, form)
    lost = rows[0].partition("\t")[0] + "\t" * rows[0].count("\t")
    assert parse_table("\n".join([lost, *rows])).values.shape == (
        len(arc) + 1,
        1 + form.count("\t"),
    )


def test_one_column_with_a_tab_at_the_end_of_each_line_is_one_column(write, arc):
    path = write("\n".join(lines_of(arc, "{z:.3f}\t")), "p.csv")
    npt.assert_array_equal(read_profile(path, dx=0.5).points[:, 1], arc[:, 1])
