"""A unit in words of any kind is read, or failure with these words: never dropped in silence.

The pipe of 2 mm, 17 mm below the sensor, looks plausible in any unit.
"""

import io
import json

import numpy as np
import numpy.testing as npt
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles, read_profile

TURN = np.linspace(2.7, 0.45, 60)
PIPE = 2 * np.column_stack([np.cos(TURN), np.sin(TURN)]) + [1.0, -17.0]
PER_MM = {"um": 1000.0, "10 um": 100.0, "0.01 mm": 100.0, "0.1 mm": 10.0, "in": 1 / 25.4}
ROUNDING_MM = 1e-3


def rows(unit, separator=","):
    return "".join(f"{x:.6g}{separator}{z:.6g}\n" for x, z in PIPE * PER_MM[unit])


@pytest.mark.parametrize(
    ("head", "unit", "separator"),
    [
        ("x (in um); z (in um)\n", "um", ";"),
        ("# resolution: 0.01 mm/digit\nx,z\n", "0.01 mm", ","),
        ("# Z resolution: 10 um per count\n# X resolution: 10 um per count\nx,z\n", "10 um", ","),
        ("# 1 digit = 0.01 mm\nx,z\n", "0.01 mm", ","),
        ("# x unit um\n# z unit um\nx,z\n", "um", ","),
        ("# 単位 0.1mm\nx,z\n", "0.1 mm", ","),
        ("# Einheit 0,1 mm\nx;z\n", "0.1 mm", ";"),
        ("x,z\ndouble,double\num,um\n", "um", ","),
        ("X-Koordinate [um];Z-Koordinate [um]\n", "um", ";"),
        ("x (inch),z (in)\n", "in", ","),
        ("# one digit is 0.01 mm\nx,z\n", "0.01 mm", ","),
        ("# one count equals 0.01 mm\nx,z\n", "0.01 mm", ","),
        ("# ein Inkrement entspricht 0,01 mm\nx;z\n", "0.01 mm", ";"),
        ("# data are in units of 0.01 mm\nx,z\n", "0.01 mm", ","),
        ("# x/z unit 0.01 mm\nx,z\n", "0.01 mm", ","),
        ("# um per LSB: 10\nx,z\n", "10 um", ","),
        ("# counts_per_mm = 100\nx,z\n", "0.01 mm", ","),
        ("# Scale [mm]: 0.01\nx,z\n", "0.01 mm", ","),
        ("# lsb_um = 10\nx,z\n", "10 um", ","),
        ("# unit of measure: um\nx,z\n", "um", ","),
        ("# units used: um\nx,z\n", "um", ","),
        ("# output unit: 0.1mm\nx,z\n", "0.1 mm", ","),
    ],
)
def test_units_in_further_forms_are_read(write, head, unit, separator):
    profile = read_profile(write(head + rows(unit, separator), "a.csv"))
    npt.assert_allclose(profile.points, PIPE, atol=ROUNDING_MM)


@pytest.mark.parametrize(
    "line",
    [
        "# saved by ACME 3000 in um",
        "Profile export, all values [um]",
        "<unit>um</unit>",
        "# X axis: micrometres; Z axis: micrometres",
        "# mm -> um",
        "# Lengths - um; angles - deg",
        "# X,Z in hundredths of a millimetre",
        "# written in 1/100 mm by hand",
        "# multiply by 0.01 to get mm",
        "# 1000 counts per mm",
        "# 100 digits/mm",
        "# mm = counts / 100",
        "# resolution x: 0.1 mm/px",
        "# x and z are in tenths of mm",
        "# 100 counts = 1 mm",
        "# 0.01 mm = 1 digit",
        "# Werte in 0,01 mm",
        "# length unit 0.01 millimeters",
        "# coords x0.01mm",
        "#SCALE_X 0.01",
        "pixelToMm: 0.01",
        "# measured in steps of 0.01 mm",
        "# LSB size 0.01mm",
        "# divide by one hundred",
        "# counts, 0.01 mm each",
        "# coded in units of 10 microns",
        "# mm = raw * 0.01",
        "# x_mm = x * 0.01, z_mm = z * 0.01",
        "# data in m*1e-6",
        "# Skalierung 0,01",
        "# conversion factor 0.01",
        "# LSB weight 10 um",
        "# weight of one LSB is 10 um",
        "# quantization 0.01 mm",
        "# quantum 10um",
        "exponent: -3",
        "# mm x 10",
        "# mm*10",
        "# x10 mm",
        "# 10 per mm",
        "# values are 10 times mm",
        "# tenths",
        "# Z [10^-1 mm]",
        "# Z = 0.01 * n",
        "# z = a*value + b, a = 0.01, b = 0",
    ],
)
def test_a_unit_in_other_words_is_rejected_with_the_line(write, line):
    path = write(f"{line}\nx,z\n{rows('um')}", "a.csv")
    with pytest.raises(UnreadableFile) as failure:
        read_profile(path)
    assert line in str(failure.value)
    assert "--units" in str(failure.value)
    npt.assert_allclose(read_profile(path, units="um").points, PIPE, atol=ROUNDING_MM)


