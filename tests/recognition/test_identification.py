import numpy as np
import pytest

from lsvision.profile import Arc
from lsvision.recognition.candidates import Candidate, find_candidates
from lsvision.recognition.identification import identify_arc
from lsvision.recognition.range_image import connected_components, rasterise
from lsvision.recognition.recognise import identify_arcs
from tests.recognition.scenes import dome, flat, line

RANGE = (5.0, 60.0)
LEFT, PIPE, RIGHT = flat(-50, -20), dome(0, 20), flat(20, 50)
FIRST, STOP = len(LEFT), len(LEFT) + len(PIPE)


def best_candidate(profile):
    return find_candidates(profile, connected_components(rasterise(profile), 10), RANGE)[0]


def middle_of(profile, start, stop):
    """A small candidate in the middle of what lies at [start, stop)."""
    return Candidate(Arc(start, stop), np.arange(start, stop), (0.0, -440.0), 20.0)


def test_a_candidate_grows_to_the_whole_arc():
    profile = line(LEFT, PIPE, RIGHT)
    centre = (FIRST + STOP) // 2
    arc = identify_arc(profile, middle_of(profile, centre - 12, centre + 12), profile.order)
    # Points of the ground may lie on the flank's prolongation, by chance.
    assert abs(arc.arc.start - FIRST) <= 2
    assert abs(arc.arc.stop - STOP) <= 2
    np.testing.assert_allclose(arc.ellipse.centre, (0, -440), atol=0.3)


def test_jumps_and_lost_lines_do_not_end_an_arc_and_jumps_are_not_on_it():
    bad = [FIRST + 15, FIRST + 30, FIRST + 31]
    pipe = PIPE.copy()
    pipe[[15, 30, 31], 1] += 4.0
    pipe[40] = np.nan
    profile = line(LEFT, pipe, RIGHT)
    arc = identify_arc(profile, best_candidate(profile), profile.order)
    assert arc.arc.start <= FIRST + 2
    assert arc.arc.stop >= STOP - 2
    assert not set(bad) & set(arc.indices.tolist())
    assert FIRST + 40 not in arc.indices


def test_an_arc_takes_only_free_points():
    profile = line(LEFT, PIPE, RIGHT)
    free = profile.order[profile.order < STOP - 15]
    arc = identify_arc(profile, best_candidate(profile), free)
    assert arc.indices.max() < STOP - 15


def test_a_candidate_without_free_points_gives_no_arc():
    profile = line(LEFT, PIPE, RIGHT)
    assert identify_arc(profile, best_candidate(profile), profile.order[:5]) is None


def test_two_touching_pipes_are_two_arcs_without_common_points():
    profile = line(dome(0, 20, 85), dome(40, 20, 85))
    candidates = find_candidates(profile, connected_components(rasterise(profile), 10), RANGE)
    arcs, _ = identify_arcs(profile, candidates, RANGE)
    assert len(arcs) == 2
    assert not set(arcs[0].indices.tolist()) & set(arcs[1].indices.tolist())
    assert sorted(arc.ellipse.centre[0] for arc in arcs) == [
        pytest.approx(0, abs=0.5), pytest.approx(40, abs=0.5),
    ]  # fmt: skip
