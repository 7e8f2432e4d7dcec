"""Limits of lost markers, each from both sides; reading of whole files is in tests/io."""

import numpy as np
import pytest

from lsvision.statistics.lost_markers import find_lost_markers

SPAN = 0.96  # of 51 even values over 1 between their 2 % and 98 % quantiles


def heights_above(value, gap_spans, repeats, span=1.0):
    """51 heights over a span, the lowest so many quantile spans above a repeated value."""
    heights = value + gap_spans * SPAN * span + np.linspace(0.0, span, 51)
    return np.concatenate([heights, np.full(repeats, value)])


@pytest.mark.parametrize(
    ("value", "gap", "repeats", "span"),
    [(-175.3, 4.0, 5, 1.0), (0.0, 2.0, 5, 1.0), (-999.9, 1.0, 5, 1.0), (-9999.0, 5.0, 1, 1.0),
     (-32768.0, 0.1, 2, 100.0)],
    ids=["any", "zero", "nines", "one of nines", "limit of an integer"],
)  # fmt: skip
def test_a_marker_lies_so_many_spans_from_the_heights(value, gap, repeats, span):
    assert find_lost_markers(heights_above(value, 1.1 * gap, repeats, span)) == (value,)
    assert find_lost_markers(heights_above(value, 0.9 * gap, repeats, span)) == ()


@pytest.mark.parametrize("bits", [15, 16, 23, 24, 31, 32, 63, 64])
@pytest.mark.parametrize("sign", [-1, 1])
def test_the_limits_of_integers_are_markers_near_the_heights(bits, sign):
    """At a tenth of a span, where -9999 needs a whole one."""
    for limit in (2.0**bits, 2.0**bits - 1):
        span = max(100.0, limit / 1e6)
        heights = sign * heights_above(-limit, 0.2, 2, span)
        assert find_lost_markers(heights) == (-sign * limit,)
    near = sign * heights_above(-(2.0**bits) * 0.98, 0.2, 2, max(100.0, 2.0**bits / 1e6))
    assert (find_lost_markers(near) == ()) == (bits < 60)


def test_a_marker_repeats_more_often_than_rounded_heights():
    heights = np.repeat(np.linspace(-170.0, -169.0, 51), 2)
    assert find_lost_markers(np.append(heights, np.full(5, -200.3))) == (-200.3,)
    assert find_lost_markers(np.append(heights, np.full(4, -200.3))) == ()


def test_a_value_that_occurs_twice_is_no_marker():
    heights = np.linspace(-170.0, -169.0, 51)
    assert find_lost_markers(np.append(heights, np.full(3, -200.3))) == (-200.3,)
    assert find_lost_markers(np.append(heights, np.full(2, -200.3))) == ()


def test_three_markers_below_the_heights_are_found_and_a_fourth_is_not():
    heights = np.linspace(-170.0, -169.0, 51)
    markers = np.array([-999.1, -888.1, -777.1, -666.1])
    three = np.append(heights, np.repeat(markers[:3], 6))
    assert find_lost_markers(three) == tuple(markers[:3].tolist())
    four = find_lost_markers(np.append(heights, np.repeat(markers, 6)))
    assert -666.1 not in four


def test_five_heights_are_enough_beside_the_markers():
    heights = np.array([-170.0, -169.7, -169.5, -169.4, -169.2])
    assert find_lost_markers(np.append(heights, [-9999.0, -9999.0])) == (-9999.0,)
    assert find_lost_markers(np.append(heights[:4], [-9999.0, -9999.0])) == ()
