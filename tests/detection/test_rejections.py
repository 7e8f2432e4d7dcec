from types import SimpleNamespace

import numpy as np
import pytest

from lsvision import Profile, Rejection
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import build_range_image, find_connected_components
from lsvision.detection.rejections import complete_rejections
from lsvision.profile import Arc
from tests.detection.scenes import bowl, dome, exact, flat, line

RANGE = (5.0, 60.0)
PROFILE = line(flat(0, 30), flat(30, 60, y=-420))  # two bars of 50 points each
COMPONENTS = find_connected_components(build_range_image(PROFILE), 10)


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


@pytest.mark.parametrize(("stop", "kept"), [(42, True), (50, False)])
def test_a_rejection_mostly_inside_a_cylinder_is_left_out(stop, kept):
    completed = explained([found_at(0, stop)], [Rejection(Arc(20, 70), "tried in vain")])
    assert any(rejection.arc == Arc(20, 70) for rejection in completed) == kept


def reasons_of(points):
    profile = prepare_profile(Profile(points), None)
    components = find_connected_components(build_range_image(profile), 10)
    return [r.reason for r in complete_rejections(profile, components, [], [], RANGE)]


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        pytest.param(dome(0, 20)[:9],
                     "too few points: 9, no segment of at least 10 connected points", id="9"),
        pytest.param(np.zeros((1, 2)), "too few points: 1,", id="one"),
        pytest.param(np.full((4, 2), np.nan), "all points are lost", id="lost"),
        pytest.param(np.column_stack([np.arange(40.0) + 20 * (np.arange(40) // 5), np.zeros(40)]),
                     "too few points: 40, no segment of at least 10", id="apart"),
        pytest.param(dome(0, 20)[:11], "no ellipse: ", id="11"),
    ],
)  # fmt: skip
def test_a_profile_without_a_line_has_a_reason_too(points, reason):
    (only,) = reasons_of(points)
    assert only.startswith(reason)


def reason_of_run(points):
    """Return the reason for points that are one component, with a noise of 0.02 mm."""
    profile, every = exact(points, 0.02 / 2**0.5), [np.arange(len(points))]
    (rejection,) = complete_rejections(profile, every, [], [], RANGE)
    return rejection.reason


def test_no_columns_have_no_reason():
    assert reasons_of(np.empty((0, 2))) == []


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        pytest.param(flat(0, 60), "flat: 0.0", id="bar"),
        pytest.param(flat(0, 60, slope=0.7), "flat: 0.0", id="sloping bar"),
        pytest.param(bowl(0, 20), "concave towards the sensor", id="bowl"),
        pytest.param(dome(0, 80, 40), "radius 80 mm outside 5 to 60 mm", id="large"),
        pytest.param(np.concatenate([flat(0, 20), flat(20, 40, y=-430), flat(40, 60)]),
                     "no ellipse: ", id="box"),
        pytest.param(np.concatenate([flat(0, 20), flat(20, 40, y=-430)]),
                     "no arc: 2", id="step"),
    ],
)  # fmt: skip
def test_a_run_has_its_reason(points, reason, rng):
    noisy = points + 0.02 * rng.normal(size=points.shape)
    assert reason_of_run(noisy).startswith(reason)


@pytest.mark.parametrize(("sigmas", "flat_"), [(1.8, True), (2.2, False)])
def test_flat_is_what_scatters_by_less_than_two_sigma(sigmas, flat_, rng):
    bar = flat(0, 600) + (0.02 * sigmas * rng.normal(size=(1000, 2))) * (0, 1)
    assert reason_of_run(bar).startswith("flat: ") == flat_


def test_points_at_one_place_are_flat():
    assert reason_of_run(np.full((20, 2), 3.0)) == ("flat: 0.00 mm rms from a straight line")


def test_only_what_bends_as_a_cylinder_is_convex(rng):
    step = np.concatenate([flat(0, 20), flat(20, 40, y=-430)])
    kinds = ((flat(0, 60), False), (step, False), (bowl(0, 20), False), (dome(0, 80, 40), True))
    for points, convex in kinds:
        profile = exact(points + 0.02 * rng.normal(size=points.shape), 0.02 / 2**0.5)
        every = [np.arange(len(points))]
        (own,) = complete_rejections(profile, every, [], [], RANGE)
        assert own.convex == convex
