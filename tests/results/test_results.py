"""Every result: one line as repr, a table as str, a notebook's view, records and data frames."""

import csv
import inspect
import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
import pytest

import lsvision as lsv
from lsvision.calibration.board_in_plane import BoardInPlane
from lsvision.calibration.bundle_adjustment_problem import LaserView
from lsvision.calibration.intrinsics import CalibratedView, CameraCalibration
from lsvision.calibration.laser_plane_result import CalibratedLaserView, LaserPlaneCalibration
from lsvision.calibration.lens_blur import LensBlur
from lsvision.calibration.observations import RejectedPose, Sphere
from lsvision.calibration.pose_planning import PosePlan
from lsvision.calibration.target import TargetView
from lsvision.calibration.views import RejectedView
from lsvision.inspection.gauge_study import study_gauge
from lsvision.inspection.repeat_study import study_repeats
from lsvision.io.result_files import ResultFiles
from lsvision.io.results import build_measurement_record
from lsvision.results.picture import draw_svg
from lsvision.results.result import Result
from lsvision.scan import ScanRejection
from tests.scripts import output_of_python

ROOT = Path(__file__).parents[2]
CAMERA = lsv.Camera([[600, 0, 32], [0, 600, 24], [0, 0, 1]], [0.1, 0, 0, 0], (64, 48))
RIG = lsv.LightSection(CAMERA, lsv.Plane((0.0, 0.866, 0.5), 150.0))


def measured():
    profile = lsv.read_profile(ROOT / "fixtures" / "welded_complex.csv")
    return lsv.measure_cylinders(profile)


def scanned():
    profiles = lsv.read_profiles(ROOT / "fixtures" / "scan_welded_pair")[::5]
    poses = [lsv.Pose.along((0, 0, 1), 5.0 * k) for k in range(len(profiles))]
    return lsv.measure_scan(profiles, poses)


def hand_eye():
    return lsv.HandEye(
        mount_from_sensor=lsv.Pose(translation=(0.0, 80.0, 120.0)),
        covariance=np.diag([0.01, 0.01, 0.01, 1e-8, 1e-8, 1e-8]),
        residuals=[0.1, 0.2, np.nan],
        leave_one_out_residuals=[0.11, 0.22, np.nan],
        rejected=(RejectedPose(2, "no sphere found"),),
        target=Sphere((800.0, 0.0, 300.0), 20.0, 0.0),
        working_point=(0.0, -150.0, 0.0),
        robot_std=(0.05, 1e-4),
        ambiguity_ratio=math.inf,
        least_determined_std=0.1,
        least_determined_direction="along x",
        mounting="eye_in_hand",
        sensor="section",
        height_scale=(1.02, 0.001),
    )


def camera_calibration():
    seen = TargetView(np.ones((4, 3)), np.ones((4, 2)), (64, 48))
    view = CalibratedView(0, seen, lsv.Pose(), np.ones((4, 2)))
    std = {"fx": 0.5, "fy": 0.5, "cx": 0.3, "cy": 0.3, "k1": 0.01, "k2": 0, "p1": 0, "p2": 0}
    rejected = (RejectedView(3, "no board"),)
    return CameraCalibration(CAMERA, std, (view,), rejected, (), ("few views",))


def laser_plane():
    seen = LaserView(np.ones((4, 3)), np.ones((4, 2)), np.ones((9, 2)), np.ones(9))
    view = CalibratedLaserView(0, seen, lsv.Pose(), np.ones((4, 2)), np.ones(9))
    return LaserPlaneCalibration(
        RIG, np.diag([1e-8, 1e-8, 1e-4]), (view,), np.zeros(2), np.zeros(2), (), (), ()
    )


def verdict():
    job = lsv.Job.from_text('name = "a"\n[[part]]\nname = "b"\norder = 2\nphi_deg = { max = 90 }')
    return lsv.judge(MEASURED, job)


