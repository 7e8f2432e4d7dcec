"""The order of points along the laser line, where the order of the sensor's columns is none."""

import math

import numpy as np

from lsvision.geometry import BoolArray, IntArray, Points
from lsvision.geometry.noisy_points import as_complex
from lsvision.statistics.robust import upper_median

HALF = 0.5
"""What is less than half counts as small here: progress along X over the travel, a path over
another one, the ends' distance over the width, a spacing over the typical one."""
MAX_CLIMB_WIDTHS = 5.0
"""Travel along Y over the width of a profile from which two returns a column are looked for;
one line with clutter and jumps has 3 at the most."""
RETURN_STEPS = 10.0
"""Two returns lie so many times further apart than half of all points from the nearer of their
neighbours, which is 5 sigma where the line is flat."""


def order_along_line(points: Points) -> IntArray | None:
    """Order of points in which each follows its neighbour on the line.

    Parameters
    ----------
    points : (n, 2) ndarray
        As the sensor gives them, none lost. Units: mm.

    Returns
    -------
    (n,) int ndarray or None
        None where the order is kept: x progresses, or the points follow a path that sorting
        by x would not make much shorter. Two returns a column, and the two sides of a closed
        section, are two lines, the one nearer to the sensor first.
    """
    if len(points) < 3:
        return None
    x = points[:, 0]
    travel = float(np.abs(x[1:] - x[:-1]).sum())
    if abs(float(x[-1] - x[0])) >= HALF * travel:
        return _separate_returns(points)
    by_x: IntArray = x.argsort(kind="stable")
    lines = _separate_returns(points[by_x])
    sorted_lines = by_x if lines is None else by_x[lines]
    if _path_length(points[sorted_lines]) < HALF * _path_length(points):
        return sorted_lines
    closed = abs(float(x[-1] - x[0])) < HALF * float(x[by_x[-1]] - x[by_x[0]])
    return _sides_of_loop(points, int(by_x[0]), int(by_x[-1])) if closed else None


def _sides_of_loop(points: Points, leftmost: int, rightmost: int) -> IntArray:
    """The two ways from the leftmost to the rightmost point of a closed path."""
    path = np.roll(np.arange(len(points)), -leftmost)
    turn = (rightmost - leftmost) % len(points)
    return _nearest_first(points, path[: turn + 1], path[turn + 1 :][::-1])


def _separate_returns(points: Points) -> IntArray | None:
    """The nearer of two lines, then the farther one; None where there is one line."""
    x, y = points.T
    climb = float(np.abs(y[1:] - y[:-1]).sum())
    if climb <= MAX_CLIMB_WIDTHS * abs(float(x[-1] - x[0])):
        return None
    first = _is_first_line(points) if x[0] <= x[-1] else _is_first_line(points[::-1])[::-1]
    order = _nearest_first(points, first.nonzero()[0], (~first).nonzero()[0])
    return order if _path_length(points[order]) < HALF * _path_length(points) else None


def _is_first_line(points: Points) -> BoolArray:
    """Which points continue the first of two lines, each the nearer one or the column's other."""
    x, y = points.T
    near, next_but_one = np.abs(y[1:] - y[:-1]), np.abs(y[2:] - y[:-2])
    limit = RETURN_STEPS * upper_median(np.minimum(near[1:], next_but_one))
    spacing = np.abs(x[1:] - x[:-1])
    same_column = spacing < HALF * upper_median(np.append(spacing[spacing > 0], 0.0))
    second_of_column = np.append(False, same_column & (near > limit))
    ends: list[float | None] = [float(y[0]), None]
    lines = [0]
    for height, is_second in zip(y[1:].tolist(), second_of_column[1:].tolist(), strict=True):
        away = [limit if end is None else abs(height - end) for end in ends]
        line = 1 - lines[-1] if is_second else int(away[1] < away[0])
        ends[line] = height
        lines.append(line)
    first: BoolArray = np.array(lines) == 0
    return first


def _nearest_first(points: Points, *lines: IntArray) -> IntArray:
    """The nearer line, then the farther one from its lowest point round to that again.

    So the end of the one is not followed by points of the other that lie on the same ellipse.
    """
    near, far = sorted(lines, key=lambda line: -points[line, 1].mean() if len(line) else math.inf)
    return np.concatenate([near, np.roll(far, -int(points[far, 1].argmin()) if len(far) else 0)])


def _path_length(points: Points) -> float:
    z = as_complex(points)
    return float(np.abs(z[1:] - z[:-1]).sum())
