"""Results in files say the same as the values, each with its unit in its key."""

import csv
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from lsvision.cylinder.robot_frame import place_section
from lsvision.detection.arcs import Rejection
from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.section import CylinderSection
from lsvision.errors import UnwritableFile
from lsvision.files.file_kinds import STDOUT
from lsvision.geometry import Ellipse, Pose
from lsvision.io.result_files import ResultFiles
from lsvision.io.results import (
    FILE_SCHEMA,
    RECORD_SCHEMA,
    build_input_record,
    build_measurement_record,
)
from lsvision.measure import Measurement
from lsvision.profile import Arc
from lsvision.results.quantities import Estimate, Quantity

NOISE_MM = 0.02


def write_csv(path, records, frame=None):
    files = ResultFiles(None, path, frame)
    files.add(records)
    files.finish()


def write_json(path, records):
    files = ResultFiles(path, None)
    files.add(records)
    files.finish()


@pytest.fixture(scope="module")
def cylinder() -> CylinderSection:
    truth = Ellipse((3.0, -400.0), semi_major=20.0, semi_minor=15.0, theta=0.5)
    t = np.linspace(0.1, 2.9, 80)
    tilt = np.array([[math.cos(0.5), math.sin(0.5)], [-math.sin(0.5), math.cos(0.5)]])
    points = np.column_stack([20 * np.cos(t), 15 * np.sin(t)]) @ tilt + truth.centre
    points += np.random.default_rng(3).normal(0, NOISE_MM, points.shape)
    fit = fit_ellipse(points, truth, np.tile(NOISE_MM**2 * np.eye(2), (80, 1, 1)))
    return CylinderSection(fit, Arc(4, 84), np.arange(4, 84))


@pytest.fixture
def record(cylinder):
    rejected = Rejection(Arc(90, 97), "radial residual 2.1 mm")
    return build_measurement_record(
        Measurement((cylinder,), (rejected,)), source="tube.csv", profile=2
    )


def test_a_record_holds_the_numbers_of_the_cylinder_in_mm_and_deg(record, cylinder):
    (written,) = record["cylinders"]
    assert written["radius_mm"] == cylinder.radius
    assert written["radius_std_mm"] == cylinder.radius_std
    assert written["theta_deg"] == pytest.approx(math.degrees(cylinder.theta))
    assert written["phi_std_deg"] == pytest.approx(math.degrees(cylinder.phi_std))
    assert written["centre_y_mm"] == cylinder.centre[1]
    assert written["centre_y_std_mm"] == pytest.approx(math.sqrt(cylinder.covariance[1, 1]))
    assert written["indices"] == list(range(4, 84))
    assert written["theta_determined"] is True


def test_a_record_holds_the_intervals_of_all_five_quantities(record, cylinder):
    (written,) = record["cylinders"]
    for name in ("radius", "centre_x", "centre_y"):
        assert written[f"{name}_interval_95_mm"] == list(cylinder.interval(name))
    for name in ("theta", "phi"):
        in_deg = np.degrees(cylinder.interval(name))
        np.testing.assert_allclose(written[f"{name}_interval_95_deg"], in_deg)


def test_a_record_names_its_schema_source_and_rejections(record):
    assert (record["schema"], record["source"], record["profile"]) == (RECORD_SCHEMA, "tube.csv", 2)
    assert record["rejections"] == [{"start": 90, "stop": 97, "reason": "radial residual 2.1 mm"}]


def test_every_length_and_angle_names_its_unit(record):
    plain = {"theta_determined", "axis_twins", "indices"}
    (written,) = record["cylinders"]
    assert all(key.endswith(("_mm", "_deg")) for key in set(written) - plain)


def test_a_robots_frame_is_named_and_its_columns_name_their_units(tmp_path, cylinder):
    placed = [place_section(cylinder, Pose(), Pose())]
    record = build_measurement_record(Measurement((cylinder,), ()), placed=placed)
    (first, _) = placed[0]
    assert record["cylinders"][0]["base_frame"]["point_std_mm"] == first.point_std.tolist()
    write_csv(tmp_path / "all.csv", [record], "base")
    (row,) = csv.DictReader((tmp_path / "all.csv").read_text().splitlines())
    ours = {name for name in row if name.startswith("base_")}
    assert len(ours) == 6 + 2 * 4
    directions = {f"base_direction_{sign}_{axis}" for sign in ("plus", "minus") for axis in "xyz"}
    assert all(name.endswith(("_mm", "_deg")) for name in ours - directions)
    assert row["includes_calibration"] == "False"


def test_json_gives_the_records_back(tmp_path, record):
    write_json(tmp_path / "all.json", [record, record])
    document = json.loads((tmp_path / "all.json").read_text())
    assert document == {"schema": FILE_SCHEMA, "measurements": [record, record]}


def test_csv_has_a_row_for_each_cylinder(tmp_path, record):
    nothing = {**record, "cylinders": [], "reason": "flat"}
    write_csv(tmp_path / "all.csv", [record, nothing, record])
    rows = list(csv.DictReader((tmp_path / "all.csv").read_text().splitlines()))
    (written,) = record["cylinders"]
    assert len(rows) == 3
    empty = {name: cell for name, cell in rows.pop(1).items() if cell}
    assert empty == {"source": "tube.csv", "profile": "2", "reason": "flat"}
    assert float(rows[1]["phi_deg"]) == written["phi_deg"]
    assert float(rows[0]["radius_high_95_mm"]) == written["radius_interval_95_mm"][1]
    assert (rows[0]["source"], rows[0]["points"]) == ("tube.csv", "80")