MEASURED, SCANNED = measured(), scanned()
JUDGED = verdict()
RESULTS = {
    "Measurement": MEASURED,
    "CylinderSection": MEASURED.cylinders[1],
    "Rejection": MEASURED.rejections[0],
    "Measurement of nothing": lsv.measure_cylinders([[0.0, -400.0], [1.0, -400.0]]),
    "ScanMeasurement": SCANNED,
    "ScannedCylinder": SCANNED.cylinders[0],
    "ScanRejection": ScanRejection((1, 2, 4), "too short"),
    "CylinderShape": lsv.measure_shape(SCANNED.cylinders[0]),
    "CylinderFit": SCANNED.cylinders[0].fit,
    "PlacedCylinder": lsv.place_section(MEASURED.cylinders[1], hand_eye(), lsv.Pose())[0],
    "SectionPrediction": lsv.plan_section(19.0, 0.3, 0.3),
    "ScanPrediction": lsv.plan_scan(19.0, 0.3, 0.3),
    "HandEye": hand_eye(),
    "CameraCalibration": camera_calibration(),
    "LaserPlaneCalibration": laser_plane(),
    "BoardInPlane": BoardInPlane(RIG, np.ones((4, 2))),
    "LensBlur": LensBlur(0.7, 0.02, 40),
    "Verdict": JUDGED,
    "ItemVerdict": JUDGED.parts[0],
    "QuantityVerdict": JUDGED.parts[0].quantities[0],
    "Relation": lsv.relate(*MEASURED.cylinders),
    "GaugeStudy": study_gauge(np.random.default_rng(1).normal(0, 1, (4, 3, 2)), tolerance=9.0),
    "RepeatStudy": study_repeats([19.0, 19.1, 18.9], 19.0, tolerance=1.0),
    "PosePlan": PosePlan((lsv.Pose(), lsv.Pose()), (3, 1), np.array([0.2, 0.1]), np.ones(2)),
}
UNITS = ("_mm", "_deg", "_px", "_mm_per_mm")
WITHOUT_UNIT = {
    "theta_determined", "points", "frame", "includes_calibration", "ambiguous", "sections",
    "section", "edges", "views", "index", "mounting", "sensor", "height_scale",
    "degrees_of_freedom", "k1", "k1_std", "k2", "k2_std", "p1", "p1_std", "p2", "p2_std",
    "height_scale_std", "target_scale", "target_scale_std", "normal_x", "normal_y", "normal_z",
    "direction_x", "direction_y", "direction_z", "start", "stop", "reason",
    # Of a verdict the unit stands in the column `quantity`; a study has that of its values.
    "schema", "decision", "passed", "job", "revision", "job_hash", "version", "item", "name",
    "item_decision", "quantity", "value", "std", "low", "high", "level", "min", "max",
    "margin_sigmas", "quantity_decision", "cylinder", "interaction_pooled", "distinct_categories",
    "note", "count", "mean", "reference", "bias", "p_value", "predicted_std", "tolerance", "cg",
    "cgk", "bias_low", "bias_high", "std_low", "std_high", "component", "variance",
    "percent_of_total", "percent_of_tolerance",
}  # fmt: skip
every_result = pytest.mark.parametrize("result", RESULTS.values(), ids=RESULTS)


def test_every_kind_of_result_is_here():
    def kinds(base):
        return {kind for sub in base.__subclasses__() for kind in {sub} | kinds(sub)}

    concrete = {
        kind
        for kind in kinds(Result)
        if not inspect.isabstract(kind) and not kind.__name__.startswith("_")
    }
    assert {type(result) for result in RESULTS.values()} == concrete


@every_result
def test_the_repr_is_one_line_that_names_the_class(result):
    text = repr(result)
    assert text.startswith(f"<{type(result).__name__}: ")
    assert "\n" not in text
    assert len(text) < 240
    assert "array" not in text


@every_result
def test_print_shows_more_than_the_repr(result):
    shown = str(result)
    assert shown
    assert shown != repr(result)
    assert shown == shown.rstrip()


@every_result
def test_a_notebook_gets_well_formed_html(result):
    view = ET.fromstring(f"<div>{result._repr_html_()}</div>")
    assert len(view) >= 1


@every_result
def test_the_record_is_json_and_the_json_is_the_record(result):
    assert json.loads(result.to_json()) == result.to_dict()
    assert "\n" in result.to_json(indent=2) or len(result.to_dict()) == 0


@every_result
def test_every_column_of_the_frame_names_its_unit(result):
    frame = result.to_dataframe()
    assert isinstance(frame, pd.DataFrame)
    plain = [name for name in frame.columns if not name.endswith(UNITS)]
    assert set(plain) <= WITHOUT_UNIT


@every_result
def test_a_result_is_equal_to_its_like_alone(result):
    import copy

    other = copy.deepcopy(result)
    assert result == other
    assert hash(result) == hash(other)
    assert all(result != each for each in RESULTS.values() if each is not result)


