"""Small pictures of cylinders in space as SVG text, for the cells of a notebook."""

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from lsvision.geometry import FloatArray, Points
from lsvision.results.number_format import with_minus_signs
from lsvision.results.palette import EDGES, cylinder_colour
from lsvision.results.picture import (
    MAX_HEIGHT_PX,
    WIDTH_PX,
    svg_dots,
    svg_element,
    svg_line,
    svg_text,
)

AZIMUTH_DEG, ELEVATION_DEG = -55.0, 25.0
"""Direction from the drawing to the viewer: from X towards Y, and above the XY plane. In the
picture X runs to the right and a little downwards, Y to the right and upwards, Z upwards."""
BORDER_PX = 46.0
"""Space around the drawing for numbers and names of the axes. Units: px."""
LABEL_PX = 11
"""Size of the letters of the axes. Units: px."""
AXIS_DASHES = "8 3 2 3"
"""Dashes and gaps of a cylinder's axis. Units: px."""
NUMBER_RISE_PX = 4.0
"""Distance from the end of an axis up to the number of its cylinder. Units: px."""
CAPTION_PX = (6.0, 14.0)
"""Position of the text that states the view. Units: px."""
EDGE_ENDS = {"X": ((0, 0, 0), (1, 0, 0)), "Y": ((1, 0, 0), (1, 1, 0)), "Z": ((0, 0, 0), (0, 0, 1))}
"""Edges of the box along which the axes are drawn: the lower two in front, and the vertical one on
the left; 0 is the lower end of a coordinate, 1 the upper end."""
LABEL_POSITIONS: dict[str, tuple[float, float, str]] = {
    "X": (-4.0, 18.0, "end"),
    "Y": (7.0, 14.0, "start"),
    "Z": (-8.0, 4.0, "end"),
}
"""Offset (px) from an end of an axis to its number, away from the box, and anchor of the text:
numbers of two axes at one corner do not overlap."""

MIN_LENGTH_MM = 0.01
"""Length of an axis below which its numbers get no more decimals."""

DrawnCylinder = tuple[Points, Sequence[Points], Points]
"""Measured points, circles at the ends of the cylinder, and the two ends of its axis, in mm."""


def draw_space_svg(cylinders: Sequence[DrawnCylinder], description: str) -> str:
    """Return an ``<svg>`` of cylinders and their points, from above and Z upwards.

    The view is a parallel projection along a constant direction, `AZIMUTH_DEG` and
    `ELEVATION_DEG`, with one scale for all directions.

    Parameters
    ----------
    cylinders : sequence of DrawnCylinder
        Cylinders, at least one; numbered from 1. Units: mm.
    description : str
        Alternative text of the picture, for screen readers; the view is added.

    Returns
    -------
    str
        SVG element with a box around all points; three of its edges are the axes, in mm.

    Examples
    --------
    >>> ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 9.0]])
    >>> draw_space_svg([(ends + 2.0, [ends + 1.0], ends)], "a rod").count("<text")
    11
    """
    all_points = np.concatenate(
        [array for points, rings, axis in cylinders for array in (points, *rings, axis)]
    )
    box = np.stack([all_points.min(axis=0), all_points.max(axis=0)])
    corners = np.array(list(itertools.product(*box.T))) @ _projection().T
    low, high = corners.min(axis=0), corners.max(axis=0)
    drawing_size = np.array([WIDTH_PX, MAX_HEIGHT_PX]) - 2 * BORDER_PX
    scale = float((drawing_size / (high - low)).min())
    width, height = (high - low) * scale + 2 * BORDER_PX

    def to_pixels(points: Points) -> FloatArray:
        pixels: FloatArray = (points @ _projection().T - low) * scale + BORDER_PX
        return pixels

    elements = [svg_text("base frame, Z up", np.array(CAPTION_PX), EDGES, LABEL_PX, "start")]
    elements += _axes(box, to_pixels)
    for number, cylinder in enumerate(cylinders, 1):
        elements += _cylinder(cylinder, number, to_pixels)
    return svg_element(elements, width, height, f"{description}, Z up; X, Y, Z in mm")


def _projection() -> FloatArray:
    """Return the (2, 3) matrix that projects a point to the picture: to the right, downwards."""
    azimuth, elevation = math.radians(AZIMUTH_DEG), math.radians(ELEVATION_DEG)
    cos, sin = math.cos(azimuth), math.sin(azimuth)
    right = (-sin, cos, 0.0)
    down = (cos * math.sin(elevation), sin * math.sin(elevation), -math.cos(elevation))
    return np.array([right, down])


def _axes(box: FloatArray, to_pixels: Callable[[Points], FloatArray]) -> list[str]:
    """Return the axes along edges of the box, each with the numbers of its ends."""
    elements = []
    for axis, (name, ends) in enumerate(EDGE_ENDS.items()):
        edge = to_pixels(np.array([[box[k, j] for j, k in enumerate(end)] for end in ends]))
        numbers = _end_numbers(*box[:, axis])
        *offset, anchor = LABEL_POSITIONS[name]
        positions = edge + np.array(offset)
        elements.append(svg_line(edge, EDGES))
        for text, position in zip(
            (*numbers, f"{name} mm"), (*positions, positions.mean(axis=0)), strict=True
        ):
            elements.append(svg_text(text, position, EDGES, LABEL_PX, anchor))
    return elements


def _end_numbers(low: float, high: float) -> list[str]:
    """Return both ends of an axis with at least two digits of their distance."""
    decimals = max(0, 1 - math.floor(math.log10(max(high - low, MIN_LENGTH_MM))))
    return [with_minus_signs(f"{value:z.{decimals}f}") for value in (low, high)]  # z: no -0.0


def _cylinder(
    cylinder: DrawnCylinder, number: int, to_pixels: Callable[[Points], FloatArray]
) -> list[str]:
    """Return points, circles, axis and number of a cylinder."""
    points, rings, axis = cylinder
    colour = cylinder_colour(number)
    return [
        svg_dots(to_pixels(points), colour),
        *(svg_line(to_pixels(ring), colour) for ring in rings),
        svg_line(to_pixels(axis), colour, AXIS_DASHES),
        svg_text(str(number), to_pixels(axis)[1] - (0.0, NUMBER_RISE_PX), colour),
    ]
