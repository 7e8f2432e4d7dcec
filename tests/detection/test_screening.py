"""Inliers at the ends of arcs, on profiles where they are known."""

import math

import numpy as np
import pytest

from lsvision import Ellipse, PointNoise, Profile
from lsvision.detection import screening
from lsvision.detection.arc_stack import split_arc
from lsvision.detection.end_points import EndInliers, find_end_inliers
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import build_range_image, find_connected_components
from lsvision.ellipse.arc_noise import ArcNoise
from lsvision.ellipse.parameters import ellipse_from_parameters, parameters_from_ellipse
from tests.detection.scenes import (
    STEP,
    STEP_DEG,
    arc_points,
    circle,
    exact,
    find_candidates,
    identified,
    identify_arcs,
    screen_arc,
    walk,
    with_foot,
)
from tests.ellipse.arcs import parameter_stds, refine_ellipse
from tests.other_scenes import other_scene

ANGLES = np.arange(-60.0, 60.1, STEP_DEG)  # 81 points
STD = 0.02  # mm


def along_y(points, std=STD, rng=None):
    """Return a profile with errors along Y, and with the noise model of such errors."""
    noise = PointNoise(np.tile(np.diag([(0.05 * std) ** 2, std**2]), (len(points), 1, 1)))
    errors = 0 if rng is None else std * rng.normal(size=(len(points), 1)) * (0, 1)
    return prepare_profile(Profile(points + errors), noise)


def screened(profile, start, stop, ellipse=None):
    """The inliers of the arc of all points [start, stop)."""
    found = screen_arc(profile, identified(start, stop, circle() if ellipse is None else ellipse))
    return found.indices


def outside(points, mm):
    """Return the points of a circle moved outwards by `mm`."""
    return points + mm * (points - (0.0, -440.0)) / 20


def test_a_whole_arc_keeps_all_its_points():
    points = arc_points(ANGLES)
    np.testing.assert_array_equal(screened(exact(points), 0, 81), np.arange(81))


def test_the_middle_part_is_seven_tenths_and_not_judged():
    """81 points: 12 at each end are judged, the 57 between them are not."""
    points = arc_points(ANGLES)
    for outlier, judged in ((11, True), (12, False), (68, False), (69, True)):
        spoiled = points.copy()
        spoiled[outlier] = outside(points, 0.5)[outlier]
        kept = screened(exact(spoiled), 0, 81)
        assert (outlier in kept) != judged
        assert len(kept) == 81 - judged


@pytest.mark.parametrize(("count", "judged"), [(11, False), (12, True)])
def test_an_arc_with_fewer_than_eight_points_in_its_middle_comes_back_as_it_is(count, judged):
    """Of 12 points, two at each end are compared."""
    points = arc_points(np.linspace(-60, 60, count))
    points[-1] = outside(points, 3.0)[-1]
    profile = exact(points)
    found = screen_arc(profile, identified(0, count, circle()))
    assert (count - 1 in found.indices) != judged
    if not judged:
        np.testing.assert_array_equal(found.indices, np.arange(count))
        assert found.ellipse == circle()
        assert found.variance_factor == 1.0
        np.testing.assert_array_equal(found.points.z, profile.noisy_points.z)


@pytest.mark.parametrize("count", [41, 100])
def test_an_arc_that_goes_on_is_found_to_its_ends(count):
    points = arc_points(np.linspace(-80, 80, 3 * count))
    np.testing.assert_array_equal(screened(exact(points), count, 2 * count), np.arange(3 * count))


@pytest.mark.parametrize("count", [41, 100])
def test_an_arc_that_goes_on_at_one_side_only_is_found_to_its_end(count):
    profile = exact(arc_points(np.linspace(-80, 80, 3 * count)))
    np.testing.assert_array_equal(screened(profile, 0, count), np.arange(3 * count))
    np.testing.assert_array_equal(screened(profile, 2 * count, 3 * count), np.arange(3 * count))


@pytest.mark.parametrize("count", [30, 100])
def test_the_arc_is_looked_for_among_sixteen_points_beyond_its_end(count):
    for outliers, found in ((13, True), (17, False)):
        points = arc_points(np.linspace(-60, 60, count + outliers + 12))
        between = slice(count, count + outliers)
        points[between] = outside(points, 9.0)[between]
        points[between][::2] = outside(points, 3.0)[between][::2]
        assert (count + outliers + 1 in screened(exact(points), 0, count)) == found


