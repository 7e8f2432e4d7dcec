"""A pipe to scan, and the fixtures."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lsvision.geometry import Pose
from lsvision.io.profiles import read_profile
from lsvision.profile import Profile
from lsvision.simulate import Tube

FIXTURES = Path(__file__).parents[2] / "fixtures"


@pytest.fixture(scope="session")
def pipe() -> Tube:
    return Tube.of(19.0, math.radians(30.0), math.radians(20.0), (0.0, -400.0))


@pytest.fixture(scope="session")
def fixture_scan() -> Callable[[str], tuple[list[Profile], list[Pose], dict[str, Any]]]:
    """Profiles, poses and truth of a folder of fixtures; the noise is left to be estimated."""

    def read(name: str) -> tuple[list[Profile], list[Pose], dict[str, Any]]:
        truth = json.loads((FIXTURES / name / "scan.truth.json").read_text())
        files = sorted((FIXTURES / name).glob("*.csv"))
        poses = [Pose.from_matrix(matrix) for matrix in truth["base_from_sections"]]
        return [read_profile(file) for file in files], poses, truth

    return read
