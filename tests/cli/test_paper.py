"""``lsvision paper`` from the shell."""

import json
import time

import pytest


@pytest.mark.paper
def test_the_quick_version_writes_page_and_numbers(run, tmp_path):
    page, numbers = tmp_path / "report.html", tmp_path / "report.json"
    result = run("paper", "--out", page, "--json", numbers)
    assert result.exit_code == 0, result.output
    assert page.read_text().startswith("<!DOCTYPE html>")
    report = json.loads(numbers.read_text())
    assert all(timing["ratio"] > 1 for timing in report["table_5"])
    assert sum(timing["section"]["false"] for timing in report["table_5"]) == 0
    assert "figure 16" in result.stderr


def test_a_page_that_cannot_be_written_is_refused_before_the_work(run, tmp_path):
    start = time.perf_counter()
    result = run("paper", "--out", tmp_path / "missing" / "report.html")
    assert result.exit_code == 1
    assert "its folder does not exist" in result.stderr
    assert time.perf_counter() - start < 5


def test_page_and_json_cannot_be_one_file(run, tmp_path):
    result = run("paper", "--out", tmp_path / "r", "--json", tmp_path / "r")
    assert result.exit_code == 2
    assert "it is also an output" in result.stderr


@pytest.mark.parametrize("noise", ["0", "-1", "1", "nan"])
def test_noise_out_of_range_is_a_usage_error(run, noise, tmp_path):
    result = run("paper", "--noise-mm", noise, "--out", tmp_path / "r.html")
    assert result.exit_code == 2
    assert "--noise-mm" in result.stderr