@pytest.mark.parametrize("last", [True, False])
def test_an_end_behind_a_gap_is_found(last):
    """Eight jumps, and four points of the circle behind them."""
    points = arc_points(ANGLES)
    jumps = [4.0, -2.0, 3.0, 0.7, -5.0, 2.0, -1.0, 6.0]
    points[69:77] = [outside(points, mm)[69 + i] for i, mm in enumerate(jumps)]
    expected = np.setdiff1d(np.arange(81), np.arange(69, 77))
    if last:
        np.testing.assert_array_equal(screened(exact(points), 0, 69), expected)
    else:
        found = screened(exact(points[::-1]), 12, 81)
        np.testing.assert_array_equal(np.sort(80 - found), expected)


@pytest.mark.parametrize("off_mm", [-3.0, -0.3, 0.3, 3.0])
@pytest.mark.parametrize("at", [0, 1, 3, 77, 79, 80])
def test_single_outliers_near_an_end_are_left_out(off_mm, at):
    points = arc_points(ANGLES)
    points[at] = outside(points, off_mm)[at]
    np.testing.assert_array_equal(
        screened(exact(points, STD), 0, 81), np.setdiff1d(np.arange(81), [at])
    )


def test_a_surface_at_87_deg_to_the_ray_is_not_seen():
    """The rays are parallel to Y; all points are exactly on the ellipse."""
    for last_deg, seen in ((84.0, True), (86.5, True), (87.7, False), (89.0, False)):
        points = arc_points([*np.arange(-75, 75.1, STEP_DEG), last_deg])
        kept = screened(along_y(points), 0, len(points) - 1)
        assert (len(points) - 1 in kept) == seen


def contact(count, *, step=STEP):
    """Return the arc, then `count` points of a line that rises beside it."""
    arc = arc_points(ANGLES)
    return np.concatenate([arc, walk(arc[-1], [10.0] * count, step)])


@pytest.mark.parametrize(
    ("count", "kept"), [(0, 81), (1, 81), (2, 81), (3, 80), (4, 80), (12, 80), (40, 80)]
)
def test_a_contact_costs_its_last_inlier(count, kept):
    """Three connected points beyond an end are a contact."""
    profile = exact(contact(count))
    np.testing.assert_array_equal(screened(profile, 0, 81), np.arange(kept))


def test_a_contact_at_the_start_costs_one_as_well():
    profile = exact(contact(12)[::-1] * (-1, 1))
    np.testing.assert_array_equal(screened(profile, 12, 93), np.arange(13, 93))


def test_a_line_beyond_a_gap_is_no_contact():
    """A gap of three steps is bridged, one of four is not."""
    arc = arc_points(ANGLES)
    first = walk(arc[-1], [10.0], 4 * STEP)
    points = np.concatenate([arc, first, walk(first[-1], [10.0] * 12, STEP)])
    np.testing.assert_array_equal(screened(exact(points), 0, 81), np.arange(81))


@pytest.mark.parametrize(("time", "dropped"), [(1.0, 0), (1.3, 1), (2.0, 2), (3.0, 4)])
def test_before_an_edge_a_sensor_that_smooths_costs_points(monkeypatch, time, dropped):
    """Two points per unit of autocorrelation time above 1."""
    noise = ArcNoise(1.0, time, time, sensor_smooths=False)
    monkeypatch.setattr(screening, "estimate_arc_noise", lambda *_: noise)
    kept = screened(exact(arc_points(ANGLES)), 0, 81)
    np.testing.assert_array_equal(kept, np.arange(dropped, 81 - dropped))


