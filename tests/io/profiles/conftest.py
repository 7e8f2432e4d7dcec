"""A file with given content, for each reader's tests."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    def _write(content: str | bytes, name: str = "profile.txt") -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return _write


@pytest.fixture
def arc() -> np.ndarray:
    """Points of a pipe of 20 mm, 150 mm below the sensor, in thousandths of mm."""
    rng = np.random.default_rng(5)
    angle = np.linspace(2.6, 0.54, 80)
    points = 20 * np.column_stack([np.cos(angle), np.sin(angle)]) + [0.0, -150.0]
    return (points + rng.normal(0, 0.02, points.shape)).round(3)
