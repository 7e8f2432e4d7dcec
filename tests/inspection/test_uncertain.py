import math

import numpy as np
import pytest
from scipy import stats

from lsvision.inspection.uncertain import Length, Scalar, two_sided_factor

TAIL = 0.025
DRAWS = 400
MAX_COUNT = stats.binom.ppf(0.9999, DRAWS, TAIL)
"""Most misses of one tail in `DRAWS`, if each has the probability `TAIL`."""
COVARIANCES = {
    "round": np.eye(2),
    "long": np.array([[1.0, 0.9], [0.9, 1.0]]),
    "a line": np.diag([0.0, 1.0]),
}


@pytest.mark.parametrize("length", [0.0, 0.5, 2.0, 5.0])
@pytest.mark.parametrize("name", COVARIANCES)
def test_neither_end_of_a_length_misses_the_truth_too_often(name, length, rng):
    covariance = COVARIANCES[name]
    below = above = 0
    for angle in rng.uniform(0, 2 * math.pi, DRAWS):
        truth = length * np.array([math.cos(angle), math.sin(angle)])
        drawn = rng.multivariate_normal(truth, covariance)
        low, high = Length(drawn, covariance).interval(1 - 2 * TAIL)
        below += high < length
        above += low > length
    assert below <= MAX_COUNT
    assert above <= MAX_COUNT


def test_the_lower_end_of_a_round_length_is_that_of_the_rice_distribution():
    vector, std, level = np.array([3.0, 1.0]), 0.9, 0.95
    low, _ = Length(vector, std**2 * np.eye(2)).interval(level)
    beyond = stats.rice.sf(np.linalg.norm(vector), low / std, scale=std)
    assert beyond == pytest.approx((1 - level) / 2, abs=5e-4)


def test_far_from_zero_a_length_is_normally_distributed():
    covariance = np.diag([0.04, 0.01])
    low, high = Length(np.array([6.0, 8.0]), covariance).interval(0.95)
    half = stats.norm.ppf(0.975) * math.sqrt(0.6**2 * 0.04 + 0.8**2 * 0.01)
    assert (low, high) == pytest.approx((10 - half, 10 + half), abs=1e-9)


def test_an_exact_length_has_no_interval():
    assert Length(np.array([3.0, 4.0]), np.zeros((2, 2))).interval(0.95) == (5.0, 5.0)
    assert Length(np.zeros(2), np.zeros((2, 2))).std == 0


def test_few_degrees_of_freedom_widen_both_kinds():
    assert Scalar(1.0, 0.1, 5).interval(0.95)[1] == pytest.approx(1 + 0.1 * stats.t.ppf(0.975, 5))
    wide, narrow = (Length(np.array([9.0, 0.0]), np.eye(2), dof) for dof in (5, math.inf))
    assert wide.interval(0.95)[0] < narrow.interval(0.95)[0]
    assert wide.interval(0.95)[1] > narrow.interval(0.95)[1]
    assert two_sided_factor(0.9) == pytest.approx(stats.norm.ppf(0.95))
