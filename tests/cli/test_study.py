"""``lsvision study``: tables of repeated measurements, and messages."""

import json

import numpy as np
import pytest

from lsvision.results.number_format import format_value


def test_study_repeat_compares_with_the_reference(run, written, tmp_path):
    angle = np.linspace(2.6, 0.5, 160)
    circle = 19.0 * np.column_stack([np.cos(angle), np.sin(angle)]) - [0.0, 400.0]
    paths = [
        written(circle + np.random.default_rng(20 + k).normal(0, 0.03, circle.shape), f"{k}.csv")
        for k in range(4)
    ]
    out = tmp_path / "out.json"
    done = run("study", "repeat", *paths, "--reference", "19", "--tolerance", "4", "--json", out)
    assert done.exit_code == 0, done.output
    record = json.loads(out.read_text())
    low, high = record["bias_interval"]
    assert (record["count"], low < 0 < high) == (4, True)
    mean = format_value(record["mean"], record["std"] / 2)  # of 4 values
    assert done.stdout.startswith(f"radius in mm:\n4 values, mean {mean}, reference 19\n")
    wrong = run("study", "repeat", *paths, "--reference", "19", "--quantity", "colour")
    assert wrong.exit_code == 2
    assert "expected --quantity among radius, theta" in wrong.stderr


def test_study_grr_reads_a_table(run, tmp_path):
    rng = np.random.default_rng(3)
    rows = [
        f"{part},{operator},{part + rng.normal(0, 0.1):.4f}"
        for part in range(5)
        for operator in "ab"
        for _ in range(3)
    ]
    table = tmp_path / "table.csv"
    table.write_text("\n".join(["part,operator,value", *rows]))
    done = run("study", "grr", table, "--tolerance", "4")
    assert done.exit_code == 0, done.output
    assert "repeatability" in done.stdout
    assert "% of tolerance" in done.stdout
    german = [row.replace(",", ";").replace(".", ",") for row in rows]
    table.write_text("\n".join(["part;operator;value", *german]))
    assert run("study", "grr", table, "--tolerance", "4").stdout == done.stdout
    table.write_text("\n".join(["part,operator,value", *rows[:-1]]))
    short = run("study", "grr", table)
    assert short.exit_code == 1
    assert "expected every operator to measure every part equally often" in short.stderr
    other = run("study", "grr", table, "--value", "height")
    assert "expected a column 'height', got part, operator, value" in other.stderr
    table.write_text("part,operator,value\n1,a,x\n")
    assert "line 2: expected a number in 'value', got 'x'" in run("study", "grr", table).stderr
    assert run("study", "grr", table, "--level", "95").exit_code == 2


def test_repeats_of_theta_scatter_about_a_reference_of_0(run, written):
    """A pipe along X is seen at 1 deg and at 179 deg, 1 deg beside it on either side."""
    angle = np.linspace(2.6, 0.5, 160)
    paths = []
    for number, theta in enumerate(np.radians([1.0, 179.0, 1.0, 179.0])):
        u, v = 25.0 * np.cos(angle - theta), 19.0 * np.sin(angle - theta)
        cos, sin = np.cos(theta), np.sin(theta)
        points = np.column_stack([u * cos - v * sin, u * sin + v * cos - 400.0])
        noise = np.random.default_rng(number).normal(0, 0.005, points.shape)
        paths.append(written(points + noise, f"{number}.csv"))
    done = run("study", "repeat", *paths, "--reference", "0", "--quantity", "theta", "--json", "-")
    record = json.loads(done.stdout)
    assert abs(record["bias"]) < 0.3, done.output
    assert record["std"] == pytest.approx(1.15, abs=0.3)  # sqrt(4/3): four values at +/- 1


