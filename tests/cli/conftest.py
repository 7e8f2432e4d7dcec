"""The command line run in this process, and profiles to run it on."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

from lsvision.cli.app import app


@pytest.fixture
def run():
    """Runs ``lsvision WORDS...``; its streams and exit code."""
    return lambda *words: CliRunner().invoke(
        app,
        [str(word) for word in words],
        prog_name="lsvision",
        env={"COLUMNS": "200", "NO_COLOR": "1"},
    )


@pytest.fixture
def pipe():
    """Points of a pipe of 19 mm, 400 mm below the sensor, left to right, 0.03 mm noise."""
    angle = np.linspace(2.6, 0.5, 160)
    circle = 19.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    noise = np.random.default_rng(7).normal(0, 0.03, (160, 2))
    return circle + noise - np.array([0.0, 400.0])


@pytest.fixture
def written(tmp_path):
    """Writes points as x,z text and returns the path."""

    def write(points, name="profile.csv"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, points, delimiter=",", fmt="%.6f")
        return path

    return write


@pytest.fixture
def rows():
    """Cells of the table's rows of values: number, radius, theta, phi, centre x, y, points."""

    def split(result):
        lines = [re.split(r" {2,}", line.strip()) for line in result.stdout.splitlines()]
        return [cells for cells in lines if cells[0].isdecimal()]

    return split
