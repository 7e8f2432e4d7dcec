"""`lsvision measure` on bad input: one line with file and remedy; the rest goes on."""

import json
import os

import numpy as np
import pytest

import lsvision.measure as measure_module

FAILED, USAGE = 1, 2


def one_line(result):
    (line,) = result.stderr.splitlines()
    assert line.startswith("lsvision: ")
    assert "Traceback" not in result.output
    return line


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the file is empty: expected x and height"),
        (bytes(range(256)) * 8, "export the profile as text"),
        (b"the quick brown fox\njumps over\n", "expected x and height in mm, one point per line"),
        (b"1.5\n2.5\n3.5\n", "one column in it: expected x and height"),
        (b"x,z\n" + b"nan,nan\n" * 50, "all 50 points are lost"),
        (b"inf,inf\n" * 50, "all 50 points are lost"),
        (b"1.0,-400.0\n", "one valid point in it, no profile: check exposure"),
        (b"0.0,0.0\n" * 50, "all 50 points are lost: check exposure"),
    ],
)
def test_file_without_a_profile_is_one_line_and_exit_code_1(run, tmp_path, content, words):
    path = tmp_path / "bad.csv"
    path.write_bytes(content)
    result = run("measure", path)
    assert result.exit_code == FAILED
    line = one_line(result)
    assert line.startswith(f"lsvision: {path}: ")
    assert words in line


def test_missing_file_and_empty_folder_are_reported(run, tmp_path):
    assert "absent.csv: no such file: check the name" in one_line(
        run("measure", tmp_path / "absent.csv")
    )
    result = run("measure", tmp_path)
    assert result.exit_code == FAILED
    assert f"{tmp_path}: no profile in this folder" in one_line(result)
    pattern = run("measure", tmp_path / "*.csv")
    assert pattern.exit_code == FAILED
    assert "no file matches this pattern" in one_line(pattern)


def test_a_file_that_may_not_be_read_is_no_internal_error(run, written, pipe, monkeypatch):
    path = written(pipe)
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may read all
    assert one_line(run("measure", path)) == (
        f"lsvision: {path}: no permission to read it: check its owner and mode"
    )


def test_wrong_units_name_the_option(run, written, pipe):
    result = run("measure", written(pipe * 1000))
    assert result.exit_code == FAILED
    assert "coordinates reach 3.91e+05 mm: if the unit is another, see --units um" in one_line(
        result
    )
    metres = run("measure", written(pipe / 1000))
    assert metres.exit_code == FAILED
    assert "see --units m, or --units mm if it is correct" in one_line(metres)
    assert run("measure", written(pipe * 1000), "--units", "um").exit_code == 0
    far = run("measure", written(2 * pipe), "--units", "inch").stdout
    assert "mm: check the stated unit (in), see --units" in far


def test_other_files_are_measured_and_the_failures_counted_at_the_end(run, written, pipe, tmp_path):
    written(pipe, "a.csv")
    (tmp_path / "b.csv").write_text("no numbers\n")
    written(pipe, "c.csv")
    result = run("measure", tmp_path, tmp_path / "*.xyz", "--json", tmp_path / "out.json")
    assert result.exit_code == FAILED
    pattern, bad, count = result.stderr.splitlines()
    assert "*.xyz: no file matches" in pattern
    assert "b.csv: expected x and height" in bad
    assert count == "lsvision: 2 of 4 could not be measured"
    measured = json.loads((tmp_path / "out.json").read_text())["measurements"]
    assert [record["source"][-5:] for record in measured] == ["a.csv", "c.csv"]


def test_bug_met_by_one_file_does_not_cost_the_others(run, written, pipe, monkeypatch):
    def measure(profiles, **_):
        if 30 in map(len, profiles):
            raise ZeroDivisionError("thirty")
        return [measure_module.Measurement((), ()) for _ in profiles]

    monkeypatch.setattr(measure_module, "measure_profiles", measure)
    words = written(pipe[:30], "a.csv"), written(pipe, "b.csv")
    result = run("measure", *words)
    assert result.exit_code == FAILED
    assert "a.csv: internal error, ZeroDivisionError: thirty" in result.stderr
    assert "b.csv: text" in result.stdout
    assert "Traceback" in run("measure", *words, "--debug").stderr


@pytest.mark.parametrize(
    "spoil",
    [
        lambda points: np.repeat(points, 2, axis=0),
        lambda points: np.random.default_rng(0).permutation(points),
        lambda points: points[::-1],
        lambda points: np.where(np.arange(len(points))[:, None] % 9 == 0, np.inf, points),
    ],
    ids=["duplicate points", "unsorted x", "reversed x", "infinite values"],
)
def test_spoilt_profile_is_measured_all_the_same(run, rows, written, pipe, spoil):
    result = run("measure", written(spoil(pipe)))
    assert result.exit_code == 0, result.output
    assert "nan" not in result.stdout.lower()
    ((_, cell, *_),) = rows(result)
    radius, sigma = map(float, cell.split(" ± "))
    assert abs(radius - 19.0) < 5 * sigma


