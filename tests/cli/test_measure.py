"""`lsvision measure`: table, files and pictures on good input."""

import csv
import json
import os
import pty
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest

import lsvision.measure as measure_module
from lsvision.cli.profile_options import READERS
from lsvision.io.profiles import FORMATS
from lsvision.studies import chen_liu_2016

REPOSITORY = Path(__file__).parents[2]
PAIR = REPOSITORY / "fixtures" / "welded_pair.csv"
PNG = b"\x89PNG\r\n\x1a\n"
FIVE_SIGMA = 5


def test_table_has_each_cylinder_with_sigmas_units_and_intervals(run, rows):
    result = run("measure", PAIR)
    assert result.exit_code == 0, result.output
    assert f"{PAIR}: text, mm, 1 profile, 214 of 376 points lost" in result.stdout
    for word in ("radius mm", "theta deg", "phi deg", "centre x mm", "centre y mm", "95 %"):
        assert word in result.stdout
    truth = json.loads(PAIR.with_suffix("").with_suffix(".truth.json").read_text())["tubes"]
    true_radii = [t["radius_mm"] for t in sorted(truth, key=lambda t: t["centre_mm"][0])]
    for row, true in zip(rows(result), true_radii, strict=True):
        radius, sigma = map(float, row[1].split(" ± "))
        assert abs(radius - true) < FIVE_SIGMA * sigma


def test_theta_of_a_circle_is_not_determinable(run, rows, written, pipe):
    (row,) = rows(run("measure", written(pipe)))
    assert row[2] == "not determinable"


def test_verbose_lists_the_rejected_arcs_with_their_reasons(run):
    quiet = run("measure", REPOSITORY / "fixtures" / "empty.csv")
    assert "no cylinder found: continues tangentially" in quiet.stdout
    assert "-v lists them" in quiet.stdout
    outcome = run("measure", REPOSITORY / "fixtures" / "empty.csv", "-v").stdout
    spans = [line.strip() for line in outcome.splitlines() if line.strip().startswith("points ")]
    starts = [int(line.split()[1]) for line in spans]
    assert starts == sorted(starts)
    assert spans
    assert all(" mm: " in line for line in spans)


def test_profile_upside_down_names_flip(run, rows, written, pipe):
    result = run("measure", written(pipe * (1, -1)))
    assert result.exit_code == 0
    assert "no cylinder found" in result.stdout
    assert "use --flip" in result.stdout
    assert len(rows(run("measure", written(pipe * (1, -1)), "--flip"))) == 1
    assert "use --no-flip" in run("measure", written(pipe), "--flip").stdout


def test_json_and_csv_hold_what_the_table_shows(run, rows, tmp_path):
    result = run("measure", PAIR, "--json", tmp_path / "m.json", "--csv", tmp_path / "m.csv")
    assert result.exit_code == 0, result.output
    (record,) = json.loads((tmp_path / "m.json").read_text())["measurements"]
    assert record["source"] == str(PAIR)
    table = list(csv.DictReader((tmp_path / "m.csv").read_text().splitlines()))
    shown = [float(row[1].split(" ± ")[0]) for row in rows(result)]
    for cylinder, line, radius in zip(record["cylinders"], table, shown, strict=True):
        assert float(line["radius_mm"]) == cylinder["radius_mm"]
        assert abs(cylinder["radius_mm"] - radius) < 0.01


def test_plot_of_one_profile_has_just_the_name_given(run, written, pipe, tmp_path):
    for name in ("p.png", "p.svg"):
        assert run("measure", written(pipe), "--plot", tmp_path / name).exit_code == 0
    assert (tmp_path / "p.png").read_bytes().startswith(PNG)
    assert ET.parse(tmp_path / "p.svg").getroot().tag.endswith("svg")


def test_plots_of_several_files_and_profiles_never_overwrite_each_other(
    run, written, pipe, tmp_path
):
    written(pipe, "a/pipe.csv")
    written(pipe, "b/pipe.csv")
    np.save(tmp_path / "two.npy", np.stack([pipe, pipe + 1]))
    words = [tmp_path / "a", tmp_path / "b", tmp_path / "two.npy"]
    result = run("measure", *words, "--plot", tmp_path / "out.png")
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in tmp_path.glob("*.png")) == [
        "out-pipe-2.png",
        "out-pipe.png",
        "out-two-0.png",
        "out-two-1.png",
    ]


