from dataclasses import dataclass

import numpy as np

from lsvision.recognition.parts import without_parts


@dataclass(frozen=True)
class Found:
    indices: np.ndarray


def spans(*bounds):
    return [Found(np.arange(start, stop)) for start, stop in bounds]


def test_of_two_that_hold_the_same_points_the_larger_stays():
    half, whole = spans((30, 60), (0, 60))
    assert without_parts([half, whole]) == [whole]


def test_neighbours_that_share_a_few_points_both_stay():
    left, right = spans((0, 50), (45, 80))
    assert without_parts([right, left]) == [left, right]


def test_nothing_is_nothing():
    assert without_parts([]) == []
