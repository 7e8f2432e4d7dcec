"""The candidates of a profile do not depend on the order, position or scale of its points."""

import numpy as np
import pytest

from lsvision import Profile, ProfileSensor
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import build_range_image, find_connected_components
from lsvision.simulate import SCENE_KINDS, SectionSettings, random_section
from tests.detection.scenes import find_candidates
from tests.other_scenes import other_scene

RADII = (3.0, 150.0)
HARD = SectionSettings(lost_fraction=0.10, jump_fraction=0.05)


def own(kind, seed):
    return random_section(kind, seed, settings=HARD).profile.points


def others(seed):
    points, _, _ = other_scene(np.random.default_rng(seed), 2, welded=True, cluttered=True)
    return points


SCENES = {f"{kind} {seed}": own(kind, seed) for kind in SCENE_KINDS for seed in (32, 36)}
SCENES |= {f"welded in clutter {seed}": others(seed) for seed in range(4)}


def dense(count=12_000):
    """Return more points than `MAX_POINTS`."""
    x = np.linspace(-60, 60, count)
    y = np.where(np.abs(x) < 19, np.sqrt(np.maximum(400 - x * x, 0)), -5) - 400
    return np.column_stack([x, y + 0.05 * np.random.default_rng(1).normal(size=count)])


SCENES["more points than are kept"] = dense()


def front_end(points, sensor=None, scale=1.0):
    """Return columns, centre and radius of each candidate, in order."""
    profile = prepare_profile(Profile(points), sensor)
    components = find_connected_components(build_range_image(profile), 10)
    candidates = find_candidates(profile, components, (RADII[0] * scale, RADII[1] * scale))
    return [
        (profile.sensor_columns[candidate.indices], candidate.centre, candidate.radius)
        for candidate in candidates
    ]


def assert_same(found, expected, rows=None, move=lambda centre: centre):
    """Compare candidates, in order; `rows` are the former columns of the points of `found`."""
    assert len(found) == len(expected) > 0
    for (columns, centre, radius), (old_columns, old_centre, old_radius) in zip(
        found, expected, strict=True
    ):
        own_columns = columns if rows is None else rows[columns]
        np.testing.assert_array_equal(np.sort(own_columns), np.sort(old_columns))
        assert radius == pytest.approx(old_radius, rel=1e-7)
        assert centre == pytest.approx(move(old_centre), abs=1e-6)


@pytest.fixture(params=SCENES, scope="module")
def scene(request):
    return SCENES[request.param]


@pytest.fixture(params=[None, ProfileSensor()], ids=["estimated", "sensor"])
def sensor(request):
    return request.param


def test_reversed_points_have_the_same_candidates(scene, sensor):
    back = np.arange(len(scene))[::-1]
    assert_same(front_end(scene[::-1], sensor), front_end(scene, sensor), back)


def test_mirrored_points_have_the_same_candidates(scene, sensor):
    found = front_end(scene * (-1, 1), sensor)
    assert_same(found, front_end(scene, sensor), move=lambda centre: (-centre[0], centre[1]))


def test_lost_rows_between_the_columns_change_no_candidate(scene, sensor, rng):
    rows = np.insert(np.arange(len(scene)), rng.integers(0, len(scene), len(scene) // 5), -1)
    points = np.where((rows < 0)[:, None], np.nan, scene[rows])
    assert_same(front_end(points, sensor), front_end(scene, sensor), rows)


@pytest.mark.parametrize("shift", [(37.0, -21.0), (-1234.5, 678.9)])
def test_moved_points_have_the_same_candidates(scene, shift):
    found = front_end(scene + shift)
    assert_same(found, front_end(scene), move=lambda centre: np.add(centre, shift))


@pytest.mark.parametrize("scale", [0.001, 7.0])
def test_scaled_points_have_the_same_candidates(scene, scale):
    found = [
        (c, np.divide(m, scale), r / scale) for c, m, r in front_end(scene * scale, scale=scale)
    ]
    assert_same(found, front_end(scene))


def test_points_in_any_order_have_the_candidates_of_those_by_x(rng):
    """The order follows from x if no two points have the same x, and there is no overhang."""
    points = SCENES["welded in clutter 1"]
    points = points[np.isfinite(points[:, 0])]
    rows = rng.permutation(len(points))
    assert_same(front_end(points[rows]), front_end(points), rows)
