"""History of jobs, golden part, calibration files, template, remedies."""

import datetime
import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import lsvision as lsv
from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.inspection.calibration_files import (
    check_calibration_files,
    compute_calibration_age_days,
)
from lsvision.inspection.golden import check_golden, find_blocking_reason
from lsvision.inspection.history import (
    append_record,
    build_history_path,
    describe_unrecorded_change,
    read_records,
    record_revision,
)
from lsvision.inspection.job_template import build_job_text, find_needed_tolerance
from lsvision.inspection.remedies import plan_remedies
from lsvision.measure import measure_cylinders
from lsvision.scan import measure_scan
from lsvision.simulate import (
    SCENE_SENSOR,
    Scene,
    SectionSettings,
    Tube,
    simulate_scan,
    simulate_section,
)

NOW = datetime.datetime(2026, 5, 1, 12, tzinfo=datetime.UTC)
JOB = """
name = "tube"
revision = {revision}
[[part]]
name = "tube"
order = 1
radius_mm = {{ nominal = 19, upper = {upper}, lower = -0.2 }}
[golden]
radius_mm = 19
tolerance_mm = {tolerance}
every_hours = 8
"""


def job_text(revision=1, upper=0.2, tolerance=0.5):
    return JOB.format(revision=revision, upper=upper, tolerance=tolerance)


def job(**values):
    return lsv.Job.from_text(job_text(**values))


@pytest.fixture(scope="module")
def scan():
    """Three sections, 10 mm apart, of a tube of 19 mm tilted by 20 deg."""
    tube = Tube.of(19.0, 0.4, math.radians(20), (0.0, -400.0))
    sensor = replace(SCENE_SENSOR, range_std=0.05)
    poses = [lsv.Pose.along((0, 0, 1), 10.0 * k) for k in (-1, 0, 1)]
    settings = SectionSettings(jump_fraction=0.0)
    sections = simulate_scan(Scene((tube,)), poses, sensor, settings, rng=np.random.default_rng(5))
    return [section.profile for section in sections], poses


def test_a_file_of_other_records_is_named(tmp_path):
    path = tmp_path / "job.toml.history.jsonl"
    append_record(path, {"revision": 1}, "revision")
    message = (
        r"history\.jsonl, line 1: expected a record with 'passed', got one without: name another"
    )
    for use in (lambda: read_records(path, "passed"), lambda: append_record(path, {}, "passed")):
        with pytest.raises(UnreadableFile, match=message):
            use()


def test_a_file_that_only_grows_notices_what_was_changed(tmp_path):
    path = tmp_path / "log.jsonl"
    for number in range(3):
        append_record(path, {"number": number}, "number")
    assert [record["number"] for record in read_records(path, "number")] == [0, 1, 2]
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0].replace("0", "7", 1), *lines[1:]]))
    with pytest.raises(UnreadableFile, match="line 2: the line before it was changed or removed"):
        read_records(path, "number")
    path.write_text("\n".join([lines[0], lines[2]]))
    with pytest.raises(UnreadableFile, match="line 2: the line before it was changed or removed"):
        append_record(path, {"number": 3}, "number")
    path.write_text("nothing\n")
    with pytest.raises(UnreadableFile, match="line 1: expected a record with the hash"):
        read_records(path, "number")


def test_a_record_is_appended_to_a_file_whose_last_line_has_no_end(tmp_path):
    path = tmp_path / "log.jsonl"
    append_record(path, {"number": 0}, "number")
    path.write_text(path.read_text().rstrip("\n"))
    append_record(path, {"number": 1}, "number")
    assert [record["number"] for record in read_records(path, "number")] == [0, 1]


def test_a_revision_stands_for_one_content(tmp_path):
    path = tmp_path / "job.toml"
    assert describe_unrecorded_change(job(), path) is None
    assert record_revision(job(), path, NOW)
    assert not record_revision(job(), path, NOW)
    assert "not in its history (last recorded: revision 1)" in describe_unrecorded_change(
        job(upper=0.3), path
    )
    with pytest.raises(LsvisionError, match="revision 1 is recorded with another content"):
        record_revision(job(upper=0.3), path, NOW)
    assert record_revision(job(revision=2, upper=0.3), path, NOW)
    entries = read_records(build_history_path(path), "revision")
    assert [entry["revision"] for entry in entries] == [1, 2]
    assert entries[0]["job"]["part"][0]["radius_mm"]["upper"] == 0.2