def test_the_frame_of_a_relation_has_the_ends_of_its_intervals():
    relation = RESULTS["Relation"]
    (row,) = relation.to_dataframe().to_dict("records")
    assert (row["gap_low_95_mm"], row["gap_high_95_mm"]) == relation.interval("gap")


@pytest.mark.parametrize("unknown", [slice(1), slice(6)])
def test_coordinates_that_are_not_finite_keep_their_columns(unknown):
    placed = RESULTS["PlacedCylinder"]
    variances = placed.covariance.diagonal().copy()
    variances[unknown] = math.inf
    uncertain = replace(placed, covariance=np.diag(variances))
    (row,) = uncertain._list_rows()
    assert list(row) == list(placed._list_rows()[0])
    assert row["point_std_x_mm"] is None
    assert json.loads(uncertain.to_json())["point_std_mm"][0] is None


def test_the_table_of_a_measurement_is_that_of_the_command():
    lines = str(MEASURED).splitlines()
    assert lines[0].split("  ")[0] == ""
    assert "radius mm" in lines[0]
    first = MEASURED.cylinders[0]
    assert lines[1].split()[:4] == ["1", f"{first.radius:.2f}", "±", f"{first.radius_std:.2f}"]
    assert lines[2].split()[:2] == ["95", "%"]
    assert lines[-1] == "7 arcs rejected: see .rejections"


def test_a_measurement_without_cylinders_says_why():
    nothing = RESULTS["Measurement of nothing"]
    assert str(nothing).splitlines()[0] == "no cylinder found, 1 arc rejected"
    assert "too few points" in str(nothing)
    assert "too few points" in nothing._repr_html_()
    assert nothing.to_dataframe().empty


def test_the_frame_has_the_columns_and_numbers_of_the_csv(tmp_path):
    files = ResultFiles(None, tmp_path / "all.csv")
    files.add([build_measurement_record(MEASURED)])
    files.finish()
    rows = list(csv.reader((tmp_path / "all.csv").read_text().splitlines()))
    frame = MEASURED.to_dataframe()
    assert list(frame.columns) == rows[0][3:-1]  # the reason stands last
    for place in range(2):
        assert [str(value) for value in frame.iloc[place]] == rows[1 + place][3:-1]


def test_the_record_is_that_of_the_command():
    written = build_measurement_record(MEASURED, source="a.csv")
    assert {key: written[key] for key in ("cylinders", "rejections")} == MEASURED.to_dict()


@pytest.mark.parametrize("name", ["radius", "theta", "phi", "centre_x", "centre_y"])
def test_every_quantity_is_that_of_the_properties_in_its_unit(name):
    section = MEASURED.cylinders[1]
    unit, scale = ("deg", 180 / math.pi) if name in ("theta", "phi") else ("mm", 1.0)
    values = {"centre_x": section.centre[0], "centre_y": section.centre[1]}
    value = values[name] if name in values else getattr(section, name)
    record = section.to_dict()
    assert record[f"{name}_{unit}"] == pytest.approx(value * scale, rel=1e-12)
    interval = [end * scale for end in section.interval(name)]
    assert record[f"{name}_interval_95_{unit}"] == pytest.approx(interval, rel=1e-12)


def test_the_picture_shows_the_profile_and_each_cylinder_upright():
    view = ET.fromstring(f"<div>{MEASURED._repr_html_()}</div>")
    svg = next(child for child in view if child.tag.endswith("svg"))
    assert [text.text for text in svg if text.tag.endswith("text")] == ["1", "2"]
    heights = [float(text.get("y")) for text in svg if text.tag.endswith("text")]
    centres = [cylinder.centre[1] for cylinder in MEASURED.cylinders]
    assert (heights[0] > heights[1]) == (centres[0] < centres[1])
    dots = [path for path in svg if path.get("stroke-linecap") == "round"]
    assert len(dots) == 3
    assert dots[0].get("d").count("M") == len(MEASURED.profile) - MEASURED.profile.lost


@pytest.mark.parametrize("points", [[[0.0, 5.0], [99.0, 5.0]], [[5.0, 0.0], [5.0, 99.0]]])
def test_the_picture_of_a_straight_line_has_a_width_and_a_height(points):
    svg = ET.fromstring(draw_svg(np.array(points), [], "a line"))
    assert min(int(svg.get("width")), int(svg.get("height"))) >= 10


