"""Arguments of `measure_cylinders` and similar functions, and errors for wrong ones."""

import math
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import lsvision as lsv
from lsvision.simulate import random_section

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def profile():
    return random_section("single", 7, noise_mm=0.02).profile


@pytest.fixture(scope="module")
def measured(profile):
    return lsv.measure_cylinders(lsv.Profile(profile.points), radius=(10, 60))


def frame_of(points, x="x", z="z"):
    return pd.DataFrame({z: points[:, 1], x: points[:, 0], "grey": 7})


class PolarsLikeFrame(dict):
    """Data frame with the methods that pandas and polars have in common."""

    @property
    def columns(self):
        return list(self)

    def to_numpy(self):
        return np.column_stack(list(self.values()))


FORMS = {
    "array": lambda points: points,
    "list": lambda points: points.tolist(),
    "list with None": lambda points: np.where(np.isnan(points), None, points).tolist(),
    "masked": np.ma.masked_invalid,
    "frame": frame_of,
    "frame x_mm": lambda points: frame_of(points, "X_mm", "Z_mm"),
    "frame y": lambda points: frame_of(points, "x", "y"),
    "frame y, height": lambda points: frame_of(points, "x", "height").assign(y=12.0),
    "frame of numbered columns": pd.DataFrame,
    "frame of nullable floats": lambda points: frame_of(points).convert_dtypes(),
    "frame of polars": lambda points: PolarsLikeFrame(
        x=points[:, 0], y=np.full(len(points), 5.0), z=points[:, 1]
    ),
    "fortran order": np.asfortranarray,
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_every_form_of_the_points_measures_the_same(form, profile, measured):
    found = lsv.measure_cylinders(form(profile.points), radius=(10, 60))
    assert [c.radius for c in found.cylinders] == [c.radius for c in measured.cylinders]


def test_the_callers_array_is_left_alone(profile):
    points = profile.points.copy()
    lsv.measure_cylinders(points)
    assert points.flags.writeable
    np.testing.assert_array_equal(points, profile.points)


@pytest.mark.parametrize(
    ("points", "kind", "message"),
    [
        (np.zeros((2, 376)), ValueError, r"shape \(n, 2\), got \(2, 376\): transpose them"),
        (np.zeros((9, 3)), ValueError, r"got \(9, 3\): .*points\[:, \[0, 2\]\]"),
        (np.zeros(9), ValueError, r"shape \(n, 2\), got \(9,\)"),
        ("fixtures/pair.csv", TypeError, "got 'fixtures/pair.csv': .*read_profile"),
        (Path("a.csv"), TypeError, "a.csv.*read_profile"),
        ([[0, 1], [2]], TypeError, r"array of numbers in mm, got list \[\[0, 1\], \[2\]\]"),
        ([["0", "1"]], TypeError, r"got list \[\['0', '1'\]\]"),
        (np.zeros((9, 2), complex), TypeError, r"an array of shape \(9, 2\) and type complex128"),
        (None, TypeError, "array of numbers in mm, got NoneType None"),
        (object(), TypeError, "array of numbers in mm, got object"),
        (pd.DataFrame({"x": [0.0], "range": [400.0]}), ValueError, r"x and z .*got x, range"),
        (
            pd.DataFrame({"x": pd.to_datetime(["2026-01-01"]), "z": [-400.0]}),
            TypeError,
            "numbers in mm in the columns x and z",
        ),
        (
            pd.DataFrame({"x": [0.0], "z": [True]}),
            TypeError,
            "numbers in mm in the columns x and z",
        ),
        (
            pd.DataFrame({"x": [0.0], "z": ["far"]}),
            TypeError,
            "numbers in mm in the columns x and z",
        ),
        (pd.DataFrame({"a": [0.0], "b": [1.0], "c": [1.0]}), ValueError, "got a, b, c"),
        (
            pd.DataFrame({"x": [0.0, 0.0], "y": [0.0, 1.0], "z": [5.0, 5.0]}),
            ValueError,
            "one profile, got columns x, y, z with several values of y",
        ),
    ],
)
def test_what_is_no_profile_is_reported_with_what_came(points, kind, message):
    with pytest.raises(kind, match=message):
        lsv.measure_cylinders(points)


def test_a_frame_whose_y_is_one_place_of_the_feed_is_one_profile(profile, measured):
    frame = frame_of(profile.points).assign(y=12.0)
    assert len(lsv.measure_cylinders(frame, radius=(10, 60)).cylinders) == len(measured.cylinders)


@pytest.mark.parametrize("radius", [[10, 60], (10, 60), np.array([10, 60]), (np.int64(10), 60.0)])
def test_a_range_of_radii_is_any_pair(radius, profile, measured):
    found = lsv.measure_cylinders(profile.points, radius=radius)
    assert [c.radius for c in found.cylinders] == [c.radius for c in measured.cylinders]


def test_known_values_are_any_pair(profile):
    def measure(make):
        found = lsv.measure_cylinders(
            profile.points, known_radius=make([25, 5.0]), known_phi=make([0.3, 0.1])
        )
        return [c.radius for c in found.cylinders]

    assert measure(list) == measure(tuple) == measure(np.array)


@pytest.mark.parametrize(
    ("arguments", "kind", "message"),
    [
        ({"radius": "20"}, TypeError, r"radius as a number or \(min, max\) in mm, got str '20'"),
        ({"radius": ["10", "60"]}, TypeError, r"in mm, got list \['10', '60'\]"),
        ({"radius": [1, 2, 3]}, ValueError, r"\(min, max\) in mm, got list \[1, 2, 3\]"),
        ({"radius": {"min": 1}}, TypeError, r"\(min, max\) in mm, got dict"),
        ({"radius": [30, 20]}, ValueError, "0 < min < max"),
        ({"known_radius": [1, 2, 3]}, ValueError, r"known_radius as a number or \(radius, std\)"),
        ({"known_radius": -3}, ValueError, "positive known radius"),
        ({"known_phi": 20}, ValueError, r"got 20: convert degrees by math.* = 0\.349"),
        ({"known_phi": math.pi / 2}, ValueError, r"below pi/2 rad, got 1\.5708"),
        ({"known_phi": (0, 2)}, ValueError, r"the std of known_phi .* got 2: convert degrees"),
        ({"known_phi": -0.1}, ValueError, "known phi from 0 to below"),
        ({"sensor": "lps37"}, ValueError, "a sensor among lps36hi, lps36, got 'lps37'"),
        ({"sensor": 0.05}, TypeError, r"got float 0\.05: ProfileSensor\(range_std=0\.05\)"),
        ({"sensor": lsv.ProfileSensor}, TypeError, "ProfileSensor, another NoiseModel or a name"),
    ],
)
def test_a_slip_in_an_argument_is_reported_with_what_came(arguments, kind, message, profile):
    with pytest.raises(kind, match=message):
        lsv.measure_cylinders(profile, **arguments)


@pytest.mark.parametrize("name", ["lps36hi", "LPS36HI", "LPS 36 HI", "lps-36_hi"])
def test_a_known_sensor_may_be_named(name, profile):
    named = lsv.measure_cylinders(profile, sensor=name)
    given = lsv.measure_cylinders(profile, sensor=lsv.LPS36HI)
    assert [c.radius_std for c in named.cylinders] == [c.radius_std for c in given.cylinders]


@pytest.mark.parametrize("pitch_mm", [0.05, 0.58, 1.6])
def test_metres_are_reported(pitch_mm):
    x = np.arange(-100, 100) * pitch_mm
    points = np.column_stack([x, -400 + 5 * np.cos(x / 20)]) / 1000
    with pytest.warns(UserWarning, match=r"got one of 0\.\d+ mm .* in metres, multiply .* by 1000"):
        lsv.measure_cylinders(points)


@pytest.mark.parametrize(
    ("pitch", "count", "distance"),
    [(0.0025, 3200, 20.0), (0.0025, 200, 0.0), (0.01, 80, 0.1), (0.6, 4, 400.0), (0.6, 376, 400.0)],
    ids=["finest sensor", "a crop of it", "wire of 0.4 mm", "four points", "LPS 36"],
)
def test_small_profiles_in_mm_are_not_taken_for_metres(pitch, count, distance):
    x = (np.arange(count) - count / 2) * pitch
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lsv.measure_cylinders(np.column_stack([x, -distance - 0.01 * x**2]))


def test_no_shipped_profile_is_taken_for_metres():
    for file in sorted((ROOT / "fixtures").rglob("*.csv")):
        for seen in lsv.read_profiles(file):
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                lsv.profile.as_profile(seen)


def test_the_warning_points_to_the_callers_line():
    points = np.column_stack([np.arange(200) * 6e-4, np.full(200, -0.4)])
    with pytest.warns(UserWarning, match="metres") as caught:
        lsv.measure_cylinders(points)
    assert caught[0].filename == __file__


def test_a_scan_takes_arrays_and_matrices():
    folder = ROOT / "fixtures" / "scan_welded_pair"
    profiles = lsv.read_profiles(folder)[:3]
    poses = [lsv.Pose.along((0, 0, 1), 1.0 * k) for k in range(3)]
    usual = lsv.measure_scan(profiles, poses, radius=(10, 25))
    plain = lsv.measure_scan(
        [seen.points.tolist() for seen in profiles],
        np.stack([pose.matrix for pose in poses]),
        radius=[10, 25],
    )
    assert plain.cylinders == usual.cylinders
    assert len(plain.cylinders) == 2
    with pytest.raises(TypeError, match=r"pose 1: expected a Pose or a 4x4 matrix .*from_matrix"):
        lsv.measure_scan(profiles, [poses[0], np.eye(3), poses[2]])
    with pytest.raises(TypeError, match=r"expected points as an \(n, 2\) array"):
        lsv.measure_scan([profiles[0], "a", "b"], poses)


def test_a_section_is_placed_by_matrices(measured):
    mount, flange = lsv.Pose(translation=(0, 80, 120)), lsv.Pose(translation=(800, 0, 300))
    (pipe, *_) = measured.cylinders
    usual = lsv.place_section(pipe, mount, flange)
    assert lsv.place_section(pipe, mount.matrix, flange.matrix.tolist()) == usual
    with pytest.raises(TypeError, match=r"expected a Pose or a 4x4 matrix in mm \(as Pose.from"):
        lsv.place_section(pipe, "flange")


def test_a_folder_or_a_pattern_of_profiles_is_read(tmp_path):
    folder = ROOT / "fixtures" / "scan_welded_pair"
    by_folder = lsv.read_profiles(folder)
    by_pattern = lsv.read_profiles(f"{folder}/*.csv")
    assert len(by_folder) == 20
    assert by_folder == by_pattern == [lsv.read_profile(f) for f in sorted(folder.glob("*.csv"))]
    with pytest.raises(lsv.LsvisionError, match="no profile file in it"):
        lsv.read_profiles(tmp_path)
    with pytest.raises(lsv.LsvisionError, match="no profile file in it"):
        lsv.read_profiles(str(tmp_path / "*.csv"))
    with pytest.raises(lsv.LsvisionError, match="no such file"):
        lsv.read_profiles(tmp_path / "one.csv")


def test_micrometres_are_reported(profile):
    with pytest.warns(UserWarning, match=r"up to 4\.\d+e\+05 mm: .* micrometres, divide"):
        lsv.measure_cylinders(profile.points * 1000)


def test_zeros_of_lost_points_are_reported_and_can_be_named(profile, measured):
    zeros = np.nan_to_num(profile.points)
    lost = int(np.count_nonzero(~zeros.any(axis=1)))
    with pytest.warns(UserWarning, match=rf"\(0, 0\) occurs in {lost} of .* lost=0\)"):
        lsv.Profile(zeros)
    named = lsv.Profile(zeros, lost=0)
    assert named.lost == profile.lost
    assert lsv.measure_cylinders(named, radius=(10, 60)) == measured


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("scans/", "got str 'scans/': lsvision.read_profiles reads files"),
        (lsv.Profile([[0.0, -400.0], [1.0, -400.0]]), "got one Profile: put it into a list"),
        (pd.DataFrame({"x": [0.0, 1.0], "z": [1.0, 1.0]}), "got one DataFrame: put it into a list"),
        (np.array([[0.0, -400.0], [1.0, -400.0]]), "got one ndarray: put it into a list"),
        (None, "got NoneType"),
    ],
)
def test_one_profile_or_a_name_is_no_sequence_of_profiles(given, words):
    for call in (
        lambda: lsv.measure_scan(given, [np.eye(4)]),
        lambda: lsv.measure_many(given, jobs=1),
        lambda: lsv.calibrate_hand_eye_sphere(given, [lsv.Pose.from_matrix(np.eye(4))]),
    ):
        with pytest.raises(TypeError, match="expected a sequence of profiles") as caught:
            call()
        assert words in str(caught.value)


