"""The scenes are the paper's, and what is printed is what the paper prints."""

import numpy as np
import pytest

from lsvision.geometry import Pose
from lsvision.studies.chen_liu_2016.cases import PITCH_MM, list_paper_cases, simulate_case
from lsvision.studies.chen_liu_2016.published_results import PUBLISHED_ROWS, PUBLISHED_TIMES

NOISE = 0.1  # mm
HERE = (Pose(),)

pytestmark = pytest.mark.paper


def test_the_paper_has_twelve_single_pipes_and_three_pairs():
    assert [len(case.rows) for case in list_paper_cases()] == [1] * 12 + [2] * 3
    assert len(PUBLISHED_ROWS) == 18


@pytest.mark.parametrize(("table", "phi_error"), [(1, 0.1253), (2, 0.1626), (3, 0.2140)])
def test_the_largest_printed_error_of_phi_is_that_of_the_text(table, phi_error):
    """Section 4.1 names the largest for each phi."""
    errors = [abs(row.errors.phi_deg) for row in PUBLISHED_ROWS if row.table == table]
    assert max(errors) == phi_error
    assert all(abs(row.errors.radius_mm) < 0.4 for row in PUBLISHED_ROWS)


def test_the_printed_times_of_pairs_are_for_two_pipes():
    assert [time.pipes for time in PUBLISHED_TIMES] == [1, 2, 1, 1, 2]


@pytest.mark.parametrize("case", list_paper_cases(), ids=lambda case: f"{case.rows[0]}"[:40])
def test_the_pipes_of_a_scene_are_those_of_its_rows(case):
    (section,) = simulate_case(case, 0, HERE, noise_mm=NOISE)
    for row, tube in zip(case.rows, section.truth.tubes, strict=True):
        truth = [tube.radius, *np.degrees([tube.theta, tube.phi])]
        np.testing.assert_allclose(truth, [row.radius_mm, row.theta_deg, row.phi_deg], atol=1e-9)
        assert tube.visible


def test_the_points_are_as_far_apart_as_the_papers():
    (section,) = simulate_case(list_paper_cases()[0], 0, HERE, noise_mm=NOISE)
    x = section.truth.points[section.truth.labels == 1, 0]
    np.testing.assert_allclose(np.diff(x), PITCH_MM, rtol=0, atol=1e-9)


def test_another_measurement_has_other_noise_and_the_same_one_the_same():
    case = list_paper_cases()[0]
    first, again, other = (
        simulate_case(case, seed, HERE, noise_mm=NOISE)[0].profile.points for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert np.nanmax(np.abs(first - other)) > NOISE
