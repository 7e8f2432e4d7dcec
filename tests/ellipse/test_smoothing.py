import math
from dataclasses import replace

import numpy as np
import pytest

from lsvision import Ellipse
from lsvision.ellipse.smoothing import (
    POSITION_COUNT,
    smooth_arcs,
    smooth_residuals,
)
from lsvision.geometry import orthogonal_residuals
from lsvision.geometry.noisy_points import NoisyPoints, as_vectors
from tests.ellipse.arcs import SENSOR, measured, pipe, upper_arc
from tests.tolerances import MACHINE, ROUNDING

TRUTH = pipe(25.0)
SLIGHTLY_OFF = Ellipse((5.2, -400.1), TRUTH.semi_major + 0.2, TRUTH.semi_minor + 0.1, 0.55)
LENGTH = np.linspace(0.0, 60.0, 121)
EVEN = np.linspace(0.0, 60.0, 25)
STDS = np.full(121, 0.05)


def smooth_arc(points, ellipse):
    """An arc smoothed alone."""
    (smoothed,) = smooth_arcs([points], [ellipse])
    return smoothed


def smooth_residual(*arrays):
    """Smoothed residuals and weights of one arc; see `smooth_residuals`."""
    rows = [array[None] for array in arrays]
    smooth, weights = smooth_residuals(*rows, np.ones(rows[0].shape, dtype=bool))
    return smooth[0], weights[0]


def noisy(points):
    return NoisyPoints.of(points, SENSOR.covariances(points))


def local_quadratic(length, residuals, stds, even, weights):
    """Loader's local regression by `np.polyfit`: tricube kernel, 30 % of the arc wide."""
    half = 0.15 * (length[-1] - length[0])
    smooth = []
    for place in even:
        first = min(max(place - half, length[0]), length[-1] - 2 * half)
        reach = max(place - first, first + 2 * half - place)
        kernel = np.clip(1 - np.abs((length - place) / reach) ** 3, 0, None) ** 3
        # Weights of `np.polyfit` multiply the residuals, not their squares.
        used = kernel * weights > 0
        each = np.sqrt(kernel * weights)[used] / stds[used]
        fitted = np.polyfit(length[used] - place, residuals[used], 2, w=each)
        smooth.append(fitted[-1])
    return np.array(smooth)


def bisquare(normalised):
    """Tukey's bisquare at 95 % efficiency, about the median of the moduli."""
    scale = max(1.4826 * float(np.median(np.abs(normalised))), 1.0)
    return np.clip(1 - (normalised / (4.685 * scale)) ** 2, 0, None) ** 2


def robust_quadratic(length, residuals, stds, even):
    """Return the regression with the weights of the residuals, and the weights of what remains."""
    smooth = local_quadratic(length, residuals, stds, even, bisquare(residuals / stds))
    return smooth, bisquare((residuals - np.interp(length, even, smooth)) / stds)


@pytest.mark.parametrize("factor", [0.7, 3.0], ids=["within the noise", "beyond it"])
def test_it_is_a_robust_local_quadratic_regression(factor, rng):
    stds = STDS * rng.uniform(0.5, 2.0, 121)
    residuals = np.sin(LENGTH / 9) + factor * stds * rng.normal(size=121)
    residuals[[20, 77, 78]] += (1.0, -2.0, 3.0)
    smooth, weights = smooth_residual(LENGTH, residuals, stds, EVEN)
    wanted, wanted_weights = robust_quadratic(LENGTH, residuals, stds, EVEN)
    np.testing.assert_allclose(smooth, wanted, atol=1e-6)  # of the ridge
    np.testing.assert_allclose(weights, wanted_weights, atol=1e-5)


@pytest.mark.parametrize(
    "residual",
    [0 * LENGTH, 0.3 + 0 * LENGTH, 0.01 * LENGTH, 0.001 * (LENGTH - 20) ** 2],
    ids=["zero", "constant", "slope", "parabola"],
)
def test_quadratics_pass_unchanged(residual):
    smooth, _ = smooth_residual(LENGTH, residual, STDS, EVEN)
    np.testing.assert_allclose(smooth, np.interp(EVEN, LENGTH, residual), atol=1e-6)  # of the ridge


@pytest.mark.parametrize(
    ("sigmas", "kept"), [(4.3, True), (-4.3, True), (5.0, False), (-5.0, False)]
)
def test_a_jump_is_4_7_sigma_from_its_neighbours(sigmas, kept):
    residuals = np.zeros(2001)
    residuals[1000] = 0.05 * sigmas
    length = np.linspace(0.0, 60.0, 2001)
    _, weights = smooth_residual(length, residuals, np.full(2001, 0.05), EVEN)
    assert (weights[1000] > 0) is np.bool_(kept)
    assert weights.mean() > 0.999