FEET = [(curvature, seed) for curvature in (0.8, 1.3, 2.0) for seed in range(4)]


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(("curvature", "seed"), FEET)
def test_the_foot_of_a_weld_bead_is_left_out(curvature, seed, mirrored):
    """It begins tangentially: its first points cannot be detected, those beyond 3 sigma can."""
    points, first, away = with_foot(curvature)
    beside = np.flatnonzero(away > 3 * STD)
    if mirrored:
        points = points[::-1] * (-1, 1)
        beside, first = len(points) - 1 - beside, len(points) - 1 - first
    rng = np.random.default_rng([3, seed])
    # The identified arc has four points of the foot.
    arc = (first - 3, len(points)) if mirrored else (0, first + 4)
    kept = screened(along_y(points, rng=rng), *arc)
    assert not np.isin(beside, kept).any()
    own = np.arange(first + 1, len(points)) if mirrored else np.arange(first)
    assert len(np.setdiff1d(own, kept)) <= 5


def test_many_feet_do_not_move_the_ellipse():
    """Errors of the ellipses of 200 circles between two beads, over their standard deviations."""
    errors = []
    for seed in range(200):
        right = with_foot(1.3)[0][40:]  # from the top
        points = np.concatenate([right[:0:-1] * (-1, 1), right])
        profile = along_y(points, rng=np.random.default_rng([10, seed]))
        found = screen_arc(profile, identified(12, len(points) - 12, circle()))
        parameters = refine_ellipse(found.points, parameters_from_ellipse(found.ellipse), 3)
        errors.append((parameters - [0, -440, 20, 0, 0]) / parameter_stds(found.points, parameters))
    assert np.abs(np.mean(errors, axis=0)).max() < 4 / math.sqrt(200)
    assert np.abs(np.std(errors, axis=0) - 1).max() < 4 / math.sqrt(400)


def test_what_was_cut_off_on_one_side_is_judged_with_the_other_side():
    """The left end is predicted with the right one, and the other way round."""
    points = arc_points(ANGLES)
    profile = exact(points, STD)
    both = screen_arc(profile, identified(10, 71, circle()))
    np.testing.assert_array_equal(both.indices, np.arange(81))


def test_a_tube_whose_first_fit_misses_its_end_is_whole_after_the_second():
    points, labels, _ = other_scene(np.random.default_rng([33, 0]), 2, welded=True, cluttered=True)
    profile = prepare_profile(Profile(points), None)
    components = find_connected_components(build_range_image(profile), 10)
    candidates = find_candidates(profile, components, (5.0, 60.0))
    arcs, _ = identify_arcs(profile, candidates, (5.0, 60.0))
    kept = [set(profile.sensor_columns[screen_arc(profile, arc).indices].tolist()) for arc in arcs]
    for label in (1, 2):
        assert set(np.flatnonzero(labels == label).tolist()) in kept


def both_ends(members, log_odds, leverages):
    """Return the same inliers at both ends of an arc, with 12 points beyond its middle part."""
    mask, odds, large = np.zeros((1, 2, 12), dtype=bool), np.zeros((1, 2, 12)), np.ones((1, 2, 12))
    mask[..., members], odds[..., members], large[..., members] = True, log_odds, leverages
    return EndInliers(mask, odds, large)


@pytest.mark.parametrize(("more", "expected"), [(1, True), (0, False)])
def test_an_arc_is_screened_again_only_if_it_has_more_inliers_than_before(more, expected):
    """Otherwise screening might not end. Here the outermost point that is compared is an inlier."""
    arc = split_arc(0, exact(arc_points(ANGLES)), identified(20, 60, circle()))
    members = np.zeros((2, len(arc.members[0])), dtype=bool)
    before = sum(map(np.count_nonzero, arc.members))
    members[0, -1] = True
    members[1, : before - 1 + more] = True
    assert arc.may_continue(members) == expected


def test_inliers_that_alternate_are_compared_three_times(monkeypatch):
    found = [both_ends(np.arange(n), np.full(n, 14.0), np.ones(n)) for n in (4, 5)]
    calls = []

    def alternate(*_):
        calls.append(None)
        return found[len(calls) % 2]

    monkeypatch.setattr(screening, "find_end_inliers", alternate)
    screen_arc(exact(arc_points(ANGLES)), identified(0, 81, circle()))
    assert len(calls) == 3


def test_inliers_that_growth_found_already_are_compared_once(monkeypatch):
    calls = []

    def count(*end):
        calls.append(None)
        return find_end_inliers(*end)

    monkeypatch.setattr(screening, "find_end_inliers", count)
    screen_arc(exact(arc_points(ANGLES)), identified(0, 81, circle()))
    assert len(calls) == 1


