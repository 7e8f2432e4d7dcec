"""Completion of the command's words in a shell."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
BASH = shutil.which("bash")

pytestmark = pytest.mark.skipif(BASH is None, reason="bash is not here")


@pytest.fixture
def bash(tmp_path):
    """Runs a line in bash, with this source tree's ``lsvision`` first on the path."""
    command = tmp_path / "bin" / "lsvision"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m lsvision "$@"\n')
    command.chmod(0o755)
    path = f"{command.parent}{os.pathsep}{os.environ['PATH']}"
    environment = {"PATH": path, "PYTHONPATH": str(REPOSITORY), "HOME": str(tmp_path)}

    def run(line):
        # With one command bash would give way to it, and no shell would be its parent.
        words = [BASH, "--noprofile", "--norc", "-c", f"{line}; true"]
        return subprocess.run(
            words, env=environment, capture_output=True, text=True, timeout=60, check=True
        ).stdout

    return run


def completed(bash, *words):
    """What bash offers for the last of some words."""
    typed = " ".join(f"'{word}'" for word in words)
    return bash(
        'eval "$(lsvision --show-completion)"; '
        f"COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; _lsvision_completion lsvision; "
        'echo "${COMPREPLY[@]}"'
    ).split()


def test_the_script_is_shown(bash):
    assert "complete -o default -F _lsvision_completion lsvision" in bash(
        "lsvision --show-completion"
    )


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("lsvision", "me"), ["measure"]),
        (("lsvision", "calibrate", "la"), ["laser-plane"]),
        (("lsvision", "measure", "--known-r"), ["--known-radius"]),
    ],
    ids=["command", "command of a group", "option"],
)
def test_commands_and_options_are_completed(bash, words, expected):
    assert completed(bash, *words) == expected


def test_installing_changes_only_the_shells_own_files(bash, tmp_path):
    bash("lsvision --install-completion")
    script = tmp_path / ".bash_completions" / "lsvision.sh"
    assert "_lsvision_completion" in script.read_text()
    assert str(script) in (tmp_path / ".bashrc").read_text()