def test_the_golden_part_blocks_until_it_was_measured_rightly(scan):
    found = measure_cylinders(scan[0][1]).cylinders
    assert "never measured" in find_blocking_reason(job(), [], NOW)
    passed = check_golden(found, job(), "golden.csv", NOW)
    assert passed["passed"], passed
    assert find_blocking_reason(job(), [passed], NOW + datetime.timedelta(hours=7)) == ""
    late = find_blocking_reason(job(), [passed], NOW + datetime.timedelta(hours=9))
    assert late == "golden part overdue: measured 9.0 h ago, expected every 8 h"
    early = find_blocking_reason(job(), [passed], NOW - datetime.timedelta(hours=1))
    assert early.endswith("after the present time: set the clock")
    other = lsv.Job.from_text(job_text().replace("radius_mm = 19\n", "radius_mm = 20\n"))
    assert find_blocking_reason(other, [passed], NOW).startswith(
        "golden part of radius 19 mm measured, expected 20 mm"
    )


def test_a_golden_part_outside_a_tolerance_that_was_narrowed_blocks(scan):
    passed = check_golden(measure_cylinders(scan[0][1]).cylinders, job(), "golden.csv", NOW)
    blocked = find_blocking_reason(job(tolerance=0.001), [passed], NOW)
    assert "limits are now 18.999 .. 19.001: lsvision inspect JOB --golden FILE" in blocked
    assert find_blocking_reason(job(tolerance=1.0), [passed], NOW) == ""


@pytest.mark.parametrize("rule", ["level = 0.9999", "extra_std = { radius_mm = 0.1 }"])
def test_a_golden_part_measured_by_a_less_strict_rule_blocks(scan, rule):
    found = measure_cylinders(scan[0][1]).cylinders
    passed = check_golden(found, job(), "golden.csv", NOW)
    strict = lsv.Job.from_text(
        f"{JOB.format(revision=1, upper=0.2, tolerance=1)}[decision]\n{rule}"
    )
    blocked = find_blocking_reason(strict, [passed], NOW)
    assert blocked.startswith("golden part measured with level 0.95 and extra_std 0 mm, now ")
    assert not find_blocking_reason(job(), [check_golden(found, strict, "golden.csv", NOW)], NOW)


@pytest.mark.parametrize(
    ("more", "files", "changed"),
    [
        ("[measure]\nrange_std_mm = 0.05\n", {}, "[measure]"),
        ("[scan]\nfeed = [0, 0, 1]\nstep_mm = 1\n", {}, "[scan]"),
        ("", {"light_section": {"sha256": "ab"}}, "calibration files"),
    ],
)
def test_a_golden_part_measured_by_other_settings_or_calibrations_blocks(
    scan, more, files, changed
):
    found = measure_cylinders(scan[0][1]).cylinders
    other = lsv.Job.from_text(f"{job_text()}{more}")
    passed = json.loads(json.dumps(check_golden(found, job(), "golden.csv", NOW)))
    assert find_blocking_reason(other, [passed], NOW, files) == (
        f"golden part measured with another state of {changed}: lsvision inspect JOB --golden FILE"
    )
    again = json.loads(json.dumps(check_golden(found, other, "golden.csv", NOW, files)))
    assert find_blocking_reason(other, [passed, again], NOW, files) == ""
    earlier_version = {key: value for key, value in passed.items() if key != "measured_by"}
    assert find_blocking_reason(other, [earlier_version], NOW, files) == ""


def test_each_measurement_of_the_golden_part_in_a_run_must_pass(scan):
    found = measure_cylinders(scan[0][1]).cylinders
    passed = check_golden(found, job(), "a.csv", NOW)
    failed = check_golden((), job(), "b.csv", NOW)
    for records in ([passed, failed], [failed, passed]):
        assert find_blocking_reason(job(), records, NOW).startswith("golden part failed")
    later = check_golden(found, job(), "a.csv", NOW + datetime.timedelta(minutes=1))
    now = NOW + datetime.timedelta(minutes=2)
    assert find_blocking_reason(job(), [passed, failed, later], now) == ""


def test_a_golden_part_that_is_not_proved_right_has_failed(scan):
    found = measure_cylinders(scan[0][1]).cylinders
    narrow = job(tolerance=0.001)
    failed = check_golden(found, narrow, "golden.csv", NOW)
    assert not failed["passed"]
    assert find_blocking_reason(narrow, [failed], NOW).startswith(
        "golden part failed at 2026-05-01"
    )
    nothing = check_golden((), job(), "golden.csv", NOW)
    assert nothing["reason"] == "no cylinder was measured"


