"""Units are taken from wherever a file states them, and rejected where they are not understood."""

import numpy as np
import numpy.testing as npt
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import ReadSettings, inspect_profiles, read_profile
from lsvision.io.profiles.reading import require_plausible_units
from lsvision.io.profiles.unit_statements import find_unit_statements
from lsvision.io.profiles.units import find_mm_per_unit, parse_unit, split_label


@pytest.mark.parametrize(
    ("text", "mm"),
    [
        ("mm", 1.0),
        ("um", 1e-3),
        ("µm", 1e-3),
        ("μm", 1e-3),
        ("Micrometers", 1e-3),
        ("dm", 100.0),
        ("thou", 0.0254),
        ('"', 25.4),
        ("Zoll", 25.4),
        ("ft", 304.8),
        ("1/10 mm", 0.1),
        ("1/100mm", 0.01),
        ("0.1mm", 0.1),
        ("0,1 mm", 0.1),
        ("10um", 0.01),
        ("100 nm", 1e-4),
        ("mm/10", 0.1),
        ("1e-6 m", 1e-3),
        ("10^-6 m", 1e-3),
        ("5 x 10^-2 mm", 0.05),
        ("10⁻⁶ m", 1e-3),
        ("1/1000 inch", 0.0254),
        ("hundredths of a millimetre", 0.01),
        ("0.01 mm/digit", 0.01),
        ("um per count", 1e-3),
    ],
)
def test_a_unit_is_understood_however_it_is_written(text, mm):
    assert find_mm_per_unit(text) == pytest.approx(mm, rel=1e-12)
    name = parse_unit(text)
    assert name is not None
    assert find_mm_per_unit(name) == pytest.approx(mm, rel=1e-9)


@pytest.mark.parametrize(
    "text", ["", "px", "furlong", "deg", "mm^2", "1/0 mm", "0 mm", "counts", "7"]
)
def test_what_is_no_unit_of_length_is_none(text):
    assert parse_unit(text) is None
    with pytest.raises(ValueError, match="expected a unit of length"):
        find_mm_per_unit(text)


@pytest.mark.parametrize(
    ("label", "name", "unit"),
    [
        ("X [1/10 mm]", "x", "0.1 mm"),
        ("Z (mm)", "z", "mm"),
        ("z_0.1mm", "z", "0.1 mm"),
        ("Height <um>", "height", "um"),
        ("Xmm", "x", "mm"),
        ("x in mm", "x", "mm"),
        ("z-um", "z", "um"),
        ("z (mm, towards the sensor)", "z", "mm"),
        ("[um]", "", "um"),
        ("Z (filtered)", "z", "nothing"),
        ("pos_x", "pos_x", "nothing"),
        ("z [furlong]", "z", None),
        ("z/counts", "z", None),
        ("x_px", "x", None),
        ("Height (raw)", "height", None),
    ],
)
def test_a_label_is_a_name_and_a_unit(label, name, unit):
    found, stated = split_label(label)
    assert found == name
    assert ("nothing" if stated is None else stated.unit) == unit


def written(points, separator=",", decimal="."):
    rows = [separator.join(f"{v:.6g}".replace(".", decimal) for v in row) for row in points]
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    ("head", "scale"),
    [
        ("X [1/10 mm],Z [1/10 mm]\n", 10),
        ("X [0.1mm],Z [0.1mm]\n", 10),
        ("x (10um),z (10um)\n", 100),
        ("x[dm],z[dm]\n", 0.01),
        ("X,Z\num,um\n", 1000),
        ("X,Z\n[um],[um]\n", 1000),
        ("X,Z\n(µm),(µm)\n", 1000),
        ("[um],[um]\n", 1000),
        ("um,um\nX,Z\n", 1000),
        ("# unit: um\n", 1000),
        ("# unit: um\nx,z\n", 1000),
        ("Units: micrometer\nx,z\n", 1000),
        ("Units,um\n\nx,z\n", 1000),
        ("Unit=um\nSerial=17\nx,z\n", 1000),
        ("LengthUnit: um\nx,z\n", 1000),
        ("% all values in micrometres\nx,z\n", 1000),
        ("// x in um, z in um\nx,z\n", 1000),
        ("Unit X: um\nUnit Z: um\nx,z\n", 1000),
        ("Units: um (X), um (Z)\nx,z\n", 1000),
        ("# [um]\n", 1000),
        ("um\nx,z\n", 1000),
        ("X [1/10 mm]  Z [1/10 mm]\n", 10),
        ("position [um] along the line, heights\n", 1000),
        ("Einheit: 1/100 mm\nx,z\n", 100),
        ("# Scale: 0.01 mm\nx,z\n", 100),
        ("# Time unit: ms\n# Unit: um\nx,z\n", 1000),
        ("x [um],z\n", 1000),
    ],
)
@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ","), ("\t", ".")])
def test_a_stated_unit_is_used_wherever_it_stands(write, arc, head, scale, separator, decimal):
    head = head.replace(",", separator) if head[0] not in "#%/" else head
    text = head.replace("0.1mm", f"0{decimal}1mm") + written(arc * scale, separator, decimal)
    file = inspect_profiles(write(text, "p.csv"))
    npt.assert_allclose(file.profiles[0].points, arc, atol=2e-3)
    assert "mm (assumed)" not in file.summary


