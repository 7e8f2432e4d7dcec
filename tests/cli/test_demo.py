"""The demo: it needs nothing but the package, and what it says next works."""

import shlex
from importlib import resources
from pathlib import Path

import pytest

from lsvision.io.images import read_image

FIXTURE = Path(__file__).parents[2] / "fixtures" / "welded_complex.csv"


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_it_measures_what_is_shipped_and_draws_it(run, rows, empty_folder):
    result = run("demo")
    assert result.exit_code == 0, result.output
    radii = [float(cells[1].split(" ±")[0]) for cells in rows(result)]
    assert radii == pytest.approx([23.673, 25.325], abs=0.5)  # the truth; 0.6 mm one sigma
    assert read_image(empty_folder / "lsvision-demo" / "profile.png").shape == (770, 1430, 3)


def test_the_shipped_profile_is_the_fixture_and_small():
    shipped = (resources.files("lsvision.cli") / "demo_data" / "profile.csv").read_bytes()
    assert shipped == FIXTURE.read_bytes()
    assert len(shipped) < 10_000


def test_every_command_it_proposes_works(run, empty_folder):
    lines = [line.strip() for line in run("demo").stdout.split("Next:")[1].splitlines()]
    commands = [shlex.split(line)[1:] for line in lines if line.startswith("lsvision ")]
    assert len(commands) == 5
    (empty_folder / "YOUR_PROFILE.csv").write_bytes(FIXTURE.read_bytes())
    for words in commands:
        assert run(*words).exit_code == 0, words


def test_the_measure_command_it_shows_prints_the_same(run, empty_folder):
    first, *shown = run("demo", "--out", "a folder").stdout.splitlines()
    again = run(*shlex.split(first)[2:])
    table = again.stdout.splitlines()
    assert len(table) == 6
    assert shown[: len(table)] == table


def test_again_it_does_the_same(run, empty_folder):
    assert run("demo").stdout == run("demo").stdout


@pytest.mark.parametrize("name", ["mine/profile.csv", "mine"])
def test_what_is_no_demo_is_left_alone(run, empty_folder, name):
    place = empty_folder / name
    place.parent.mkdir(exist_ok=True)
    place.write_text("my own")
    result = run("demo", "--out", "mine")
    assert result.exit_code == 1
    assert result.stderr.startswith("lsvision: mine")
    assert "--out" in result.stderr
    assert place.read_text() == "my own"


@pytest.mark.parametrize("words", [(), ("--open",)])
def test_the_picture_is_opened_only_when_asked_for(run, empty_folder, monkeypatch, words):
    opened = []
    monkeypatch.setattr("typer.launch", opened.append)
    assert run("demo", *words).exit_code == 0
    assert opened == [str(Path("lsvision-demo") / "profile.png")] * len(words)


def test_its_help_holds_whole_examples(run):
    shown = run("demo", "--help").stdout
    assert "\n    lsvision demo\n" in shown
    assert "lsvision demo --out" in shown
