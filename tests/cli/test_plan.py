import pytest
import typer
from typer.testing import CliRunner

from lsvision.cli.plan import MAX_SECTIONS, plan
from lsvision.planning.plan import MAX_SECTIONS as MAX_SECTIONS_OF_A_TARGET

FOUND, USAGE = 0, 2


def run(*options):
    app = typer.Typer()
    app.command()(plan)
    return CliRunner().invoke(app, options)


def rows(result):
    return [line.split() for line in result.stdout.splitlines() if line.strip()[0].isdigit()]


def test_one_section_is_a_row_with_units():
    result = run("--radius", "19", "--theta-deg", "20", "--phi-deg", "20", "--standoff", "400")
    assert result.exit_code == FOUND
    assert "one sigma" in result.stdout
    assert "radius mm" in result.stdout
    assert "phi deg" in result.stdout
    assert rows(result) == [["1", "-", "0", "96", "0.39", "4.4", "1.9"]]


def test_a_scan_is_more_accurate_than_its_section():
    one, scan = rows(run("--radius", "19", "--range-std", "0.1", "--sections", "20"))
    assert scan[:3] == ["20", "1", "19"]
    assert float(scan[-1]) < float(one[-1]) / 10


def test_target_answers_with_sections_over_a_length_for_each_spacing():
    answer = rows(run("--radius", "19", "--target-phi-deg", "0.05"))[1:]
    assert [row[1] for row in answer] == ["0.5", "1", "2", "5", "10"]
    assert all(float(row[-1]) <= 0.05 for row in answer)


def test_as_many_sections_are_allowed_as_are_proposed():
    assert MAX_SECTIONS == MAX_SECTIONS_OF_A_TARGET


def test_a_known_radius_makes_phi_more_accurate():
    free, known = (rows(run("--radius", "19", *more))[0] for more in ((), ("--known-radius",)))
    assert known[-3] == "0"
    assert float(known[-1]) < float(free[-1]) / 3


def test_theta_of_an_upright_pipe_is_not_determinable():
    assert "not determinable" in run("--radius", "19", "--phi-deg", "0").stdout


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--radius", "-19"], "positive radius"),
        (["--radius", "19", "--phi-deg", "90"], "(90 deg), got"),
        (["--radius", "19", "--sensor", "lps99"], "lps36hi, lps36"),
        (["--radius", "19", "--sensor", "lps36", "--range-std", "0.1"], "got both"),
        (["--radius", "19", "--target-phi-deg", "0"], "expected --target-phi-deg above 0, got 0"),
        (
            ["--radius", "19", "--pitch", "1e-7"],
            "expected a --pitch of at least 0.004 mm with --st",
        ),
        (["--radius", "19", "--known-radius", "--target-radius", "1"], "--target-radius, got both"),
        (["--radius", "19", "--sections", "2049"], "equal to 2048"),
        (["--radius", "19", "--spacing", "2"], "2 or more, or a target, with --spacing, got"),
        (["--radius", "19", "--pose-std", "1", "--sections", "1"], "with --pose-std, got neither"),
        (["--radius", "19", "--range-std", "1e200"], "range_std from 1e-06 to 1000 mm"),
        (
            ["--radius", "19", "--pose-std", "1e200", "--sections", "2", "--spacing", "1"],
            "expected pose_std >= 0 and at most 1000, got 1e+200",
        ),
        (["--radius", "19", "--feed-std-deg", "1"], "with --feed-std-deg, got neither"),
    ],
)
def test_slip_is_a_usage_error_that_says_what_is_wanted(options, words):
    result = run(*options)
    assert result.exit_code == USAGE
    assert words in " ".join(result.stderr.replace("│", " ").split())
