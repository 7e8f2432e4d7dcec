"""``lsvision inspect`` and ``job``: tables, files, exit codes, messages."""

import csv
import html
import io
import itertools
import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from lsvision.inspection.job import Job

FIXTURES = Path(__file__).parents[2] / "fixtures"
EXPECTED = json.loads((FIXTURES / "jobs" / "expected.json").read_text())

JOB = """
name = "tube"
[measure]
radius_mm = [10, 30]
[[part]]
name = "tube"
order = 1
radius_mm = { LIMITS }
"""
INSIDE, AT, OUTSIDE = "min = 17, max = 21", "max = 19", "max = 17"


@pytest.fixture
def job(tmp_path):
    def write(limits, more=""):
        path = tmp_path / "job.toml"
        path.write_text(JOB.replace("LIMITS", limits) + more)
        return path

    return write


@pytest.fixture
def profile(written, pipe):
    return written(pipe, "part_0.csv")


@pytest.mark.parametrize(
    ("name", "source"),
    [("welded_pair", "welded_pair.csv"), ("scan_welded_pair", "scan_welded_pair")],
)
def test_the_jobs_of_the_fixtures_are_judged_as_their_truth_demands(run, name, source, tmp_path):
    out = tmp_path / "out.json"
    path = FIXTURES / "jobs" / f"{name}.toml"
    done = run("inspect", path, FIXTURES / source, "--json", out)
    assert done.exit_code == 3, done.output
    (verdict,) = json.loads(out.read_text())["verdicts"]
    found = {
        item["name"]: {each["quantity"]: each for each in item["quantities"]}
        for item in (*verdict["parts"], *verdict["relations"])
    }
    assert {name: set(item) for name, item in found.items()} == {
        item: set(keys) for item, keys in EXPECTED[name].items()
    }
    for item, keys in EXPECTED[name].items():
        for key, (decision, truth) in keys.items():
            each = found[item][key]
            assert each["decision"] == decision, (item, key, each)
            if truth is not None:
                least, most = each["min"] or -np.inf, each["max"] or np.inf
                right = "OK" if least <= truth <= most else "NG"
                assert decision in (right, "undecided")


@pytest.mark.parametrize(("limits", "code"), [(INSIDE, 0), (OUTSIDE, 3), (AT, 4)])
def test_the_exit_code_is_that_of_the_verdict(run, job, profile, limits, code):
    done = run("inspect", job(limits), profile)
    assert done.exit_code == code, done.output
    word = {0: "OK", 3: "NG", 4: "undecided"}[code]
    assert done.stdout.startswith(f"{profile}: {word}\n")


def test_many_files_are_summed_up_and_a_bad_one_does_not_stop_the_rest(
    run, job, written, pipe, tmp_path
):
    for number in range(2):
        written(pipe, f"parts/part_{number}.csv")
    (tmp_path / "parts" / "part_2.csv").write_text("nothing here\n")
    outputs = [tmp_path / f"v.{suffix}" for suffix in ("csv", "json", "html")]
    options = zip(("--csv", "--json", "--report"), outputs, strict=True)
    done = run("inspect", job(INSIDE), tmp_path / "parts", *itertools.chain(*options))
    assert done.exit_code == 1
    (reason,) = json.loads(outputs[1].read_text())["not_judged"]
    assert reason.startswith(f"{tmp_path / 'parts' / 'part_2.csv'}: ")
    assert f"not judged: {reason}" in html.unescape(outputs[2].read_text())
    assert "2 judged: 2 OK, 0 NG, 0 undecided, 1 could not be judged" in done.stdout
    assert "part_2.csv" in done.stderr
    rows = list(csv.DictReader(io.StringIO((tmp_path / "v.csv").read_text())))
    assert [row["item_decision"] for row in rows] == ["OK", "OK"]
    assert float(rows[0]["low"]) < float(rows[0]["value"]) < float(rows[0]["high"])


