"""False OK and false NG of simulated parts near their limits; ``-m slow`` runs all conditions."""

import pytest
from scipy import stats

from tests.inspection.false_verdicts import CONDITIONS, KEYS, run, shares

PARTS = 1112
"""Of each condition: 20,016 in all."""
TAIL = 0.025
MAX_OPEN = 1.1
"""Largest undecided share over the least that a rule with this guarantee needs."""


@pytest.mark.slow
@pytest.mark.parametrize("condition", CONDITIONS, ids=str)
def test_few_verdicts_near_the_limits_are_wrong(condition):
    number = CONDITIONS.index(condition)
    results, _ = run(condition, PARTS, 5_000_000 + 10_000 * number)
    at_most = stats.binom.ppf(1 - 1e-4, len(results), TAIL) / len(results)
    for key in KEYS:
        false_ok, false_ng, at_limit, undecided = shares(results, key)
        assert false_ok <= at_most, key
        assert false_ng <= at_most, key
        assert at_limit <= at_most, key
        # Phi and theta of a pipe nearly square to the plane are far from normally distributed: no
        # interval reaches the bound that the least share is computed from.
        near_circle = condition.phi_deg[0] == 0 and condition.noise_mm > 0.05
        if key != "phi_deg" and not (key == "theta_deg" and near_circle):
            assert undecided <= MAX_OPEN, key


def test_a_direction_is_judged_by_its_interval_also_near_a_circle():
    """Where the tables show no theta yet, because a circle is not excluded at 99.9 %."""
    results, _ = run(CONDITIONS[3], 60, 4_400_000)
    false_ok, false_ng, _, undecided = shares(results, "theta_deg")
    assert max(false_ok, false_ng) <= stats.binom.ppf(1 - 1e-4, len(results), TAIL) / len(results)
    assert undecided <= MAX_OPEN


def test_the_run_judges_every_quantity():
    results, lost = run(CONDITIONS[5], 3, 77)
    assert len(results) + lost == 3
    assert set(results[0]) == set(KEYS)
