"""Which candidates make the laser line: the cheapest way from the first column to the last.

Brightness must not buy a jump: a candidate's score counts only up to a little more than the
threshold of detection, so that a long dim line beats any number of bright glints. Taking a
candidate costs 1 less its saturated score, leaving a column empty costs nearly 1, moving up or
down costs by the square of the step, and starting anew elsewhere costs a fixed price.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, IntArray
from lsvision.laser_line.candidates import LineCandidates


@dataclass(frozen=True, kw_only=True)
class PathSettings:
    """How the line is followed from column to column.

    Parameters
    ----------
    candidates : int
        Strongest maxima looked at in each column.
    max_score_ratio : float
        Multiple of the detection threshold from which a score counts no more.
    slope_cost : float
        Price of a step of one px from column to column; grows with its square.
    max_row_step : int
        Longest step from column to column; beyond it the line starts anew. Units: px.
    max_missing_columns : int
        Columns that may be missing without a new start.
    restart_cost : float
        Price of a new start, in columns; shorter pieces of line are not worth one.
    empty_column_cost : float
        Price of an empty column; taking a candidate costs between 0 and this.
    """

    candidates: int = 12
    max_score_ratio: float = 1.2
    slope_cost: float = 0.1
    max_row_step: int = 4
    max_missing_columns: int = 3
    restart_cost: float = 30.0
    empty_column_cost: float = 0.95


@dataclass(frozen=True, eq=False)
class LinePath:
    """Candidates on the line.

    Parameters
    ----------
    indices : (k,) ndarray of int
        Into the candidates, by column.
    segment_labels : (k,) ndarray of int
        0, 1, ...: which unbroken piece of the line each belongs to.
    cost_reduction : float
        Price of an empty image less the line's: its worth, in columns.
    """

    indices: IntArray
    segment_labels: IntArray
    cost_reduction: float


def shortest_line_path(candidates: LineCandidates, settings: PathSettings) -> LinePath:
    """The cheapest path through the candidates, at most one in each column.

    Parameters
    ----------
    candidates : LineCandidates
        Ordered by column, then row.
    settings : PathSettings
        The prices.

    Returns
    -------
    LinePath
        Empty where no piece of line is worth its price.

    Notes
    -----
    Nodes are the candidates and, for each column, "no line here"; every edge leads to a later
    column, so the shortest path is exact whatever its order. Dijkstra (scipy) wants no
    negative price; there is none.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    if not len(candidates):
        return LinePath(np.zeros(0, np.int64), np.zeros(0, np.int64), 0.0)
    count, width = len(candidates), candidates.shape[1]
    start, stop, price = _edges(candidates, settings)
    nodes = count + width + 1
    # A price of 0 is no edge to a sparse matrix.
    graph = csr_array((price + 1e-9, (start, stop)), shape=(nodes, nodes))
    costs, before = dijkstra(graph, indices=count, return_predecessors=True)
    indices = _backtrack(before.tolist(), count, width)
    saved = width * settings.empty_column_cost - float(costs[count + width])
    return LinePath(indices, _segment_labels(candidates, indices, settings), saved)


def _edges(
    candidates: LineCandidates, settings: PathSettings
) -> tuple[IntArray, IntArray, FloatArray]:
    """Start, stop and price of every edge; node ``count + c`` is "no line in column c"."""
    count, width = len(candidates), candidates.shape[1]
    columns = candidates.columns
    own = settings.empty_column_cost * (
        1 - np.minimum(candidates.scores / (settings.max_score_ratio * candidates.threshold), 1.0)
    )
    here = np.arange(count)
    none = count + np.arange(width)
    starts = [none, none[columns], here]
    stops = [none + 1, here, count + columns + 1]
    prices = [
        np.full(width, settings.empty_column_cost),
        settings.restart_cost / 2 + own,
        np.full(count, settings.restart_cost / 2),
    ]
    for step in range(1, settings.max_missing_columns + 2):
        first, second = _neighbours(candidates, step, settings.max_row_step)
        rise = candidates.rows[second] - candidates.rows[first]
        starts.append(first)
        stops.append(second)
        prices.append(
            settings.slope_cost * rise**2 / step
            + own[second]
            + settings.empty_column_cost * (step - 1)
        )
    return np.concatenate(starts), np.concatenate(stops), np.concatenate(prices)


def _neighbours(candidates: LineCandidates, step: int, reach: int) -> tuple[IntArray, IntArray]:
    """Pairs of candidates `step` columns apart and at most `reach` rows a column."""
    span = candidates.shape[0] + 2 * reach * (step + 1)  # no reach touches the next column
    keys = candidates.columns * span + candidates.rows
    target = keys + step * span
    half = reach * step
    low = np.searchsorted(keys, target - half)
    high = np.searchsorted(keys, target + half, side="right")
    counts = high - low
    first = np.repeat(np.arange(len(keys)), counts)
    before = np.repeat(np.cumsum(counts) - counts, counts)
    second = np.repeat(low, counts) + np.arange(len(first)) - before
    return first, second


def _backtrack(before: list[int], count: int, width: int) -> IntArray:
    """Candidates met on the way back from the last column."""
    taken, node = [], count + width
    while node != count:
        if node < count:
            taken.append(node)
        node = before[node]
    return np.array(taken[::-1], dtype=np.int64)


def _segment_labels(
    candidates: LineCandidates, indices: IntArray, settings: PathSettings
) -> IntArray:
    steps = np.diff(candidates.columns[indices])
    rises = np.abs(np.diff(candidates.rows[indices]))
    broken = (steps > settings.max_missing_columns + 1) | (rises > settings.max_row_step * steps)
    pieces: IntArray = np.concatenate([[0], np.cumsum(broken)]).astype(np.int64)
    return pieces[: len(indices)]
