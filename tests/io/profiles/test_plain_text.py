"""Text of one point per line: separators, commas, comments, headers, units, third columns."""

import numpy as np
import numpy.testing as npt
import pytest

from lsvision.io.profiles import inspect_profiles, read_profile, read_profiles

TWO_POINTS = [[1.5, -2.0], [2.5, -3.0]]
NAN = float("nan")


@pytest.mark.parametrize(
    "text",
    [
        "1.5,-2\n2.5,-3\n",
        "1.5, -2\r\n2.5, -3\r\n",
        "1.5;-2\n2.5;-3",
        "1.5\t-2\n2.5\t-3\n",
        "  1.5   -2\n  2.5   -3\n",
        "1,5;-2,0\n2,5;-3,0\n",
        "1,5\t-2\n2,5\t-3\n",
        "1,5 -2\n2,5 -3\n",
        "1.5,-2,\n2.5,-3,\n",
        "1.5e0,-0.2E+1\n25e-1,-3.\n",
        "# a comment\n% another\n// a third\n\n1.5,-2\n# in between\n2.5,-3\n\n",
        "x,z\n1.5,-2\n2.5,-3\n",
        "# x [mm], z [mm]\n1.5,-2\n2.5,-3\n",
        '"X (mm)";"Height (mm)"\n1,5;-2\n2,5;-3\n',
        "z,x\n-2,1.5\n-3,2.5\n",
        "sensor LPS 36\nserial 17\nx z\n1.5 -2\n2.5 -3\n",
        "2\n1.5\t-2\n2.5\t-3\n",
        '"1.5","-2"\n"2.5","-3"\n',
        "\ufeffx,z\n1.5,-2\n2.5,-3\n",
        "x y\n1.5 -2\n2.5 -3\n",
        "y z\n1.5 -2\n2.5 -3\n",
        "index,x,z,intensity\n0,1.5,-2,40\n1,2.5,-3,50\n",
        "x,range\n1.5,2\n2.5,3\n",
        "X;Distance\n1,5;2\n2,5;3\n",
        "x [m], z [m]\n0.0015,-0.002\n0.0025,-0.003\n",
        "X(m) Z(m)\n0.0015 -0.002\n0.0025 -0.003\n",
        "x [mm],z [um]\n1.5,-2000\n2.5,-3000\n",
        "x_mm,range_um\n1.5,2000\n2.5,3000\n",
        "x/cm z/cm\n.15 -.2\n.25 -.3\n",
        "x [µm]\tz [μm]\n1500\t-2000\n2500\t-3000\n",
    ],
)
def test_two_points_are_read_however_they_are_written(write, text):
    npt.assert_allclose(read_profile(write(text)).points, TWO_POINTS, rtol=1e-14)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig", "latin-1"])
def test_an_encoding_does_not_change_a_profile(write, encoding):
    path = write("# Höhe\nx [mm]\tHöhe [mm]\n1.5\t-2\n2.5\t-3\n".encode(encoding))
    npt.assert_array_equal(read_profile(path).points, TWO_POINTS)


@pytest.mark.parametrize("lost", ["nan", "NaN", "", "-", "inf", "-inf", "null", "-99999.9999"])
def test_a_lost_point_keeps_its_row(write, lost):
    path = write(f"x,z\n1,5\n2,{lost}\n3,6\n")
    file = inspect_profiles(path)
    npt.assert_array_equal(file.profiles[0].points, [[1, 5], [NAN, NAN], [3, 6]])
    assert file.lost == 1


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_lost_points_before_the_first_valid_one_keep_their_rows(write, separator):
    rows = ["x,z", ",", "nan,nan", "1,5", "2,6", ",", "3,"]
    path = write("\n".join(rows).replace(",", separator))
    lost = np.isnan(read_profile(path).points[:, 0])
    assert lost.tolist() == [True, True, False, False, True, True]


def test_lines_of_tabs_at_the_end_are_lost_points_beside_a_comment(write):
    assert read_profile(write("x\tz\n1\t5\n# a comment\n2\t6\n\t\n\t\n")).lost == 2


def test_a_long_run_of_lost_points_at_the_start_is_no_preamble(write):
    (profile,) = read_profiles(write("nan,nan\n" * 500 + "1.5,2\n2,2.5\n"))
    assert (len(profile), profile.lost) == (502, 500)