def test_a_job_without_a_golden_part_forbids_nothing():
    plain = lsv.Job.from_text(JOB.split("[golden]", maxsplit=1)[0].format(revision=1, upper=0.2))
    assert find_blocking_reason(plain, [], NOW) == ""
    with pytest.raises(LsvisionError, match="names no golden part"):
        check_golden((), plain, "golden.csv", NOW)


def test_calibration_files_are_those_of_the_job(tmp_path):
    rig = tmp_path / "rig.json"
    rig.write_text(json.dumps({"provenance": {"date": "2026-04-21T12:00:00+00:00"}}))
    text = 'name = "a"\n[[part]]\nname = "b"\norder = 1\n[rig]\nlight_section = "rig.json"\n'
    path = tmp_path / "job.toml"
    files = check_calibration_files(lsv.Job.from_text(text), path)
    assert compute_calibration_age_days(files, NOW) == pytest.approx(10)
    digest = files["light_section"]["sha256"]
    stated = text + f'light_section_sha256 = "{digest}"\n'
    path.write_text(stated)
    assert check_calibration_files(lsv.Job.load(path), path) == files
    rig.write_text("{}")
    changed = r"job\.toml, line 7: expected rig\.json with SHA-256 .* write light_section_sha256"
    with pytest.raises(LsvisionError, match=changed):
        check_calibration_files(lsv.Job.load(path), path)
    undated = check_calibration_files(lsv.Job.from_text(text), path)
    assert compute_calibration_age_days(undated, NOW) is None


@pytest.mark.parametrize("date", ["2026-04-21T12:00:00", "2026-04-21T12:00:00Z"])
def test_a_calibration_date_without_a_time_zone_is_utc(date):
    assert compute_calibration_age_days({"light_section": {"date": date}}, NOW) == pytest.approx(10)


def test_a_job_from_a_profile_is_passed_by_it():
    section = lsv.simulate.random_section("welded_pair", 520, noise_mm=0.02)
    found = measure_cylinders(section.profile)
    assert len(found.cylinders) == 2
    made = lsv.Job.from_text(build_job_text('a "pair"', found.cylinders, 5.0))
    assert made.name == 'a "pair"'
    verdict = lsv.judge(found, made)
    assert [item.decision for item in verdict.parts] == ["OK", "OK"], str(verdict)


@pytest.mark.parametrize(
    ("name", "written"),
    [("\N{NUT AND BOLT}", "\N{NUT AND BOLT}"), ("a\x7f\n", "a\x7f\n"), ("a\udcff", "a?"),
     ("b" * 99, "b" * 80)],
    ids=["beyond 16 bit", "control", "no text", "long"],
)  # fmt: skip
def test_any_name_of_a_file_becomes_the_name_of_a_job(name, written):
    section = lsv.simulate.random_section("welded_pair", 520, noise_mm=0.02)
    found = measure_cylinders(section.profile).cylinders
    assert lsv.Job.from_text(build_job_text(name, found, 5.0)).name == written


def test_a_job_of_small_tolerances_has_all_digits():
    section = lsv.simulate.random_section("welded_pair", 520, noise_mm=0.02)
    found = measure_cylinders(section.profile).cylinders
    made = lsv.Job.from_text(build_job_text("pair", found, 2e-4))
    for part, cylinder in zip(made.parts, found, strict=True):
        assert abs(part.radius_mm.nominal - cylinder.radius) <= 1e-5
        assert part.radius_mm.upper == 2e-4
    gap = lsv.relate(*found).gap
    assert made.relations[0].gap_mm.max == pytest.approx(max(gap, 0.0) + 2e-4, abs=1e-5)


@pytest.mark.parametrize(
    ("scene", "seed", "noise"),
    [("single", 0, 0.1), ("single", 1, 0.05), ("single", 12, 0.4), ("welded_pair", 10, 0.1)],
)
def test_a_job_of_the_needed_tolerance_is_ok(scene, seed, noise):
    """Although its nominal radius is rounded to another step, and a gap is less certain."""
    section = lsv.simulate.random_section(scene, seed, noise_mm=noise)
    found = measure_cylinders(section.profile)
    narrow = lsv.Job.from_text(build_job_text("tube", found.cylinders, 0.01))
    needed = find_needed_tolerance(narrow, found.cylinders)
    assert needed is not None
    made = lsv.Job.from_text(build_job_text("tube", found.cylinders, needed))
    assert find_needed_tolerance(made, found.cylinders) is None
    assert lsv.judge(found, made).decision == "OK"


def tube_of(radius, half_width):
    return SimpleNamespace(
        radius=radius, radius_std=half_width / 2, phi=0.1, centre=(0.0, -400.0),
        interval=lambda name, level: (radius - half_width, radius + half_width),
    )  # fmt: skip


