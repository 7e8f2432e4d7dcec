"""The goals of accuracy and speed as tests, at the quick effort: ``pytest -m slow tests/bench``."""

import pytest

from tests.bench.__main__ import BENCHES, QUICK
from tests.bench.goals import missed
from tests.bench.spheres import real_data

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", sorted(set(BENCHES) - {"spheres"}))
def test_every_goal_is_reached(name):
    assert not missed(BENCHES[name](QUICK))


@pytest.mark.skipif(not real_data(), reason="real profiles are not shipped: ../shared/real")
def test_every_goal_on_real_spheres_is_reached():
    assert not missed(BENCHES["spheres"](QUICK))
