import math

import numpy as np
import pytest

from lsvision import PointNoise, Profile, Settings, measure_cylinders
from lsvision.detection.candidates import (
    Candidate,
    CandidateSettings,
    _order_by_coverage,
    _suppress_non_maxima,
    fit_seed_ellipse,
)
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import build_range_image, find_connected_components
from lsvision.detection.windows import Windows
from tests.detection.scenes import bowl, dome, find_candidates, flat, line

RANGE = (5.0, 60.0)


def candidates_of(profile, radius_range=RANGE):
    components = find_connected_components(build_range_image(profile), 10)
    return find_candidates(profile, components, radius_range)


def whole(points, noise_mm=1e-4, radius_range=RANGE):
    """Return whether all points together are a candidate, with a given noise along Y."""
    covariances = np.tile(np.diag([0, noise_mm**2]), (len(points), 1, 1))
    profile = prepare_profile(Profile(points), PointNoise(covariances))
    every = [np.arange(len(points))]
    found = find_candidates(profile, every, radius_range)
    spans = [(c.indices[0], c.indices[-1] + 1) for c in found]
    return (0, len(points)) in spans


def arc(count, degrees, radius=20.0):
    turn = np.radians(90 + degrees * np.linspace(0.5, -0.5, count))
    return radius * np.column_stack([np.cos(turn), np.sin(turn)])


def wavy(amplitude):
    """Return an arc of 20 mm whose points lie `amplitude` mm outside and inside in turn."""
    points = arc(60, 120)
    return points * (1 + amplitude / 20 * np.tile([1, -1], 30))[:, None]


def test_the_search_range_may_be_as_wide_as_numbers_go():
    assert len(candidates_of(line(dome(0, 20)), (1e-300, 1e308))) > 0


def test_the_best_candidate_of_a_dome_is_its_circle():
    profile = line(flat(-40, -20), dome(0, 20), flat(20, 40))
    best = candidates_of(profile)[0]
    np.testing.assert_allclose(best.centre, (0, -440), atol=0.3)
    assert best.radius == pytest.approx(20, abs=0.3)


@pytest.mark.parametrize(
    "pieces",
    [
        pytest.param([flat(-60, 60)], id="flat bar"),
        pytest.param([flat(-60, 60, slope=0.5)], id="sloping bar"),
        pytest.param([bowl(0, 20)], id="concave"),
        pytest.param([dome(0, 300, half_deg=6)], id="larger than the range"),
        pytest.param([flat(-30, 0), flat(0, 30, y=-430)], id="step"),
        pytest.param([flat(-30, 0, slope=-0.4), flat(0, 30, slope=0.4)], id="valley"),
    ],
)
def test_what_does_not_curve_like_a_pipe_is_hardly_tried(pieces):
    # A short window of noisy points may be curved by chance.
    assert all(len(candidate.indices) < 25 for candidate in candidates_of(line(*pieces)))


def test_a_radius_range_excludes_other_pipes():
    profile = line(dome(0, 6), dome(100, 60))
    only_small = candidates_of(profile, (4.0, 8.0))
    assert only_small
    assert all(candidate.centre[0] < 20 for candidate in only_small)


@pytest.mark.parametrize(
    ("radius_range", "tried"),
    [((34.0, 60.0), True), ((46.0, 60.0), False), ((2.0, 5.7), True), ((2.0, 4.4), False)],
)
def test_an_ellipse_curves_twice_as_much_as_its_radius_or_a_quarter(radius_range, tried):
    """A circle of 20 mm may be the sharp end of a larger ellipse or the flat side of a smaller."""
    assert whole(arc(80, 150), radius_range=radius_range) == tried


@pytest.mark.parametrize(("degrees", "tried"), [(22, False), (29, True)])
def test_36_points_must_cover_25_degrees(degrees, tried):
    """A whole component may cover less: it may be a part of a pipe under several cables."""
    points, span = arc(36, degrees) @ (1, 1j), Windows(*np.array([[0], [0], [36]]))
    ordered = [
        len(_order_by_coverage(points[None], span, np.zeros(1, complex), np.array([is_component])))
        for is_component in (False, True)
    ]
    assert ordered == [tried, True]
    assert whole(arc(36, degrees))


