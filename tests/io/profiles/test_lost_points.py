"""Lost points are recognised by the values that mark them, counted and reported."""

import warnings

import numpy as np
import numpy.testing as npt
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import inspect_profiles, read_profile
from lsvision.profile import Profile
from lsvision.statistics.lost_markers import find_lost_markers

MARKERS = [
    "-999.9999",
    "-999",
    "999.99",
    "-9999",
    "-9999.0",
    "-10000",
    "-32768",
    "32767",
    "65535",
    "-2147483648",
    "4294967295",
    "-3.4028235e38",
    "1e30",
    "-327.68",
    "500.000",
    "-1000",
    "0",
    "0.000",
]


def spoilt(points, marker, fraction, both=False, separator=","):
    """Rows of text, a fraction of whose heights (or whole rows) are the marker."""
    lost = np.random.default_rng(3).permutation(len(points)) < fraction * len(points)
    rows = [
        separator.join((marker if both and gone else f"{x:.3f}", marker if gone else f"{z:.3f}"))
        for (x, z), gone in zip(points.tolist(), lost.tolist(), strict=True)
    ]
    return "\n".join(rows) + "\n", lost


@pytest.mark.parametrize("marker", MARKERS)
@pytest.mark.parametrize("fraction", [0.1, 0.3, 0.6])
@pytest.mark.parametrize("both", [False, True])
def test_a_marker_reads_as_nan_does(write, arc, marker, fraction, both):
    text, lost = spoilt(arc, marker, fraction, both)
    file = inspect_profiles(write(text))
    expected = np.where(lost[:, np.newaxis], np.nan, arc)
    npt.assert_array_equal(file.profiles[0].points, expected)
    assert file.lost == lost.sum()
    assert file.unit_warnings == ()
    beyond = abs(float(marker)) >= 1e15
    shown = "0, 0" if both and float(marker) == 0 else f"{float(marker):.10g}"
    assert f"{lost.sum()} by {shown}" in file.summary or beyond


def test_two_markers_are_distinguished(write, arc):
    text, _ = spoilt(arc, "-9999", 0.2)
    lines = text.splitlines()
    lines[3:60:7] = [line.split(",")[0] + ",9999" for line in lines[3:60:7]]
    file = inspect_profiles(write("\n".join(lines)))
    assert {marker.text for marker in file.markers} == {"-9999", "9999"}
    assert file.profiles[0].points[:, 1][~np.isnan(file.profiles[0].points[:, 1])].max() < -100


@pytest.mark.parametrize("lost", ["-180.5", -180.5, (-180.5,)])
def test_a_marker_that_is_given_is_the_only_one(write, arc, lost):
    text, gone = spoilt(arc, "-180.5", 0.1)
    more = text + "90.0,-9999\n90.1,-9999\n"
    file = inspect_profiles(write(more), lost=lost)
    assert file.lost == gone.sum()
    assert not any(marker.guessed for marker in file.markers)
    assert float(np.nanmin(file.profiles[0].points[:, 1])) == -9999


def test_none_says_that_all_numbers_are_measured(write, arc):
    text, _ = spoilt(arc, "-999.9999", 0.1)
    assert inspect_profiles(write(text), lost="none").lost == 0


@pytest.mark.parametrize(
    "word", ["0xFFFFFFFF", "*****", "-1.#IND00", "1.#QNAN", "overrange", "N/A"]
)
@pytest.mark.parametrize("fraction", [0.1, 0.6])
def test_words_that_sensors_write_mark_lost_points(write, arc, word, fraction):
    text, lost = spoilt(arc, word, fraction)
    assert inspect_profiles(write(text)).lost == lost.sum()


def test_a_word_in_most_lines_is_named_with_the_option(write, arc):
    text, lost = spoilt(arc, "dunkel", 0.6)
    path = write(text)
    with pytest.raises(UnreadableFile, match=f"'dunkel' in {lost.sum()} lines.*--lost dunkel"):
        inspect_profiles(path)
    assert inspect_profiles(path, lost="dunkel").lost == lost.sum()


def test_a_hexadecimal_word_beyond_all_numbers_marks_lost_points(write, arc):
    word = "0x" + "f" * 300
    text, lost = spoilt(arc, word, 0.2)
    assert inspect_profiles(write(text), lost=word).lost == lost.sum()


def test_a_word_can_mark_lost_points(write, arc):
    text, lost = spoilt(arc, "ERR", 0.2)
    assert inspect_profiles(write(text), lost="ERR").lost == lost.sum()