def test_estimated_noise_is_that_of_the_residuals():
    """The noise estimated for the profile is too small, because its ground is smooth."""
    rng = np.random.default_rng(11)
    points = arc_points(np.arange(-60, 60.1, 0.5)) + rng.normal(size=(241, 1)) * (0, 0.06)
    x = np.arange(-200.0, -25.0, 0.2)
    ground = np.column_stack([x, -445 + 0.02 * rng.normal(size=len(x))])
    profile = prepare_profile(Profile(np.concatenate([ground, points])), None)
    found = screen_arc(profile, identified(len(ground), len(ground) + 241, circle()))
    std = profile.noise_std * math.sqrt(found.variance_factor)
    assert 0.045 < std < 0.075
    assert profile.noise_std < 0.04


def test_no_ellipse_in_the_middle_part_is_no_arc(monkeypatch):
    lost = np.full((1, 5), np.nan)
    monkeypatch.setattr(screening, "take_gauss_newton_step", lambda *_: lost)
    assert screen_arc(exact(arc_points(ANGLES)), identified(0, 81, circle())) is None


def test_another_line_that_runs_beside_the_circle_is_none_of_its_points():
    """Eight successive points lie 0.5 mm outside the circle, the next ones on it."""
    points = arc_points(ANGLES)
    points[69:77] = outside(points, 0.5)[69:77]
    kept = screened(exact(points), 0, 81)
    assert not np.isin(np.arange(69, 77), kept).any()
    assert np.isin(np.arange(68), kept).all()


def test_a_hundred_points_at_an_end_are_judged_at_the_most():
    points = arc_points(np.linspace(-60, 60, 1000))
    for outlier, judged in ((95, True), (105, False), (894, False), (904, True)):
        spoiled = points.copy()
        spoiled[outlier] = outside(points, 0.5)[outlier]
        assert (outlier in screened(exact(spoiled), 0, 1000)) != judged


@pytest.mark.parametrize(("outlier", "judged"), [(99, True), (100, False), (899, False)])
def test_no_more_than_a_hundred_points_of_an_end_are_judged(outlier, judged):
    points = arc_points(np.linspace(-60, 60, 1000))
    points[outlier] = outside(points, 0.5)[outlier]
    assert (outlier in screened(exact(points), 0, 1000)) != judged


def watched(monkeypatch, name, points, arc, noise=ArcNoise(1.0, 1.0, 1.0, sensor_smooths=False)):
    """Return the arguments of the first call of a step of screening, for each end."""
    step, given = getattr(screening, name), []

    def watch(*values):
        given.append(values)
        return step(*values)

    monkeypatch.setattr(screening, "estimate_arc_noise", lambda *_: noise)
    monkeypatch.setattr(screening, name, watch)
    screen_arc(exact(points, STD), identified(*arc, circle()))
    return [[one_end(value, end) for value in given[0]] for end in (0, 1)]


def one_end(value, end):
    """Return the part of one end of arrays, or of tuples of arrays, of the only arc."""
    if isinstance(value, tuple):
        return type(value)(*(one_end(field, end) for field in value))
    return np.broadcast_to(value, (1, 2, *value.shape[2:]))[0, end]


def test_the_points_of_an_end_run_outwards_with_their_residuals(monkeypatch):
    """Two points of the middle part come first; the inflated variances are 1.1 sigma^2."""
    points = arc_points(ANGLES)
    points[[2, 75]] = outside(points, 0.5)[[2, 75]]
    noise = ArcNoise(4.0, 1.0, 1.0, sensor_smooths=False)
    (left, _), (right, _) = watched(monkeypatch, "find_end_inliers", points, (0, 81), noise)
    for end in (left, right):
        assert len(end.residuals) == 14
        np.testing.assert_allclose(np.delete(end.residuals, [8, 11]), 0, atol=1e-9)
        np.testing.assert_allclose(end.variances, 4 * 1.1 * STD**2)
        # A jump does not move the ellipse.
        np.testing.assert_allclose(end.positions, STEP * np.arange(14), atol=1e-9)
        assert (end.incidence_cosines > 0.05).all()
    assert left.residuals[11] == pytest.approx(0.5, abs=1e-9)
    assert right.residuals[8] == pytest.approx(0.5, abs=1e-9)
    # Of the distance outwards by centre_x: the sine of the angle from the top.
    np.testing.assert_allclose(right.jacobian[0], np.sin(np.radians(ANGLES[67:])), atol=1e-9)
    np.testing.assert_allclose(left.jacobian[0], np.sin(np.radians(ANGLES[13::-1])), atol=1e-9)