def test_points_are_no_file_name():
    for read in (lsv.read_profile, lsv.read_profiles, lsv.inspect_profiles):
        with pytest.raises(TypeError, match="expected the name of a file, got ndarray"):
            read(np.zeros((3, 2)))


def test_a_job_and_a_measurement_are_not_exchanged(measured):
    job = lsv.Job.load(ROOT / "fixtures" / "jobs" / "welded_pair.toml")
    for pair in ((job, measured), (measured, "job.toml"), (np.zeros((3, 2)), job)):
        with pytest.raises(TypeError, match=r"expected judge\(measurement, job\)"):
            lsv.judge(*pair)


def test_a_file_name_is_no_indentation_of_json(measured):
    with pytest.raises(TypeError, match=r"spaces, got .out.json.: pathlib\.Path"):
        measured.to_json("out.json")


@pytest.mark.parametrize("std", ["0.05", None, 0, float("nan"), -1])
def test_a_noise_that_is_no_positive_number_is_quoted(std):
    with pytest.raises(ValueError, match=f"expected a positive range_std in mm, got {std!r}"):
        lsv.ProfileSensor(range_std=std)


@pytest.mark.parametrize("std", [0.0, 0.001, 0.05])
def test_a_known_radius_is_never_less_certain_than_stated(std):
    tubes = lsv.read_profile(ROOT / "fixtures" / "welded_pair.csv")
    found = lsv.measure_cylinders(tubes, radius=(28, 36), known_radius=(32, std)).cylinders
    (tube,) = found
    low, high = tube.interval("radius")
    assert tube.radius_std <= max(std, 1e-6 * tube.radius)
    assert high - low == pytest.approx(2 * 1.96 * tube.radius_std, rel=0.05)