@pytest.mark.parametrize(
    "line",
    [
        "# laser of 450 nm",
        "# accuracy 5 um",
        "# exposure unit: us, gain 1.5",
        "# resolution 1280 points",
        "# pixels = 640",
        "# step: 0.1 mm",
        "# 1 count = 3 s",
        "# Sensor Number Umbra 7",
        "# Maßstab 1:1",
        "# scale 1.0",
        "# safety factor: 2",
        "# encoder: 1 count = 0.05 mm",
        "# encoder counts/mm: 20",
        "# feed mm per step: 0.1",
        "# each step is 0.5 mm",
        "# count: 640 at 0.1 mm",
        "# data interval 0.1 mm",
        "# values rounded to 0.001 mm",
        "# resolution of the values: 0.01 mm",
        "# length of the part: 10 mm",
        "# z = 20 mm",
        "# z = 20 mm / 3",
        "# range: 100 mm",
        "# field of view 100 x 80 mm",
        "# 100 mm x 10 mm",
        "# aspect ratio 0.75",
        "# unit cell 3, values ok",
        "# unit cell: 3",
        "# unit under test: 4711",
        "# unit test: passed",
        "# near field optics",
    ],
)
def test_lines_about_other_things_are_none(write, line):
    path = write(f"{line}\nx,z\n" + "".join(f"{x:.4f},{z:.4f}\n" for x, z in PIPE), "a.csv")
    file = inspect_profiles(path)
    assert file.units_assumed
    npt.assert_allclose(file.profiles[0].points, PIPE, atol=ROUNDING_MM)


@pytest.mark.parametrize(
    "head", ["# col 1: x [mm]\n# col 2: z [um]\n", "Export 3\n0) x (mm)\n1) z (um)\n"]
)
def test_columns_that_are_listed_one_per_line_have_their_units(write, head):
    file = inspect_profiles(write(head + "".join(f"{x:.4f},{1000 * z:.4f}\n" for x, z in PIPE)))
    assert file.units == "mm, um"
    npt.assert_allclose(file.profiles[0].points, PIPE, atol=ROUNDING_MM)


def test_two_units_above_columns_without_names_are_rejected(write):
    path = write(f"# lateral [mm]\n# vertical [um]\n{rows('um')}")
    with pytest.raises(UnreadableFile, match="is stated in it and not understood"):
        inspect_profiles(path)


@pytest.mark.parametrize("line", ["# stand-off [m]: 0.4", "Pitch [m];0.05", "# depth [m] = 1e-1"])
def test_the_unit_of_a_number_is_not_that_of_the_points(write, line):
    points = "".join(f"{x:.4f};{z:.4f}\n" for x, z in PIPE)
    file = inspect_profiles(write(f"{line}\n{points}"))
    assert file.units_assumed
    npt.assert_allclose(file.profiles[0].points, PIPE, atol=ROUNDING_MM)


def test_a_unit_over_the_columns_goes_before_other_words(write):
    path = write(f"# exported in um\nx [um],z [um]\n{rows('um')}")
    npt.assert_allclose(read_profile(path).points, PIPE, atol=ROUNDING_MM)


def cloud(kind):
    points = "".join(f"{x:.6g} 0 {z:.6g}\n" for x, z in PIPE * 1000)
    if kind == "ply":
        return (
            f"ply\nformat ascii 1.0\ncomment unit: um\nelement vertex {len(PIPE)}\n"
            f"property float x\nproperty float y\nproperty float z\nend_header\n{points}"
        )
    return (
        "# .PCD v0.7\n# unit: um\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n"
        f"WIDTH {len(PIPE)}\nHEIGHT 1\nPOINTS {len(PIPE)}\nDATA ascii\n{points}"
    )


@pytest.mark.parametrize("kind", ["ply", "pcd"])
def test_comments_of_clouds_state_units(write, kind):
    content = cloud(kind)
    npt.assert_allclose(read_profile(write(content)).points, PIPE, atol=ROUNDING_MM)
    with pytest.raises(UnreadableFile, match=r"saved in um.*mentions a unit"):
        read_profile(write(content.replace("unit: um", "saved in um, ACME")))


