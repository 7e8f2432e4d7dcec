"""Small pictures of results as SVG text, for the cells of a notebook: in a plane or in space."""

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from lsvision.geometry import Ellipse, FloatArray, Points
from lsvision.results.number_format import with_minus_signs
from lsvision.results.palette import EDGES, POINTS, choose_cylinder_colour

WIDTH_PX, MAX_HEIGHT_PX = 420, 320
"""Largest width and height of a picture. Units: px."""
MAX_POINTS = 1500
"""Largest number of points drawn of one set, to limit the size of the page."""
MARGIN_FRACTION = 0.04
"""Margin on each side as a fraction of the picture's size."""
MIN_ASPECT, MIN_SIZE_MM = 1e-3, 1e-9
"""Smallest ratio of the shorter to the longer side of the drawing, and smallest size: points on an
axis-parallel line, or in one place, have a side of length 0."""
MIN_SIDE_PX = 20
"""Smallest width and height of a picture, in which dots are visible. Units: px."""
OUTLINE_POINTS = 73
"""Points of a drawn ellipse, one for every 5 deg."""
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


def draw_svg(points: Points, cylinders: Sequence[tuple[Points, Ellipse]], description: str) -> str:
    """Return an ``<svg>`` of points in a plane and the cylinders among them, numbered.

    +y is upwards. NaN rows of the points, (n, 2), are left out; each cylinder is its points and its
    ellipse, in mm. The description is for screen readers. Without points the text is empty.

    Examples
    --------
    >>> draw_svg(np.array([[0.0, 0.0], [3.0, 1.0]]), [], "two points").startswith("<svg ")
    True
    >>> draw_svg(np.empty((0, 2)), [], "no points")
    ''
    """
    angles = np.linspace(0, 2 * np.pi, OUTLINE_POINTS)
    outlines = [ellipse.points_at(angles) for _, ellipse in cylinders]
    drawn = np.concatenate([points, *(arc for arc, _ in cylinders), *outlines])
    drawn = drawn[np.isfinite(drawn).all(axis=1)]
    if not len(drawn):
        return ""
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    size = np.maximum(high - low, MIN_SIZE_MM + MIN_ASPECT * float((high - low).max()))
    scale = min(WIDTH_PX / size[0], MAX_HEIGHT_PX / size[1]) * (1 - 2 * MARGIN_FRACTION)
    width, height = (size * scale / (1 - 2 * MARGIN_FRACTION)).round().clip(MIN_SIDE_PX)
    middle = (low + high) / 2

    def to_pixels(coordinates: FloatArray) -> FloatArray:
        pixels: FloatArray = (coordinates - middle) * (scale, -scale) + (width / 2, height / 2)
        return pixels

    elements = [_format_svg_dots(to_pixels(points), POINTS)]
    for number, ((arc, ellipse), outline) in enumerate(zip(cylinders, outlines, strict=True), 1):
        colour = choose_cylinder_colour(number)
        elements.append(_format_svg_dots(to_pixels(arc), colour))
        elements.append(_format_svg_line(to_pixels(outline), colour))
        elements.append(_format_svg_text(str(number), to_pixels(np.array(ellipse.centre)), colour))
    return _format_svg_element(elements, width, height, description)


def _format_svg_element(
    elements: Sequence[str], width: float, height: float, description: str
) -> str:
    """Return an ``<svg>`` of a size in px with the given elements, on white.

    `description` is the alternative text; it is not escaped, nor are the elements.
    """
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{description}" '
        f'style="background:white">{"".join(elements)}</svg>'
    )


def _format_svg_line(pixels: FloatArray, colour: str, dashes: str = "none") -> str:
    """Return a line through points (px), with dashes as in ``stroke-dasharray``."""
    path = "L".join(f"{x:.1f},{y:.1f}" for x, y in pixels)
    return f'<path d="M{path}" fill="none" stroke="{colour}" stroke-dasharray="{dashes}"/>'


def _format_svg_text(
    text: str, pixel: FloatArray, colour: str, size_px: int = 14, anchor: str = "middle"
) -> str:
    """Return a text with a white border.

    `pixel` (2,) is where it starts, where its middle is, or where it ends, as `anchor` states:
    "start", "middle" or "end".
    """
    x, y = pixel
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" font-size="{size_px}" '
        f'text-anchor="{anchor}" font-family="sans-serif" stroke="white" stroke-width="3" '
        f'paint-order="stroke">{text}</text>'
    )


