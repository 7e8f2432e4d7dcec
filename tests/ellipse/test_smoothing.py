import numpy as np
import pytest

from lsvision.ellipse.smoothing import (
    NODES,
    SmoothingSettings,
    smooth_profile_paper,
    smooth_residual,
)
from tests.ellipse.arcs import pipe, upper_arc
from tests.tolerances import MACHINE

LENGTH = np.linspace(0.0, 60.0, 120)
STDS = np.full(120, 0.05)


@pytest.mark.parametrize(
    "residual",
    [0 * LENGTH, 0.3 + 0 * LENGTH, 0.01 * LENGTH, 0.001 * (LENGTH - 20) ** 2],
    ids=["zero", "constant", "slope", "parabola"],
)
def test_quadratics_pass_unchanged(residual):
    smooth = smooth_residual(LENGTH, residual, STDS)
    # The ridge that keeps empty windows solvable takes a billionth.
    np.testing.assert_allclose(
        smooth.residual, np.interp(smooth.length, LENGTH, residual), atol=1e-4
    )


def test_jumps_get_no_weight_and_leave_no_trace(rng):
    residual = 0.05 * rng.normal(size=120)
    jumps = [7, 40, 41, 99]
    with_jumps = residual.copy()
    with_jumps[jumps] += 5.0
    smooth = smooth_residual(LENGTH, with_jumps, STDS)
    np.testing.assert_array_equal(np.flatnonzero(smooth.weights == 0), jumps)
    clean = smooth_residual(LENGTH, residual, STDS)
    # As large as leaving four points out makes it.
    assert np.abs(smooth.residual - clean.residual).max() < 0.05


def test_honest_noise_keeps_its_weight(rng):
    smooth = smooth_residual(LENGTH, 0.05 * rng.normal(size=120), STDS)
    assert np.mean(smooth.weights > 0) > 0.98
    assert ((smooth.weights >= 0) & (smooth.weights <= 1)).all()


def test_smoothing_lessens_noise(rng):
    residual = 0.05 * rng.normal(size=120)
    assert smooth_residual(LENGTH, residual, STDS).residual.std() < 0.5 * residual.std()


def test_smoothing_is_the_same_from_either_end(rng):
    residual = 0.05 * rng.normal(size=120)
    there = smooth_residual(LENGTH, residual, STDS)
    back = smooth_residual(60.0 - LENGTH[::-1], residual[::-1], STDS)
    np.testing.assert_allclose(back.residual[::-1], there.residual, atol=MACHINE)
    np.testing.assert_allclose(back.weights[::-1], there.weights, atol=1e-6)


def test_precise_points_weigh_more():
    residual = np.where(np.arange(120) % 2 == 0, 1.0, 0.0)
    stds = np.where(np.arange(120) % 2 == 0, 1.0, 0.01)
    smooth = smooth_residual(LENGTH, residual, stds, SmoothingSettings(robust_iterations=0))
    assert np.abs(smooth.residual).max() < 0.01


@pytest.mark.parametrize("count", [2, 3, 8])
def test_a_few_points_are_smoothed_without_breaking(count):
    length = np.linspace(0, 1, count)
    smooth = smooth_residual(length, np.zeros(count), np.ones(count))
    np.testing.assert_allclose(smooth.residual, np.zeros(NODES), atol=MACHINE)


def test_points_at_one_place_are_smoothed_without_breaking():
    smooth = smooth_residual(np.zeros(10), np.full(10, 0.2), np.ones(10))
    np.testing.assert_allclose(smooth.residual, 0.2, atol=1e-3)


def test_the_literal_step_keeps_parabolas_and_spoils_circles():
    x = np.linspace(-10, 10, 41)
    parabola = np.column_stack([x, -0.05 * x * x])
    np.testing.assert_allclose(smooth_profile_paper(parabola), parabola, atol=MACHINE)
    arc = upper_arc(pipe(0.0), degrees=150)
    assert np.abs(smooth_profile_paper(arc) - arc).max() > 0.1