def test_nested_units_and_columns_of_pandas_in_json(write):
    x, z = (PIPE * 1000).T.tolist()
    nested = {"meta": {"units": {"x": "um", "z": "um"}}, "x": x, "z": z}
    pandas = {"x [um]": dict(zip(map(str, range(60)), x, strict=True)),
              "z [um]": dict(zip(map(str, range(60)), z, strict=True))}  # fmt: skip
    for document in (nested, pandas):
        points = read_profile(write(json.dumps(document), "a.json")).points
        npt.assert_allclose(points, PIPE, atol=ROUNDING_MM)


@pytest.mark.parametrize(
    ("names", "values", "unit"),
    [
        (["unit"], ["um"], "um"),
        (["x_unit", "z_unit"], ["um", "um"], "um"),
        (["lsb"], ["0.01 mm"], "0.01 mm"),
        (["mm_per_count"], [0.01], "0.01 mm"),
        (["lsb_um"], [10], "10 um"),
    ],
)
def test_columns_with_one_value_state_units(write, names, values, unit):
    cells = [dict(zip(["x", "z", *names], [*point, *values], strict=True))
             for point in (PIPE * PER_MM[unit]).round(4).tolist()]  # fmt: skip
    table = "\n".join([",".join(cells[0]), *(",".join(map(str, row.values())) for row in cells)])
    for content in (table, json.dumps(cells)):
        npt.assert_allclose(read_profile(write(content)).points, PIPE, atol=ROUNDING_MM)


def test_a_scale_without_a_unit_is_never_dropped(write):
    x, z = (PIPE * 100).round(4).T.tolist()
    table = "x,z,scale\n" + "".join(f"{a},{b},0.01\n" for a, b in zip(x, z, strict=True))
    nested = {"header": {"scaling": {"x": 0.01, "z": 0.01}}, "x": x, "z": z}
    listed = {"scale": [0.01, 0.01], "x": x, "z": z}
    for content in (table, json.dumps(nested), json.dumps(listed)):
        with pytest.raises(UnreadableFile, match=r"scal.*0.01' is stated in it and not understood"):
            read_profile(write(content))


def test_a_divisor_is_never_dropped(write):
    with pytest.raises(UnreadableFile, match="'Divisor;100' is stated in it and not understood"):
        read_profile(write(f"Divisor;100\nx,z\n{rows('0.01 mm')}"))


def test_units_of_other_quantities_below_keys_are_none(write):
    x, z = PIPE.T.tolist()
    settings = {"exposure": {"value": 100, "unit": "us"}, "image": {"scale": 0.5, "unit": "px"}}
    for document in (settings, {"config": settings}):
        file = inspect_profiles(write(json.dumps({**document, "x": x, "z": z})))
        assert file.units_assumed
    fields = [{"name": "x", "unit": "10um"}, {"name": "z", "unit": "10um"}]
    hundredths = (PIPE * 100).T.tolist()
    document = {"fields": fields, "x": hundredths[0], "z": hundredths[1]}
    npt.assert_allclose(read_profile(write(json.dumps(document))).points, PIPE, atol=ROUNDING_MM)
    axes = {"axes": {"x": {"unit": "mm"}, "z": {"unit": "um"}}}
    file = inspect_profiles(write(json.dumps({**axes, "x": x, "z": (PIPE[:, 1] * 1000).tolist()})))
    npt.assert_allclose(file.profiles[0].points, PIPE, atol=ROUNDING_MM)
    nested = {"config": {"controller": {"unit": "um"}}, "x": [0, 1000], "z": [0, 1000]}
    assert inspect_profiles(write(json.dumps(nested))).units == "um"


def test_a_unit_in_a_list_of_objects_is_rejected_with_its_line(write):
    x, z = (PIPE * 1000).T.tolist()
    profile = {"remark": "saved in um, ACME", "x": x, "z": z}
    with pytest.raises(UnreadableFile, match=r"saved in um.*mentions a unit"):
        inspect_profiles(write(json.dumps([profile, profile])))


def test_comments_of_yaml_state_units(write):
    lists = [f"{name}: [{', '.join(f'{v:.2f}' for v in column)}]" for name, column in
             zip("xz", (PIPE * 1000).T, strict=True)]  # fmt: skip
    stated = read_profile(write("\n".join(["# unit: um", *lists]), "a.yaml"))
    npt.assert_allclose(stated.points, PIPE, atol=ROUNDING_MM)
    for line in ("# as the sensor counts, um", "meta:\n  unit: um"):
        with pytest.raises(UnreadableFile, match="mentions a unit"):
            read_profile(write("\n".join([line, *lists]), "a.yaml"))


