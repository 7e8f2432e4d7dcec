"""Arcs that grow from candidates, mostly on exact lines whose last inlier is known."""

import math

import numpy as np
import pytest

from lsvision import Profile, measure_cylinders
from lsvision.detection import identification
from lsvision.detection.arcs import IdentifiedArc
from lsvision.detection.candidates import Candidate
from lsvision.detection.identification import GrownArc, Seed, find_connected_inliers, grow_arcs
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.radius_range import find_radius_range
from lsvision.detection.range_image import build_range_image, find_connected_components
from lsvision.geometry.noisy_points import NoisyPoints, as_complex
from lsvision.profile import Arc
from lsvision.simulate import SectionSettings
from lsvision.simulate.scene_kinds import random_section
from tests.detection.scenes import (
    arc_points,
    circle,
    dome,
    exact,
    find_candidates,
    flat,
    identify_arcs,
    line,
)
from tests.other_scenes import other_scene

RANGE = (5.0, 60.0)
LEFT, PIPE, RIGHT = flat(-50, -20), dome(0, 20), flat(20, 50)
FIRST, STOP = len(LEFT), len(LEFT) + len(PIPE)


def best_candidate(profile):
    components = find_connected_components(build_range_image(profile), 10)
    return find_candidates(profile, components, RANGE)[0]


def seed_at(start, stop, *, radius=20.0, centre=(0.0, -440.0)):
    """The candidate of all points [start, stop)."""
    return Candidate(np.arange(start, stop), centre, radius)


def grown(profile, candidate, free=None):
    free = profile.valid_indices if free is None else free
    ((arc, normals),) = grow_arcs([Seed(profile, candidate, free)])
    assert len(normals) == len(arc.indices)
    return arc


def arcs_of(points, noise=None):
    """Return the columns of all arcs that grow from the candidates of a profile."""
    profile = prepare_profile(points, noise)
    radii = find_radius_range(None, None, profile)
    components = find_connected_components(build_range_image(profile), 10)
    arcs, _ = identify_arcs(profile, find_candidates(profile, components, radii), radii)
    return [np.sort(profile.sensor_columns[arc.indices]) for arc in arcs]


def test_a_candidate_grows_to_the_whole_arc():
    profile = line(LEFT, PIPE, RIGHT)
    centre = (FIRST + STOP) // 2
    arc = grown(profile, seed_at(centre - 12, centre + 12))
    # By chance, points of the ground may lie on the extended ellipse.
    assert abs(arc.arc.start - FIRST) <= 2
    assert abs(arc.arc.stop - STOP) <= 2
    np.testing.assert_allclose(arc.ellipse.centre, (0, -440), atol=0.3)


def test_jumps_do_not_end_an_arc_and_are_not_on_it():
    jumps = [FIRST + 15, FIRST + 30, FIRST + 31]
    pipe = PIPE.copy()
    pipe[[15, 30, 31], 1] += 4.0
    profile = line(LEFT, pipe, RIGHT)
    arc = grown(profile, best_candidate(profile))
    assert arc.arc.start <= FIRST + 2
    assert arc.arc.stop >= STOP - 2
    assert not set(jumps) & set(arc.indices.tolist())


def test_an_arc_that_jumps_in_a_row_cut_in_two_is_found_whole():
    rough = SectionSettings(lost_fraction=0.10, jump_fraction=0.05)
    section = random_section("single", 928, settings=rough)
    on_tube = np.flatnonzero(section.truth.labels == 1)
    (arc,) = arcs_of(section.profile, section.profile.noise)
    np.testing.assert_array_equal(np.intersect1d(arc, on_tube), on_tube)


@pytest.mark.parametrize("seed", range(6))
def test_each_tube_of_another_simulator_has_an_arc(seed):
    points, labels, tubes = other_scene(np.random.default_rng([17, seed]), 2, welded=True)
    arcs = arcs_of(Profile(points))
    for label in range(1, len(tubes) + 1):
        on_tube = np.flatnonzero(labels == label)
        best = max(arcs, key=lambda arc: len(np.intersect1d(arc, on_tube)))
        common, either = np.intersect1d(best, on_tube), np.union1d(best, on_tube)
        assert len(common) >= 0.85 * len(either)


def test_another_pipe_behind_an_interruption_is_not_joined():
    """Beyond seven jumps lies a wider pipe, whose points are not on the same ellipse."""
    near, far = dome(0, 20), dome(0, 26, y=-447.0)
    gap = np.column_stack([np.linspace(-1.8, 1.8, 7), np.linspace(-416, -413, 7)])
    near, far = near[near[:, 0] < -2], far[far[:, 0] > 2]
    profile = line(near, gap, far)
    arc = grown(profile, seed_at(4, len(near) - 2))
    assert arc.arc.stop <= len(near) + 2