def test_a_unit_below_the_numbers_and_in_a_column_counts(write, arc):
    for text in (
        written(arc * 1000) + "# unit: um\n",
        written(arc * 1000) + "Units: um\n",
        "x,z,unit\n" + "".join(f"{x},{z},um\n" for x, z in (arc * 1000).tolist()),
    ):
        npt.assert_allclose(read_profile(write(text)).points, arc, atol=1e-2)


@pytest.mark.parametrize(
    ("head", "quoted"),
    [
        ("x [furlong],z [furlong]\n", "'furlong'"),
        ("x [px],z [px]\n", "'px'"),
        ("x_px,z_px\n", "'px'"),
        ("x,z\ntick,tick\n", "'tick'"),
        ("x,z\n[cnt],[cnt]\n", "'cnt'"),
        ("# unit: elle\nx,z\n", "'unit: elle'"),
        ("# Scale: 0.01\nx,z\n", "'Scale: 0.01'"),
        ("# heights in counts\nx,z\n", "'counts'"),
        ("x [mm],z [digits]\n", "'digits'"),
        ("# unit: um\nx [mm],z [mm]\n", "'mm' and 'um'"),
        ("# unit: um\n# unit: mm\nx,z\n", "'um' and 'mm'"),
    ],
)
def test_a_unit_that_is_not_understood_is_quoted_with_the_remedy(write, arc, head, quoted):
    path = write(head + written(arc), "p.csv")
    with pytest.raises(UnreadableFile, match=f"{quoted}.*--units"):
        read_profile(path)
    npt.assert_allclose(read_profile(path, units="0.1mm").points, arc / 10, atol=1e-3)


@pytest.mark.parametrize(
    "head",
    [
        "x [mm],z [mm],intensity [%]\n",
        "x [mm],z [mm],t [s]\n",
        "x,z,i\nmm,mm,-\n",
        "x,z,i\nmm,mm,counts\n",
        "# Units: mm, deg\nx,z,i\n",
    ],
)
def test_units_of_other_columns_are_no_hindrance(write, arc, head):
    rows = np.column_stack([arc, np.arange(len(arc)) % 3])
    file = inspect_profiles(write(head + written(rows)))
    npt.assert_allclose(file.profiles[0].points, arc, atol=1e-3)
    assert not file.units_assumed


@pytest.mark.parametrize(
    "line",
    [
        "# sensor: LPS 36, noise 0.05 mm along the ray at 400 mm",
        "# exposure: 2 ms",
        "# points in file order",
        "Serial unit number: 7",
        "scale: 1",
        "# data in rows",
    ],
)
def test_a_remark_is_no_unit(line):
    assert find_unit_statements([line]) == ()


def test_units_are_given_with_a_scale_and_wrong_ones_rejected():
    assert ReadSettings(units="1/10 mm").units == "0.1 mm"
    with pytest.raises(
        ValueError, match=r"expected units among .* or with a scale as 0.1mm, got 'x'"
    ):
        ReadSettings(units="x")


def test_a_unit_of_one_axis_is_taken_for_the_other_and_said_to_be_assumed(write, arc):
    file = inspect_profiles(write("x [um],z\n" + written(arc * 1000)))
    assert file.summary.startswith("text, um (assumed)")


def test_metres_of_a_lidar_are_hinted_at(write):
    angle = np.linspace(-1, 1, 60)
    points = np.column_stack([2 * np.tan(angle), -2 - 0.2 * np.cos(angle)])
    file = inspect_profiles(write(written(points)))
    assert any("use --units m" in note for note in file.notes)
    assert file.unit_warnings == ()
    assert inspect_profiles(write("# unit: m\n" + written(points))).notes == ()


@pytest.mark.parametrize(("scale", "unit"), [(1e3, "um"), (1e5, "10nm"), (1e6, "nm")])
def test_a_coordinate_beyond_all_sensors_names_the_unit_that_would_fit(write, arc, scale, unit):
    file = inspect_profiles(write(written((arc * scale).round())))
    assert file.unit_warnings[0].endswith(f"see --units {unit}")


