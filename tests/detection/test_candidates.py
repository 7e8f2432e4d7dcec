import numpy as np
import pytest

from lsvision.detection.arc_detection import identify_arcs
from lsvision.detection.candidates import find_candidates, seed_ellipse
from lsvision.detection.range_image import connected_components, rasterise
from tests.detection.scenes import bowl, dome, flat, line

RANGE = (5.0, 60.0)


def candidates_of(profile, radius_range=RANGE):
    return find_candidates(profile, connected_components(rasterise(profile), 10), radius_range)


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
        pytest.param([dome(0, 200, half_deg=8)], id="larger than the range"),
        pytest.param([flat(-30, 0), flat(0, 30, y=-430)], id="step"),
        pytest.param([flat(-30, 0, slope=-0.4), flat(0, 30, slope=0.4)], id="valley"),
    ],
)
def test_what_does_not_curve_like_a_pipe_seeds_no_arc(pieces):
    profile = line(*pieces)
    # A seed is unproven: noise on a bar may curve by chance, but no arc grows from it.
    assert identify_arcs(profile, candidates_of(profile), RANGE)[0] == []


def test_a_radius_range_excludes_other_pipes():
    profile = line(dome(0, 6), dome(100, 60))
    only_small = candidates_of(profile, (4.0, 8.0))
    assert only_small
    assert all(candidate.centre[0] < 20 for candidate in only_small)


def test_of_two_touching_pipes_each_seeds_an_arc():
    profile = line(dome(0, 20, 85), dome(40, 20, 85))
    (first, second, *_) = candidates_of(profile)
    lefts, rights = sorted([first.centre[0], second.centre[0]])
    assert (lefts, rights) == (pytest.approx(0, abs=1.5), pytest.approx(40, abs=1.5))


def test_the_indices_of_a_candidate_lie_in_its_arc():
    for candidate in candidates_of(line(flat(-40, -20), dome(0, 20), flat(20, 40))):
        assert candidate.arc.start == candidate.indices[0]
        assert candidate.arc.stop == candidate.indices[-1] + 1


def test_the_seed_ellipse_is_near_the_circle_of_a_dome():
    profile = line(dome(0, 20))
    seed = seed_ellipse(profile, candidates_of(profile)[0])
    np.testing.assert_allclose(seed.centre, (0, -440), atol=0.5)
    assert seed.radius == pytest.approx(20, abs=0.5)


def test_same_profile_same_candidates():
    profile = line(flat(-40, -20), dome(0, 20), flat(20, 40))
    first, second = candidates_of(profile), candidates_of(profile)
    assert [c.arc for c in first] == [c.arc for c in second]


def test_no_components_have_no_candidates():
    assert find_candidates(line(flat(0, 30)), [], RANGE) == []


def test_an_arc_that_jumps_cut_in_two_is_one_candidate():
    whole = dome(0, 20)
    middle = len(whole) // 2
    left, right = whole[: middle - 3], whole[middle + 3 :]
    lost = np.full((6, 2), np.nan)
    profile = line(left, lost, right)
    components = connected_components(rasterise(profile), 10)
    assert len(components) == 2
    best = find_candidates(profile, components, RANGE)[0]
    assert (best.arc.start, best.arc.stop) == (0, len(whole))
    assert best.radius == pytest.approx(20, abs=0.2)