def test_the_foot_of_a_bead_at_a_flank_does_not_pull_the_ellipse_to_itself():
    """The seed contains points of a bead with large weights, since n' Sigma n is small there."""
    section = random_section("welded_pair", 6010)
    arcs = arcs_of(section.profile, section.profile.noise)
    for label in (1, 2):
        on_tube = np.flatnonzero(section.truth.labels == label)
        assert max(len(np.intersect1d(arc, on_tube)) for arc in arcs) >= 0.9 * len(on_tube)


def test_an_arc_takes_only_free_points():
    profile = line(LEFT, PIPE, RIGHT)
    free = profile.valid_indices[profile.valid_indices < STOP - 15]
    arc = grown(profile, best_candidate(profile), free)
    assert arc.indices.max() < STOP - 15


def test_fewer_than_eight_free_points_grow_to_nothing():
    points = arc_points(np.arange(-40, 40, 2.0))
    profile = exact(points)
    for count, fails in ((7, True), (8, False)):
        (found,) = grow_arcs([Seed(profile, seed_at(10, 30), np.arange(10, 10 + count))])
        assert (found is None) == fails


def jumping(offset_mm, *, std=0.1, at=30):
    """Return an exact circle with one point `offset_mm` outside, and a given noise of `std` mm."""
    points = arc_points(np.arange(-60, 61, 2.0))
    points[at] += offset_mm * arc_points(np.arange(-60, 61, 2.0), 1.0, (0.0, 0.0))[at]
    return exact(points, std)


@pytest.mark.parametrize(
    ("sigmas", "inside"), [(2.9, True), (3.8, True), (4.4, False), (5.3, False)]
)
@pytest.mark.parametrize("side", [-1, 1])
def test_the_sensor_error_is_four_sigma(sigmas, inside, side):
    """A twentieth of the total variance is added along any normal: sigma^2 times 1.1."""
    profile = jumping(side * sigmas * math.sqrt(1.1) * 0.1)
    assert (30 in grown(profile, seed_at(20, 45)).indices) == inside


@pytest.mark.parametrize(("scale", "inside"), [(2.0, 7.5), (2.9, 11.0)])
def test_the_sensor_error_grows_with_the_scatter_of_the_arc(scale, inside):
    """With a scatter of `scale` sigma the limit is 4 * `scale` sigma."""
    angles = np.arange(-60, 61, 2.0)
    out = arc_points(angles, 1.0, (0.0, 0.0))
    sigma = math.sqrt(1.1) * 0.1
    points = arc_points(angles) + (scale / 1.4826 * sigma * (-1) ** np.arange(61))[:, None] * out
    for sigmas, kept in ((inside, True), (1.3 * inside, False)):
        off = points.copy()
        off[30] = (arc_points(angles) + sigmas * sigma * out)[30]
        arc = grown(exact(off, 0.1), seed_at(15, 46))
        assert (30 in arc.indices) == kept


def test_the_scatter_counts_up_to_the_largest_that_an_arc_may_have():
    """That is 3 times a given sigma, or 1 % of the radius, here 0.2 mm."""
    angles = np.arange(-60, 61, 2.0)
    out = arc_points(angles, 1.0, (0.0, 0.0))
    points = arc_points(angles) + (0.5 * (-1) ** np.arange(61))[:, None] * out
    points[20:41] = arc_points(angles)[20:41]
    arc = grown(exact(points, 0.02), seed_at(20, 41))
    np.testing.assert_array_equal(arc.indices, np.arange(20, 41))


def turned_away(last_deg):
    """Return a circle up to an angle from its top at which it faces away from the sensor."""
    points = arc_points(np.arange(-60.0, last_deg, 0.5))
    count = len(points)
    noisy = NoisyPoints.uniform(as_complex(points), 0.01, 0.01)
    columns = np.arange(count)
    profile = exact(arc_points(np.linspace(-60, 60, count)))
    return type(profile)(points, noisy, columns, columns, 0.01, 0.1, 1.0, 1j)


def test_a_normal_120_deg_from_the_sensor_is_the_last_that_is_seen():
    profile = turned_away(170.0)
    arc = grown(profile, seed_at(60, 200))
    last_deg = -60 + 0.5 * arc.indices[-1]
    assert 118 < last_deg < 120.5


def gap_of(inside, gap, beyond):
    """Return points on a circle, then jumps, then points on it again; their noise is given."""
    points = arc_points(np.linspace(-60, 60, inside + gap + beyond))
    points[inside : inside + gap, 1] += 5.0
    return exact(points)