def test_a_length_alone_in_a_comment_is_no_unit(write, arc):
    assert find_unit_statements(["# 100 mm", "# 5 m"]) == ()
    assert [s.unit.unit for s in find_unit_statements(["# 0.1 mm", "# m"])] == ["0.1 mm", "m"]


@pytest.mark.parametrize(
    ("header", "positions", "note"),
    [
        ("x [um],y [mm],z [um]", (0.0, 1.0, 2.0), ""),
        ("x [um],y,z [um]", (0.0, 0.001, 0.002), ""),
        ("x,y [m],z", (0.0, 1000.0, 2000.0), ""),
        ("# x in mm\n# y in cm\n# z in mm\nx,y,z", (0.0, 10.0, 20.0), ""),
        ("x [mm],y [counts],z [mm]", None, "y in 'counts': positions left out"),
    ],
)
def test_positions_along_the_travel_have_the_unit_of_their_column(write, header, positions, note):
    rows = [f"{x}e3,{y},{z}e3\n" for y in range(3) for x, z in enumerate((7, 5, 6, 8, 9))]
    file = inspect_profiles(write(f"{header}\n{''.join(rows)}"))
    assert file.positions == positions
    assert len(file.profiles) == 3
    assert not note or note in file.notes


@pytest.mark.parametrize("label", ["z_0.1_mm", "z 1/10 mm", "z in 0.1 mm", "z_10^-4_m", "z/0.1 mm"])
def test_a_unit_with_a_scale_behind_a_name_keeps_its_scale(write, label):
    assert split_label(label)[0] == "z"
    file = inspect_profiles(write(f"x_mm,{label}\n1,-4000\n2,-3990\n"))
    npt.assert_allclose(file.profiles[0].points, [[1, -400], [2, -399]])
    assert split_label("z_2_mm")[0] == "z_2"


def test_pixels_below_the_names_are_no_names(write):
    with pytest.raises(UnreadableFile, match="the unit 'px' is stated in it and not understood"):
        read_profile(write("x,z\npx,px\n1,2\n2,3\n"))


def test_a_scale_in_free_text_is_not_passed_over(write, arc):
    for line in ("# scale factor 1000", "# Scaling 0.01"):
        with pytest.raises(UnreadableFile, match="mentions a unit that is not understood"):
            read_profile(write(f"{line}\n{written(arc)}"))
    read_profile(write(f"# scale factor 1.0\n{written(arc)}"))


def test_where_one_axis_states_its_unit_no_unit_finer_than_mm_is_suggested(write):
    file = inspect_profiles(write("x [m],z\n10,-400\n12,-399\n"))
    (warning,) = file.unit_warnings
    assert warning.endswith("check the stated unit (m), see --units")
    with pytest.raises(UnreadableFile, match="or --units m if it is correct"):
        require_plausible_units(file)


def test_a_header_that_states_a_unit_in_words_is_still_a_header(write):
    file = inspect_profiles(write("x_mm,z in um\n1,-4000\n2,-3990\n"))
    npt.assert_allclose(file.profiles[0].points, [[1, -4], [2, -3.99]])


def test_a_phrase_about_several_axes_is_about_all_of_them():
    for line in ("# x,z in um", "# x and z are given in um", "# coordinates x, y, z in um"):
        assert [(s.unit.unit, s.axis) for s in find_unit_statements([line])] == [("um", None)]
    (statement,) = find_unit_statements(["# z values in um"])
    assert statement.axis == "height"


@pytest.mark.parametrize("label", ["z", "z [counts]", "z_raw", "z [mm]"])
def test_the_size_of_counts_is_the_unit_of_heights_beside_x(write, label):
    path = write(f"x [um],{label}\n0,-30000\n100,-30100\n300,-30200\n")
    file = inspect_profiles(path, z_unit="10um")
    npt.assert_allclose(file.profiles[0].points, [[0, -300], [0.1, -301], [0.3, -302]])
    file = inspect_profiles(path, z_unit=1000, units="cm")
    npt.assert_allclose(file.profiles[0].points[1], [1000, -301])
    named = write('{"x": [[0, 1, 2]], "z [counts]": [[-30000, -30100, -30200]]}', "counts.json")
    npt.assert_allclose(read_profile(named, z_unit="10um").points[2], [2, -302])


def test_the_first_x_needs_a_spacing(write):
    with pytest.raises(ValueError, match="expected dx beside x0"):
        read_profile(write("x,z\n0,1\n1,2\n"), x0=5.0)
