"""Positions of touching tubes, and the weld beads between them.

Tubes touch in the section if their ellipses have exactly one common point. Two convex bodies are
disjoint if a direction separates their support intervals; the distance of the centres at contact,
along a given line, is therefore a minimum over directions of a sum of support widths.
"""

import math

import numpy as np
from scipy.optimize import brentq

from lsvision.geometry import Ellipse, FloatArray, Points
from lsvision.simulate.solids import Prism

DIRECTIONS = 128
"""Number of directions in each iteration of the search for the common normal."""
NORMAL_TOLERANCE = 1e-8
"""Interval at which the search stops; the error of the distance is quadratic in it. Units: rad."""
CURVE_SEGMENTS = 40
"""Number of segments of a bead's surface, which is about 20 mm long at most."""


def compute_touching_centre(
    fixed: Ellipse, moved: Ellipse, direction: float
) -> tuple[float, float]:
    """Return the centre (x, y) in mm at which the ellipse `moved` touches `fixed` from outside.

    `direction` is that from the centre of `fixed` to the result, from X towards Y, in rad.

    Examples
    --------
    >>> circle = Ellipse((0.0, -400.0), 10.0, 10.0, 0.0)
    >>> x, y = compute_touching_centre(circle, Ellipse((0.0, 0.0), 15.0, 15.0, 0.0), 0.0)
    >>> f"{x:.6f} {y:.6f}"
    '25.000000 -400.000000'
    """
    distance, _ = _find_contact(fixed, moved, direction)
    x, y = fixed.centre
    return x + distance * math.cos(direction), y + distance * math.sin(direction)


def compute_nested_centre(left: Ellipse, right: Ellipse, moved: Ellipse) -> tuple[float, float]:
    """Return the centre at which an ellipse touches two others, on the side of the sensor.

    These touch, or have a gap that is smaller than `moved`; otherwise ValueError.
    """
    to_right = math.atan2(right.centre[1] - left.centre[1], right.centre[0] - left.centre[0])

    def gap(angle: float) -> float:
        """Return the gap to `right` while `moved` touches `left` at an angle from `to_right`.

        It is negative at 0, where `moved` and `right` overlap.
        """
        x, y = compute_touching_centre(left, moved, to_right + angle)
        dx, dy = x - right.centre[0], y - right.centre[1]
        contact_distance, _ = _find_contact(right, moved, math.atan2(dy, dx))
        return math.hypot(dx, dy) - contact_distance

    if not gap(0.0) < 0 < gap(math.pi * 0.9):
        raise ValueError("expected two ellipses closer than the third is wide, got a wider gap")
    angle = brentq(gap, 0.0, math.pi * 0.9, xtol=1e-13)
    return compute_touching_centre(left, moved, to_right + angle)


def find_contact_point(first: Ellipse, second: Ellipse) -> tuple[float, float]:
    """Return the common point of two touching ellipses. Units: mm."""
    dx, dy = second.centre[0] - first.centre[0], second.centre[1] - first.centre[1]
    _, normal = _find_contact(first, second, math.atan2(dy, dx))
    u = np.array([math.cos(normal), math.sin(normal)])
    shape = _compute_shape_matrix(first)
    x, y = np.asarray(first.centre) + shape @ u / math.sqrt(u @ shape @ u)
    return float(x), float(y)


