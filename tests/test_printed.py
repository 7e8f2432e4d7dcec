"""The comparison with the README accepts another rounding, and nothing else."""

import pytest

from tests.printed import differing


@pytest.mark.parametrize(
    ("printed", "shown"),
    [
        ("17.950", "17.951"),
        ("radius 17.951 ± 0.069 mm", "radius 17.950 ± 0.070 mm"),
        ("+0.0", "-0.1"),
        ("9.99", "10.00"),
        ("163 points", "163 points"),
    ],
)
def test_numbers_one_unit_apart_are_alike(printed, shown):
    assert differing([printed], [shown]) == []


@pytest.mark.parametrize(
    ("printed", "shown"),
    [
        ("17.950", "17.952"),
        ("17.95", "17.951"),  # another number of digits
        ("0.1", "-0.1"),
        ("163 points", "164 points"),  # a count
        ("17.950 mm", "17.950 px"),
        ("17.950  mm", "17.950 mm"),  # another column
        ("17.950", ""),
        ("", "OK"),
    ],
)
def test_anything_else_differs(printed, shown):
    assert differing([printed], [shown]) == [(printed, shown)]
    assert differing([shown, "mm"], [printed, "mm"]) == [(shown, printed)]


def test_what_is_missing_differs():
    assert differing(["a", "b"], ["a"]) == [("b", "")]
    assert differing([], ["1.5"]) == [("", "1.5")]
