"""Planned uncertainties: scaling laws, pose errors, limits, and errors of the calls."""

import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from lsvision.errors import DegenerateGeometry, TooFewPoints
from lsvision.geometry import Ellipse
from lsvision.planning import (
    AccuracyTarget,
    Feed,
    SensorView,
    plan_scan,
    plan_section,
    section_bound,
    sections_needed,
)
from lsvision.sensors.profile_sensor import LATERAL_STD_RATIO
from tests.planning.views import (
    CASES,
    DIFFERENCES,
    FINE,
    FOUR_SIGMA,
    ROUNDING,
    VIEW,
    fit_ranges,
    pipe_and_points,
    rad,
    range_fisher,
    ray_ranges,
    ray_stds,
    rmse_of_brute_force,
    scan_rays,
    sigmas,
)


@pytest.mark.parametrize(("radius", "theta_deg", "phi_deg"), CASES)
def test_scan_bound_is_the_inverse_information_of_the_ranges(radius, theta_deg, phi_deg):
    unknowns, pipe, _ = pipe_and_points(radius, theta_deg, phi_deg)
    feed = Feed(sections=5, spacing=4.0, direction=(0.1, 0.0, 1.0))
    rays, origins = scan_rays(pipe, feed)
    stds = ray_stds(ray_ranges(unknowns, rays, origins))
    oracle = np.sqrt(np.diag(range_fisher(unknowns, rays, origins, stds)))[2:]
    lateral = 2 * LATERAL_STD_RATIO**2 * 10  # tan^2 of 72 deg: the preset's share across the ray
    planned = sigmas(plan_scan(*unknowns[2:], view=VIEW, feed=feed))
    assert (planned >= oracle * (1 - DIFFERENCES)).all()
    assert (planned <= oracle * (1 + lateral)).all()


@pytest.mark.parametrize(("radius", "theta_deg", "phi_deg"), CASES)
def test_a_scan_of_one_section_agrees_with_the_section(radius, theta_deg, phi_deg):
    one = plan_section(radius, *rad(theta_deg, phi_deg), view=VIEW)
    scan = plan_scan(radius, *rad(theta_deg, phi_deg), view=VIEW, feed=Feed(sections=1))
    np.testing.assert_allclose(sigmas(scan), sigmas(one), rtol=1e-6)


@pytest.mark.parametrize("plan", [plan_section, plan_scan])
def test_twice_the_noise_is_twice_the_sigma(plan):
    loud = replace(VIEW, sensor=replace(FINE, range_std=0.1))
    quiet, noisy = (sigmas(plan(19.0, 0.3, 0.4, view=view)) for view in (VIEW, loud))
    np.testing.assert_allclose(noisy, 2 * quiet, rtol=ROUNDING)


def scaled(view, s):
    sensor = replace(
        view.sensor,
        range_std=view.sensor.range_std * s,
        reference_range=view.sensor.reference_range * s,
        min_range=view.sensor.min_range * s,
        max_range=view.sensor.max_range * s,
        width_at_max_range=view.sensor.width_at_max_range * s,
    )
    return replace(view, sensor=sensor, standoff=view.standoff * s, pitch=view.pitch * s)


def test_scaling_everything_scales_lengths_and_keeps_angles():
    plain = sigmas(plan_section(19.0, 0.3, 0.4, view=VIEW))
    large = sigmas(plan_section(57.0, 0.3, 0.4, view=scaled(VIEW, 3.0)))
    np.testing.assert_allclose(large, plain * (3, 1, 1), rtol=1e-7)


@pytest.mark.parametrize("plan", [plan_section, plan_scan])
def test_four_times_the_points_is_half_the_sigma(plan):
    dense = replace(VIEW, pitch=0.01)
    sparse, fine = (
        sigmas(plan(19.0, 0.3, 0.4, view=replace(dense, pitch=pitch))) for pitch in (0.04, 0.01)
    )
    # The outermost ray lands anywhere within a pitch, where the information is densest.
    np.testing.assert_allclose(fine, sparse / 2, rtol=0.03)


@pytest.mark.slow
def test_prediction_is_what_a_brute_force_fit_achieves_over_random_geometries():
    rng = np.random.default_rng(11)
    ratios = []
    for _ in range(50):
        radius, theta_deg, phi_deg = rng.uniform((10, 0, 5), (40, 180, 40))
        unknowns, pipe, _ = pipe_and_points(radius, theta_deg, phi_deg)
        feed = Feed(sections=int(rng.integers(2, 7)), spacing=rng.uniform(2, 10))
        rays, origins = scan_rays(pipe, feed)
        stds = ray_stds(ray_ranges(unknowns, rays, origins))
        rmse = rmse_of_brute_force(unknowns, rays, origins, stds)
        ratios.append(rmse / sigmas(plan_scan(*unknowns[2:], view=VIEW, feed=feed)))
    low, median, high = np.percentile(ratios, (0, 50, 100))
    print(
        f"\nachieved / predicted: {low:.3f} .. median {median:.3f} .. {high:.3f}, goal 0.9 .. 1.1"
    )
    assert abs(median - 1) < 0.02
    # A tolerance of 10 % plus one standard deviation of the Monte Carlo estimate.
    assert low > 0.90 - FOUR_SIGMA / 4
    assert high < 1.10 + FOUR_SIGMA / 4


