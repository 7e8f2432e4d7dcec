"""Medians of few values, against the definition."""

import math

import numpy as np
import pytest

from lsvision.statistics.robust import mad_std, median, upper_mad_std, upper_median


@pytest.mark.parametrize("count", [1, 2, 3, 4, 9, 10])
def test_medians_are_those_of_numpy(count, rng):
    values = rng.normal(size=count)
    assert median(values) == np.median(values)
    assert upper_median(values) == np.sort(values)[count // 2]
    assert mad_std(values) == pytest.approx(1.4826 * np.median(np.abs(values)))
    assert upper_mad_std(values) == pytest.approx(1.4826 * np.sort(np.abs(values))[count // 2])


def test_a_median_with_a_missing_value_is_missing():
    assert math.isnan(median(np.array([1.0, np.nan, 2.0])))
