"""Files of sensor makers, written here after their manuals."""

import numpy as np
import numpy.testing as npt
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles, read_profile, read_profiles

NAN = float("nan")
GOCATOR_HEAD = """Info
CSV Version,Sensor Count,Trigger Mode
2,1,0
End

DeviceInfo
ID,Model
7,3109
End

"""
SURFACE = r"""Part
Frame,Source,Row Count,Column Count,X Offset
1,0,2,3,-0.5
Y\X,-0.5,0.0,0.5
10.0,1.25,,1.75
10.5,,,2.5
End
"""
UNIFORM = """Profile
Frame Count,Column Count,X Offset,Y Offset,Z Offset
2,3,-0.5,0,0
Frame,Source,Time,Encoder,Z Encoder,Inputs,Exposure,Y,Axis,-0.5,0.0,0.5
1,0,11,0,0,0,80,10.0,Z,1.25,,1.75
1,0,11,0,0,0,80,10.0,I,90,80,70
2,0,12,0,0,0,80,10.5,Z,,,2.5
End
"""
RAW = """RawProfile
Frame Count,Column Count,X Offset,Y Offset,Z Offset
2,3,0,0,0
Frame,Source,Time,Encoder,Z Encoder,Inputs,Exposure,Y,Axis,0,1,2
1,0,11,0,0,0,80,10.0,X,-0.5,,0.5
1,0,11,0,0,0,80,10.0,Z,1.25,,1.75
2,0,12,0,0,0,80,10.5,X,,,0.5
2,0,12,0,0,0,80,10.5,Z,,,2.5
End
"""


@pytest.mark.parametrize("section", [SURFACE, UNIFORM, RAW], ids=["surface", "uniform", "raw"])
def test_each_section_of_a_gocator_recording_gives_the_same_profiles(write, section):
    file = inspect_profiles(write(GOCATOR_HEAD + section, "replay.csv"))
    first, second = file.profiles
    npt.assert_array_equal(first.points, [[-0.5, 1.25], [NAN, NAN], [0.5, 1.75]])
    npt.assert_array_equal(second.points[2], [0.5, 2.5])
    assert file.positions == (10.0, 10.5)
    assert (file.reader, file.units, file.units_assumed) == ("gocator", "mm", False)


def test_profiles_of_a_gocator_recording_without_y_are_at_0(write):
    text = GOCATOR_HEAD + RAW.replace(",Y,Axis", ",Axis").replace("80,10.0,", "80,")
    file = inspect_profiles(write(text.replace("80,10.5,", "80,"), "replay.csv"))
    assert file.positions == (0.0, 0.0)
    npt.assert_array_equal(file.profiles[1].points[2], [0.5, 2.5])


def test_a_gocator_recording_without_its_last_end_still_reads(write):
    cut = (GOCATOR_HEAD + SURFACE).removesuffix("End\n")
    assert len(read_profiles(write(cut))) == 2


def test_an_end_without_a_block_in_a_gocator_recording_is_no_title(write):
    extra = GOCATOR_HEAD + "End\n" + SURFACE
    assert len(read_profiles(write(extra))) == 2


def test_gocator_point_lists_are_pairs_from_x0_on(write):
    text = (
        "frameIndex,timestamp,numberOfValidPoints,x0,z0,x1,z1,x2,z2\n"
        "0,5,2,-1.0,7.5,,,1.0,8.5\n1,6,3,-1.0,7.0,0.0,7.1,1.0,7.2\n"
    )
    first, second = read_profiles(write(text, "points.csv"))
    npt.assert_array_equal(first.points, [[-1, 7.5], [NAN, NAN], [1, 8.5]])
    npt.assert_array_equal(second.points[1], [0, 7.1])


def test_raw_keyence_counts_become_mm_by_the_controllers_scales(write):
    counts = np.full((2, 800), 32768)
    counts[0, 0], counts[0, 799], counts[1, 5] = 32768 + 1000, 0, 32768 - 500
    text = "\n".join(",".join(map(str, row)) for row in counts)
    path = write(text, "height.csv")
    first, second = read_profiles(path, x_start=-400_000, x_pitch=1000, z_unit=40)
    npt.assert_allclose(first.points[0], [-4.0, 0.4])  # -400000 steps of 0.01 um; 1000 x 0.4 um
    npt.assert_allclose(second.points[5], [-3.95, -0.2])
    assert (first.lost, second.lost) == (1, 0)


def test_raw_keyence_counts_without_scales_name_the_options(write):
    path = write(",".join(["32768"] * 3200))
    with pytest.raises(UnreadableFile, match="--x-start, --x-pitch and --z-unit"):
        read_profile(path)


def test_the_keyence_exporter_writes_utf_16_and_mm(write):
    text = "-1.5\t0.25\r\n-1.0\t-99999.9999\r\n-0.5\t0.75\r\n"
    file = inspect_profiles(write(text.encode("utf-16"), "export.csv"))
    npt.assert_array_equal(file.profiles[0].points, [[-1.5, 0.25], [NAN, NAN], [-0.5, 0.75]])
    assert (file.reader, file.units_assumed) == ("keyence", False)


def test_a_unit_for_raw_keyence_counts_is_rejected(write):
    text = "\n".join("\t".join(["32768"] * 800) for _ in range(2))
    scales = {"x_start": 0, "x_pitch": 10, "z_unit": 50}
    with pytest.raises(UnreadableFile, match="leave --units out"):
        inspect_profiles(write(text), units="um", **scales)


@pytest.mark.parametrize("names", ["x0,z0,i0,x1,z1,i1", "x0,y0,z0,x1,y1,z1", "x0,z0,t"])
def test_other_columns_among_gocator_points_are_rejected(write, names):
    cells = ",".join(map(str, range(names.count(",") + 1)))
    with pytest.raises(UnreadableFile, match=r"expected column [xz][01], got (i0|y0|t)"):
        read_profiles(write(f"{names}\n{cells}\n{cells}\n"), format="gocator-points")