@pytest.mark.parametrize(("gap", "bridged"), [(2, True), (6, True), (9, True), (10, False)])
def test_an_arc_grows_by_half_of_its_points_at_once(gap, bridged):
    """A window adds 20 to 40 points: 9 jumps and 11 points, which are more; 10 and 10 are not."""
    arc = grown(gap_of(40, gap, 40), seed_at(0, 40))
    assert (arc.arc.stop > 40) == bridged
    if bridged:
        assert arc.arc.stop == 80 + gap


def test_towards_the_start_it_grows_by_as_many():
    """The same from the other end: 10 jumps and 10 points are not bridged."""
    for gap, bridged in ((9, True), (10, False)):
        profile = gap_of(40, gap, 40)
        arc = grown(profile, seed_at(40 + gap, 80 + gap))
        assert (arc.arc.start < 40) == bridged


def runs(*lengths):
    """Return runs of inliers and of others in turn; the first run is the previous arc."""
    inliers = np.concatenate([np.full(n, i % 2 == 0) for i, n in enumerate(lengths)])
    return inliers, np.arange(lengths[0])


def connected(*lengths):
    """Return whether the last run is connected to the first one."""
    inliers, inside = runs(*lengths)
    return bool(find_connected_inliers(inliers, inside)[-1] == len(inliers) - 1)


def test_two_outliers_in_a_row_do_not_interrupt_and_four_do():
    assert connected(40, 2, 3)
    assert not connected(40, 4, 3)


def test_an_interruption_of_half_the_arc_is_bridged():
    for gap, bridged in ((16, True), (20, True), (21, False), (25, False)):
        assert connected(40, gap, 30) == bridged


def test_only_a_run_longer_than_the_interruption_is_worth_bridging_it():
    assert connected(40, 8, 9)
    assert not connected(40, 8, 8)


def test_bridges_are_built_to_both_sides_and_one_behind_the_other():
    inliers = np.concatenate([np.full(n, i % 2 == 0) for i, n in enumerate((8, 5, 40, 6, 9, 5, 9))])
    everything = find_connected_inliers(inliers, np.arange(13, 53))
    np.testing.assert_array_equal(everything, inliers.nonzero()[0])
    np.testing.assert_array_equal(
        find_connected_inliers(inliers[::-1], np.arange(29, 69)), inliers[::-1].nonzero()[0]
    )


def test_the_run_around_the_middle_of_the_arc_is_the_arcs():
    inliers = np.concatenate([np.full(n, i % 2 == 0) for i, n in enumerate((20, 30, 20))])
    np.testing.assert_array_equal(find_connected_inliers(inliers, np.arange(20)), np.arange(20))
    np.testing.assert_array_equal(
        find_connected_inliers(inliers, np.arange(45, 70)), np.arange(50, 70)
    )


def test_a_seed_at_one_end_of_the_longest_profile_reaches_the_other():
    """Each step adds half of the points: 10 points become 8192 in 17 steps."""
    profile = exact(arc_points(np.linspace(-60, 60, 8192)), 1e-5)
    arc = grown(profile, seed_at(0, 10))
    assert arc.arc == Arc(0, 8192)


@pytest.mark.parametrize("iterations", [1, 20])
def test_growth_fails_where_the_fit_breaks_down(iterations, monkeypatch):
    """Also in the last iteration."""
    monkeypatch.setattr(identification, "MAX_ITERATIONS", iterations)
    monkeypatch.setattr(
        identification, "take_gauss_newton_step", lambda *_: np.full((1, 5), np.nan)
    )
    profile = exact(arc_points(np.linspace(-60, 60, 90)))
    assert grow_arcs([Seed(profile, seed_at(20, 70), profile.valid_indices)]) == [None]


def two_pipes():
    """Two circles that touch, without errors: 61 points each."""
    angles = np.arange(-60, 61, 2.0)
    return exact(np.concatenate([arc_points(angles), arc_points(angles, 20.0, (36.0, -440.0))]))


@pytest.mark.parametrize(("taken", "tried"), [(5, True), (19, True), (21, False), (28, False)])
def test_a_candidate_of_which_more_than_half_is_explained_is_none(taken, tried):
    first = seed_at(10, 50)
    second = seed_at(61 - taken, 101 - taken, centre=(36.0, -440.0))
    arcs, rejections = identify_arcs(two_pipes(), [first, second], RANGE)
    assert [(arc.arc.start, arc.arc.stop) for arc in arcs] == [(0, 61), (61, 122)][: 1 + tried]
    assert rejections == []