def test_feed_direction_error_changes_the_direction_as_predicted():
    unknowns, pipe, _ = pipe_and_points(19.0, 20, 20)
    feed = Feed(sections=11, spacing=4.0)
    rays, reported = scan_rays(pipe, feed)
    small = 0.002  # rad, little enough for the linear response
    ranges = []
    for axis in range(2):
        true = reported.copy()
        true[:, axis] += small * reported[:, 2]
        ranges.append(ray_ranges(unknowns, rays, true))
    stds = ray_stds(np.array(ranges))
    found = fit_ranges(unknowns, rays, reported, np.array(ranges), stds) - unknowns
    shifted = np.hypot(*found)[2:]
    plain, off = (
        sigmas(plan_scan(*unknowns[2:], view=VIEW, feed=replace(feed, feed_std=std)))
        for std in (0.0, small)
    )
    np.testing.assert_allclose(np.sqrt(off**2 - plain**2), shifted, rtol=0.03)


def test_pose_errors_of_many_sections_average_out():
    few, many = (Feed(sections=n, spacing=40 / (n - 1), pose_std=1.0) for n in (5, 41))
    a, b = (plan_scan(19.0, 0.3, 0.4, view=VIEW, feed=feed).direction_std for feed in (few, many))
    # sd of a slope over a fixed length with n equal steps: 1 / sqrt(n (n + 1) / (n - 1)).
    assert a / b == pytest.approx(math.sqrt((41 * 42 / 40) / (5 * 6 / 4)), rel=0.02)


def test_pose_error_moves_the_axis_of_a_single_section():
    feeds = (Feed(sections=1, pose_std=std) for std in (0.0, 0.3))
    plain, moved = (plan_scan(19.0, 0.3, 0.3, view=VIEW, feed=feed) for feed in feeds)
    added = moved.position_std**2 - plain.position_std**2
    assert added == pytest.approx(2 * 0.3**2, rel=1e-6)  # two directions across the axis


def test_exactly_known_radius_is_the_limit_of_a_sharp_prior():
    exact = plan_section(19.0, 0.3, 0.4, view=VIEW, known_radius_std=0.0)
    sharp = plan_section(19.0, 0.3, 0.4, view=VIEW, known_radius_std=1e-6)
    assert exact.radius_std == 0.0
    np.testing.assert_allclose(sigmas(exact)[1:], sigmas(sharp)[1:], rtol=1e-6)


def test_circle_has_no_theta_and_a_finite_phi():
    flat = plan_section(19.0, 0.3, 0.0, view=VIEW)
    assert flat.theta_std == pytest.approx(math.pi / math.sqrt(12))
    assert math.isinf(flat.covariance[4, 4])
    assert not np.isnan(flat.covariance).any()
    assert 0 < flat.phi_std < 0.5


def test_phi_std_is_not_limited_where_the_linear_bound_is_valid():
    phi = math.radians(20)
    prediction = plan_section(19.0, 0.3, phi, view=VIEW)
    a, b = 19.0 / math.cos(phi), 19.0
    by_axes = np.array([b / a, -1.0]) / math.sqrt(a * a - b * b)
    linear = math.sqrt(by_axes @ prediction.covariance[2:4, 2:4] @ by_axes)
    assert prediction.phi_std == pytest.approx(linear, rel=ROUNDING)


@pytest.mark.parametrize("spacing", [0.5, 5.0])
def test_sections_needed_is_the_least_number_that_reaches_the_target(spacing):
    target, feed = AccuracyTarget(phi_std=math.radians(0.05)), Feed(spacing=spacing)
    answer = sections_needed(19.0, 0.3, 0.3, target=target, feed=feed)
    fewer = plan_scan(19.0, 0.3, 0.3, feed=replace(feed, sections=answer.sections - 1))
    assert answer.phi_std <= target.phi_std < fewer.phi_std
    assert answer.length == pytest.approx((answer.sections - 1) * spacing)


def test_sections_needed_finds_a_target_that_longer_scans_miss():
    """With an error of the feed, phi_std has its minimum at 22 sections: 16 and 32 miss it."""
    tube, feed = (18.4, 2.78, 1.0), Feed(feed_std=1e-3)
    stds = {
        n: plan_scan(*tube, feed=replace(feed, sections=n), known_radius_std=0.0).phi_std
        for n in (16, 22, 32)
    }
    target = AccuracyTarget(phi_std=1.02 * stds[22])
    assert min(stds[16], stds[32]) > target.phi_std
    answer = sections_needed(*tube, target=target, feed=feed, known_radius_std=0.0)
    assert 16 < answer.sections <= 22
    assert answer.phi_std <= target.phi_std


