"""Photos of a calibration as SVG: corners found, laser line, residuals as scaled arrows."""

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.geometry import FloatArray, Points
from lsvision.laser_line.image_array import convert_to_grey
from lsvision.laser_line.line_image import Bayer, interpolate_grey
from lsvision.results.palette import CORNER, CORNER_RESIDUAL, LASER_PLANE

MAX_PHOTO_WIDTH_PX = 640
"""Largest width at which a photo is stored in a page, and largest size in px at which it is shown.
Units: px."""
JPEG_QUALITY = 70
"""Quality of stored photos, 0 to 100."""
ARROW_FRACTION = 0.03
"""Largest length of the median arrow relative to the image's width; the magnification is rounded
down to 1, 2 or 5 times a power of ten."""
LINE_ARROWS = 30
"""Largest number of arrows along a laser line; more would hide it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ViewPhoto:
    """Photo with the points detected in it and their residuals.

    The name of the file begins the caption. The image, of 8 or 16 bit, is grey or blue, green, red.
    Found corners of the board, (n, 2), and points of the laser line, (m, 2), have residuals
    (predicted minus found). Units: px.
    """

    name: str
    image: npt.NDArray[Any]
    corners: Points
    corner_residuals: FloatArray
    line: Points
    line_residuals: FloatArray


def compute_arrow_factor(residuals: Sequence[FloatArray], width: int) -> float:
    """Return the magnification of the arrows that show residuals; 1 if the median is 0.

    `residuals` are those of each photo, (n, 2), `width` is that of the widest photo. Units: px.
    """
    lengths = np.concatenate([np.hypot(*residual.T) for residual in residuals] or [np.zeros(0)])
    median = float(np.median(lengths)) if len(lengths) else 0.0
    if median <= 0:
        return 1.0
    max_factor = ARROW_FRACTION * width / median
    power = 10.0 ** math.floor(math.log10(max_factor))
    # The logarithm of a number just below a power of ten may be rounded up to that power.
    return max((step * power for step in (1, 2, 5) if step * power <= max_factor), default=power)


def combine_photos(
    board: npt.NDArray[Any], line: npt.NDArray[Any], pattern: Bayer | None = None
) -> npt.NDArray[Any]:
    """Return board and laser line in one photo: the brighter value of two photos of one view.

    Two images that differ in depth or number of channels become grey of 8 bit; raw images of a
    mosaic `pattern` become grey.
    """
    board, line = interpolate_grey(board, pattern), interpolate_grey(line, pattern)
    if board.dtype != line.dtype or board.shape != line.shape:
        board, line = convert_to_grey(board), convert_to_grey(line)
    brighter: npt.NDArray[Any] = np.maximum(board, line)
    return brighter


def render_photo_svg(photo: ViewPhoto, factors: tuple[float, float]) -> str:
    """Return an ``<svg>`` element: the photo, its points, and residuals as arrows.

    Its coordinates are pixels: (0, 0) is the centre of a pixel. `factors` are the magnifications of
    the corners' arrows and of the laser line's, from `compute_arrow_factor`.
    """
    height, width = photo.image.shape[:2]
    stroke = width / MAX_PHOTO_WIDTH_PX  # one px of the page at the largest size
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="-0.5 -0.5 {width} {height}" '
        f'width="{min(width, MAX_PHOTO_WIDTH_PX)}"><image x="-0.5" y="-0.5" width="{width}" '
        f'height="{height}" href="data:image/jpeg;base64,{_encode_jpeg(photo.image)}"/>'
    )
    line_step = math.ceil(len(photo.line) / LINE_ARROWS) or 1
    corner_factor, line_factor = factors
    corner_arrows = photo.corner_residuals * corner_factor
    line_arrows = photo.line_residuals * line_factor
    return "".join(
        [
            head,
            _render_arrows(
                photo.line[::line_step], line_arrows[::line_step], LASER_PLANE, 0.8 * stroke
            ),
            _render_dots(photo.line, 1.6 * stroke, LASER_PLANE),
            _render_circles(photo.corners, 4 * stroke, CORNER, 1.5 * stroke),
            _render_arrows(photo.corners, corner_arrows, CORNER_RESIDUAL, 1.5 * stroke),
            "</svg>",
        ]
    )


def _encode_jpeg(image: npt.NDArray[Any]) -> str:
    """Return an image as JPEG in base64, not too wide for a page; grey if deeper than 8 bit."""
    stored = image if image.dtype == np.uint8 else convert_to_grey(image)
    scale = MAX_PHOTO_WIDTH_PX / stored.shape[1]
    if scale < 1:
        size = (MAX_PHOTO_WIDTH_PX, max(1, round(stored.shape[0] * scale)))
        stored = cv2.resize(stored, size, interpolation=cv2.INTER_AREA)
    _, content = cv2.imencode(".jpg", stored, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return base64.b64encode(content.tobytes()).decode("ascii")


def _render_circles(points: Points, radius: float, colour: str, stroke: float) -> str:
    """Return an SVG group of circles around points (n, 2). Units: px."""
    circles = "".join(f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{radius:.1f}"/>' for u, v in points)
    style = f'fill="none" stroke="{colour}" stroke-width="{stroke:.2f}"'
    return f'<g class="corners" {style}>{circles}</g>'


def _render_dots(points: Points, radius: float, colour: str) -> str:
    """Return an SVG group of filled discs at points (n, 2). Units: px."""
    dots = "".join(f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{radius:.1f}"/>' for u, v in points)
    return f'<g class="line" fill="{colour}">{dots}</g>'


def _render_arrows(points: Points, vectors: FloatArray, colour: str, stroke: float) -> str:
    """Return arrows from points along vectors, both (n, 2) in px, as one SVG path."""
    paths = []
    for (u, v), (du, dv) in zip(points.tolist(), vectors.tolist(), strict=True):
        # The head: two strokes of a quarter of the length, at 30 deg to the shaft.
        du1, dv1 = np.array([[-0.22, -0.125], [0.125, -0.22]]) @ (du, dv)
        du2, dv2 = np.array([[-0.22, 0.125], [-0.125, -0.22]]) @ (du, dv)
        paths.append(
            f"M{u:.1f} {v:.1f}l{du:.1f} {dv:.1f}l{du1:.1f} {dv1:.1f}m{-du1:.1f} {-dv1:.1f}"
            f"l{du2:.1f} {dv2:.1f}"
        )
    return (
        f'<path class="residuals" fill="none" stroke="{colour}" '
        f'stroke-width="{stroke:.2f}" d="{"".join(paths)}"/>'
    )
