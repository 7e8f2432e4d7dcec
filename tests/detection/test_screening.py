import numpy as np

from lsvision.detection.identification import IdentifiedArc
from lsvision.detection.screening import screen_arc
from lsvision.profile import Arc
from lsvision.shapes import Ellipse
from tests.detection.scenes import dome, line

CIRCLE = Ellipse((0.0, -440.0), 20.0, 20.0, 0.0)


def arc_of(profile, start=0, stop=None):
    indices = profile.valid_indices[start:stop]
    return IdentifiedArc(Arc(int(indices[0]), int(indices[-1]) + 1), indices, CIRCLE)


BEAD = 0.02 * np.arange(1, 7) ** 2  # mm: a bead leaves the tube gently, 0.02 to 0.72 mm


def with_bead():
    """Six points more and more outside, along the normal, at the right end."""
    points = dome(0, 20)
    outward = points[-6:] - CIRCLE.centre
    points[-6:] += outward / 20 * BEAD[:, None]
    return points


def test_a_clean_arc_keeps_its_points():
    profile = line(dome(0, 20))
    screened = screen_arc(profile, arc_of(profile))
    assert len(screened.indices) >= len(profile.valid_indices) - 1


def test_points_of_a_weld_bead_are_screened_out():
    profile = line(with_bead(), noise_mm=0.01)
    kept = screen_arc(profile, arc_of(profile)).indices
    # The gentlest two of its six points lie within a few sigma and may stay.
    assert kept.max() < len(profile.points) - 4
    np.testing.assert_array_equal(kept[:50], np.arange(50))


def test_a_bead_at_the_start_is_screened_out_as_well():
    profile = line(with_bead()[::-1], noise_mm=0.01)
    assert screen_arc(profile, arc_of(profile)).indices.min() >= 4


def test_the_middle_part_is_not_touched():
    points = dome(0, 20)
    points[30, 1] += 0.5
    profile = line(points)
    assert 30 in screen_arc(profile, arc_of(profile)).indices


def test_the_screened_ellipse_is_that_of_the_middle_part():
    points = dome(0, 20)
    clean = screen_arc(line(points), arc_of(line(points))).ellipse
    points[-4:, 1] += 3.0
    bent = screen_arc(line(points), arc_of(line(points))).ellipse
    np.testing.assert_allclose(bent.centre, clean.centre, atol=0.02)


def test_an_arc_too_short_to_be_judged_stays_as_it_is():
    profile = line(dome(0, 20))
    arc = arc_of(profile, 0, 11)
    assert screen_arc(profile, arc) is arc


def test_the_arc_holds_exactly_the_points_kept():
    profile = line(dome(0, 20))
    screened = screen_arc(profile, arc_of(profile))
    assert screened.arc == Arc(int(screened.indices[0]), int(screened.indices[-1]) + 1)
