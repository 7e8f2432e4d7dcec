"""Derivatives of a run of a laser line, and the edges of its light."""

import numpy as np
import pytest

from lsvision.laser_line.line_shape import POLYNOMIAL_COLUMNS, compute_line_shape

MAX_FALSE_EDGES = 0.015  # of ends in noise alone: 0.5 % seen, 5 % with half their std


@pytest.mark.parametrize("distance", [0, 3, 6, 40])
def test_a_run_shorter_than_the_distance_has_no_point_far_from_its_ends(distance):
    shape = compute_line_shape(
        np.zeros(POLYNOMIAL_COLUMNS), np.ones(POLYNOMIAL_COLUMNS), np.full(POLYNOMIAL_COLUMNS, 0.01)
    )
    far = np.arange(POLYNOMIAL_COLUMNS)
    far = (far >= distance) & (far < POLYNOMIAL_COLUMNS - distance)
    np.testing.assert_array_equal(shape.is_far_from_edges(distance), far)


def test_noise_at_the_end_of_a_run_is_no_edge():
    rng, noise = np.random.default_rng(3), np.full(60, 0.06)
    ends = []
    for _ in range(600):
        shape = compute_line_shape(np.zeros(60), np.exp(rng.normal(0, noise)), noise)
        ends += shape.edge[[0, -1]].tolist()
    assert np.mean(ends) < MAX_FALSE_EDGES