def test_repeated_zero_pairs_are_lost_and_a_single_one_is_a_point(write):
    assert read_profile(write("0,0\n1,5\n0,0\n2,5\n")).lost == 2
    assert read_profile(write("0,0\n1,5\n2,5\n")).lost == 0


def test_unsorted_and_doubled_points_keep_the_order_of_the_file(write):
    rows = [[3.0, 1.0], [1.0, 2.0], [1.0, 2.0], [2.0, 0.0]]
    text = "\n".join(f"{x},{z}" for x, z in rows)
    npt.assert_array_equal(read_profile(write(text)).points, rows)


@pytest.mark.parametrize("head", ["{}\n" + "mm," * 21 + "mm\n", "# {}\n", "{}\n# a remark\n"])
def test_x_and_height_are_found_by_their_names_above_a_wide_table(write, head):
    rows = np.random.default_rng(1).normal(0, 1, (80, 22)).round(3)
    names = ",".join(["x", "z"] + [f"c{k}" for k in range(20)])
    text = "\n".join(",".join(map(str, row)) for row in rows.tolist())
    npt.assert_array_equal(read_profile(write(head.format(names) + text)).points, rows[:, :2])


def test_a_constant_second_column_is_left_out(write):
    text = "".join(f"{x} 7.0 {x * x}\n" for x in range(6))
    npt.assert_array_equal(read_profile(write(text)).points[:, 1], np.arange(6.0) ** 2)


def test_whole_numbers_in_the_third_column_are_a_label(write):
    text = "".join(f"{x / 2},{x * x / 4},{x % 2}.000\n" for x in range(9))
    file = inspect_profiles(write(text))
    npt.assert_array_equal(file.profiles[0].points[:, 1], np.arange(9.0) ** 2 / 4)
    assert any("label" in note for note in file.notes)


def test_a_second_column_of_few_values_separates_profiles(write):
    text = "".join(f"{x} {y} {x * y + 0.5}\n" for y in (0.5, 1.5, 0.25) for x in range(5))
    file = inspect_profiles(write(text))
    assert file.positions == (0.5, 1.5, 0.25)
    npt.assert_array_equal(file.profiles[2].points[:, 1], 0.25 * np.arange(5) + 0.5)


def test_a_column_that_numbers_the_scan_separates_profiles(write):
    text = "scan,x,z\n" + "".join(f"{s},{x},{s + x}\n" for s in (4, 5) for x in range(3))
    profiles = read_profiles(write(text))
    assert [profile.points[0].tolist() for profile in profiles] == [[0.0, 4.0], [0.0, 5.0]]


def test_columns_can_be_chosen_by_place_and_by_name(write):
    path = write("q,x,z,h2\n9,1,2,3\n8,4,5,6\n")
    for columns in ((1, 3), "1,3", "x,h2", ("X", 3)):
        npt.assert_array_equal(read_profile(path, columns=columns).points, [[1, 3], [4, 6]])


def test_two_rows_of_many_numbers_are_x_over_height(write):
    x = np.arange(30.0)
    text = "\n".join(" ".join(map(str, row)) for row in (x, x**2))
    npt.assert_array_equal(read_profile(write(text)).points, np.column_stack([x, x**2]))


def test_rows_of_heights_take_their_x_from_the_options(write):
    heights = np.arange(60.0).reshape(2, 30)
    heights[:, 3] = NAN
    text = "\n".join(",".join(map(str, row)) for row in heights)
    profiles = read_profiles(write(text), x0=-3.0, dx=0.5)
    assert len(profiles) == 2
    npt.assert_array_equal(profiles[1].points[4], [-1.0, 34.0])
    assert profiles[0].lost == 1


def test_units_of_heights_do_not_scale_a_spacing_given_in_mm(write):
    text = " ".join(["2000"] * 30)
    points = read_profile(write(text), dx=0.5, units="um").points
    npt.assert_allclose(points[2], [1.0, 2.0])


def test_one_column_is_a_profile_where_its_spacing_is_said(write):
    points = read_profile(write("5\n6\n\n7\n"), x0=1.0, dx=2.0).points
    npt.assert_array_equal(points, [[1, 5], [3, 6], [5, 7]])
