"""``lsvision paper`` from the shell."""

import json

import pytest

from lsvision.studies import chen_liu_2016
from lsvision.studies.chen_liu_2016 import ExperimentSizes, page, scenes
from lsvision.studies.chen_liu_2016.published_results import PUBLISHED_TIMES
from tests.studies.test_page import no_pictures

SMALLEST = ExperimentSizes(
    runs={"paper": 0, "section": 1, "known": 0, "two": 0, "twenty": 0},
    timing_scenes=1,
    repeats=40,
    ablation_scenes=1,
)
"""Every experiment runs; what its numbers are is tested in tests/studies."""


@pytest.mark.paper
def test_page_and_numbers_are_written(run, tmp_path, monkeypatch):
    monkeypatch.setattr(ExperimentSizes, "quick", lambda: SMALLEST)
    monkeypatch.setattr(scenes, "PUBLISHED_TIMES", PUBLISHED_TIMES[:1])  # without clutter
    drawn = []  # tests/studies/test_page.py draws the pictures
    monkeypatch.setattr(
        page, "_draw_pictures", lambda report: drawn.append(report) or no_pictures(report)
    )
    report = written_report(run, tmp_path)
    assert len(drawn) == 1
    assert len(report["table_5"]) == 1
    assert all(row["spreads"]["section"]["runs"] == 1 for row in report["tables_1_to_4"])


@pytest.mark.slow
@pytest.mark.paper
def test_the_quick_version_writes_page_and_numbers(run, tmp_path):
    report = written_report(run, tmp_path)
    assert len(report["table_5"]) == 5
    assert all(row["spreads"]["section"]["runs"] == 24 for row in report["tables_1_to_4"])


def written_report(run, folder):
    page, numbers = folder / "report.html", folder / "report.json"
    result = run("paper", "--out", page, "--json", numbers)
    assert result.exit_code == 0, result.output
    assert page.read_text().startswith("<!DOCTYPE html>")
    report = json.loads(numbers.read_text())
    assert all(timing["ratio"] > 1 for timing in report["table_5"])
    assert sum(timing["section"]["false"] for timing in report["table_5"]) == 0
    assert "figure 16" in result.stderr
    return report


def test_a_page_that_cannot_be_written_is_rejected_before_the_work(run, tmp_path, monkeypatch):
    monkeypatch.setattr(chen_liu_2016, "run_experiments", lambda *_, **__: pytest.fail("work"))
    result = run("paper", "--out", tmp_path / "missing" / "report.html")
    assert result.exit_code == 1
    assert "its folder does not exist" in result.stderr


def test_page_and_json_cannot_be_one_file(run, tmp_path):
    result = run("paper", "--out", tmp_path / "r", "--json", tmp_path / "r")
    assert result.exit_code == 2
    assert "it is also an output" in result.stderr


@pytest.mark.parametrize("noise", ["0", "-1", "1", "nan"])
def test_noise_out_of_range_is_a_usage_error(run, noise, tmp_path):
    result = run("paper", "--noise-mm", noise, "--out", tmp_path / "r.html")
    assert result.exit_code == 2
    assert "--noise-mm" in result.stderr