def test_a_scale_in_numpy_is_never_dropped(write):
    stream = io.BytesIO()
    x, z = (PIPE * 1000).T
    np.savez(stream, x=x, z=z, scale=0.001)
    with pytest.raises(UnreadableFile, match=r"the unit 'scale: 0.001' is stated"):
        read_profile(write(stream.getvalue(), "a.npz"))


@pytest.mark.parametrize("name", ["a.json", "a.yaml"])
def test_a_key_that_stands_twice_is_rejected(write, name):
    content = '{"x": [1, 2, 3], "z": [4, 5, 6], "x": [7, 8, 9]}'
    if name == "a.yaml":
        content = "x: [1, 2, 3]\nz: [4, 5, 6]\nx: [7, 8, 9]\n"
    with pytest.raises(UnreadableFile, match="'x' twice"):
        read_profile(write(content, name))


@pytest.mark.parametrize("word", ["<NA>", "\\N", "nan(snan)", "---.---", "-nan"])
def test_further_words_for_nothing(write, word):
    heights = [word if k % 4 == 0 else f"{z:.3f}" for k, (_, z) in enumerate(PIPE)]
    cells = "".join(f"{x:.3f},{z}\n" for (x, _), z in zip(PIPE, heights, strict=True))
    assert read_profile(write(f"x,z\n{cells}")).lost == 15


def test_names_that_occur_twice_are_reported(write):
    both = "".join(f"{x:.4f},{z:.4f},{x + 9:.4f},{z:.4f}\n" for x, z in PIPE)
    file = inspect_profiles(write(f"x,z,x,z\n{both}"))
    npt.assert_allclose(file.profiles[0].points, PIPE, atol=ROUNDING_MM)
    used = "x and z occur twice in the header: the first is used, choose others with --columns"
    assert used in file.notes


@pytest.mark.parametrize("footer", ["-----\nChecksum 0xAB12", "=====", "___\nEND"])
def test_a_rule_under_a_table_is_a_footer(write, footer):
    plain = "".join(f"{x:.4f},{z:.4f}\n" for x, z in PIPE)
    assert len(read_profile(write(f"x,z\n{plain}{footer}\n"))) == len(PIPE)


def test_width_and_depth_are_x_and_range(write):
    swapped = "".join(f"{-z:.4f},{x:.4f}\n" for x, z in PIPE)
    points = read_profile(write(f"depth,width\n{swapped}")).points
    npt.assert_allclose(points, PIPE, atol=ROUNDING_MM)


@pytest.mark.parametrize(
    ("x_label", "z_label"),
    [("x_1e-4_m", "z_1e-4_m"), ("x_tenth_mm", "z_tenth_mm"), ("x in 1e-1 mm", "z_1e2_um")],
)
def test_scales_behind_names_are_read(tmp_path, x_label, z_label):
    path = tmp_path / "profile.csv"
    path.write_text(f"{x_label},{z_label}\n-50.5,-2000.5\n0.5,-1900.5\n50.5,-2000.5\n")
    np.testing.assert_allclose(read_profile(path).points[0], [-5.05, -200.05])


def test_a_power_of_ten_behind_a_name_is_rejected(tmp_path):
    path = tmp_path / "profile.csv"
    path.write_text("x_10_um,z_10_um\n-500.5,-20000.5\n0.5,-19000.5\n500.5,-20000.5\n")
    with pytest.raises(UnreadableFile, match=r"x_10 in um: this may be a unit of 10 um.* --units"):
        read_profile(path)
    np.testing.assert_allclose(read_profile(path, units="10um").points[0], [-5.005, -200.005])


@pytest.mark.parametrize("line", ["# 10 = 1 mm", "# 1:10 mm", "# z = 0.5 mm", "# x: 25 um"])
def test_a_number_that_is_a_length_is_no_unit(tmp_path, line):
    path = tmp_path / "profile.csv"
    path.write_text(f"{line}\n-50,-2000\n0,-1900\n50,-2000\n")
    with pytest.raises(UnreadableFile, match="stated in it and not understood"):
        read_profile(path)


def test_units_of_both_axes_in_one_comment_are_read(tmp_path):
    path = tmp_path / "profile.csv"
    path.write_text("# x: mm, z: um\n-5,-200000\n0,-190000\n5,-200000\n")
    np.testing.assert_allclose(read_profile(path).points[0], [-5, -200])
