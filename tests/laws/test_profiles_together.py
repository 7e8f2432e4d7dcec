"""Profiles measured at once have the results that each has alone, whatever the others are."""

import numpy as np
import pytest

from lsvision import LPS36HI, Profile, measure_cylinders
from lsvision.cli.measure_files import TASK_SIZE
from lsvision.measure import PROFILES_AT_ONCE, measure_profiles
from lsvision.simulate import SCENE_KINDS, SectionSettings, random_section
from tests.measurements import assert_same_measurement
from tests.other_scenes import other_scene

HARD = SectionSettings(lost_fraction=0.10, jump_fraction=0.05)


def scenes(seed):
    """One profile of each kind, usual or hard, and two of another simulator."""
    own = [
        random_section(kind, 1000 * seed + k, noise_mm=0.05, settings=HARD if k % 2 else None)
        for k, kind in enumerate(SCENE_KINDS)
    ]
    others = [
        other_scene(np.random.default_rng([seed, k]), 2, welded=True, cluttered=True)[0]
        for k in range(2)
    ]
    return [section.profile for section in own] + [Profile(points) for points in others]


def degenerate(rng):
    """Profiles in which nothing is found, for many reasons, and some of unusual size."""
    x = np.linspace(-60, 60, 400)
    line = np.column_stack([x, 0 * x - 400])
    dense = np.linspace(-60, 60, 5000)
    arc = np.sqrt(np.maximum(900 - dense**2, 0.0)) - 430 + 0.02 * rng.normal(size=len(dense))
    far = np.column_stack([9e4 + x, np.sqrt(np.maximum(900 - x**2, 0.0)) - 9e4])
    return [
        Profile(np.zeros((0, 2))),
        Profile(np.full((30, 2), np.nan)),
        Profile([[1.0, -400.0]]),
        Profile(np.full((40, 2), 5.0), lost=()),
        Profile(line),
        Profile(line + 0.1 * rng.normal(size=line.shape)),
        Profile(rng.normal(size=(200, 2)) + np.array([0.0, -400.0])),
        Profile(np.column_stack([dense, arc])),
        Profile(far),
    ]


def assert_as_alone(profiles, **options):
    together = measure_profiles(profiles, **options)
    assert len(together) == len(profiles)
    for profile, measurement in zip(profiles, together, strict=True):
        assert_same_measurement(measurement, measure_cylinders(profile, **options))
        assert measurement.profile is profile
    return together


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"sensor": LPS36HI},
        {"radius": (10, 40)},
        {"known_radius": (20.0, 0.1)},
        {"known_phi": 0.0},
        {"known_phi": (0.3, 0.1)},
    ],
    ids=str,
)
@pytest.mark.parametrize("seed", [1, 2])
def test_scenes_together_have_the_results_of_each_alone(seed, options):
    together = assert_as_alone(scenes(seed), **options)
    assert sum(len(measurement.cylinders) for measurement in together) > 0


def test_profiles_in_which_nothing_is_found_change_no_other(rng):
    pairs = zip(degenerate(rng), scenes(3), strict=False)
    assert_as_alone([profile for pair in pairs for profile in pair])


def test_the_order_of_the_profiles_is_irrelevant(rng):
    profiles = scenes(4)
    order = rng.permutation(len(profiles))
    expected = measure_profiles(profiles)
    for k, measurement in zip(order, measure_profiles([profiles[k] for k in order]), strict=True):
        assert_same_measurement(measurement, expected[k])


def test_more_profiles_than_are_measured_at_once():
    count = PROFILES_AT_ONCE + 3
    assert_as_alone([random_section("single", k, noise_mm=0.05).profile for k in range(count)])


def test_no_profile_has_no_result():
    assert measure_profiles([]) == []


def test_a_warning_points_at_the_caller():
    metres = random_section("single", 1).profile.points / 1000
    with pytest.warns(UserWarning, match="metres") as warned:
        measure_profiles([metres])
    assert warned[0].filename == __file__


def test_one_profile_is_not_several():
    with pytest.raises(TypeError, match="expected a sequence of profiles, got one Profile"):
        measure_profiles(Profile([[0.0, -400.0]]))


def test_the_shell_measures_as_many_at_once():
    assert TASK_SIZE == PROFILES_AT_ONCE
