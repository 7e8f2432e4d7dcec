"""Quantiles and probabilities, against scipy's."""

import numpy as np
import numpy.testing as npt
import pytest
from scipy.special import chdtri, fdtri, ndtr

from lsvision.statistics.quantiles import normal_probability, squared_quantile

LEVELS = (0.05, 0.5, 0.68, 0.95, 0.9973, 0.999)
DEGREES = (
    1.0,
    1.05,
    1.1,
    1.5,
    2.0,
    3.7,
    8.0,
    25.3,
    80.0,
    101.0,
    371.5,
    5e3,
    9.9e4,
    1.1e5,
    3e6,
    1e10,
)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("quantities", [1, 2])
def test_quantile_with_an_estimated_variance_is_that_of_f(quantities, level):
    ours = squared_quantile(quantities, np.array(DEGREES), level)
    npt.assert_allclose(ours, quantities * fdtri(quantities, DEGREES, level), rtol=1e-8)


@pytest.mark.parametrize("level", [1e-6, 0.9999, 0.999999, 1 - 1e-9])
@pytest.mark.parametrize("quantities", [1, 2])
def test_quantile_of_an_extreme_level(quantities, level):
    ours = squared_quantile(quantities, np.array(DEGREES), level)
    npt.assert_allclose(ours, quantities * fdtri(quantities, DEGREES, level), rtol=1e-5)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("quantities", [1, 2])
def test_quantile_with_a_known_variance_is_that_of_chi_squared(quantities, level):
    ours = squared_quantile(quantities, np.array([np.inf]), level)
    npt.assert_allclose(ours, [chdtri(quantities, 1 - level)], rtol=1e-12)


def test_normal_probability_in_both_tails():
    values = np.linspace(-12.0, 12.0, 60).reshape(3, 20)
    npt.assert_allclose(normal_probability(values), ndtr(values), rtol=1e-12)
