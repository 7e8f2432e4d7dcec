"""False OK and false NG of simulated parts near their limits; ``-m slow`` runs all conditions."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from lsvision.inspection.decision import Decision
from lsvision.inspection.job import Job
from lsvision.inspection.judge import judge
from lsvision.measure import measure_profiles
from lsvision.simulate import SCENE_SENSOR, Scene, SectionSettings, Tube, simulate_section
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


@pytest.mark.slow
def test_a_tilt_at_its_limit_is_seldom_ng():
    """All errors of a phi of the size of its error are on one side: too large."""
    phi_deg, parts = 6.0, 600
    sensor = replace(SCENE_SENSOR, range_std=0.05)
    scene = Scene((Tube.of(15.0, math.radians(60), math.radians(phi_deg), (22.0, -410.0)),))
    settings = SectionSettings(jump_fraction=0.0, lost_fraction=0.0)
    rng = np.random.default_rng(61)
    profiles = [
        simulate_section(scene, sensor, settings, rng=rng).profile.points for _ in range(parts)
    ]
    job = Job.from_text(
        f'name = "t"\n[[part]]\nname = "t"\norder = 1\nphi_deg = {{ max = {phi_deg} }}'
    )
    verdicts = [judge(each, job) for each in measure_profiles(profiles, sensor=sensor)]
    ng = sum(verdict.decision == Decision.NG for verdict in verdicts)
    assert ng <= stats.binom.ppf(1 - 1e-4, parts, TAIL)
    assert all(verdict.part("t").cylinder == 0 for verdict in verdicts)


def test_the_run_judges_every_quantity():
    results, lost = run(CONDITIONS[5], 3, 77)
    assert len(results) + lost == 3
    assert set(results[0]) == set(KEYS)