def test_correlated_errors_widen_the_prediction(monkeypatch):
    points = arc_points(ANGLES)
    (_, single), _ = watched(monkeypatch, "find_end_inliers", points, (0, 81))
    noise = ArcNoise(1.0, 2.5, 4.0, sensor_smooths=False)
    (_, wide), _ = watched(monkeypatch, "find_end_inliers", points, (0, 81), noise)
    np.testing.assert_allclose(wide.covariance, 4.0 * single.covariance)
    assert (single.autocorrelation_time, wide.autocorrelation_time) == (1.0, 2.5)
    assert single.radius == pytest.approx(20.0)


def test_a_departure_is_looked_for_with_the_eight_points_that_follow(monkeypatch):
    """12 points at the end are inliers, with a line beyond them; at the start there is no line."""
    given = []
    monkeypatch.setattr(
        screening,
        "compute_departure_free_probability",
        lambda *values: given.append(values) or np.ones(values[2].shape),
    )
    screen_arc(exact(contact(12), STD), identified(0, 81, circle()))
    ((_, _, (members,), (following,)),) = given
    np.testing.assert_array_equal(np.flatnonzero(members), np.arange(12))
    np.testing.assert_array_equal(np.flatnonzero(following), np.arange(12, 20))


LOG_ODDS = np.log([1e9, 8.2, 7.8, 1.2, 0.9, 1e9])
LEVERAGES = np.array([1.0, 8.0, 8.0, 1.0, 1.0, 30.0])


def test_an_inlier_that_decides_much_must_be_the_more_probable(monkeypatch):
    """Odds of 8.2 exceed its leverage of 8, odds of 7.8 do not."""
    found = both_ends(np.r_[0:5, 11], LOG_ODDS, LEVERAGES)
    monkeypatch.setattr(screening, "find_end_inliers", lambda *_: found)
    kept = screened(exact(arc_points(ANGLES)), 0, 81)
    np.testing.assert_array_equal(kept[kept > 68], 69 + np.array([0, 1, 3, 11]))
    np.testing.assert_array_equal(kept[kept < 12], 11 - np.array([11, 3, 1, 0]))


def test_an_inlier_beyond_a_probable_departure_is_none(monkeypatch):
    """The probability that no departure has begun must exceed 0.9."""
    free = np.array([1.0] * 9 + [0.91, 0.89, 0.4])
    found = both_ends(np.arange(12), np.full(12, 20.0), np.ones(12))
    found = EndInliers(*(np.pad(f, ((0, 0), (0, 0), (0, 12)), mode="edge") for f in found))
    found.members[..., 12:] = False
    monkeypatch.setattr(screening, "find_end_inliers", lambda *_: found)
    monkeypatch.setattr(
        screening, "compute_departure_free_probability", lambda *_: np.pad(free, (0, 12))[None]
    )
    monkeypatch.setattr(screening, "GUARD_POINTS", 0)
    np.testing.assert_array_equal(screened(exact(contact(12)), 0, 81), np.arange(79))


def test_the_ellipse_is_that_of_the_inliers():
    """It is within some std of the result of more steps of the same fit: smoothing and
    refinement begin there, and end elsewhere.
    """
    rng = np.random.default_rng(4)
    profile = along_y(arc_points(np.arange(-70, 70.1, STEP_DEG)), rng=rng)
    begin = parameters_from_ellipse(Ellipse((0.3, -440.2), 20.6, 19.9, 0.4))
    grown = refine_ellipse(profile.noisy_points, begin, 2)
    arc = identified(0, len(profile.points), ellipse_from_parameters(grown))
    found = screen_arc(profile, arc)
    parameters = parameters_from_ellipse(found.ellipse)
    best = refine_ellipse(found.points, parameters, 5)
    assert (np.abs(best - parameters) < parameter_stds(found.points, best)).all()
