"""Order of points along the laser line, where it differs from the order of the sensor's columns.

Y increases towards the sensor: of two lines, the one nearer to the sensor has the larger Y.
"""

import math

import numpy as np

from lsvision.geometry import BoolArray, IntArray, Points
from lsvision.geometry.noisy_points import as_complex
from lsvision.statistics.robust import upper_median

MIN_PROGRESS_RATIO = 0.5
"""Smallest ratio of the distance in X between first and last point to the sum of the lengths of all
steps in X, for points that are in order along X. Only few steps are reversed by an overhang or by
noise in X."""
MAX_PATH_RATIO = 0.5
"""Ratio of the path length in a new order to that in the present order, below which the new order
is used. A wrong order at least doubles the path, since most of its steps are between two lines."""
MAX_CLOSURE_RATIO = 0.5
"""Ratio of the distance in X between first and last point to the width of the profile, below which
the path is closed."""
MAX_COLUMN_SPACING_RATIO = 0.5
"""Ratio of the spacing of two points in X to the median spacing, below which they belong to the
same column."""
MAX_CLIMB_WIDTHS = 5.0
"""Ratio of the sum of the absolute steps in Y to the width of a profile, above which the profile
may have two returns per column; a single line with clutter and jumps has at most 3."""
MIN_RETURN_DISTANCE_STEPS = 10.0
"""Smallest distance in Y of two returns of a column, in units of the typical step: the median of
the distances in Y of each point from the nearer of the two before it. About 5 sigma on a flat
line."""


def order_along_line(points: Points) -> IntArray | None:
    """Return the indices that sort points along the laser line; None if the order is correct.

    The order is correct where the points progress along X, or where sorting by X would not halve
    their path. Two returns per column, and the two sides of a closed section, are two lines; the
    one nearer to the sensor comes first.

    Parameters
    ----------
    points : (n, 2) ndarray
        Valid points, in the order of the sensor; any number. Units: mm.

    Returns
    -------
    (n,) ndarray of int, or None
        Permutation of the indices of the points.
    """
    if len(points) <= 2:
        return None
    x = points[:, 0]
    travel = float(np.abs(x[1:] - x[:-1]).sum())
    end_distance = abs(float(x[-1] - x[0]))
    if end_distance >= MIN_PROGRESS_RATIO * travel:
        return _separate_returns(points)
    by_x: IntArray = x.argsort(kind="stable")
    separated = _separate_returns(points[by_x])
    new_order = by_x if separated is None else by_x[separated]
    if _measure_path_length(points[new_order]) < MAX_PATH_RATIO * _measure_path_length(points):
        return new_order
    leftmost, rightmost = int(by_x[0]), int(by_x[-1])
    closed = end_distance < MAX_CLOSURE_RATIO * float(x[rightmost] - x[leftmost])
    return _split_loop(points, leftmost, rightmost) if closed else None


def _split_loop(points: Points, leftmost: int, rightmost: int) -> IntArray:
    """Return the order of a closed path as two lines, one for each side, from left to right.

    `leftmost` and `rightmost` are the indices of the points at which the sides meet.
    """
    path = np.roll(np.arange(len(points)), -leftmost)
    side_end = (rightmost - leftmost) % len(points) + 1
    return _join_lines(points, path[:side_end], path[side_end:][::-1])


def _separate_returns(points: Points) -> IntArray | None:
    """Return the order of points along X as two lines, one for each return of a column.

    None if the points are a single line.
    """
    x, y = points.T
    climb = float(np.abs(y[1:] - y[:-1]).sum())
    if climb <= MAX_CLIMB_WIDTHS * abs(float(x[-1] - x[0])):
        return None
    # The lines are followed towards +X, so that the result does not depend on the columns'
    # direction.
    ascending = x[0] <= x[-1]
    mask = _follow_two_lines(points) if ascending else _follow_two_lines(points[::-1])[::-1]
    order = _join_lines(points, mask.nonzero()[0], (~mask).nonzero()[0])
    shorter = _measure_path_length(points[order]) < MAX_PATH_RATIO * _measure_path_length(points)
    return order if shorter else None


def _follow_two_lines(points: Points) -> BoolArray:
    """Return the mask (n,) of the points on the same line as the first point.

    Each point is assigned to the line whose last point is nearer in Y.
    """
    x, y = points.T
    steps, double_steps = np.abs(y[1:] - y[:-1]), np.abs(y[2:] - y[:-2])
    min_distance = MIN_RETURN_DISTANCE_STEPS * upper_median(np.minimum(steps[1:], double_steps))
    spacing = np.abs(x[1:] - x[:-1])
    median_spacing = upper_median(np.append(spacing[spacing > 0], 0.0))
    same_column = spacing < MAX_COLUMN_SPACING_RATIO * median_spacing
    second_returns = same_column & (steps > min_distance)
    last_y: list[float | None] = [float(y[0]), None]
    lines = [0]
    for point_y, is_second in zip(y[1:].tolist(), second_returns.tolist(), strict=True):
        # Until the second line has a point, its distance is assumed to be `min_distance`.
        distances = [min_distance if last is None else abs(point_y - last) for last in last_y]
        # The second return of a column belongs to the line to which the first one does not belong.
        line = 1 - lines[-1] if is_second else int(distances[1] < distances[0])
        last_y[line] = point_y
        lines.append(line)
    mask: BoolArray = np.array(lines) == 0
    return mask


def _join_lines(points: Points, first: IntArray, second: IntArray) -> IntArray:
    """Return the indices of the nearer of two lines, then those of the farther one.

    The farther line begins at its point farthest from the sensor, and its points before that one
    come last, so that the end of the nearer line is not followed by points on the same ellipse.
    """
    near, far = sorted(
        (first, second), key=lambda line: -points[line, 1].mean() if len(line) else math.inf
    )
    farthest = int(points[far, 1].argmin()) if len(far) else 0
    return np.concatenate([near, np.roll(far, -farthest)])


def _measure_path_length(points: Points) -> float:
    """Return the sum of the distances between successive points. Units: mm."""
    z = as_complex(points)
    return float(np.abs(z[1:] - z[:-1]).sum())