def test_sections_needed_of_a_tube_along_the_normal_is_two_or_more():
    """One section does not determine its direction at all."""
    answer = sections_needed(19.0, 0.3, 0.0, target=AccuracyTarget(radius_std=1.0))
    assert answer.sections == 2
    with pytest.raises(DegenerateGeometry, match="radius and axis undetermined"):
        plan_scan(19.0, 0.3, 0.0, feed=Feed(sections=1))


INVALID_CALLS = [
    (lambda: plan_section(-1.0, 0.3, 0.3), ValueError, "positive radius"),
    (
        lambda: plan_section(19.0, 0.3, math.pi / 2),
        ValueError,
        "expected phi from 0 to below pi/2 rad",
    ),
    (lambda: plan_section(19.0, math.nan, 0.3), ValueError, "finite theta"),
    (lambda: plan_section(19.0, 0.3, 0.3, known_radius_std=-1.0), ValueError, "known_radius_std"),
    (
        lambda: plan_section(19.0, 0.3, 0.3, view=SensorView(standoff=900.0)),
        TooFewPoints,
        "standoff",
    ),
    (
        lambda: plan_scan(19.0, 0.3, 0.3, view=SensorView(offset=500.0)),
        TooFewPoints,
        "has 0 points",
    ),
    (lambda: SensorView(standoff=0.0), ValueError, "positive standoff"),
    (lambda: SensorView(offset=math.inf), ValueError, "finite offset"),
    (lambda: SensorView(pitch=-0.6), ValueError, "positive pitch"),
    (lambda: SensorView(incidence_limit=2.0), ValueError, "incidence_limit"),
    (lambda: Feed(sections=0), ValueError, "sections >= 1"),
    (lambda: Feed(spacing=0.0), ValueError, "positive spacing"),
    (lambda: Feed(direction=(0.0, 0.0, 0.0)), ValueError, "feed direction"),
    (lambda: Feed(pose_std=-1.0), ValueError, "pose_std"),
    (AccuracyTarget, ValueError, "at least one target"),
    (lambda: AccuracyTarget(phi_std=0.0), ValueError, "positive"),
    (
        lambda: section_bound(Ellipse((0, 0), 2, 1, 0), np.zeros((4, 2)), np.zeros((4, 2, 2))),
        ValueError,
        "positive finite variances",
    ),
    (
        lambda: section_bound(
            Ellipse((0, 0), 2, 1, 0),
            Ellipse((0, 0), 2, 1, 0).points_at(np.arange(4.0)),
            np.tile(np.eye(2), (4, 1, 1)),
        ),
        DegenerateGeometry,
        "undetermined",
    ),
    (
        lambda: section_bound(Ellipse((0, 0), 2, 1, 0), np.zeros((1, 2)), np.ones((1, 2, 2))),
        TooFewPoints,
        "reduce the standoff",
    ),
]


@pytest.mark.parametrize(("call", "error", "message"), INVALID_CALLS)
def test_invalid_calls_raise_errors(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_a_target_that_no_scan_reaches_is_rejected_with_the_remedy(monkeypatch):
    monkeypatch.setattr("lsvision.planning.plan.MAX_SECTIONS", 64)
    target, feed = AccuracyTarget(phi_std=1e-4), Feed(feed_std=0.01)
    with pytest.raises(DegenerateGeometry, match="reduce the uncertainty of the poses"):
        sections_needed(19.0, 0.3, 0.3, target=target, feed=feed)


def test_errors_of_many_poses_take_little_memory():
    """As a dense array, those of 256 sections would take 180 MB."""
    feed = Feed(sections=256, spacing=0.1, pose_std=0.02, feed_std=1e-4)
    tracemalloc.start()
    try:
        plan_scan(19.0, *rad(20, 20), feed=feed)
        assert tracemalloc.get_traced_memory()[1] < 40e6
    finally:
        tracemalloc.stop()


def test_the_sections_needed_by_so_coarse_a_pitch_that_one_has_too_few_points():
    view = SensorView(pitch=12.0)
    with pytest.raises(TooFewPoints):
        plan_scan(19.0, *rad(20, 20), view=view, feed=Feed(sections=1))
    scan = sections_needed(19.0, *rad(20, 20), view=view, target=AccuracyTarget(radius_std=0.1))
    assert scan.sections > 1
    assert scan.radius_std <= 0.1


@pytest.mark.parametrize(("std", "equivalent"), [(1e-200, 0.0), (1e-150, 0.0), (1e200, None)])
def test_a_prior_of_any_size_is_accepted(std, equivalent):
    got, expected = (
        plan_section(19.0, 0.3, 0.3, known_radius_std=prior) for prior in (std, equivalent)
    )
    assert got.phi_std == pytest.approx(expected.phi_std, rel=1e-9)
