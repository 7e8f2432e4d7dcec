"""The check for profiles that are upside down."""

import numpy as np
import pytest

from lsvision.batch.measure_group import MAX_FLIP_CHECK_POINTS, holds_cylinders_upside_down
from lsvision.measure import Measurement
from lsvision.profile import Profile


@pytest.mark.parametrize(("excess", "checked"), [(-1, 1), (0, 1), (1, 2)])
def test_only_a_profile_above_the_limit_is_subsampled(excess, checked):
    count = MAX_FLIP_CHECK_POINTS + excess
    counts = []

    def measure(profiles):
        counts.extend(map(len, profiles))
        return [Measurement((), ())]

    x = np.linspace(0.0, 100.0, count)
    assert not holds_cylinders_upside_down(measure, Profile(np.column_stack([x, x - 400.0])))
    assert counts == [-(-count // checked)]
