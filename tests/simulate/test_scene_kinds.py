"""Properties of the kinds of random scene."""

import math

import numpy as np
import pytest

from lsvision.errors import DegenerateGeometry
from lsvision.geometry import orthogonal_residuals
from lsvision.simulate import SCENE_KINDS, SCENE_SENSOR, SectionSettings, TubeRanges, random_section

TUBES = {
    "single": 1,
    "welded_pair": 2,
    "planar": 1,
    "complex": 1,
    "welded_complex": 2,
    "three_stacked": 3,
    "empty": 0,
}
SEEDS = range(12)
CONTACT = 1e-3  # mm: what 2000 samples of an outline miss


def test_the_order_of_the_kinds():
    assert list(SCENE_KINDS) == list(TUBES)


@pytest.mark.parametrize("kind", TUBES)
def test_tubes_are_within_the_ranges_and_visible(kind):
    for seed in SEEDS:
        tubes = random_section(kind, seed).truth.tubes
        assert len(tubes) == TUBES[kind]
        for tube in tubes:
            assert tube.visible
            assert 10 - 1e-9 <= tube.radius <= 40 + 1e-9
            assert tube.phi <= math.radians(40) + 1e-9


@pytest.mark.parametrize("kind", ["planar", "complex", "welded_pair", "welded_complex", "empty"])
def test_clutter_and_beads_are_visible(kind):
    seen = [int((random_section(kind, seed).truth.labels == 0).sum()) for seed in SEEDS]
    assert np.median(seen) > 3


@pytest.mark.parametrize("kind", ["welded_pair", "welded_complex", "three_stacked"])
def test_tubes_of_a_pair_or_stack_touch_and_do_not_overlap(kind):
    turns = np.linspace(0, 2 * math.pi, 2001)
    for seed in SEEDS:
        ellipses = [tube.ellipse for tube in random_section(kind, seed).truth.tubes]
        outlines = [ellipse.points_at(turns) for ellipse in ellipses]
        for k in range(len(ellipses)):
            others = [o for j, o in enumerate(outlines) if j != k]
            gaps = [orthogonal_residuals(other, ellipses[k]).min() for other in others]
            assert min(gaps) == pytest.approx(0.0, abs=CONTACT)


def test_default_losses_jumps_and_noise():
    sections = [random_section("single", seed) for seed in range(40)]
    noise = np.array([section.sensor.range_std for section in sections])
    assert (noise.min() >= 0.02, noise.max() <= 0.1, np.ptp(noise) > 0.05) == (True,) * 3
    settings = sections[0].settings
    assert (settings.lost_fraction, settings.jump_fraction) == (0.03, 0.02)
    pitch = SCENE_SENSOR.width_at_max_range / 375 * 400 / SCENE_SENSOR.max_range
    assert pitch == pytest.approx(0.6, abs=0.01)


def test_a_seed_determines_a_section_and_kinds_differ():
    first, again = random_section("planar", 5), random_section("planar", 5)
    assert first.profile.points.tobytes() == again.profile.points.tobytes()
    assert random_section("planar", 6).truth.tubes[0].radius != first.truth.tubes[0].radius
    assert random_section("complex", 5).truth.tubes[0].radius != first.truth.tubes[0].radius


def test_noise_does_not_change_the_scene():
    drawn, given = random_section("single", 3), random_section("single", 3, noise_mm=0.02)
    assert given.sensor.range_std == 0.02
    assert given.truth.tubes[0].radius == drawn.truth.tubes[0].radius


def test_tubes_of_fixed_parameters():
    ranges = TubeRanges(radius_mm=(19, 19), theta_deg=(30, 30), phi_deg=(20, 20))
    section = random_section("welded_pair", 1, tubes=ranges, settings=SectionSettings.ideal())
    for tube in section.truth.tubes:
        found = (tube.radius, math.degrees(tube.theta), math.degrees(tube.phi))
        assert found == pytest.approx((19, 30, 20))


@pytest.mark.parametrize("radius", [1.0, 900.0])
def test_tubes_too_small_or_too_large_for_the_sensor_raise_an_error(radius):
    with pytest.raises(DegenerateGeometry, match=r"ask for radii of about 10 to 40 mm .* or less"):
        random_section("single", 1, tubes=TubeRanges(radius_mm=(radius, radius)))


def test_an_unknown_kind_raises_an_error():
    with pytest.raises(ValueError, match="expected one of single, welded_pair"):
        random_section("double", 1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"radius_mm": (0.0, 10.0)}, "radius min:max above 0 mm, got 0 to 10"),
        ({"radius_mm": (20.0, 10.0)}, "radius min:max above 0 mm, got 20 to 10"),
        ({"phi_deg": (0.0, 85.0)}, "phi within"),
        ({"theta_deg": (10.0, 5.0)}, "theta min:max in deg, got 10 to 5"),
    ],
)
def test_invalid_ranges_raise_errors(changes, message):
    with pytest.raises(ValueError, match=message):
        TubeRanges(**changes)
