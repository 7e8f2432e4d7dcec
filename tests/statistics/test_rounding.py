"""Steps of rounded heights, and none where noise, slopes or repeated columns explain equal ones."""

import numpy as np
import pytest

from lsvision.statistics.rounding import find_rounding

X = np.linspace(-20.0, 20.0, 401)
PIPE = np.sqrt(25.0**2 - X**2)


@pytest.mark.parametrize("step", [0.2, 0.5, 1.0])
def test_the_step_of_a_rounded_pipe_is_found(step):
    assert find_rounding([np.round(PIPE / step) * step]) == pytest.approx(step)


def test_lost_points_and_other_profiles_do_not_hide_it():
    rounded = np.round(PIPE)
    rounded[[5, 100, 101]] = np.nan
    assert find_rounding([rounded, np.full(9, np.nan), np.round(PIPE - 3)]) == 1.0


def test_noise_above_the_step_is_no_rounding():
    noise = np.random.default_rng(3).normal(0, 1.0, len(X))
    assert find_rounding([np.round(PIPE + noise)]) is None
    assert find_rounding([PIPE + noise]) is None


def test_repeated_columns_are_no_rounding():
    noise = np.random.default_rng(3).normal(0, 0.05, len(X))
    assert find_rounding([np.repeat(PIPE + noise, 3)]) is None


def test_a_flat_beside_a_pipe_in_fine_steps_is_no_rounding():
    assert find_rounding([np.append(np.zeros(1000), np.round(PIPE, 2))]) is None


@pytest.mark.parametrize("heights", [[], [np.empty(0)], [np.zeros(50)], [np.arange(12.0)]])
def test_few_steps_show_none(heights):
    assert find_rounding(heights) is None


def staircase(ties, moving=40, step=1.0):
    """Heights with some steps between neighbours, and a number of equal neighbours."""
    steps = np.concatenate([np.full(moving, step), np.zeros(ties)])
    return np.cumsum([0.0, *np.random.default_rng(0).permutation(steps)])


@pytest.mark.parametrize(("ties", "found"), [(38, None), (40, 1.0)])
def test_half_of_the_neighbours_are_equal(ties, found):
    assert find_rounding([staircase(ties)]) == found


@pytest.mark.parametrize(("moving", "found"), [(9, None), (10, 1.0)])
def test_ten_steps_are_enough(moving, found):
    assert find_rounding([staircase(60, moving)]) == found


@pytest.mark.parametrize(("ties", "found"), [(9, None), (10, 1.0)])
def test_twenty_neighbours_are_enough(ties, found):
    assert find_rounding([staircase(ties, 10)]) == found


@pytest.mark.parametrize(("larger", "found"), [(2.4, 1.0), (2.6, None)])
def test_most_steps_are_not_much_larger_than_the_smallest(larger, found):
    steps = np.concatenate([np.full(12, 1.0), np.full(20, larger), np.zeros(40)])
    heights = np.cumsum([0.0, *np.random.default_rng(0).permutation(steps)])
    step = find_rounding([heights])
    assert step is None if found is None else step == pytest.approx(found)
