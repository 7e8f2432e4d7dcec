"""Arrays of unlike length that are stacked, and groups of them."""

import numpy as np
import pytest

from lsvision.geometry.arrays import apply_in_groups, as_unit_vector, pad_rows, stack_padded


def calls_of_groups(sizes, max_elements):
    """Results of a step that doubles, and the items that it was given together."""
    calls = []

    def double(items):
        calls.append(list(items))
        return [2 * item for item in items]

    return apply_in_groups(double, list(range(len(sizes))), sizes, max_elements), calls


def test_groups_hold_items_of_similar_size_and_results_keep_their_order():
    results, calls = calls_of_groups([10, 31, 29, 100, 9, 300], 10_000)
    assert results == [0, 2, 4, 6, 8, 10]
    # 9 to 27 and 29 to 87 elements, 100 to 300.
    assert calls == [[4, 0], [2, 1], [3, 5]]


def test_a_group_has_no_more_elements_with_padding_than_allowed():
    _, calls = calls_of_groups([10, 20, 30], 60)
    assert calls == [[0, 1], [2]]
    _, calls = calls_of_groups([10, 20, 30], 90)
    assert calls == [[0, 1, 2]]


def test_an_item_that_is_too_large_is_alone():
    results, calls = calls_of_groups([500, 5, 600], 100)
    assert results == [0, 2, 4]
    assert calls == [[1], [0], [2]]


def test_no_item_is_no_group():
    assert calls_of_groups([], 100) == ([], [])


@pytest.mark.parametrize("sizes", [[3], [2, 5, 1], [4, 4]])
def test_arrays_are_stacked_with_their_last_element_repeated(sizes, rng):
    arrays = [rng.normal(size=size) for size in sizes]
    rows, valid = pad_rows(sizes)
    stacked = stack_padded(arrays, rows)
    assert stacked.shape == (len(sizes), max(sizes))
    for row, mask, array in zip(stacked, valid, arrays, strict=True):
        np.testing.assert_array_equal(row[mask], array)
        assert (row[~mask] == array[-1]).all()


@pytest.mark.parametrize("length", [5e-324, 1e-161, 1e-3, 1e200, 1e308])
def test_a_vector_of_any_length_has_a_unit_vector(length):
    unit, found = as_unit_vector((0.0, -length, 0.0), "normal")
    assert (unit.tolist(), found) == ([0.0, -1.0, 0.0], length)
    oblique, _ = as_unit_vector((0.6 * length, 0.0, 0.8 * length), "normal")
    if length > 1e-300:
        np.testing.assert_allclose(oblique, (0.6, 0.0, 0.8), rtol=1e-15)