def test_jumps_get_no_weight_and_leave_no_trace(rng):
    residuals = 0.05 * rng.normal(size=121)
    jumps = [7, 40, 41, 99]
    with_jumps = residuals.copy()
    with_jumps[jumps] += 5.0
    smooth, weights = smooth_residual(LENGTH, with_jumps, STDS, EVEN)
    np.testing.assert_array_equal(np.flatnonzero(weights == 0), jumps)
    clean, _ = smooth_residual(LENGTH, residuals, STDS, EVEN)
    # As large as leaving four points out makes it.
    assert np.abs(smooth - clean).max() < 0.05


def test_smoothing_lessens_noise(rng):
    residuals = 0.05 * rng.normal(size=121)
    assert smooth_residual(LENGTH, residuals, STDS, EVEN)[0].std() < 0.5 * residuals.std()


def test_smoothing_is_the_same_from_either_end(rng):
    residuals = 0.05 * rng.normal(size=121)
    there, weights = smooth_residual(LENGTH, residuals, STDS, EVEN)
    back, back_weights = smooth_residual(60.0 - LENGTH[::-1], residuals[::-1], STDS, EVEN)
    np.testing.assert_allclose(back[::-1], there, atol=MACHINE)
    np.testing.assert_allclose(back_weights[::-1], weights, atol=1e-6)


@pytest.mark.parametrize("count", [2, 3, 8])
def test_a_few_points_are_smoothed_without_breaking(count):
    length, even = np.linspace(0, 1, count), np.linspace(0, 1, 9)
    smooth, _ = smooth_residual(length, np.zeros(count), np.ones(count), even)
    np.testing.assert_allclose(smooth, np.zeros(9), atol=MACHINE)


def test_points_at_one_place_are_smoothed_without_breaking():
    smooth, _ = smooth_residual(np.zeros(10), np.full(10, 0.2), np.ones(10), np.zeros(5))
    np.testing.assert_allclose(smooth, 0.2, atol=1e-3)


def test_clean_arcs_have_no_jumps(rng):
    """One of the 14 000 points would be one too many: 4.685 sigma are passed once in 360 000."""
    for _ in range(200):
        points = measured(upper_arc(TRUTH), rng)
        assert smooth_arc(noisy(points), SLIGHTLY_OFF).inliers.all()


@pytest.mark.parametrize("screened", [TRUTH, SLIGHTLY_OFF], ids=["right", "off by 4 sigma"])
def test_jumps_inside_an_arc_are_found_and_nothing_else(screened, rng):
    """5 % of the points of 100 arcs, but for the steepest, displaced by 2 to 12 mm."""
    for _ in range(100):
        points = measured(upper_arc(TRUTH), rng)
        jumps = 8 + np.flatnonzero(rng.random(54) < 0.05)
        rays = points[jumps] / np.hypot(*points[jumps].T)[:, None]
        size = rng.choice([-1, 1], len(jumps)) * rng.uniform(2.0, 12.0, len(jumps))
        points[jumps] += rays * size[:, None]
        found = np.flatnonzero(~smooth_arc(noisy(points), screened).inliers)
        np.testing.assert_array_equal(found, jumps)


@pytest.mark.parametrize("jump", [2, 8, 58, 64])
def test_a_jump_takes_no_clean_neighbours_with_it(jump):
    """12 mm away from the sensor near a steep end, where a window without weights follows it."""
    points = upper_arc(TRUTH)
    points[jump] *= 1 + 12.0 / np.hypot(*points[jump])
    inliers = smooth_arc(noisy(points), TRUTH).inliers
    np.testing.assert_array_equal(np.flatnonzero(~inliers), [jump])


def test_a_wave_as_long_as_the_window_keeps_its_shape_between_the_positions():
    """More positions have the same error, which is that of a local quadratic."""
    residual = 0.2 * np.sin(LENGTH / 60.0 * 2 * math.pi)
    positions = np.linspace(0.0, 60.0, POSITION_COUNT)
    few, _ = smooth_residual(LENGTH, residual, STDS, positions)
    many, _ = smooth_residual(LENGTH, residual, STDS, LENGTH)
    assert np.abs(np.interp(LENGTH, positions, few) - many).max() < 0.2 * 0.025


def test_an_arc_is_smoothed_from_its_first_to_its_last_point():
    points = upper_arc(TRUTH)
    smoothed = smooth_arc(noisy(points), TRUTH)
    unit = as_vectors(smoothed.directions)
    ends = TRUTH.from_ellipse_frame(
        TRUTH.to_ellipse_frame(unit[[0, -1]] + TRUTH.centre) * [TRUTH.semi_major, TRUTH.semi_minor]
    )
    nearest = [np.hypot(*(ends - p).T).min() for p in points[[0, -1]]]
    assert max(nearest) < 1e-6
    assert np.abs(smoothed.residuals).max() < 1e-6