@pytest.mark.parametrize(
    "line", ["# invalid value: -77", "NODATA_value -77", "# lost = -77", "No data;-77"]
)
def test_a_marker_that_the_file_states_is_used(write, arc, line):
    text, lost = spoilt(arc, "-77", 0.2)
    file = inspect_profiles(write(f"{line}\nx,z\n{text}"))
    assert file.lost == lost.sum()
    assert [marker.guessed for marker in file.markers] == [False]


def test_a_guess_of_a_unit_waits_for_the_marker(write, arc):
    rows = (arc * 1000).round()
    text, _ = spoilt(rows, "-2147483648", 0.1)
    file = inspect_profiles(write(text.replace(".000", "")))
    assert "coordinates reach 1.4e+05 mm" in file.unit_warnings[0]
    assert file.markers[0].text == "-2147483648"


def test_the_lost_points_of_a_range_are_zero_or_less_or_its_largest(write, arc):
    for marker in ("0", "-1", "800"):
        text, lost = spoilt(arc * [1, -1], marker, 0.3)
        file = inspect_profiles(write("x,range\n" + text))
        assert file.lost == lost.sum(), marker


@pytest.mark.parametrize(
    "heights",
    [
        np.repeat([-200.0, -140.0], 100),  # two planes without noise
        np.concatenate([np.full(100, -190.0), np.linspace(-165, -140, 80).round(1)]),
        np.linspace(-165, -140, 80).round(0),
        np.concatenate([[-300.0], np.linspace(-165, -140, 80)]),  # one stray point
        np.concatenate([np.full(90, -170.0), -130 + 20 * np.sin(np.linspace(0.3, 2.8, 90))]),
    ],
)
def test_planes_and_rounded_heights_are_no_markers(heights):
    assert find_lost_markers(heights) == ()


def test_points_in_python_are_warned_of_and_removed_on_request(arc):
    points = arc.copy()
    points[::5, 1] = -9999
    with pytest.warns(UserWarning, match=r"-9999 occurs in 16 of 80 points .*lost=-9999"):
        assert Profile(points).lost == 0
    assert Profile(points, lost=-9999).lost == 16
    assert Profile(points, lost=[-9999, 7]).lost == 16
    points[::5, 1] = -999.9999
    assert Profile(points.astype(np.float32), lost=-999.9999).lost == 16
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Profile(points, lost=()).lost == 0
        assert Profile(arc).lost == 0


def test_a_single_profile_with_a_marker_is_read(write, arc):
    text, lost = spoilt(arc, "-9999", 0.3, separator=";")
    assert read_profile(write(text)).lost == lost.sum()


def test_signalling_nan_is_a_lost_point_as_any_other(tmp_path, arc):
    signalling = np.array([0x7FF4000000000000], dtype=np.uint64).view(np.float64)
    arc.view(np.uint64)[7] = signalling.view(np.uint64)
    np.save(tmp_path / "a.npy", arc)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        profile = read_profile(tmp_path / "a.npy")
    assert profile.lost == 1


def test_a_stated_marker_that_is_too_large_for_a_number_marks_nothing(write, arc):
    rows = "\n".join(f"{x},{z}" for x, z in arc)
    assert read_profile(write(f"# invalid value: 1e999\nx,z\n{rows}\n")).lost == 0


@pytest.mark.parametrize(("odd", "markers"), [(-1.0, (-1.0,)), (0.0, (0.0,)), (60.0, ())])
def test_of_distances_a_single_one_that_is_none_is_a_marker(odd, markers):
    distances = np.repeat(np.linspace(168.0, 172.0, 12), 4)
    values = np.append(distances, [odd, odd])
    assert find_lost_markers(values, is_range=True) == markers


@pytest.mark.parametrize("marker", [0, -1])
def test_a_stated_marker_leaves_the_point_with_this_x(write, arc, marker):
    points = arc.round(3)
    points[40] = marker, -130.0
    rows = [f"{x},{marker if k in (3, 7) else z}" for k, (x, z) in enumerate(points.tolist())]
    file = inspect_profiles(write("\n".join(rows)), lost=marker)
    assert np.flatnonzero(np.isnan(file.profiles[0].points[:, 0])).tolist() == [3, 7]


def test_negative_heights_in_a_column_of_distances_are_valid_with_no_flip(write):
    x = np.linspace(-10, 10, 30)
    heights = (np.sqrt(400 - x**2) - 300).round(3)  # each one twice
    rows = "\n".join(f"{a:.3f},{b}" for a, b in zip(x, heights.tolist(), strict=True))
    file = inspect_profiles(write(f"x,distance\n{rows}\n"), flip=False)
    assert (file.lost, file.markers) == (0, ())
    npt.assert_array_equal(file.profiles[0].points[:, 1], heights)
