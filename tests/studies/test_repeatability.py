"""Repeated measurements of one position (Figure 16)."""

import dataclasses
import math

import numpy as np
import pytest

from lsvision.studies.chen_liu_2016.repeatability import (
    compute_expected_range,
    measure_repeatedly,
    phi_std_of_axes,
)
from lsvision.studies.chen_liu_2016.report import ExperimentSizes
from tests.tolerances import spread_of_rms


@pytest.mark.parametrize(("count", "mean"), [(2, 1.128), (5, 2.326), (10, 3.078), (100, 5.015)])
def test_the_expected_range_is_that_of_the_tables_of_statistics(count, mean):
    assert compute_expected_range(count) == pytest.approx(mean, abs=5e-4)


def test_the_spread_of_repeated_measurements_is_the_bound(repeatability):
    ratios = np.array(repeatability.stds_mm) / repeatability.bound_stds_mm
    assert (np.abs(ratios - 1) < spread_of_rms(len(repeatability.ellipses))).all()


def test_the_centres_do_not_fit_into_the_papers_box(repeatability):
    assert repeatability.box_mm[1] > 1.0  # mm; the paper's is 0.6 mm high
    assert repeatability.noise_of_printed_box_mm < 0.06


def test_axes_that_vary_by_a_quarter_mm_mean_degrees_of_phi():
    """By simulation: a and b drawn independently about a pipe of phi = 30 deg."""
    a, b = 19.0 / math.cos(math.radians(30)), 19.0
    draws = np.random.default_rng(1).normal(0, 0.125, (20_000, 2))
    phi = np.degrees(np.arccos((b + draws[:, 1]) / (a + draws[:, 0])))
    assert phi_std_of_axes(0.125, 19.0, 30.0) == pytest.approx(phi.std(), rel=0.03)


@pytest.mark.parametrize("repeats", [0, 1])
def test_one_measurement_is_not_repeated(repeats):
    with pytest.raises(ValueError, match=f"two or more measurements .* got {repeats} of {repeats}"):
        measure_repeatedly(repeats, noise_mm=0.1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"runs": {"paper": 1}}, "runs >= 0 of paper, section, known, two, twenty, got"),
        ({"repeats": 1}, "repeats >= 2, got 1"),
        ({"timing_scenes": 0}, "timing_scenes >= 1, got 0"),
        ({"ablation_scenes": -1}, "ablation_scenes >= 1, got -1"),
    ],
)
def test_sizes_without_a_result_are_rejected(changes, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(ExperimentSizes.quick(), **changes)