def test_a_number_that_does_not_exist_is_null(tmp_path, record):
    unknown = Estimate(Quantity("theta", "deg"), 28.6, math.inf, (0.0, math.nan))
    record["cylinders"][0] |= unknown.record
    write_json(tmp_path / "r.json", [record])
    (written,) = json.loads((tmp_path / "r.json").read_text())["measurements"][0]["cylinders"]
    assert written["theta_std_deg"] is None
    assert written["theta_interval_95_deg"] == [0.0, None]


@pytest.mark.parametrize("write", [write_json, write_csv])
def test_results_that_cannot_be_written_name_the_file(tmp_path, record, write):
    with pytest.raises(UnwritableFile, match="none/all: its folder does not exist"):
        write(tmp_path / "none" / "all", [record])


def with_attributes(record, **attributes):
    return record | {"input": {"attributes": attributes}}


def test_what_a_file_says_stands_before_the_reason(tmp_path, record):
    without = {"source": "b.csv", "profile": 0, "cylinders": [], "reason": "flat"}
    records = [
        with_attributes(record, part="=1+1", reason="shift"),
        with_attributes(without, part="-5", encoder=2.5),
    ]
    write_csv(tmp_path / "out.csv", records)
    header, *_ = (tmp_path / "out.csv").read_text().splitlines()
    assert header.endswith(",part,reason_in_file,encoder,reason")
    first, second = csv.DictReader((tmp_path / "out.csv").read_text().splitlines())
    assert (first["part"], first["reason_in_file"], first["encoder"]) == ("'=1+1", "shift", "")
    assert (first["reason"], second["reason"]) == ("", "flat")
    assert (second["part"], second["encoder"], second["radius_mm"]) == ("-5", "2.5", "")


def test_a_column_that_comes_late_is_given_to_the_rows_before(tmp_path, record, capsys):
    late = with_attributes(record, part="P7", encoder=1.5)
    for name, rows in (("late.csv", [record, late]), ("early.csv", [late, record])):
        files = ResultFiles(None, tmp_path / name)
        for row in rows:
            files.add([row])
        files.finish()
    late_rows, early_rows = (
        list(csv.DictReader((tmp_path / name).read_text().splitlines()))
        for name in ("late.csv", "early.csv")
    )
    assert late_rows == early_rows[::-1]
    assert [row["encoder"] for row in late_rows] == ["", "1.5"]
    stream = ResultFiles(None, STDOUT)
    stream.add([record])
    stream.add([late])
    stream.finish()
    header, *lines = csv.reader(capsys.readouterr().out.splitlines())
    assert "encoder" not in header
    assert [len(line) for line in lines] == [len(header)] * 2


def test_attributes_that_are_no_numbers_are_null_in_json(tmp_path, record):
    file = SimpleNamespace(
        reader="text", units="mm", units_assumed=False, flipped=False, markers=(),
        profiles=[SimpleNamespace(lost=0)], attributes=({"time": math.nan, "part": "P7"},),
    )  # fmt: skip
    read = build_input_record(file, 0)
    assert read["attributes"] == {"time": None, "part": "P7"}
    write_json(tmp_path / "out.json", [record | {"input": read}])


@pytest.mark.parametrize("spool", [10, 10**7])
def test_a_long_file_lies_on_the_disk_and_reads_the_same(tmp_path, monkeypatch, spool):
    """With a column that comes later, for which all rows are written again."""
    monkeypatch.setattr("lsvision.io.result_files.SPOOL_BYTES", spool)
    files = ResultFiles(tmp_path / "o.json", tmp_path / "o.csv")
    for number in range(3):
        reading = {"attributes": {"part": f"A{number}"}} if number == 2 else None
        record = build_measurement_record(
            Measurement((), ()), source="a,\n.csv", profile=number, reading=reading, reason="flat"
        )
        files.add([record])
    files.finish()
    with (tmp_path / "o.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["profile"], row["part"], row["reason"]) for row in rows] == [
        ("0", "", "flat"), ("1", "", "flat"), ("2", "A2", "flat"),
    ]  # fmt: skip
    assert {row["source"] for row in rows} == {"a,\n.csv"}
    document = json.loads((tmp_path / "o.json").read_text())
    assert [record["profile"] for record in document["measurements"]] == [0, 1, 2]


def test_columns_of_attributes_are_distinct_and_no_formulas(tmp_path, record):
    values = {"reason": 1, "reason_in_file": 2, "reason_in_file_in_file": 3, "=x": 4}
    write_csv(tmp_path / "o.csv", [with_attributes(record, **values)])
    header, row = csv.reader((tmp_path / "o.csv").read_text().splitlines())
    assert len(set(header)) == len(header)
    assert row[-5:-1] == ["1", "2", "3", "4"]
    assert header[-2:] == ["'=x", "reason"]


def test_a_column_may_come_after_a_long_text(tmp_path, record):
    files = ResultFiles(None, tmp_path / "o.csv")
    files.add([with_attributes(record, image="0" * 200_000)])
    files.add([with_attributes(record, part="P7")])
    files.finish()
    first, second = (tmp_path / "o.csv").read_text().splitlines()[1:]
    assert len(first) > 200_000
    assert ",P7," in second
