"""Tubes that touch, and the weld beads between them.

Touching is meant in the section: two ellipses with one common point. The gap between two convex
bodies is their separation along the direction that separates them best, so the touching distance
along a given line is a minimum over directions of support widths (no root finding on conics).
"""

import math

import numpy as np
from scipy.optimize import brentq

from lsvision.geometry import Ellipse, FloatArray, Points
from lsvision.simulate.prism import Prism

DIRECTIONS = 128
"""Directions tried in each round of the search for the common normal."""
NORMAL_WIDTH = 1e-8
"""Width at which that search stops; the distance is then right to its square. Units: rad."""
CURVE_STEPS = 40
"""Straight pieces of a bead's surface, which is never longer than about 20 mm."""


def touching_centre(fixed: Ellipse, moved: Ellipse, direction: float) -> tuple[float, float]:
    """Centre at which an ellipse touches another from outside.

    Parameters
    ----------
    fixed, moved : Ellipse
        The centre of `moved` is not used.
    direction : float
        From the centre of `fixed` to the centre looked for, from X towards Y. Units: rad.

    Returns
    -------
    tuple of float
        ``(x, y)``. Units: mm.

    Examples
    --------
    >>> circle = Ellipse((0.0, -400.0), 10.0, 10.0, 0.0)
    >>> x, y = touching_centre(circle, Ellipse((0.0, 0.0), 15.0, 15.0, 0.0), 0.0)
    >>> f"{x:.6f} {y:.6f}"
    '25.000000 -400.000000'
    """
    distance, _ = _touching(fixed, moved, direction)
    x, y = fixed.centre
    return x + distance * math.cos(direction), y + distance * math.sin(direction)


def nested_centre(left: Ellipse, right: Ellipse, moved: Ellipse) -> tuple[float, float]:
    """Centre at which an ellipse touches two others, on the sensor's side of them.

    Parameters
    ----------
    left, right : Ellipse
        Apart or touching, less far than `moved` is wide.
    moved : Ellipse
        Its centre is not used.

    Raises
    ------
    ValueError
        If it falls through between them.
    """
    to_right = math.atan2(right.centre[1] - left.centre[1], right.centre[0] - left.centre[0])

    def gap(turn: float) -> float:
        x, y = touching_centre(left, moved, to_right + turn)
        dx, dy = x - right.centre[0], y - right.centre[1]
        apart, _ = _touching(right, moved, math.atan2(dy, dx))
        return math.hypot(dx, dy) - apart

    if not gap(0.0) < 0 < gap(math.pi * 0.9):
        raise ValueError("want two ellipses closer than the third is wide, got a wider gap")
    turn = brentq(gap, 0.0, math.pi * 0.9, xtol=1e-13)
    return touching_centre(left, moved, to_right + turn)


def contact_point(first: Ellipse, second: Ellipse) -> tuple[float, float]:
    """Where two touching ellipses touch. Units: mm."""
    dx, dy = second.centre[0] - first.centre[0], second.centre[1] - first.centre[1]
    _, normal = _touching(first, second, math.atan2(dy, dx))
    u = np.array([math.cos(normal), math.sin(normal)])
    shape = _shape(first)
    x, y = np.asarray(first.centre) + shape @ u / math.sqrt(u @ shape @ u)
    return float(x), float(y)


def weld_bead(
    first: Ellipse,
    second: Ellipse,
    *,
    leg: float,
    bulge: float,
    along: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> Prism:
    """Bead in the groove between two touching tubes, on the sensor's side.

    Parameters
    ----------
    first, second : Ellipse
        They touch.
    leg : float
        How far the bead reaches up each tube from the contact, along the tube. Units: mm.
    bulge : float
        Height of the bead's crown over the straight line between its feet, towards the sensor,
        as a share of that line. 0 is the hollow fillet that runs tangentially into both tubes;
        above it the bead stands out and meets them with an edge.
    along : tuple of float
        Direction of extrusion.
    """
    contact = np.asarray(contact_point(first, second))
    feet = [_foot(ellipse, contact, leg) for ellipse in (first, second)]
    crown = (
        _fillet_control_point(feet, contact)
        if bulge == 0
        else _bulged_control_point(feet, contact, bulge)
    )
    t = np.linspace(0.0, 1.0, CURVE_STEPS + 1)[:, None]
    (start, _), (stop, _) = feet
    curve = (1 - t) ** 2 * start + 2 * t * (1 - t) * crown + t**2 * stop
    return Prism(np.vstack([curve, contact[None], curve[:1]]), along)


def _touching(fixed: Ellipse, moved: Ellipse, direction: float) -> tuple[float, float]:
    """Distance of the centres at contact, and direction of the common normal."""
    shapes = _shape(fixed), _shape(moved)

    def distance(turn: FloatArray) -> FloatArray:
        u = np.array([np.cos(direction + turn), np.sin(direction + turn)])
        widths = [np.sqrt(np.einsum("i...,ij,j...->...", u, shape, u)) for shape in shapes]
        total: FloatArray = (widths[0] + widths[1]) / np.cos(turn)
        return total

    low, high = -1.5, 1.5
    while high - low > NORMAL_WIDTH:
        turns = np.linspace(low, high, DIRECTIONS)
        best = int(np.argmin(distance(turns)))
        low, high = turns[max(best - 1, 0)], turns[min(best + 1, DIRECTIONS - 1)]
    middle = np.array((low + high) / 2)
    return float(distance(middle)), direction + float(middle)


def _shape(ellipse: Ellipse) -> FloatArray:
    """Matrix S of the support width sqrt(u' S u)."""
    axes = ellipse.from_ellipse_frame(np.diag([ellipse.semi_major, ellipse.semi_minor]))
    axes = axes - ellipse.centre
    shape: FloatArray = axes.T @ axes
    return shape


def _foot(ellipse: Ellipse, contact: FloatArray, leg: float) -> tuple[FloatArray, FloatArray]:
    """Point of an ellipse `leg` away from the contact on the sensor's side, and its tangent."""
    own = ellipse.to_ellipse_frame(contact[None])[0]
    at = math.atan2(own[1] / ellipse.semi_minor, own[0] / ellipse.semi_major)
    walk = np.linspace(0.0, math.pi, 2000)
    ways = [ellipse.points_at(at + sign * walk) for sign in (1.0, -1.0)]
    up = max(ways, key=lambda way: float(way[100, 1]))
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(up, axis=0).T))])
    index = int(np.searchsorted(length, leg))
    tangent = up[index] - up[index - 1]
    return up[index], tangent / np.linalg.norm(tangent)


def _fillet_control_point(
    feet: list[tuple[FloatArray, FloatArray]], contact: FloatArray
) -> FloatArray:
    """Control point of the fillet: where the tangents of both feet meet."""
    (start, start_tangent), (stop, stop_tangent) = feet
    sides = np.column_stack([start_tangent, -stop_tangent])
    if abs(np.linalg.det(sides)) < 0.05:
        return (start + stop + contact) / 3
    crown: FloatArray = start + np.linalg.solve(sides, stop - start)[0] * start_tangent
    return crown


def _bulged_control_point(
    feet: list[tuple[FloatArray, FloatArray]], contact: FloatArray, bulge: float
) -> Points:
    """Control point of a bead whose crown stands over the line between its feet."""
    (start, _), (stop, _) = feet
    middle = (start + stop) / 2
    out = middle - contact
    height = bulge * np.linalg.norm(stop - start)
    # A quadratic curve reaches half way to its control point.
    control: FloatArray = middle + 2 * height * out / np.linalg.norm(out)
    return control
