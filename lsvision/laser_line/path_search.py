"""Connect candidates to a laser line: the shortest path from the first column to the last.

A candidate's score counts only up to a little more than the detection threshold, so that bright
glints do not compensate for jumps and a long dim line has the lower cost. A candidate on the path
costs less the higher its score, an empty column costs nearly 1, a step between rows costs its
square, and a new segment elsewhere costs a constant.
"""

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from lsvision.geometry import FloatArray, IntArray
from lsvision.laser_line.candidates import LineCandidates

if TYPE_CHECKING:
    from scipy.sparse import csr_array

MIN_EDGE_COST = 1e-9
"""Added to the cost of every edge; negligible beside `PathSettings.empty_column_cost`."""


@dataclass(frozen=True, kw_only=True)
class PathSettings:
    """Costs and limits of the path along a laser line; only ratios of the costs matter.

    Parameters
    ----------
    candidates : int
        Largest number of candidates in a column: those with the highest scores. 8 and 17 yield the
        same lines.
    max_score_ratio : float
        Score over detection threshold above which a higher score has no effect. Ratios of 0.84 and
        1.7 yield the same lines, but for a few columns at their ends.
    slope_cost : float
        Cost of a step of 1 px from one column to the next; grows with the square of the step. With
        0.14 a third more columns at steep ends of pipes is lost, with 0.07 a third fewer, but the
        errors of wide lines are twice as large.
    max_row_step : int
        Largest step from one column to the next within a segment. With 3 an eighth more columns of
        cluttered images is lost; 6 yields the same lines. Units: px.
    max_missing_columns : int
        Largest number of consecutive empty columns within a segment. 2 and 4 yield the same lines.
    restart_cost : float
        Cost of a new segment, which is not used unless it has more than restart_cost /
        empty_column_cost columns. 21 and 42 yield the same lines.
    empty_column_cost : float
        Cost of an empty column, and of a candidate whose score is zero.

    Raises
    ------
    ValueError
        If a number is negative or not finite, that of an int is not whole, or `candidates`,
        `max_score_ratio` or `empty_column_cost` is zero.

    Notes
    -----
    The results of other values are those on 120 simulated images of pipes and boards: bright,
    faint, saturated, wide, thin, with speckle, among clutter, compressed, coloured.
    """

    candidates: int = 12
    max_score_ratio: float = 1.2
    slope_cost: float = 0.1
    max_row_step: int = 4
    max_missing_columns: int = 3
    restart_cost: float = 30.0
    empty_column_cost: float = 0.95

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0 <= value < math.inf:
                raise ValueError(f"expected {field.name} >= 0, got {value}")
        for name in ("candidates", "max_row_step", "max_missing_columns"):
            if not isinstance(getattr(self, name), int | np.integer):
                raise ValueError(f"expected a whole number of {name}, got {getattr(self, name)}")
        for name in ("candidates", "max_score_ratio", "empty_column_cost"):
            if not getattr(self, name) > 0:
                raise ValueError(f"expected a positive {name}, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False)
class LinePath:
    """The candidates on a laser line.

    Parameters
    ----------
    indices : (k,) ndarray of int
        Indices of the candidates, ordered by column.
    cost_reduction : float
        Cost of an image without a line minus that of the path; about the number of columns in
        which the line is.
    """

    indices: IntArray
    cost_reduction: float


def find_shortest_line_path(candidates: LineCandidates, settings: PathSettings) -> LinePath:
    """Find the path of lowest cost with at most one candidate in each column.

    It is empty where every segment costs more than empty columns. Nodes are the candidates and, for
    each column, "no line here"; every edge leads to a later column, and no cost is negative, as
    Dijkstra's algorithm requires.
    """
    from scipy.sparse.csgraph import dijkstra

    if not len(candidates):
        return LinePath(np.zeros(0, np.int64), 0.0)
    count, width = len(candidates), candidates.shape[1]
    graph = _build_sparse_matrix(*_build_edges(candidates, settings), count + width + 1)
    costs, predecessors = dijkstra(graph, indices=count, return_predecessors=True)
    indices = _backtrack(predecessors.tolist(), count, width)
    cost_reduction = width * settings.empty_column_cost - float(costs[count + width])
    return LinePath(indices, cost_reduction)


def _build_sparse_matrix(
    start: IntArray, stop: IntArray, cost: FloatArray, nodes: int
) -> "csr_array[np.float64]":
    """Return the matrix of the edges' costs; scipy's own checks and sorting take twice the time."""
    from scipy.sparse import csr_array

    order = np.argsort(start, kind="stable")
    row_starts = np.zeros(nodes + 1, np.int32)
    np.cumsum(np.bincount(start, minlength=nodes), out=row_starts[1:])
    # A sparse matrix does not store an edge of cost 0.
    entries = cost[order] + MIN_EDGE_COST, stop[order].astype(np.int32), row_starts
    return csr_array(entries, shape=(nodes, nodes))


def _build_edges(
    candidates: LineCandidates, settings: PathSettings
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return start, stop and cost of each edge.

    Node ``count + c`` is "no line in column c"; the path leads from the first of them to
    ``count + width``, beyond the last column.
    """
    count, width = len(candidates), candidates.shape[1]
    candidate_costs = settings.empty_column_cost * (
        1 - np.minimum(candidates.scores / (settings.max_score_ratio * candidates.threshold), 1.0)
    )
    first, second, link_costs = _build_links(candidates, candidate_costs, settings)
    empty = count + np.arange(width)
    starts = [empty, empty[candidates.columns], np.arange(count), first]
    stops = [empty + 1, np.arange(count), count + candidates.columns + 1, second]
    costs = [
        np.full(width, settings.empty_column_cost),
        settings.restart_cost / 2 + candidate_costs,
        np.full(count, settings.restart_cost / 2),
        link_costs,
    ]
    return np.concatenate(starts), np.concatenate(stops), np.concatenate(costs)


def _build_links(
    candidates: LineCandidates, candidate_costs: FloatArray, settings: PathSettings
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return start, stop and cost of the edges between candidates that may be on the path.

    An edge over several columns is left out if the path may as well pass a candidate of the next
    column: that saves the cost of an empty column less the candidate's. A candidate `detour` rows
    off the straight line of the edge adds slope_cost * step / (step - 1) * detour^2: its two parts
    rise by rise / step + detour over one column and by the rest over step - 1 columns, and each
    costs slope_cost times the square of its rise over its columns.
    """
    rows, empty_cost = candidates.rows, settings.empty_column_cost
    steps = range(1, settings.max_missing_columns + 2)
    columns = np.arange(candidates.shape[1] + steps.stop)
    column_starts = np.searchsorted(candidates.columns, columns)
    next_rise, saved = np.zeros((2, len(candidates)))
    links = []
    for step in steps:
        first, second = _pair_candidates(column_starts, candidates.columns + step)
        rise = rows.take(second) - rows.take(first)
        near = np.flatnonzero(np.abs(rise) <= settings.max_row_step * step)
        first, second, rise = first.take(near), second.take(near), rise.take(near)
        if step > 1:
            first_rise = next_rise.take(first)
            detour, remaining_rise = first_rise - rise / step, rise - first_rise
            added = settings.slope_cost * step / (step - 1) * detour**2
            needed = np.abs(remaining_rise) > settings.max_row_step * (step - 1)
            kept = np.flatnonzero((added >= saved.take(first)) | needed)
            first, second, rise = first.take(kept), second.take(kept), rise.take(kept)
        if step == 1:
            next_rise[first], saved[first] = rise, empty_cost - candidate_costs[second]
        cost = settings.slope_cost * rise**2 / step + candidate_costs.take(second)
        links.append((first, second, cost + empty_cost * (step - 1)))
    starts, stops, costs = (np.concatenate(each) for each in zip(*links, strict=True))
    return starts, stops, costs


def _pair_candidates(column_starts: IntArray, columns: IntArray) -> tuple[IntArray, IntArray]:
    """Return the pairs of each candidate with all candidates of the column given for it (n,)."""
    low = column_starts[columns]
    counts = column_starts[columns + 1] - low
    first = np.repeat(np.arange(len(low)), counts)
    second = np.arange(len(first)) + np.repeat(low - np.cumsum(counts) + counts, counts)
    return first, second


def _backtrack(predecessors: list[int], count: int, width: int) -> IntArray:
    """Return the candidates (k,) on the path, from the last node back over the predecessors."""
    path, node = [], count + width
    while node != count:
        if node < count:
            path.append(node)
        node = predecessors[node]
    return np.array(path[::-1], dtype=np.int64)
