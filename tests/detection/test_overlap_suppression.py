from dataclasses import dataclass

import numpy as np

from lsvision.detection.overlap_suppression import suppress_overlapping


@dataclass(frozen=True)
class Found:
    indices: np.ndarray


def spans(*bounds):
    return [Found(np.arange(start, stop)) for start, stop in bounds]


def test_of_two_that_hold_the_same_points_the_larger_stays():
    half, whole = spans((30, 60), (0, 60))
    assert suppress_overlapping([half, whole]) == [whole]


def test_neighbours_that_share_a_few_points_both_stay():
    left, right = spans((0, 50), (45, 80))
    assert suppress_overlapping([right, left]) == [left, right]


def test_nothing_is_nothing():
    assert suppress_overlapping([]) == []
