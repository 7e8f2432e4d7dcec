"""Order of points along the laser line, where it is not the order of the sensor's columns."""

import math

import numpy as np

from lsvision.geometry import BoolArray, IntArray, Points
from lsvision.geometry.noisy_points import as_complex
from lsvision.statistics.robust import upper_median

HALF = 0.5
"""Ratio below which a quantity is small: progress along X over the travel, a path length over
another one, the distance of the ends over the width, a spacing over the typical one."""
MAX_CLIMB_WIDTHS = 5.0
"""Travel along Y over the width of a profile above which two returns per column are searched;
one line with clutter and jumps has at most 3."""
RETURN_STEPS = 10.0
"""Smallest distance of two returns of a column along Y, in medians of the distance of points from
the nearer of their neighbours; 5 sigma on a flat line."""


def order_along_line(points: Points) -> IntArray | None:
    """Return the order in which each of the valid points follows its neighbour on the line.

    None means the given order: x progresses, or sorting by x would not make the path of the points
    much shorter. Two returns per column, and the two sides of a closed section, are two lines, of
    which the one nearer to the sensor comes first.
    """
    if len(points) <= 2:
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
    """Return the order with the two sides of a closed path, both from left to right."""
    path = np.roll(np.arange(len(points)), -leftmost)
    turn = (rightmost - leftmost) % len(points)
    return _nearest_first(points, path[: turn + 1], path[turn + 1 :][::-1])


def _separate_returns(points: Points) -> IntArray | None:
    """Return the order with the nearer of two lines first; None where there is one line."""
    x, y = points.T
    climb = float(np.abs(y[1:] - y[:-1]).sum())
    if climb <= MAX_CLIMB_WIDTHS * abs(float(x[-1] - x[0])):
        return None
    first = _is_first_line(points) if x[0] <= x[-1] else _is_first_line(points[::-1])[::-1]
    order = _nearest_first(points, first.nonzero()[0], (~first).nonzero()[0])
    return order if _path_length(points[order]) < HALF * _path_length(points) else None


def _is_first_line(points: Points) -> BoolArray:
    """Return which points lie on the first of two lines: each joins the line nearer along Y."""
    x, y = points.T
    near, next_but_one = np.abs(y[1:] - y[:-1]), np.abs(y[2:] - y[:-2])
    limit = RETURN_STEPS * upper_median(np.minimum(near[1:], next_but_one))
    spacing = np.abs(x[1:] - x[:-1])
    same_column = spacing < HALF * upper_median(np.append(spacing[spacing > 0], 0.0))
    second_of_column = np.append(False, same_column & (near > limit))
    ends: list[float | None] = [float(y[0]), None]
    lines = [0]
    for height, is_second in zip(y[1:].tolist(), second_of_column[1:].tolist(), strict=True):
        distances = [limit if end is None else abs(height - end) for end in ends]
        # The second return of a column lies on the line that the first one is not on.
        line = 1 - lines[-1] if is_second else int(distances[1] < distances[0])
        ends[line] = height
        lines.append(line)
    first: BoolArray = np.array(lines) == 0
    return first


def _nearest_first(points: Points, *lines: IntArray) -> IntArray:
    """Return the order with the nearer line first, then the farther one from its lowest point on.

    The end of the nearer line is then not followed by points of the other on the same ellipse.
    """
    near, far = sorted(lines, key=lambda line: -points[line, 1].mean() if len(line) else math.inf)
    return np.concatenate([near, np.roll(far, -int(points[far, 1].argmin()) if len(far) else 0)])


def _path_length(points: Points) -> float:
    z = as_complex(points)
    return float(np.abs(z[1:] - z[:-1]).sum())