def test_words_in_html_are_escaped():
    report = lsv.Rejection(lsv.Arc(0, 3), "<b> & more")._repr_html_()
    assert "&lt;b&gt; &amp; more" in report


def test_results_of_other_numbers_differ():
    assert MEASURED.cylinders[0] != MEASURED.cylinders[1]
    fresh = lsv.measure_cylinders(MEASURED.profile)
    assert fresh == MEASURED
    assert len({fresh, MEASURED, lsv.measure_cylinders(MEASURED.profile, radius=(22, 27))}) == 2


def test_where_a_measurement_came_from_does_not_count():
    assert lsv.Measurement(MEASURED.cylinders, MEASURED.rejections) == MEASURED


def test_axis_candidates_are_the_twins():
    section = MEASURED.cylinders[1]
    np.testing.assert_array_equal(section.axis_candidates, section.axis_twins)
    assert section.axis_candidates.shape == (2, 3)
    np.testing.assert_allclose(section.axis_candidates[:, 2], math.cos(section.phi))


@pytest.mark.parametrize("level", [0.5, 0.95, 0.999])
def test_the_interval_of_a_scanned_radius_is_students(level):
    from scipy.stats import t

    tube = SCANNED.cylinders[0]
    half = t.ppf((1 + level) / 2, tube.fit.degrees_of_freedom) * tube.radius_std
    expected = (tube.radius - half, tube.radius + half)
    np.testing.assert_allclose(tube.interval("radius", level), expected, rtol=1e-9)


def test_the_intervals_of_point_and_direction_are_those_of_the_covariance():
    tube = SCANNED.cylinders[0]
    basis = np.kron(np.eye(2), tube.fit.tangent_basis)  # (4, 6)
    std = np.sqrt(np.diag(basis.T @ tube.covariance[:4, :4] @ basis))
    low, high = tube.interval("radius")
    sigmas = (high - low) / 2 / tube.radius_std
    for name, value, s in zip(
        [*(f"point_{axis}" for axis in "xyz"), *(f"direction_{axis}" for axis in "xyz")],
        [*tube.point, *tube.direction],
        std,
        strict=True,
    ):
        np.testing.assert_allclose(tube.interval(name), (value - sigmas * s, value + sigmas * s))


def test_the_intervals_of_many_scans_have_their_coverage():
    scene = lsv.simulate.Scene((lsv.simulate.Tube.of(19.0, 0.3, 0.35, (0.0, -400.0)),))
    poses = [lsv.Pose.along((0, 0, 1), 10.0 * k) for k in range(2)]
    inside = 0
    for seed in range(40):
        seen = lsv.simulate.simulate_scan(
            scene, poses, lsv.simulate.SCENE_SENSOR, lsv.simulate.SectionSettings(),
            rng=np.random.default_rng(seed),
        )  # fmt: skip
        (tube,) = lsv.measure_scan([section.profile for section in seen], poses).cylinders
        low, high = tube.interval("radius", 0.8)
        inside += low < 19.0 < high
    assert 22 <= inside <= 40  # 32 expected, sd 2.5


@pytest.mark.parametrize(
    ("quantity", "level", "message"),
    [
        ("theta", 0.95, "quantity among radius, point_x.*got 'theta'"),
        ("radius", 95, "between 0 and 1, got 95"),
    ],
)
def test_an_interval_of_nothing_is_rejected(quantity, level, message):
    with pytest.raises(ValueError, match=message):
        SCANNED.cylinders[0].interval(quantity, level)


def test_without_pandas_the_remedy_is_reported(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r"pip install 'lsvision\[dataframe\]'"):
        MEASURED.to_dataframe()


def test_pandas_is_imported_for_frames_only():
    code = (
        "import sys, lsvision as lsv\n"
        "m = lsv.measure_cylinders([[0, -400], [1, -400]])\n"
        "str(m), m.to_json(), m._repr_html_()\n"
        "print('pandas' in sys.modules, 'matplotlib' in sys.modules)"
    )
    assert output_of_python(code).split() == ["False", "False"]


def test_ipython_shows_the_html():
    formatters = pytest.importorskip("IPython.core.formatters")
    shown = formatters.HTMLFormatter()(MEASURED)
    assert shown.startswith("<table>")
    assert "<svg" in shown