@pytest.mark.parametrize(("millimetres", "tried"), [(1.5, True), (1.65, False)])
def test_points_lie_within_three_sigma_of_their_circle(millimetres, tried):
    """The limit is 3 * 0.5 mm, plus 1 % of the radius since the section may be an ellipse."""
    assert whole(wavy(millimetres), noise_mm=0.5) == tried


@pytest.mark.parametrize(("degrees", "tried"), [(36, True), (32, False)])
def test_a_window_is_nearer_to_its_circle_than_to_a_line(degrees, tried):
    points = arc(60, degrees) * (1 + 0.3 / 20 * np.tile([1, -1], 30))[:, None]
    assert whole(points, noise_mm=1.0) == tried


@pytest.mark.parametrize(("share", "tried"), [(0.008, True), (0.012, False)])
def test_points_of_an_ellipse_lie_within_a_fraction_of_the_radius(share, tried):
    assert whole(wavy(share * 20)) == tried


@pytest.mark.parametrize(("start", "kept"), [(41, [0, 1]), (26, [0])], ids=["0.42", "0.59"])
def test_windows_that_share_more_than_half_of_their_union_are_one(start, kept):
    starts, stops = np.array([0, start]), np.array([100, 100 + start])
    assert _suppress_non_maxima(Windows(np.zeros(2, dtype=int), starts, stops)) == kept


def test_of_two_touching_pipes_each_seeds_an_arc():
    best = candidates_of(line(dome(0, 20, 85), dome(40, 20, 85)))[:4]
    for centre in (0.0, 40.0):
        assert any(abs(candidate.centre[0] - centre) < 0.5 for candidate in best)


def test_the_seed_ellipse_is_near_the_circle_of_a_dome():
    profile = line(dome(0, 20))
    seed = fit_seed_ellipse(profile, candidates_of(profile)[0])
    np.testing.assert_allclose(seed.centre, (0, -440), atol=0.5)
    assert seed.radius == pytest.approx(20, abs=0.5)


@pytest.mark.parametrize(("ratio", "is_ellipse"), [(1.7, True), (2.3, False)])
def test_a_seed_is_no_ellipse_tilted_by_more_than_60_degrees(ratio, is_ellipse):
    turn = np.radians(np.linspace(10, 170, 80))
    points = np.column_stack([15 * ratio**0.5 * np.cos(turn), 15 / ratio**0.5 * np.sin(turn)])
    profile = prepare_profile(Profile(points), None)
    seed = fit_seed_ellipse(profile, Candidate(np.arange(80), (0.0, 0.0), 15.0))
    expected = ratio if is_ellipse else 1.0
    assert seed.semi_major / seed.semi_minor == pytest.approx(expected, rel=1e-3)


def test_where_no_ellipse_fits_the_seed_is_the_circle():
    profile = prepare_profile(Profile(flat(0, 30)), None)
    seed = fit_seed_ellipse(profile, Candidate(np.arange(50), (15.0, -460.0), 20.0))
    assert (seed.centre, seed.semi_major, seed.semi_minor) == ((15.0, -460.0), 20.0, 20.0)


def test_same_profile_same_candidates():
    profile = line(flat(-40, -20), dome(0, 20), flat(20, 40))
    first, second = candidates_of(profile), candidates_of(profile)
    spans = [[(c.indices[0], c.indices[-1]) for c in found] for found in (first, second)]
    assert spans[0] == spans[1]


def test_no_components_have_no_candidates():
    assert find_candidates(line(flat(0, 30)), [], RANGE) == []


def test_the_shortest_window_is_a_setting():
    profile = line(dome(0, 20, half_deg=80))
    (component,) = find_connected_components(build_range_image(profile), 10)
    shortest = [
        min(
            len(c.indices)
            for c in find_candidates(
                profile, [component], (1.0, 60.0), CandidateSettings(min_span_points=points)
            )
        )
        for points in (12, 60)
    ]
    assert shortest[0] < 60 <= shortest[1]
    assert math.isclose(len(component), max(shortest[1], len(component)))


def test_fewer_points_than_determine_a_circle_are_no_window():
    with pytest.raises(ValueError, match=r"^expected min_span_points >= 3, got 2$"):
        CandidateSettings(min_span_points=2)
    measurement = measure_cylinders(
        line(dome(0, 20)).points, settings=Settings(candidates=CandidateSettings(min_span_points=3))
    )
    assert len(measurement.cylinders) == 1