def build_weld_bead(
    first: Ellipse,
    second: Ellipse,
    *,
    leg: float,
    bulge: float,
    along: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> Prism:
    """Return the weld bead in the groove between two touching tubes, towards the sensor.

    `leg` is the arc length from the contact to either foot of the bead in mm; ValueError unless it
    is positive and at most half the circumference of a section. `bulge` is the height of the bead
    above the straight line between its feet, divided by the length of that line. 0: a concave
    fillet, tangential to both tubes; larger: a convex bead that meets the tubes in an edge. `along`
    is the direction of extrusion.
    """
    contact = np.asarray(find_contact_point(first, second))
    feet = [_find_foot(ellipse, contact, leg) for ellipse in (first, second)]
    control = (
        _find_fillet_control_point(feet, contact)
        if bulge == 0
        else _find_bulged_control_point(feet, contact, bulge)
    )
    t = np.linspace(0.0, 1.0, CURVE_SEGMENTS + 1)[:, None]
    (start, _), (stop, _) = feet
    curve = (1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * stop
    return Prism(np.vstack([curve, contact[None], curve[:1]]), along)


def _find_contact(fixed: Ellipse, moved: Ellipse, direction: float) -> tuple[float, float]:
    """Return the distance of the centres at contact (mm), and the direction of the normal (rad).

    `direction` is that from the centre of `fixed` to that of `moved`. The bodies touch where the
    sum of their support widths along a unit vector, over its cosine with `direction`, is smallest.
    """
    shapes = _compute_shape_matrix(fixed), _compute_shape_matrix(moved)

    def distance(angle: FloatArray) -> FloatArray:
        u = np.array([np.cos(direction + angle), np.sin(direction + angle)])
        widths = [np.sqrt(np.einsum("i...,ij,j...->...", u, shape, u)) for shape in shapes]
        sum_of_widths: FloatArray = (widths[0] + widths[1]) / np.cos(angle)
        return sum_of_widths

    low, high = -1.5, 1.5  # less than a right angle from `direction`
    while high - low > NORMAL_TOLERANCE:
        angles = np.linspace(low, high, DIRECTIONS)
        index = int(np.argmin(distance(angles)))
        low, high = angles[max(index - 1, 0)], angles[min(index + 1, DIRECTIONS - 1)]
    middle = np.array((low + high) / 2)
    return float(distance(middle)), direction + float(middle)


def _compute_shape_matrix(ellipse: Ellipse) -> FloatArray:
    """Return the matrix S with which sqrt(u' S u) is the support width along u."""
    axes = ellipse.from_ellipse_frame(np.diag([ellipse.semi_major, ellipse.semi_minor]))
    axes = axes - ellipse.centre
    return axes.T @ axes


def _find_foot(ellipse: Ellipse, contact: FloatArray, leg: float) -> tuple[FloatArray, FloatArray]:
    """Return point and unit tangent at arc length `leg` from the contact, towards the sensor."""
    u, v = ellipse.to_ellipse_frame(contact[None])[0]
    anomaly = math.atan2(v / ellipse.semi_minor, u / ellipse.semi_major)
    steps = np.linspace(0.0, math.pi, 2000)
    paths = [ellipse.points_at(anomaly + sign * steps) for sign in (1.0, -1.0)]
    # Of both ways round the ellipse, the one that rises at first: over 9 deg of the anomaly.
    path = max(paths, key=lambda points: float(points[100, 1]))
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    if not 0 < leg <= length[-1]:
        raise ValueError(
            f"expected a leg in (0, {length[-1]:.4g}] mm, up to half the circumference, got {leg}"
        )
    index = int(np.searchsorted(length, leg))
    tangent = path[index] - path[index - 1]
    return path[index], tangent / np.linalg.norm(tangent)


def _find_fillet_control_point(
    feet: list[tuple[FloatArray, FloatArray]], contact: FloatArray
) -> FloatArray:
    """Return the control point of a fillet: the intersection of the tangents at both feet.

    If they are nearly parallel, the mean of feet and contact.
    """
    (start, start_tangent), (stop, stop_tangent) = feet
    sides = np.column_stack([start_tangent, -stop_tangent])
    if abs(np.linalg.det(sides)) < 0.05:  # 3 deg
        return (start + stop + contact) / 3
    control: FloatArray = start + np.linalg.solve(sides, stop - start)[0] * start_tangent
    return control


def _find_bulged_control_point(
    feet: list[tuple[FloatArray, FloatArray]], contact: FloatArray, bulge: float
) -> Points:
    """Return the control point of a convex bead of given height over the line of its feet."""
    (start, _), (stop, _) = feet
    middle = (start + stop) / 2
    outward = middle - contact
    height = bulge * np.linalg.norm(stop - start)
    # The middle of a quadratic Bezier curve is half way to its control point.
    control: FloatArray = middle + 2 * height * outward / np.linalg.norm(outward)
    return control
