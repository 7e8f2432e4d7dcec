"""Outlines of clutter: position, size, and that none contains an arc like a tube's."""

import math

import numpy as np
import pytest

from lsvision.simulate import TubeRanges, clutter
from lsvision.simulate.clutter import draw_mixed
from lsvision.simulate.scene_kinds import draw_welded_pair_scene
from lsvision.simulate.solids import Prism

PIPE_CURVATURES = (10.0 * math.cos(math.radians(40)), 40.0 / math.cos(math.radians(40)) ** 2)
"""Radii of curvature of sections of pipes of 10-40 mm tilted by 0-40 deg: b^2/a to a^2/b, mm."""
MAX_TUBE_LIKE_TURN = math.radians(55.0)
"""An arc below 60 deg does not determine an ellipse; such a tube counts as invisible."""


def longest_round_turn(outline):
    """Largest angle by which an outline turns with a curvature like a tube's.

    All outlines run from left to right over their sensor side, so that round means clockwise.
    """
    pieces = np.diff(outline, axis=0)
    length = np.hypot(*pieces.T)
    turn = -np.diff(np.unwrap(np.arctan2(pieces[:, 1], pieces[:, 0])))
    between = (length[1:] + length[:-1]) / 2
    # A corner between long straight pieces is an edge, not an arc.
    round_ = (turn > 0) & (between < 2.0)
    radius = between / np.where(round_, turn, 1.0)
    low, high = PIPE_CURVATURES
    alike = round_ & (radius > low) & (radius < high)
    total = longest = 0.0
    for step, counts in zip(turn, alike, strict=True):
        total = total + step if counts else 0.0
        longest = max(longest, total)
    return longest


def test_the_turning_angle_is_large_for_a_tube_and_zero_for_a_trough():
    turns = np.linspace(0.8 * math.pi, 0.2 * math.pi, 120)
    arc = 20.0 * np.column_stack([np.cos(turns), np.sin(turns)])
    assert longest_round_turn(arc) == pytest.approx(math.radians(108), abs=0.05)
    assert longest_round_turn(arc * [1.0, -1.0]) == 0.0


def test_no_random_clutter_resembles_a_tube():
    for seed in range(300):
        outline = draw_mixed(np.random.default_rng(seed)).outline
        assert longest_round_turn(outline) < MAX_TUBE_LIKE_TURN, seed


def test_no_weld_bead_resembles_a_tube():
    for seed in range(40):
        scene = draw_welded_pair_scene(np.random.default_rng(seed), TubeRanges())
        (bead,) = (solid for solid in scene.objects if isinstance(solid, Prism))
        assert longest_round_turn(bead.outline[:41]) < MAX_TUBE_LIKE_TURN, seed


def test_an_outline_is_translated_and_rotated_from_x_to_y():
    outline = clutter.build_bar(40.0, 10.0, (100.0, -400.0), math.pi / 2).outline
    # The right end of its upper edge, 20 mm along X, comes to lie 20 mm towards the sensor.
    np.testing.assert_allclose(outline[1], (100.0, -380.0), rtol=0, atol=1e-12)


def test_outlines_have_the_specified_sizes():
    x, y = clutter.build_sine_sheet(60.0, 3.0, 20.0, (0.0, 0.0)).outline.T
    assert (np.ptp(x), np.ptp(y)) == pytest.approx((60.0, 6.0), abs=1e-2)
    x, y = clutter.build_parabola(40.0, 8.0, (0.0, 0.0)).outline.T
    assert (y[0], y.max(), y[-1]) == pytest.approx((-8.0, 0.0, -8.0), abs=1e-3)
    x, y = clutter.build_v_groove(50.0, 10.0, 6.0, (0.0, 0.0)).outline.T
    assert (np.ptp(x), y.min()) == (50.0, -6.0)
    x, y = clutter.build_rounded_box(30.0, 20.0, 4.0, (0.0, 0.0)).outline.T
    assert (np.ptp(x), np.ptp(y)) == pytest.approx((30.0, 20.0))
    x, y = clutter.build_angle_iron(30.0, 4.0, (0.0, 0.0)).outline[:3].T
    assert np.hypot(x[0], y[0]) == pytest.approx(30.0)


def test_a_spline_passes_through_its_knots():
    knots = np.array([[-20.0, 0.0], [-8.0, 3.0], [4.0, -2.0], [19.0, 1.0]])
    x, y = clutter.build_spline_sheet(knots, (0.0, 0.0)).outline.T
    np.testing.assert_allclose(np.interp(knots[:, 0], x, y), knots[:, 1], rtol=0, atol=5e-3)


def test_bumps_are_summed():
    one = clutter.build_gaussian_bumps(80.0, [[0.0, 5.0, 6.0]], (0.0, 0.0)).outline
    two = clutter.build_gaussian_bumps(80.0, [[0.0, 2.0, 6.0], [0.0, 3.0, 6.0]], (0.0, 0.0)).outline
    np.testing.assert_allclose(one, two, rtol=0, atol=1e-12)
    assert one[:, 1].max() == pytest.approx(5.0, abs=1e-2)


@pytest.mark.parametrize("corner", [0.0, 6.0])
def test_a_corner_with_the_radius_of_a_tube_raises_an_error(corner):
    with pytest.raises(ValueError, match="expected a corner"):
        clutter.build_rounded_box(60.0, 60.0, corner, (0.0, 0.0))


def test_the_largest_corner_of_a_small_box_is_reported():
    with pytest.raises(ValueError, match=r"corner in \(0, 3\] mm, got 4"):
        clutter.build_rounded_box(6.0, 20.0, 4.0, (0.0, 0.0))