@pytest.mark.parametrize(
    ("command", "words", "message"),
    [
        ("repeat", ("--reference", "nan"), "expected a finite --reference, got nan"),
        ("repeat", ("--reference", "19", "--tolerance", "0"), "expected --tolerance above 0"),
        (
            "repeat",
            ("--reference", "19", "--known-radius", "19"),
            "expected --known-radius with another --quantity than radius",
        ),
        ("grr", ("--tolerance", "0"), "expected --tolerance above 0, got 0"),
        ("grr", ("--tolerance", "inf"), "expected --tolerance above 0, got inf"),
    ],
)
def test_a_number_without_meaning_is_a_usage_error(run, written, pipe, command, words, message):
    result = run("study", command, written(pipe), *words)
    assert (result.exit_code, message in result.stderr) == (2, True), result.output


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("part,operator,value\n1,a,1\n\n1,a,x\n", "line 4: expected a number in 'value', got 'x'"),
        ("part,operator,value\n1,a,nan\n", "line 2: expected a number in 'value', got 'nan'"),
        ("part,operator,value\n1,a\n", "line 2: expected a number in 'value', got ''"),
        ("part,operator,value,value\n1,a,1,2\n", "expected one column 'value', got several"),
        ("value,part,operator\n1,a\n", "line 2: expected a name in 'part' and in 'operator'"),
        ("part,operator,value\n1,a,2\n1,a,2,5\n", "line 3: expected 3 cells, got more"),
        ("part,operator,value\n1,a,1_9\n", "line 2: expected a number in 'value', got '1_9'"),
        ("part,operator,value\n\n,,\n", "expected rows with values, got none below the header"),
        (
            "part,operator,value\n1,Ann,1\n1,ann,2\n1,Bob,3\n",
            "table.csv: expected two or more parts, operators and trials of each pair, got parts "
            "1; operators Ann, ann, Bob; 1 trial: measure more, or write each name in one way",
        ),
        (
            "part,operator,value\n1,a,1\n2,b,2\n",
            "got 2 of 4 pairs with 1 to 1 trials (parts 1, 2; operators a, b): add the missing",
        ),
        ('part,operator,value\n1,a,"2\n' + 200_000 * "x", "close each quote"),
    ],
)
def test_a_wrong_row_is_reported_with_its_line(run, tmp_path, text, message):
    table = tmp_path / "table.csv"
    table.write_text(text)
    result = run("study", "grr", table)
    assert (result.exit_code, message in result.stderr) == (1, True), result.output


def test_lines_may_end_in_any_way_and_in_an_empty_cell(run, tmp_path):
    table = tmp_path / "table.csv"
    rows = [f"{p},{o},{p + n / 10}" for p in (1, 2) for o in "ab" for n in (0, 1)]
    table.write_text("\n".join(["part,operator,value", *rows]))
    expected = run("study", "grr", table).stdout
    for end in ("\r", "\r\n", ",\n", "\n,,\n"):  # the last one adds rows of empty cells
        table.write_bytes(end.join(["part,operator,value", *rows, ""]).encode())
        assert run("study", "grr", table).stdout == expected != ""


def test_blanks_beside_a_separator_are_not_part_of_a_name(run, tmp_path):
    table = tmp_path / "table.csv"
    rows = [f"{p},{o},{p + n / 10}" for p in (1, 2) for o in "ab" for n in (0, 1)]
    table.write_text("\n".join(["part,operator,value", *rows]))
    expected = run("study", "grr", table).stdout
    rows[0] = rows[0].replace(",", " , ")
    table.write_text("\n".join(["part, operator, value", *rows]))
    assert run("study", "grr", table).stdout == expected != ""


def test_a_repeat_that_shows_another_pipe_is_reported(run, written):
    angle = np.linspace(2.6, 0.5, 160)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    paths = [
        written(radius * circle - [0.0, 400.0], f"{number}.csv")
        for number, radius in enumerate([19.0, 19.1, 12.0, 18.9])
    ]
    done = run("study", "repeat", *paths, "--reference", "19", "--range-std", "0.05")
    assert done.exit_code == 0, done.output
    assert f"{paths[2]}, profile 0: its cylinder of radius 12 mm counts, most have" in done.stderr
    assert done.stderr.count("another part?") == 1
