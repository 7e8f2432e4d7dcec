"""Fixtures only."""

import zlib

import numpy as np
import pytest


@pytest.fixture
def rng(request):
    """Seeded by the test's own name: alike in any order; printed, so that a failure shows it."""
    seed = zlib.crc32(request.node.nodeid.encode())
    print(f"seed of rng: {seed}")
    return np.random.default_rng(seed)
