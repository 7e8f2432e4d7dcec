"""The cases of ../shared/cases/hostile, if the folder exists: rejected in one line, or read."""

import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lsvision import measure_cylinders, read_profile
from lsvision.cli.app import app

REPOSITORY = Path(__file__).parents[1]
FOLDERS = [
    REPOSITORY.parent / "shared/cases/hostile",
    Path("/work/shared/cases/hostile"),
]
HOSTILE = next((folder for folder in FOLDERS if folder.is_dir()), FOLDERS[0])
CASES = sorted(path.name for path in HOSTILE.iterdir()) if HOSTILE.is_dir() else []
SINGLE = REPOSITORY / "fixtures/single.csv"
PAIR = REPOSITORY / "fixtures/images/pair.png"
READ = {"cr.csv", "u2028.csv"}
"""Line ends of other kinds, which are read: a pipe of 20 mm."""


def words_for(path):
    if path.name.startswith("p_"):
        return ["measure", SINGLE, "--poses", path, "--convention", "kuka"]
    if path.name.startswith("he_"):
        return ["measure", SINGLE, "--flange-from-section", path]
    if path.name.startswith("rig_"):
        return ["measure", PAIR, "--light-section", path]
    if path.suffix == ".png":
        return ["line", path]
    return ["measure", path]


@pytest.mark.skipif(not CASES, reason=f"{HOSTILE} is not here")
@pytest.mark.parametrize("name", [name for name in CASES if name not in READ])
def test_a_hostile_file_is_one_line(name, capfd):
    path = HOSTILE / name
    result = CliRunner().invoke(app, [*map(str, words_for(path))], prog_name="lsvision")
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"lsvision: {path}")
    assert "internal error" not in line
    assert capfd.readouterr() == ("", "")  # of native libraries


@pytest.mark.skipif(not CASES, reason=f"{HOSTILE} is not here")
@pytest.mark.parametrize("name", sorted(READ))
def test_every_line_end_is_read(name):
    (cylinder,) = measure_cylinders(read_profile(HOSTILE / name)).cylinders
    low, high = cylinder.interval("radius")
    assert low < 20 < high


@pytest.mark.skipif("h_nocols.json" not in CASES, reason=f"{HOSTILE} is not here")
def test_a_matrix_without_columns_spoils_no_memory():
    code = (
        "import sys\nfrom lsvision import LsvisionError, read_profile\n"
        "for _ in range(2000):\n"
        "    try: read_profile(sys.argv[1])\n"
        "    except LsvisionError: pass\n"
    )
    words = [sys.executable, "-c", code, str(HOSTILE / "h_nocols.json")]
    result = subprocess.run(words, cwd=REPOSITORY, capture_output=True, timeout=60, check=False)
    assert (result.returncode, result.stderr) == (0, b"")
