import numpy as np
import pytest

from lsvision.detection.arc_detection import identify_arcs
from lsvision.detection.candidates import Candidate, find_candidates
from lsvision.detection.identification import identify_arc
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import connected_components, rasterise
from lsvision.detection.search_range import search_range
from lsvision.profile import Arc
from lsvision.simulate import SectionSettings
from lsvision.simulate.scene_kinds import random_section
from tests.detection.scenes import dome, flat, line

RANGE = (5.0, 60.0)
LEFT, PIPE, RIGHT = flat(-50, -20), dome(0, 20), flat(20, 50)
FIRST, STOP = len(LEFT), len(LEFT) + len(PIPE)


def best_candidate(profile):
    return find_candidates(profile, connected_components(rasterise(profile), 10), RANGE)[0]


def middle_of(profile, start, stop):
    """A small candidate in the middle of what lies at [start, stop)."""
    return Candidate(Arc(start, stop), np.arange(start, stop), (0.0, -440.0), 20.0)


def arcs_of(section):
    """Columns of all arcs that a simulated section's candidates grow to."""
    profile = prepare_profile(section.profile, section.profile.noise)
    radii = search_range(None, None, profile)
    candidates = find_candidates(profile, connected_components(rasterise(profile), 10), radii)
    arcs, _ = identify_arcs(profile, candidates, radii)
    return [profile.sensor_columns[arc.indices] for arc in arcs]


def test_a_candidate_grows_to_the_whole_arc():
    profile = line(LEFT, PIPE, RIGHT)
    centre = (FIRST + STOP) // 2
    arc = identify_arc(profile, middle_of(profile, centre - 12, centre + 12), profile.valid_indices)
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
    arc = identify_arc(profile, best_candidate(profile), profile.valid_indices)
    assert arc.arc.start <= FIRST + 2
    assert arc.arc.stop >= STOP - 2
    assert not set(bad) & set(arc.indices.tolist())
    assert FIRST + 40 not in arc.indices


@pytest.mark.parametrize("seed", [924, 928])
def test_an_arc_that_jumps_in_a_row_cut_in_two_is_found_whole(seed):
    rough = SectionSettings(lost_fraction=0.10, jump_fraction=0.05)
    section = random_section("single", seed, settings=rough)
    on_tube = np.flatnonzero(section.truth.labels == 1)
    (arc,) = arcs_of(section)
    assert len(np.intersect1d(arc, on_tube)) >= 0.95 * len(on_tube)
    assert len(np.setdiff1d(arc, on_tube)) == 0


def test_another_pipe_behind_an_interruption_is_not_joined():
    """Beyond seven jumps the line goes on at a wider pipe: one ellipse does not hold both."""
    near, far = dome(0, 20), dome(0, 26, y=-447.0)
    gap = np.column_stack([np.linspace(-1.8, 1.8, 7), np.linspace(-416, -413, 7)])
    near, far = near[near[:, 0] < -2], far[far[:, 0] > 2]
    profile = line(near, gap, far)
    arc = identify_arc(profile, middle_of(profile, 4, len(near) - 2), profile.valid_indices)
    assert arc.arc.stop <= len(near) + 2


def test_the_foot_of_a_bead_at_a_flank_does_not_pull_the_ellipse_to_itself():
    """The seed holds a bead's points, which weigh much: n' Sigma n is small there."""
    section = random_section("welded_pair", 6010)
    arcs = arcs_of(section)
    for label in (1, 2):
        on_tube = np.flatnonzero(section.truth.labels == label)
        assert max(len(np.intersect1d(arc, on_tube)) for arc in arcs) >= 0.9 * len(on_tube)


def test_an_arc_takes_only_free_points():
    profile = line(LEFT, PIPE, RIGHT)
    free = profile.valid_indices[profile.valid_indices < STOP - 15]
    arc = identify_arc(profile, best_candidate(profile), free)
    assert arc.indices.max() < STOP - 15


def test_a_candidate_without_free_points_gives_no_arc():
    profile = line(LEFT, PIPE, RIGHT)
    assert identify_arc(profile, best_candidate(profile), profile.valid_indices[:5]) is None


def test_two_touching_pipes_are_two_arcs_without_common_points():
    profile = line(dome(0, 20, 85), dome(40, 20, 85))
    candidates = find_candidates(profile, connected_components(rasterise(profile), 10), RANGE)
    arcs, _ = identify_arcs(profile, candidates, RANGE)
    assert len(arcs) == 2
    assert not set(arcs[0].indices.tolist()) & set(arcs[1].indices.tolist())
    assert sorted(arc.ellipse.centre[0] for arc in arcs) == [
        pytest.approx(0, abs=0.5), pytest.approx(40, abs=0.5),
    ]  # fmt: skip
