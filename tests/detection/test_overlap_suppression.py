from dataclasses import dataclass

import numpy as np
import pytest

from lsvision.detection.overlap_suppression import suppress_overlapping


@dataclass(frozen=True)
class Found:
    indices: np.ndarray


def spans(*bounds):
    return [Found(np.arange(start, stop)) for start, stop in bounds]


def test_of_two_that_hold_the_same_points_the_larger_stays():
    half, whole = spans((30, 60), (0, 60))
    assert suppress_overlapping([half, whole]) == [whole]


@pytest.mark.parametrize(("common", "both"), [(5, True), (11, True), (13, False), (17, False)])
def test_two_of_which_three_tenths_are_common_are_one(common, both):
    left, right = spans((0, 50), (50 - common, 90 - common))
    assert suppress_overlapping([right, left]) == ([left, right] if both else [left])


def test_nothing_is_nothing():
    assert suppress_overlapping([]) == []