def test_same_input_gives_the_same_bytes(run, written, pipe, tmp_path):
    outputs = []
    for turn in "12":
        files = [tmp_path / f"{turn}.{kind}" for kind in ("json", "csv", "svg", "png")]
        options = zip(("--json", "--csv", "--plot"), files, strict=False)
        table = run("measure", written(pipe), *(word for pair in options for word in pair)).stdout
        run("measure", written(pipe), "--plot", files[3])
        outputs.append([table, *(file.read_bytes() for file in files)])
    assert outputs[0] == outputs[1]


def test_known_radius_sharpens_phi(run, rows):
    free, known = (
        rows(run("measure", REPOSITORY / "fixtures" / "single.csv", *more))[0]
        for more in ((), ("--known-radius", "25.34:0.02"))
    )
    sigma_free, sigma_known = (float(row[3].split(" ± ")[1]) for row in (free, known))
    assert sigma_known < sigma_free
    assert float(known[1].split(" ± ")[1]) <= 0.02


def test_known_tilt_sharpens_the_radius(run, rows):
    free, known = (
        rows(run("measure", REPOSITORY / "fixtures" / "planar.csv", *more))[0]
        for more in ((), ("--known-phi-deg", "0:5"))
    )
    sigma_free, sigma_known = (float(row[1].split(" ± ")[1]) for row in (free, known))
    assert sigma_known < sigma_free


def test_radius_range_decides_what_is_a_pipe(run, rows, written, pipe):
    assert len(rows(run("measure", written(pipe), "--radius", "15:25"))) == 1
    assert len(rows(run("measure", written(pipe), "--radius", "19"))) == 1
    assert "no cylinder found" in run("measure", written(pipe), "--radius", "30:40").stdout


@pytest.mark.parametrize(
    "options",
    [
        ["--sensor", "lps36hi"],
        ["--sensor", "LPS36"],
        ["--range-std", "0.03"],
        ["--range-std", "0.03", "--reference-range", "300"],
    ],
)
def test_other_ways_to_measure_find_the_pipe(run, rows, written, pipe, options):
    result = run("measure", written(pipe), *options)
    assert result.exit_code == 0, result.output
    assert rows(result), result.output


def test_heights_not_counted_from_the_sensor_are_noted(run, written, pipe):
    middle = written(pipe + np.array([0, 400]))
    warning = "mm from the sensor's origin, and its noise is stated for 200 to 600 mm: check"
    assert warning in run("measure", middle, "--sensor", "lps36hi").stdout
    noise = ("--range-std", 0.03)
    assert "stated for 200 to 800 mm: check" in run("measure", middle, *noise).stdout
    far = (written(10 * pipe, "far.csv"), "--range-std", 0.3, "--reference-range")
    assert "stated for 200 to 800 mm: check" in run("measure", *far, 400).stdout
    assert "sensor's origin" not in run("measure", *far, 4000).stdout
    assert "sensor's origin" not in run("measure", middle).stdout
    assert "sensor's origin" not in run("measure", written(pipe), "--sensor", "lps36").stdout


def test_a_wrong_origin_of_many_profiles_is_reported_once(run, tmp_path, pipe):
    distances = np.arange(350, 380, 10.0)
    np.save(tmp_path / "many.npy", [pipe + np.array([0.0, distance]) for distance in distances])
    shown = run("measure", tmp_path / "many.npy", "--sensor", "lps36").stdout
    assert "3 profiles" in shown
    assert shown.count("sensor's origin") == 1


def test_paper_measures_by_the_chain_of_the_paper(run, written, pipe, monkeypatch):
    calls = []

    def measure(profile, **options):
        calls.append(options)
        return measure_module.Measurement((), ())

    def fail(profiles, **_):
        raise AssertionError("expected measure_cylinders_paper, got measure_profiles")

    monkeypatch.setattr(chen_liu_2016, "measure_cylinders_paper", measure)
    monkeypatch.setattr(measure_module, "measure_profiles", fail)
    assert run("measure", written(pipe), "--paper", "--radius", "10:40").exit_code == 0
    assert calls
    assert all(c == {"radius": (10.0, 40.0), "known_radius": None} for c in calls)


def test_reading_can_be_overridden(run, rows, tmp_path, pipe):
    table = np.column_stack([pipe[:, 0], np.zeros(len(pipe)), -pipe[:, 1]]) / 1000
    np.savetxt(tmp_path / "ranges.txt", table, fmt="%.7f")
    options = ["--format", "text", "--columns", "0,2", "--units", "m", "--flip"]
    result = run("measure", tmp_path / "ranges.txt", *options)
    assert result.exit_code == 0, result.output
    ((_, radius, *_),) = rows(result)
    assert abs(float(radius.split(" ± ")[0]) - 19) < 0.5


