"""The shortest path against a plain dynamic programme over every edge."""

import numpy as np
import pytest

from lsvision.laser_line.candidates import LineCandidates
from lsvision.laser_line.path_search import PathSettings, find_shortest_line_path

SETTINGS = PathSettings(restart_cost=3.0)
THRESHOLD, HEIGHT = 10.0, 60


def random_candidates(seed, width=60):
    """Two lines that bend, meet and have gaps, and noise; few scores count fully."""
    rng = np.random.default_rng(seed)
    columns, rows = [], []
    for start in rng.uniform(15, 45, 2):
        steps = rng.choice([0, 1, -1, 3, -3], width, p=[0.5, 0.2, 0.2, 0.05, 0.05])
        seen = rng.random(width) > 0.2
        columns.append(np.flatnonzero(seen))
        rows.append((start + np.cumsum(steps) + rng.normal(0, 0.2, width))[seen])
    columns.append(rng.integers(0, width, width // 2))
    rows.append(rng.uniform(0, HEIGHT, width // 2))
    columns, rows = np.concatenate(columns), np.concatenate(rows)
    order = np.lexsort((rows, columns))
    scores = rng.uniform(2, 14, len(order))
    return LineCandidates(columns[order], rows[order], scores, THRESHOLD, (HEIGHT, width))


def candidate_costs(candidates):
    ratio = candidates.scores / (SETTINGS.max_score_ratio * candidates.threshold)
    return SETTINGS.empty_column_cost * (1 - np.minimum(ratio, 1.0))


def link_cost(candidates, first, second):
    """Cost of the edge between two candidates without the second's own; infinite without one."""
    step = candidates.columns[second] - candidates.columns[first]
    rise = candidates.rows[second] - candidates.rows[first]
    near = 1 <= step <= SETTINGS.max_missing_columns + 1
    if not (near and abs(rise) <= SETTINGS.max_row_step * step):
        return np.inf
    return SETTINGS.slope_cost * rise**2 / step + SETTINGS.empty_column_cost * (step - 1)


def least_cost(candidates):
    own, width = candidate_costs(candidates), candidates.shape[1]
    empty, at = np.zeros(width + 1), np.full(len(own), np.inf)
    for column in range(width):
        here = np.flatnonzero(candidates.columns == column)
        for new in here:
            links = [at[old] + link_cost(candidates, old, new) for old in range(new)]
            at[new] = own[new] + min([empty[column] + SETTINGS.restart_cost / 2, *links])
        ends = [at[new] + SETTINGS.restart_cost / 2 for new in here]
        empty[column + 1] = min([empty[column] + SETTINGS.empty_column_cost, *ends])
    return empty[width]


def cost_of(candidates, path):
    own, width = candidate_costs(candidates), candidates.shape[1]
    cost, restart = 0.0, SETTINGS.restart_cost / 2
    for before, after in zip([None, *path], [*path, None], strict=True):
        start = -1 if before is None else candidates.columns[before]
        stop = width if after is None else candidates.columns[after]
        apart = SETTINGS.empty_column_cost * (stop - start - 1)
        apart += restart * ((before is not None) + (after is not None))
        linked = np.inf if None in (before, after) else link_cost(candidates, before, after)
        cost += min(apart, linked) + (0.0 if after is None else own[after])
    return cost


@pytest.mark.parametrize("seed", range(20))
def test_no_path_costs_less(seed):
    candidates = random_candidates(seed)
    found = find_shortest_line_path(candidates, SETTINGS)
    empty = candidates.shape[1] * SETTINGS.empty_column_cost
    assert len(found.indices) > 10
    assert empty - found.cost_reduction == pytest.approx(least_cost(candidates), abs=1e-6)
    assert cost_of(candidates, found.indices) == pytest.approx(least_cost(candidates), abs=1e-6)


def test_a_candidate_that_leads_nowhere_does_not_stand_for_the_edge_over_it():
    """From column 30 no candidate is within reach; over it the next one is."""
    climb = np.minimum(25.0 + 4.0 * np.arange(29), 45.0)
    rows = np.concatenate([np.full(30, 20.0), [20.5], climb])
    candidates = LineCandidates(np.arange(60), rows, np.full(60, 20.0), THRESHOLD, (HEIGHT, 60))
    path = find_shortest_line_path(candidates, PathSettings(restart_cost=3.0, slope_cost=0.02))
    np.testing.assert_array_equal(path.indices, np.delete(np.arange(60), 30))


INVALID = {
    "candidates": {"candidates": 0},
    "max_score_ratio": {"max_score_ratio": 0.0},
    "slope_cost": {"slope_cost": -1.0},
    "max_missing_columns": {"max_missing_columns": -1},
    "restart_cost": {"restart_cost": float("nan")},
    "empty_column_cost": {"empty_column_cost": 0.0},
}


@pytest.mark.parametrize("name", ["candidates", "max_row_step", "max_missing_columns"])
def test_a_number_of_columns_is_whole(name):
    with pytest.raises(ValueError, match=f"expected a whole number of {name}, got 1.5"):
        PathSettings(**{name: 1.5})


@pytest.mark.parametrize("arguments", INVALID.values(), ids=INVALID)
def test_costs_out_of_range_are_rejected(arguments):
    """A negative cost makes the path arbitrary."""
    (name,) = arguments
    with pytest.raises(ValueError, match=f"expected (a positive )?{name}"):
        PathSettings(**arguments)