@pytest.mark.parametrize(
    "points",
    [
        np.column_stack([np.linspace(-100, 100, 300), np.full(300, -400.0)]),
        np.column_stack([np.linspace(-100, 100, 300), np.linspace(-500, -400, 300)]),
        np.random.default_rng(1).normal(0, 50, (600, 2)),
        np.array([[1.0, -400.0], [2.0, -401.0]]),
        np.column_stack([np.repeat([-5.0, 5.0], 100), np.linspace(-500, -400, 200)]),
    ],
    ids=["exactly flat", "exactly sloping", "cloud", "two points", "two verticals"],
)
def test_profile_that_holds_nothing_is_no_failure(run, written, points):
    result = run("measure", written(points))
    assert result.exit_code == 0, result.output
    assert "no cylinder found" in result.stdout


def test_a_million_points_are_measured(run, tmp_path):
    x = np.linspace(-200, 200, 1_000_000)
    y = np.where(np.abs(x) < 19, np.sqrt(np.maximum(361 - x * x, 0)) - 400, -450.0)
    points = np.column_stack([x, y + np.random.default_rng(0).normal(0, 0.02, len(x))])
    np.save(tmp_path / "million.npy", points)
    result = run("measure", tmp_path / "million.npy")
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--radius", "40:10"], "expected --radius above 0 mm, min:max, got '40:10'"),
        (["--radius", "-5"], "expected --radius above 0 mm"),
        (["--radius", "0:10"], "expected --radius above 0 mm"),
        (["--radius", "ten"], "expected --radius 19 or --radius 10:40 in mm, got 'ten'"),
        (["--radius", "1:2:3"], "expected --radius 19 or --radius 10:40 in mm"),
        (["--radius", "nan"], "expected --radius 19 or --radius 10:40 in mm"),
        (["--known-radius", "-19"], "expected --known-radius and its sigma above 0 mm"),
        (["--known-radius", "19:0"], "expected --known-radius and its sigma above 0 mm"),
        (["--known-radius", "x"], "expected --known-radius 19 or --known-radius 19:0.05"),
        (["--known-phi-deg", "-1"], "expected --known-phi-deg from 0 to below 90 deg"),
        (["--known-phi-deg", "90"], "expected --known-phi-deg from 0 to below 90 deg"),
        (["--known-phi-deg", "0:0"], "and its sigma above 0, got '0:0'"),
        (["--known-phi-deg", "flat"], "expected --known-phi-deg 0 or --known-phi-deg 0:2 in deg"),
        (["--sensor", "lps99"], "expected a sensor among lps36hi, lps36, got 'lps99'"),
        (["--sensor", "lps36", "--range-std", "0.1"], "expected --sensor or --range-std, got both"),
        (["--range-std", "0"], "expected a positive range_std in mm"),
        (["--range-std", "1e-300"], "expected range_std from 1e-06 to 1000 mm, got 1e-300"),
        (["--surface-std", "1e200"], "expected at most 1000, got '1e200'"),
        (["--reference-range", "300"], "expected --range-std with --reference-range"),
        (
            ["--sensor", "lps36", "--reference-range", "300"],
            "expected --range-std with --reference-range",
        ),
        (["--units", "furlong"], "expected units among nm, um, mm"),
        (["--format", "docx"], "expected format among text"),
        (["--paper", "--sensor", "lps36"], "expected --paper, or --sensor, --range-std or"),
        (["--paper", "--known-phi-deg", "0"], "uses neither the noise nor a known tilt"),
        (
            ["--paper", "--radius", "19", "--known-radius", "19"],
            "expected --paper with --radius or --known-radius, got both",
        ),
        (["--columns", "1"], "expected columns of x and height"),
        (["--plot", "out.pdf"], "expected --plot F.png or F.svg, got 'out.pdf'"),
    ],
)
def test_slip_in_an_option_is_a_usage_error(run, written, pipe, options, words):
    result = run("measure", written(pipe), *options)
    assert result.exit_code == USAGE
    assert words in " ".join(result.stderr.split())
    assert "Traceback" not in result.output


def test_output_over_an_input_or_another_output_is_a_usage_error(run, written, pipe, tmp_path):
    path = written(pipe)
    before = path.read_bytes()
    over = run("measure", path, "--csv", path)
    twice = run("measure", path, "--csv", tmp_path / "o", "--json", tmp_path / "o")
    assert over.exit_code == twice.exit_code == USAGE
    assert "it is also an input" in over.stderr
    assert "it is also an output" in twice.stderr
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    "case",
    [
        ("--json", "nowhere/out.json", "its folder does not exist: create it first"),
        ("--csv", "", "a directory: name a file in it"),
        ("--plot", "nowhere/out.png", "its folder does not exist: create it first"),
    ],
)
def test_output_that_cannot_be_written_is_reported_before_the_work(
    run, written, pipe, tmp_path, case
):
    option, output, words = case
    path = written(pipe)
    before = sorted(tmp_path.rglob("*"))
    result = run("measure", path, option, tmp_path / output)
    assert result.exit_code == FAILED
    assert result.stdout == ""
    line = one_line(result)
    assert str(tmp_path / output) in line
    assert words in line
    assert sorted(tmp_path.rglob("*")) == before


def test_nothing_is_written_where_nothing_was_measured(run, tmp_path):
    (tmp_path / "bad.csv").write_text("words\n")
    assert run("measure", tmp_path / "bad.csv", "--json", tmp_path / "o.json").exit_code == FAILED
    assert not (tmp_path / "o.json").exists()