def test_help_lists_the_formats_that_the_reader_knows():
    assert ", ".join(FORMATS) == READERS


def test_examples_of_the_help_run(run, monkeypatch, tmp_path):
    # Slow, and tested elsewhere.
    monkeypatch.setattr("lsvision.cli.chunk_results._draw", lambda *_: [])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fixtures").symlink_to(REPOSITORY / "fixtures")
    lines = run("measure", "--help").stdout.splitlines()
    examples = [line.split()[1:] for line in lines if line.startswith("    lsvision measure fix")]
    assert len(examples) == 6
    for words in examples:
        result = run(*words)
        assert result.exit_code == 0, (words, result.output)


def test_progress_bar_shows_on_a_terminal_only(written, pipe, tmp_path):
    paths = [str(written(pipe, f"{k}.csv")) for k in (1, 2)]
    command = [sys.executable, "-m", "lsvision", "measure", *paths]
    ours, theirs = pty.openpty()
    done = subprocess.run(
        command, cwd=REPOSITORY, stdout=subprocess.PIPE, stderr=theirs, timeout=60, check=True
    )
    os.close(theirs)
    shown = os.read(ours, 10_000).decode()
    os.close(ours)
    assert "0/2 " in shown
    assert "2/2 " in shown
    assert shown.endswith("\r\x1b[K")
    assert b"0/2 " not in done.stdout
    piped = subprocess.run(command, cwd=REPOSITORY, capture_output=True, timeout=60, check=True)
    assert piped.stderr == b""


def test_how_a_profile_was_read_stands_in_the_json(run, pipe, tmp_path):
    rows = [f"{x:.3f},{z:.3f},P7,{k}" for k, (x, z) in enumerate(pipe.tolist())]
    rows[::6] = [f"{row.split(',')[0]},-9999,P7,0" for row in rows[::6]]
    path = tmp_path / "p.csv"
    path.write_text("x,z,part,grey\n" + "\n".join(rows))
    out = tmp_path / "out.json"
    result = run("measure", path, "--json", out, "--csv", tmp_path / "out.csv", "-v")
    assert result.exit_code == 0, result.output
    assert "p.csv: text, mm (assumed), 1 profile, 27 of 160 points lost (27 by -9999)" in (
        result.stdout
    )
    assert "columns not used: grey" in result.stdout
    (record,) = json.loads(out.read_text())["measurements"]
    assert record["input"] == {
        "reader": "text",
        "units": "mm",
        "units_assumed": True,
        "heights_turned": False,
        "lost_points": 27,
        "lost_markers": [{"value": "-9999", "points_of_file": 27, "guessed": True}],
        "attributes": {"part": "P7"},
    }
    (row,) = csv.DictReader((tmp_path / "out.csv").read_text().splitlines())
    assert (row["part"], row["reason"]) == ("P7", "")


def test_units_with_a_scale_and_a_marker_can_be_given(run, rows, pipe, tmp_path):
    path = tmp_path / "p.csv"
    lines = [f"{10 * x:.2f};{10 * z:.2f}" for x, z in pipe.tolist()]
    lines[::9] = ["12.0;-77" for _ in lines[::9]]
    path.write_text("\n".join(lines))
    result = run("measure", path, "--units", "0.1mm", "--lost", "-77")
    assert result.exit_code == 0, result.output
    assert "text, 0.1 mm, 1 profile, 18 of 160 points lost (18 by -77)" in result.stdout
    ((_, cell, *_),) = rows(result)
    radius, sigma = map(float, cell.split(" ± "))
    assert abs(radius - 19) < 5 * sigma
    assert run("measure", path, "--units", "furlong").exit_code == 2


def test_a_height_map_is_measured_with_its_spacing(run, rows, tmp_path):
    x = -30 + 0.25 * np.arange(240)
    heights = -300 + np.sqrt(np.maximum(19.0**2 - x**2, 0))
    heights += np.random.default_rng(3).normal(0, 0.03, heights.shape)
    counts = np.where(np.abs(x) > 17, 0, np.round((heights + 400) / 0.005)).astype("u2")
    path = tmp_path / "map.tif"
    cv2.imwrite(str(path), np.stack([counts, counts]))
    result = run("measure", path, "--x0", -30, "--dx", 0.25, "--z-unit", "5um")
    assert result.exit_code == 0, result.output
    assert [abs(float(cells[1].split(" ± ")[0]) - 19) < 0.2 for cells in rows(result)] == [True] * 2
    assert "height-map" in result.stdout
    assert "--light-section" in run("measure", path).stderr