def _format_svg_dots(pixels: FloatArray, colour: str) -> str:
    """Return at most `MAX_POINTS` of the points (px) as dots: lines of length 0 with round ends."""
    valid = pixels[np.isfinite(pixels).all(axis=1)]
    sample = valid[:: max(1, math.ceil(len(valid) / MAX_POINTS))]
    path = "".join(f"M{x:.1f},{y:.1f}h0" for x, y in sample)
    return f'<path d="{path}" stroke="{colour}" stroke-width="2.5" stroke-linecap="round"/>'


def draw_space_svg(cylinders: Sequence[DrawnCylinder], description: str) -> str:
    """Return an ``<svg>`` of cylinders, at least one, and their points, from above and Z upwards.

    The view is a parallel projection along a constant direction, `AZIMUTH_DEG` and `ELEVATION_DEG`,
    with one scale for all directions. Three edges of a box around all points are the axes, in mm.
    The description is for screen readers; the view is added.

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
    corners = np.array(list(itertools.product(*box.T))) @ _compute_projection().T
    low, high = corners.min(axis=0), corners.max(axis=0)
    drawing_size = np.array([WIDTH_PX, MAX_HEIGHT_PX]) - 2 * BORDER_PX
    scale = float((drawing_size / (high - low)).min())
    width, height = (high - low) * scale + 2 * BORDER_PX

    def to_pixels(points: Points) -> FloatArray:
        pixels: FloatArray = (points @ _compute_projection().T - low) * scale + BORDER_PX
        return pixels

    elements = [
        _format_svg_text("base frame, Z up", np.array(CAPTION_PX), EDGES, LABEL_PX, "start")
    ]
    elements += _draw_axes(box, to_pixels)
    for number, cylinder in enumerate(cylinders, 1):
        elements += _draw_cylinder(cylinder, number, to_pixels)
    return _format_svg_element(elements, width, height, f"{description}, Z up; X, Y, Z in mm")


def _compute_projection() -> FloatArray:
    """Return the (2, 3) matrix that projects a point to the picture: to the right, downwards."""
    azimuth, elevation = math.radians(AZIMUTH_DEG), math.radians(ELEVATION_DEG)
    cos, sin = math.cos(azimuth), math.sin(azimuth)
    right = (-sin, cos, 0.0)
    down = (cos * math.sin(elevation), sin * math.sin(elevation), -math.cos(elevation))
    return np.array([right, down])


def _draw_axes(box: FloatArray, to_pixels: Callable[[Points], FloatArray]) -> list[str]:
    """Return the axes along edges of the box, each with the numbers of its ends."""
    elements = []
    for axis, (name, ends) in enumerate(EDGE_ENDS.items()):
        edge = to_pixels(np.array([[box[k, j] for j, k in enumerate(end)] for end in ends]))
        numbers = _format_end_numbers(*box[:, axis])
        *offset, anchor = LABEL_POSITIONS[name]
        positions = edge + np.array(offset)
        elements.append(_format_svg_line(edge, EDGES))
        for text, position in zip(
            (*numbers, f"{name} mm"), (*positions, positions.mean(axis=0)), strict=True
        ):
            elements.append(_format_svg_text(text, position, EDGES, LABEL_PX, anchor))
    return elements


def _format_end_numbers(low: float, high: float) -> list[str]:
    """Return both ends of an axis with at least two digits of their distance."""
    decimals = max(0, 1 - math.floor(math.log10(max(high - low, MIN_LENGTH_MM))))
    return [with_minus_signs(f"{value:z.{decimals}f}") for value in (low, high)]  # z: no -0.0


def _draw_cylinder(
    cylinder: DrawnCylinder, number: int, to_pixels: Callable[[Points], FloatArray]
) -> list[str]:
    """Return points, circles, axis and number of a cylinder."""
    points, rings, axis = cylinder
    colour = choose_cylinder_colour(number)
    return [
        _format_svg_dots(to_pixels(points), colour),
        *(_format_svg_line(to_pixels(ring), colour) for ring in rings),
        _format_svg_line(to_pixels(axis), colour, AXIS_DASHES),
        _format_svg_text(str(number), to_pixels(axis)[1] - (0.0, NUMBER_RISE_PX), colour),
    ]
