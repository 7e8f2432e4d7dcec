"""The README is the truth: its commands run, and their output is what it shows."""

import contextlib
import importlib
import io
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import lsvision
from lsvision.cli.app import app
from tests.printed import differing

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"```shell\n(.*?)```", README, re.DOTALL)
SCANNED = re.search(r"--plot pair.png\n```\n+```text\n(.*?)```", README, re.DOTALL)[1]
PYTHON, PYTHON_OUTPUT = re.search(
    r"```python\n(.*?)```\n+```text\n(.*?)```", README, re.DOTALL
).groups()
MEASURED = re.search(r"```text\n(.*?)```", README, re.DOTALL)[1]


def words_of(command):
    return [
        f"{ROOT}/{word}" if word.startswith(("fixtures/", "calibration/")) else word
        for word in shlex.split(command)[1:]
    ]


def block_of(start):
    """The only block of commands that begins with a text."""
    (commands,) = (block for block in COMMANDS if block.startswith(start))
    return commands


def output_below(commands):
    """What the README shows below commands."""
    return README.split(commands, 1)[1].split("```text\n", 1)[1].split("```")[0]


def words_printed(run_lsvision, commands):
    """What the commands of a block print, without the path of the repository."""
    printed = []
    for command in commands.strip().splitlines():
        done = run_lsvision(command)
        assert done.exit_code == 0, done.stderr
        printed += done.stdout.replace(f"{ROOT}/", "").split()
    return printed


@pytest.fixture
def run_lsvision(tmp_path, monkeypatch):
    """Runs a command line of the README in this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return lambda command: CliRunner().invoke(app, words_of(command), prog_name="lsvision")


def test_the_first_two_shell_blocks_are_the_whole_set_up():
    assert COMMANDS[0].startswith("pip install . && lsvision measure fixtures/")
    assert COMMANDS[1] == "pip install '.[test]' && pytest\n"


def test_the_first_command_prints_the_table_and_draws_the_picture(tmp_path):
    command = COMMANDS[0].split("&&")[1].strip()
    done = subprocess.run(
        [sys.executable, "-m", "lsvision", *words_of(command)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin", "OMP_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    shown = [line.rstrip() for line in MEASURED.splitlines()][1:]
    printed = [line.rstrip() for line in done.stdout.splitlines()][1:]
    assert differing(printed, shown) == []
    assert (tmp_path / "welded.png").read_bytes().startswith(b"\x89PNG")


def test_the_scan_prints_what_it_shows(run_lsvision, tmp_path):
    printed = words_printed(run_lsvision, block_of("lsvision scan"))
    assert differing(printed, SCANNED.split()) == []
    assert (tmp_path / "pair.png").exists()


def test_the_inspection_prints_what_it_shows_and_ends_with_the_code_of_ng(run_lsvision, tmp_path):
    command = block_of("lsvision inspect")
    done = run_lsvision(command)
    assert done.exit_code == 3, done.stderr
    printed = done.stdout.replace(f"{ROOT}/", "").split()
    assert differing(printed, output_below(command).split()) == []
    assert "<svg" in (tmp_path / "pair.html").read_text(encoding="utf-8")


def test_the_images_print_what_they_show(run_lsvision, tmp_path):
    commands = block_of("lsvision line")
    printed = words_printed(run_lsvision, commands)
    assert differing(printed, output_below(commands).split()) == []
    assert (tmp_path / "line.png").exists()
    assert (tmp_path / "found.png").exists()


def test_the_robot_prints_what_it_shows(run_lsvision):
    commands = block_of("lsvision calibrate hand-eye")
    printed = words_printed(run_lsvision, commands)
    for part in output_below(commands).split("...\n")[:-1]:  # of six tables the first
        words = part.split()
        starts = (i for i, word in enumerate(printed) if not differing([word], words[:1]))
        assert any(not differing(printed[i : i + len(words)], words) for i in starts), part


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.startswith("lsvision plan")])
def test_every_other_command_runs(command, run_lsvision):
    words_printed(run_lsvision, command)


def test_the_batch_is_done_and_tells_its_status(run_lsvision, tmp_path):
    first, second = map(run_lsvision, block_of("lsvision batch").strip().splitlines())
    assert (first.exit_code, second.exit_code) == (0, 0), first.stderr + second.stderr
    assert first.stdout == second.stdout
    assert first.stdout.startswith("20 of 20 files done, 0 failed, 0 left: 20 profiles")
    assert len(list((tmp_path / "cylinders").glob("*.parquet"))) == 20


def test_the_python_example_prints_what_it_says(monkeypatch):
    monkeypatch.chdir(ROOT)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(PYTHON, "README.md", "exec"), {})
    assert differing(printed.getvalue().splitlines(), PYTHON_OUTPUT.splitlines()) == []


def test_every_public_name_exists():
    names = set(re.findall(r"\blsv\.(\w+)", README))
    assert [name for name in sorted(names) if not hasattr(lsvision, name)] == []


def test_every_function_of_a_module_exists():
    functions = re.findall(r"`(\w+)\([^`]*\)` of\s+`(lsvision[.\w]+)`", README)
    assert functions
    for name, module in functions:
        assert callable(getattr(importlib.import_module(module), name))