def test_a_tolerance_is_needed_where_the_rounded_nominal_makes_a_radius_undecided():
    tube = tube_of(23.9548, 0.0965)
    made = lsv.Job.from_text(build_job_text("tube", [tube], 0.1))
    assert made.parts[0].limits["radius_mm"].ends == (23.85, 24.05)
    assert find_needed_tolerance(made, [tube]) == 0.11


def test_the_window_of_a_thin_wire_contains_its_centre():
    (part,) = lsv.Job.from_text(build_job_text("wire", [tube_of(0.04, 1e-4)], 1e-3)).parts
    assert part.x_mm == (-0.04, 0.04)


def test_nothing_is_predicted_for_a_quantity_without_a_value():
    scene = Scene((Tube.of(19.0, 0.4, 0.0, (0.0, -400.0)),))
    sensor = replace(SCENE_SENSOR, range_std=0.1)
    section = simulate_section(scene, sensor, SectionSettings(), rng=np.random.default_rng(0))
    job = lsv.Job.from_text(
        'name = "tube"\n[[part]]\nname = "a"\norder = 1\ntheta_deg = { min = 0, max = 60 }'
    )
    found = measure_cylinders(section.profile)
    assert not found.cylinders[0].theta_determined
    (remedy,) = plan_remedies(lsv.judge(found, job), found, job)
    assert remedy.sections is None
    assert remedy.text.startswith("no prediction")


def test_what_would_decide_is_what_a_scan_then_reaches(scan):
    profiles, poses = scan
    middle = measure_cylinders(profiles[1])
    (tube,) = middle.cylinders
    # A limit as far away as three sections can prove and one cannot.
    limit = tube.radius + 2.5 * tube.radius_std / 2
    text = f'name = "a"\n[[part]]\nname = "b"\norder = 1\nradius_mm = {{ max = {limit} }}\n'
    planned = lsv.Job.from_text(text)
    verdict = lsv.judge(middle, planned)
    assert verdict.decision == "undecided"
    (remedy,) = plan_remedies(verdict, middle, planned)
    assert remedy.sections in (2, 3)
    assert remedy.text.startswith(("two sections 10 mm apart would decide: radius ± 0.0", "three"))
    assert str(remedy) == f"b, radius: {remedy.text}"
    chosen = slice(0, remedy.sections)
    (reached,) = measure_scan(profiles[chosen], poses[chosen]).cylinders
    assert reached.radius_std == pytest.approx(remedy.std, rel=0.5)


def test_a_scan_for_phi_is_proposed_with_the_quantity_that_it_has(scan):
    middle = measure_cylinders(scan[0][1])
    (tube,) = middle.cylinders
    limit = math.degrees(tube.phi + 1.2 * tube.phi_std)
    text = f'name = "a"\n[[part]]\nname = "b"\norder = 1\nphi_deg = {{ max = {limit} }}\n'
    planned = lsv.Job.from_text(text)
    (remedy,) = plan_remedies(lsv.judge(middle, planned), middle, planned)
    assert remedy.sections is not None
    assert remedy.text.endswith("deg (direction_deg in a job with [scan])")


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("", "no scan would decide: the value lies at the limit"),
        (
            "[decision]\nextra_std = { radius_mm = 5.0 }",
            "no scan would decide: the limit is nearer than",
        ),
    ],
)
def test_what_no_scan_decides_is_reported(scan, more, words):
    middle = measure_cylinders(scan[0][1])
    limit = middle.cylinders[0].radius
    text = f'name = "a"\n[[part]]\nname = "b"\norder = 1\nradius_mm = {{ max = {limit} }}\n{more}'
    planned = lsv.Job.from_text(text)
    (remedy,) = plan_remedies(lsv.judge(middle, planned), middle, planned)
    assert remedy.text.startswith(words)
    assert remedy.sections is None


def test_a_remedy_does_not_depend_on_the_origin_of_y(scan):
    """Of a profile in heights above a plane the tube's centre is nearly at y = 0."""
    remedies = []
    for offset in (0.0, 395.0):
        found = measure_cylinders(scan[0][1].points + np.array([0.0, offset]))
        limit = found.cylinders[0].radius + found.cylinders[0].radius_std
        text = f'name = "a"\n[[part]]\nname = "b"\norder = 1\nradius_mm = {{ max = {limit} }}\n'
        planned = lsv.Job.from_text(text)
        remedies += plan_remedies(lsv.judge(found, planned), found, planned)
    at_sensor, at_plane = remedies
    assert at_plane.sections == at_sensor.sections
    assert at_plane.std == pytest.approx(at_sensor.std, rel=0.5)