def test_csv_and_json_go_to_standard_output_and_parquet_to_a_file(run, job, profile, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    done = run("inspect", job(INSIDE), profile, "--csv", "-", "--parquet", tmp_path / "v.parquet")
    (row,) = csv.DictReader(io.StringIO(done.stdout))
    table = parquet.read_table(tmp_path / "v.parquet").to_pylist()
    assert table[0]["quantity"] == row["quantity"] == "radius_mm"
    assert table[0]["value"] == float(row["value"])
    assert "tube" in done.stderr


def test_the_report_is_one_page_without_anything_from_elsewhere(run, job, written, pipe, tmp_path):
    paths = [written(pipe * (1 + step / 1000), f"part_{step}.csv") for step in (0, 1, 2)]
    page = tmp_path / "report.html"
    done = run("inspect", job(INSIDE), *paths, "--report", page)
    assert done.exit_code == 0, done.output
    text = page.read_text()
    assert text.count("<svg") == 4  # one trend, three profiles
    assert "3 measurements" in text
    assert "ISO 22514-7 is not claimed" in text
    assert re.search(r"Cpk</dt>\s*<dd>[^<]*95 % interval", text)
    assert "src=" not in text
    assert "<link" not in text
    assert Job.load(tmp_path / "job.toml").hash in text


def test_the_golden_part_comes_first(run, job, profile, tmp_path):
    path = job(INSIDE, "[golden]\nradius_mm = 19\ntolerance_mm = 1\nevery_hours = 8\n")
    before = run("inspect", path, profile)
    assert before.exit_code == 4
    assert "golden part never measured" in before.stdout
    check = run("inspect", path, profile, "--golden")
    assert check.exit_code == 0
    assert "golden part passed: radius" in check.stdout
    assert run("inspect", path, profile).exit_code == 0
    log = (tmp_path / "job.toml.golden.jsonl").read_text().splitlines()
    assert [json.loads(line)["passed"] for line in log] == [True]


def test_a_golden_part_that_is_missing_has_not_passed(run, job, profile, tmp_path):
    path = job(INSIDE, "[golden]\nradius_mm = 19\ntolerance_mm = 1\nevery_hours = 8\n")
    none = run("inspect", path, tmp_path / "golden*.csv", "--golden")
    some = run("inspect", path, tmp_path / "golden*.csv", profile, "--golden")
    assert none.exit_code == some.exit_code == 1
    assert "golden part passed" in some.stdout
    with_output = run("inspect", path, profile, "--golden", "--csv", "-")
    assert with_output.exit_code == 2
    assert "expected --golden without output files" in with_output.stderr


def test_a_lost_section_of_a_scan_does_not_cost_the_scan(run, tmp_path):
    folder, lost = tmp_path / "scan", tmp_path / "lost"
    shutil.copytree(FIXTURES / "scan_welded_pair", folder)
    lost.mkdir()
    for path in (folder / "section_07.csv", lost / "section_00.csv"):
        path.write_text("x,z\n1,nan\n2,nan\n3,nan\n")
    job = FIXTURES / "jobs" / "scan_welded_pair.toml"
    done = run("inspect", job, folder)
    assert done.exit_code == 3, done.output  # as with all sections
    assert "section_07.csv: note: all points are lost: a section without points" in done.stderr
    none = run("inspect", job, lost)
    assert none.exit_code == 1
    assert "all points of all sections (1) are lost" in none.stderr


def test_a_golden_file_that_cannot_be_read_costs_no_other_check(run, job, profile, tmp_path):
    path = job(INSIDE, "[golden]\nradius_mm = 19\ntolerance_mm = 1\nevery_hours = 8\n")
    done = run("inspect", path, tmp_path / "missing.csv", profile, "--golden")
    assert done.exit_code == 1
    assert f"{tmp_path / 'missing.csv'}: no such file" in done.stderr
    assert "part_0.csv: golden part passed" in done.stdout
    assert len((tmp_path / "job.toml.golden.jsonl").read_text().splitlines()) == 1
    done = run("inspect", job(INSIDE), profile, "--golden")
    assert done.exit_code == 1
    assert "the job names no golden part: add a [golden] table" in done.stderr


def test_a_limit_that_a_profile_does_not_have_is_reported_with_the_file(run, job, profile):
    path = job("max = 21 }\nbow_mm = { max = 1")
    done = run("inspect", path, profile)
    assert done.exit_code == 1
    assert "for a profile, got bow_mm of part 'tube': a scan has it" in done.stderr


def test_a_changed_calibration_file_is_rejected(run, job, profile, tmp_path):
    (tmp_path / "rig.json").write_text("{}")
    path = job(INSIDE, '[rig]\nlight_section = "rig.json"\nlight_section_sha256 = "00"\n')
    done = run("inspect", path, profile)
    assert done.exit_code == 1
    assert "line 11: expected rig.json with SHA-256 00..., got" in done.stderr


def test_images_are_judged_through_the_rig_of_the_job(run, tmp_path):
    rig = FIXTURES / "images" / "rig.json"
    path = tmp_path / "job.toml"
    path.write_text(
        f'name = "image"\n[rig]\nlight_section = "{rig}"\n[[part]]\nname = "pipe"\norder = 1\n'
        "radius_mm = { nominal = 25, upper = 1, lower = -1 }\n"
    )
    done = run("inspect", path, FIXTURES / "images" / "single.png", "--json", tmp_path / "v.json")
    assert done.exit_code == 0, done.output
    (verdict,) = json.loads((tmp_path / "v.json").read_text())["verdicts"]
    assert len(verdict["calibration"]["light_section"]["sha256"]) == 64
    done = run("inspect", path, FIXTURES / "images" / "single.png", "--units", "um")
    assert done.exit_code == 2
    assert "expected profiles with options for reading them, such as --units" in done.stderr


def test_a_report_of_another_kind_is_a_usage_error(run, job, profile, tmp_path):
    done = run("inspect", job(INSIDE), profile, "--report", tmp_path / "report.docx")
    assert done.exit_code == 2
    assert "expected --report F.html, got 'report.docx'" in done.stderr


def test_a_scan_needs_poses(run, job, profile):
    done = run("inspect", job(INSIDE, "[scan]\n"), profile)
    assert done.exit_code == 1
    assert "job.toml: [scan] and [rig]: expected feed and step_mm, or poses and conv" in done.stderr
    done = run("inspect", job(INSIDE, "[scan]\nfeed = [0, 0, 1]\nstep_mm = 1e12\n"), profile)
    assert "[scan] and [rig]: expected step_mm other than 0, at most 100000, got 1" in done.stderr


def test_job_check_says_every_slip_or_what_the_job_is(run, job):
    good = run("job", "check", job(INSIDE))
    assert good.exit_code == 0
    assert "tube, revision 1, hash " in good.stdout
    bad = run("job", "check", job("min = 21, max = 17 }\nphi = { max = 1"))
    assert bad.exit_code == 1
    first, second = bad.stderr.splitlines()
    assert "line 8: part 1, radius_mm: limits reversed" in first
    assert "line 9: part 1, phi: the unit is missing: write phi_deg" in second


def test_job_check_records_revisions(run, job, profile):
    path = job(INSIDE)
    assert "recorded in job.toml.history.jsonl" in run("job", "check", path, "--record").stdout
    assert "is already in" in run("job", "check", path, "--record").stdout
    job(OUTSIDE)
    assert "not in its history" in run("job", "check", path).stdout
    assert "not in its history" in run("inspect", path, profile).stderr
    result = run("job", "check", path, "--record")
    assert result.exit_code == 1
    assert "revision 1 is recorded with another content" in result.stderr


def test_job_new_writes_a_job_that_its_profile_passes(run, profile, tmp_path):
    path = tmp_path / "new.toml"
    done = run("job", "new", profile, "--radius", "10:30", "--tolerance", "2", "-o", path)
    assert done.exit_code == 0, done.output
    assert Job.load(path).name == "part_0"
    assert run("inspect", path, profile).exit_code == 0


def test_job_new_replaces_an_existing_file_only_if_asked(run, profile, tmp_path):
    path = tmp_path / "new.toml"
    path.write_text("edited")
    words = ("job", "new", profile, "--radius", "10:30", "--tolerance", "2", "-o", path)
    done = run(*words)
    assert done.exit_code == 1
    assert f"{path}: it exists: name another file, or replace it with --force" in done.stderr
    assert path.read_text() == "edited"
    assert run(*words, "--force").exit_code == 0
    assert Job.load(path).name == "part_0"


def test_job_new_needs_a_cylinder(run, written):
    flat = written(np.column_stack([np.linspace(-50, 50, 200), np.full(200, -400.0)]))
    done = run("job", "new", flat)
    assert done.exit_code == 1
    assert "no cylinder for a job: flat: 0.00 mm rms from a straight line" in done.stderr
    done = run("job", "new", flat, "--tolerance", "inf")
    assert done.exit_code == 2
    assert "expected a finite --tolerance in mm, got inf" in done.stderr


def test_job_schema_is_json_schema_with_the_units(run):
    schema = json.loads(run("job", "schema").stdout)
    assert "radius_mm" in schema["$defs"]["Part"]["properties"]
    assert schema["additionalProperties"] is False


def test_no_output_overwrites_the_job(run, job, profile):
    path = job(INSIDE)
    shutil.copy(path, path.with_suffix(".bak"))
    done = run("inspect", path, profile, "--json", path)
    assert done.exit_code == 2
    assert path.read_text() == path.with_suffix(".bak").read_text()


@pytest.mark.parametrize(
    "key", ['light_section = "{}"', 'flange_from_section = "{}"', 'poses = "{}"\nconvention = "ur"']
)
def test_no_output_overwrites_a_file_of_the_rig(run, job, profile, tmp_path, key):
    path = tmp_path / "rig.json"
    path.write_text("the rig")
    done = run("inspect", job(INSIDE, "[rig]\n" + key.format(path.name)), profile, "--csv", path)
    assert (done.exit_code, "it is also an input" in done.stderr) == (2, True), done.output
    assert path.read_text() == "the rig"


def test_tables_of_a_job_that_are_not_used_are_reported_where_it_is_run_or_checked(
    run, job, profile
):
    path = job(INSIDE, '[source]\nkind = "folder"\n[output]\nresults = "results"\n')
    done = run("inspect", path, profile, "--json", "-")
    assert done.exit_code == 0, done.output
    (note,) = [line for line in done.stderr.splitlines() if "not used" in line]
    assert note.startswith(f"lsvision: {path}: note: not used: [source], [output] (")
    assert json.loads(done.stdout)["verdicts"]
    assert "note: not used: [source], [output] (" in run("job", "check", path).stdout
    assert "not used" not in run("inspect", job(INSIDE), profile).stderr


def test_job_new_reports_a_tolerance_that_leaves_its_own_profile_undecided(run, profile, tmp_path):
    path = tmp_path / "new.toml"
    words = ("job", "new", profile, "--radius", "10:30", "-o", path)
    done = run(*words, "--tolerance", "0.01")
    assert done.exit_code == 0, done.output
    (note,) = [line for line in done.stderr.splitlines() if "undecided" in line]
    needed = float(note.partition("--tolerance ")[2].split()[0])
    assert run("inspect", path, profile).exit_code == 4
    assert "undecided" not in run(*words, "--tolerance", needed, "--force").stderr
    assert run("inspect", path, profile).exit_code == 0


@pytest.fixture
def interrupted_after_two(monkeypatch):
    """The third judgement of a run is interrupted, as by Ctrl-C."""
    import lsvision.inspection.judge

    judge, calls = lsvision.inspection.judge.judge, []

    def judge_twice(*args, **kwargs):
        calls.append(args)
        if len(calls) > 2:
            raise KeyboardInterrupt
        return judge(*args, **kwargs)

    monkeypatch.setattr(lsvision.inspection.judge, "judge", judge_twice)


@pytest.mark.usefixtures("interrupted_after_two")
def test_an_interrupted_run_keeps_the_verdicts_so_far(run, job, written, pipe, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    for number in range(4):
        written(pipe, f"parts/part_{number}.csv")
    outputs = {option: tmp_path / f"o.{option}" for option in ("json", "csv", "parquet")}
    (tmp_path / "o.json").write_text("of an earlier run")
    options = [each for option, path in outputs.items() for each in (f"--{option}", path)]
    done = run(
        "inspect", job(INSIDE), tmp_path / "parts", *options, "--report", tmp_path / "o.html"
    )
    assert done.exit_code == 130
    assert "interrupted: 2 measurements judged" in done.stderr
    document = json.loads(outputs["json"].read_text())
    assert len(document["verdicts"]) == 2
    assert document["not_judged"] == ["interrupted: 2 measurements judged"]
    assert len(outputs["csv"].read_text().splitlines()) == 3
    assert parquet.read_table(outputs["parquet"]).num_rows == 2
    assert "2 measurements" in (tmp_path / "o.html").read_text()


def test_a_run_without_a_verdict_leaves_none_of_an_earlier_run(run, job, written, tmp_path):
    out = tmp_path / "o.json"
    out.write_text('{"verdicts": [{"decision": "OK"}]}')
    (tmp_path / "bad.csv").write_text("nothing here\n")
    done = run("inspect", job(INSIDE), tmp_path / "bad.csv", "--json", out)
    assert done.exit_code == 1
    assert json.loads(out.read_text())["verdicts"] == []


def test_an_output_that_cannot_be_written_costs_no_other(run, job, profile, tmp_path, monkeypatch):
    import lsvision.io.result_files
    from lsvision.errors import UnwritableFile
    from lsvision.files.atomic_files import write_atomic

    def full_for_json(path, content):
        if path.suffix == ".json":
            raise UnwritableFile(f"{path}: cannot be written (No space left on device)")
        write_atomic(path, content)

    monkeypatch.setattr(lsvision.io.result_files, "write_atomic", full_for_json)
    names = {option: tmp_path / f"o.{option}" for option in ("json", "csv", "report")}
    names["report"] = tmp_path / "o.html"
    done = run(
        "inspect", job(INSIDE), profile,
        *(each for option, path in names.items() for each in (f"--{option}", path)),
    )  # fmt: skip
    assert done.exit_code == 1
    assert "No space left" in done.stderr
    assert "OK" in names["csv"].read_text()
    assert "<html" in names["report"].read_text()


def test_parquet_without_its_library_is_reported_before_the_work(
    run, job, profile, tmp_path, monkeypatch
):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    done = run("inspect", job(INSIDE), profile, "--parquet", tmp_path / "v.parquet")
    assert done.exit_code == 1
    assert "pip install 'lsvision[batch]'" in done.stderr
    assert done.stdout == ""


def test_json_and_csv_are_written_during_the_run(tmp_path, monkeypatch):
    import lsvision.io.result_files
    from lsvision.cli.verdict_outputs import VerdictOutputs, VerdictPaths
    from lsvision.inspection.judge import judge
    from lsvision.inspection.judged_measurements import JudgedMeasurement
    from lsvision.measure import measure_cylinders
    from lsvision.simulate import random_section

    monkeypatch.setattr(lsvision.io.result_files, "CHECKPOINT_S", 0.0)
    measurement = measure_cylinders(random_section("single", 7, noise_mm=0.02).profile)
    verdict = judge(measurement, Job.from_text(JOB.replace("LIMITS", INSIDE)))
    paths = VerdictPaths(tmp_path / "o.json", tmp_path / "o.csv")
    outputs = VerdictOutputs(paths, lambda _: "")
    outputs.add(JudgedMeasurement("a.csv", 0, measurement, verdict))
    document = json.loads(paths.json_file.read_text())
    assert document == {
        "schema": "lsvision.verdicts/1",
        "verdicts": [outputs.judged[0].record],
        "not_judged": [],
    }
    assert paths.csv_file.read_text().count("a.csv") == 1
    assert outputs.finish() == []