def test_the_standard_deviations_are_those_of_single_points_along_the_normal():
    circle = pipe(0.0)
    points = upper_arc(circle, 120.0, 121)
    smoothed = smooth_arc(noisy(points), circle)
    turns = np.angle(smoothed.directions * np.conj(1j))  # from +Y
    # The ray to the sensor at the origin is some degrees off Y beside the middle.
    np.testing.assert_allclose(smoothed.stds, 0.05 * np.abs(np.cos(turns)), rtol=0.2, atol=3e-3)


@pytest.mark.parametrize("order", ["reverse", "random"])
def test_the_order_of_the_points_does_not_matter(order, rng):
    points = measured(upper_arc(TRUTH), rng)
    points[[20, 45]] += (0.0, 3.0)
    turn = np.arange(70)[::-1] if order == "reverse" else rng.permutation(70)
    there, back = smooth_arc(noisy(points), TRUTH), smooth_arc(noisy(points[turn]), TRUTH)
    np.testing.assert_array_equal(back.inliers, there.inliers[turn])
    np.testing.assert_allclose(back.residuals, there.residuals, atol=MACHINE)
    assert not there.inliers[[20, 45]].any()


@pytest.mark.parametrize("theta", [0.0, math.pi / 2, math.pi - 1e-6], ids=["0", "90", "180"])
def test_the_seam_of_theta_does_not_cut_an_arc(theta):
    truth = pipe(25.0, theta=theta)
    smoothed = smooth_arc(noisy(upper_arc(truth, degrees=200)), truth)
    steps = np.abs(np.angle(smoothed.directions[1:] / smoothed.directions[:-1]))
    assert steps.max() < math.radians(15)
    assert smoothed.inliers.all()


def test_duplicate_points_are_smoothed_too():
    points = np.repeat(upper_arc(TRUTH, count=20), 3, axis=0)
    smoothed = smooth_arc(noisy(points), SLIGHTLY_OFF)
    assert np.isfinite(smoothed.residuals).all()
    assert smoothed.inliers.all()


def test_smoothed_points_lie_nearer_to_the_truth(rng):
    points = measured(upper_arc(TRUTH), rng)
    smoothed = smooth_arc(noisy(points), TRUTH)
    assert smoothed.residuals.std() < 0.6 * orthogonal_residuals(points, TRUTH).std()


def arcs_of_many_sizes(rng, count=12):
    """Noisy points of arcs of 8 to 250 points with jumps, and slightly wrong ellipses."""
    points, ellipses = [], []
    for i in range(count):
        truth = pipe(5.0 * i, radius=10.0 + 3 * i, theta=0.3 * i)
        arc = measured(upper_arc(truth, 60.0 + 10 * i, int(rng.integers(8, 250))), rng)
        arc[len(arc) // 3] += (0.0, 3.0)
        points.append(noisy(arc))
        ellipses.append(replace(truth, semi_major=truth.semi_major + 0.2))
    return points, ellipses


@pytest.mark.parametrize("order", ["as they are", "reverse"])
def test_arcs_in_a_stack_are_smoothed_as_alone(order, rng):
    points, ellipses = arcs_of_many_sizes(rng)
    if order == "reverse":
        points, ellipses = points[::-1], ellipses[::-1]
    for together, *arc in zip(smooth_arcs(points, ellipses), points, ellipses, strict=True):
        alone = smooth_arc(*arc)
        np.testing.assert_array_equal(together.inliers, alone.inliers)
        np.testing.assert_allclose(together.directions, alone.directions, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(together.stds, alone.stds, rtol=ROUNDING)
        # mm: in a window with two points the ridge increases rounding errors.
        few = len(alone.inliers) < 40
        atol = 1e-6 if few else 1e-10
        np.testing.assert_allclose(together.residuals, alone.residuals, rtol=0, atol=atol)
        assert together.ellipse is alone.ellipse


def test_no_arcs_are_smoothed_to_none():
    assert smooth_arcs([], []) == []


def test_points_all_around_an_ellipse_are_smoothed():
    circle = Ellipse((0.0, 0.0), 20.0, 20.0, 0.0)
    points = NoisyPoints.uniform(20.0 * np.array([1, 1j, -1, -1j]), 0.05, 0.05)
    smoothed = smooth_arc(points, circle)
    assert smoothed.inliers.all()
    np.testing.assert_allclose(smoothed.residuals, 0, atol=MACHINE)
