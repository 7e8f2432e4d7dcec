from types import SimpleNamespace

import numpy as np

from lsvision import Rejection
from lsvision.detection.range_image import connected_components, rasterise
from lsvision.detection.rejections import complete_rejections
from lsvision.profile import Arc
from tests.detection.scenes import dome, flat, line

RANGE = (5.0, 60.0)
PROFILE = line(flat(0, 30), flat(30, 60, y=-420))  # two bars of 50 points each
COMPONENTS = connected_components(rasterise(PROFILE), 8)


def explained(cylinders=(), rejections=()):
    return complete_rejections(PROFILE, COMPONENTS, list(cylinders), list(rejections), RANGE)


def found_at(start, stop):
    return SimpleNamespace(indices=np.arange(start, stop))


def test_every_stretch_gets_one_reason():
    left, right = explained()
    assert (left.arc, right.arc) == (Arc(0, 50), Arc(50, 100))
    assert left.reason.startswith("flat")


def test_what_a_cylinder_holds_needs_no_reason():
    (only,) = explained([found_at(0, 50)])
    assert only.arc == Arc(50, 100)


def test_the_rest_beside_a_cylinder_is_explained():
    arcs = [rejection.arc for rejection in explained([found_at(10, 30)])]
    assert arcs == [Arc(0, 10), Arc(30, 50), Arc(50, 100)]


def test_a_few_points_beside_a_cylinder_are_not():
    assert [rejection.arc for rejection in explained([found_at(5, 50)])] == [Arc(50, 100)]


def test_a_flat_stretch_is_called_flat_whatever_was_tried_on_it_and_once():
    kept = explained(rejections=[Rejection(Arc(0, 50), "first"), Rejection(Arc(2, 48), "again")])
    assert kept[0].reason.startswith("flat: ")
    assert [rejection.arc for rejection in kept] == [Arc(0, 50), Arc(50, 100)]


def test_a_rejection_inside_a_cylinder_is_left_out():
    kept = explained([found_at(0, 50)], [Rejection(Arc(10, 30), "tried in vain")])
    assert all(rejection.reason != "tried in vain" for rejection in kept)


def test_the_order_is_that_of_the_profile():
    starts = [r.arc.start for r in explained(rejections=[Rejection(Arc(60, 70), "middle")])]
    assert starts == sorted(starts)


def test_a_profile_without_components_has_nothing_to_explain():
    assert complete_rejections(line(dome(0, 20)), [], [], [], RANGE) == []