@pytest.mark.parametrize(("long", "tried"), [(30, True), (32, False)])
def test_only_one_arc_along_half_of_a_candidate_explains_it(long, tried, monkeypatch):
    """Three rejected arcs have most of its 62 points; noise may consist of such short arcs."""
    profile = line(LEFT, PIPE, RIGHT)
    spans = (0, 15), (15, 15 + long), (50, 60)
    few_normals = np.ones(5, dtype=complex)
    seeds = []

    def grow(round_of_seeds):
        seeds.extend(seed.candidate for seed in round_of_seeds)
        arcs = [IdentifiedArc(seed.candidate.indices, circle()) for seed in round_of_seeds]
        return [GrownArc(arc, few_normals) for arc in arcs]

    monkeypatch.setattr(identification, "grow_arcs", grow)
    whole = seed_at(0, 62)
    identify_arcs(profile, [*(seed_at(*span) for span in spans), whole], RANGE)
    assert (seeds[-1] is whole) == tried


def test_noise_of_two_pitches_does_not_hide_a_pipe():
    """The noise of heights that are held over 4 columns looks like many small round tops."""
    for seed in range(8):
        rng = np.random.default_rng([3, seed])
        x = np.arange(-15.0, 15.0, 0.2)
        heights = np.sqrt(17.0**2 - x * x) - 300 + 0.1 * rng.normal(size=len(x))
        columns = np.arange(4 * len(x)) * 0.05
        pipes = measure_cylinders(np.column_stack([columns, np.repeat(heights, 4)])).cylinders
        assert [pipe.interval("radius")[1] > 16 for pipe in pipes] == [True], seed


def test_an_arc_without_the_shape_of_a_pipe_is_reported_once():
    """The other two candidates overlap it, and are left out."""
    arcs, rejections = identify_arcs(two_pipes(), [seed_at(10, 50)] * 3, (30.0, 60.0))
    assert arcs == []
    (rejection,) = rejections
    assert rejection.reason == "radius 20 mm outside 30 to 60 mm"
    assert (rejection.arc.start, rejection.arc.stop) == (0, 61)


def test_two_touching_pipes_are_two_arcs_without_common_points():
    profile = line(dome(0, 20, 85), dome(40, 20, 85))
    components = find_connected_components(build_range_image(profile), 10)
    arcs, _ = identify_arcs(profile, find_candidates(profile, components, RANGE), RANGE)
    assert len(arcs) == 2
    assert not set(arcs[0].indices.tolist()) & set(arcs[1].indices.tolist())
    assert sorted(arc.ellipse.centre[0] for arc in arcs) == [
        pytest.approx(0, abs=0.5), pytest.approx(40, abs=0.5),
    ]  # fmt: skip


def test_the_arc_so_far_may_lie_anywhere_in_the_profile():
    """The window in which an arc grows begins far from the first point of the profile."""
    points = arc_points(np.linspace(-60, 60, 300))
    points[[100, 101, 102, 103, 204, 205, 206, 207], 1] += 5.0
    arc = grown(exact(points), seed_at(140, 170))
    assert arc.arc == Arc(0, 300)
    assert len(arc.indices) == 292


def test_a_run_of_the_arc_counts_from_its_own_first_point():
    """Half of the central run is bridged, wherever it lies."""
    inliers = np.concatenate([np.full(n, i % 2 == 0) for i, n in enumerate((30, 21, 40, 19, 30))])
    kept = find_connected_inliers(inliers, np.arange(55, 85))
    np.testing.assert_array_equal(kept, np.r_[51:91, 110:140])
    kept = find_connected_inliers(inliers[::-1], np.arange(55, 85))
    np.testing.assert_array_equal(kept, np.r_[0:30, 49:89])


def test_candidates_that_grow_again_keep_their_order(monkeypatch):
    """Both worse arcs share a point with the best one, which has grown at the same time."""
    profile = line(LEFT, PIPE, RIGHT)
    spans = (0, 20), (20, 40), (40, 60)
    normals = np.exp(1j * np.linspace(0.5, 2.5, 20))
    grown_spans = (0, 45), (20, 40), (40, 60)
    rounds = []

    def grow(seeds):
        rounds.append([seed.candidate.indices[0] for seed in seeds])
        if len(rounds) > 1:
            return [None for _ in seeds]
        return [
            GrownArc(IdentifiedArc(np.arange(*span), circle()), normals) for span in grown_spans
        ]

    monkeypatch.setattr(identification, "MAX_OVERLAP", 1.0)
    monkeypatch.setattr(identification, "grow_arcs", grow)
    identification.identify_arcs([profile], [[seed_at(*span) for span in spans]], [RANGE])
    assert rounds == [[0, 20, 40], [20, 40]]
