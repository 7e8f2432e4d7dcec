"""Small pictures of results as SVG text, for the cells of a notebook."""

import math
from collections.abc import Sequence

import numpy as np

from lsvision.geometry import Ellipse, FloatArray, Points
from lsvision.results.palette import POINTS, cylinder_colour

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


def draw_svg(points: Points, cylinders: Sequence[tuple[Points, Ellipse]], description: str) -> str:
    """Return an ``<svg>`` of points in a plane and the cylinders among them, numbered.

    Parameters
    ----------
    points : (n, 2) ndarray
        All points; NaN rows are left out. Units: mm.
    cylinders : sequence of ((k, 2) ndarray, Ellipse)
        Points and ellipse of each cylinder. Units: mm.
    description : str
        Alternative text of the picture, for screen readers.

    Returns
    -------
    str
        SVG element with +y upwards; empty text without points.

    Examples
    --------
    >>> draw_svg(np.array([[0.0, 0.0], [3.0, 1.0]]), [], "two points").startswith("<svg ")
    True
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

    elements = [svg_dots(to_pixels(points), POINTS)]
    for number, ((arc, ellipse), outline) in enumerate(zip(cylinders, outlines, strict=True), 1):
        colour = cylinder_colour(number)
        elements.append(svg_dots(to_pixels(arc), colour))
        elements.append(svg_line(to_pixels(outline), colour))
        elements.append(svg_text(str(number), to_pixels(np.array(ellipse.centre)), colour))
    return svg_element(elements, width, height, description)


def svg_element(elements: Sequence[str], width: float, height: float, description: str) -> str:
    """Return an ``<svg>`` of a size in px with the given elements, on white.

    `description` is the alternative text; it is not escaped, nor are the elements.
    """
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{description}" '
        f'style="background:white">{"".join(elements)}</svg>'
    )


def svg_line(pixels: FloatArray, colour: str, dashes: str = "none") -> str:
    """Return a line through points (px), with dashes as in ``stroke-dasharray``."""
    path = "L".join(f"{x:.1f},{y:.1f}" for x, y in pixels)
    return f'<path d="M{path}" fill="none" stroke="{colour}" stroke-dasharray="{dashes}"/>'


def svg_text(
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


def svg_dots(pixels: FloatArray, colour: str) -> str:
    """Return at most `MAX_POINTS` of the points (px) as dots: lines of length 0 with round ends."""
    valid = pixels[np.isfinite(pixels).all(axis=1)]
    sample = valid[:: max(1, math.ceil(len(valid) / MAX_POINTS))]
    path = "".join(f"M{x:.1f},{y:.1f}h0" for x, y in sample)
    return f'<path d="{path}" stroke="{colour}" stroke-width="2.5" stroke-linecap="round"/>'
