"""Pictures of an extracted laser line: in its image, and its values as curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lsvision.draw.figures import (
    create_figure,
    draw_legend,
    get_figure,
    make_printable,
    set_title,
    show_photo,
)
from lsvision.geometry import BoolArray, FloatArray, Points
from lsvision.laser_line.line import LaserLine
from lsvision.results.palette import LASER_LINE, SATURATED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 100
"""Resolution of the PNG. Units: 1 / inch."""
MAX_PHOTO_INCH = {"columns": (11.7, 9.0), "rows": (7.5, 10.5)}
"""Largest width and height of the photo, for a line with one point per column and one per row."""
MIN_WIDTH_INCH = 10.5
"""Smallest width of the figure, for the summary above the image. Units: inch."""
LEFT_INCH, RIGHT_INCH, TOP_INCH, BOTTOM_INCH = 0.95, 0.3, 1.05, 0.65
"""Margins of the figure, with labels of axes, title and legend."""
CURVE_INCH, CURVE_GAP_INCH, PHOTO_GAP_INCH = 1.45, 0.2, 0.75
"""Extent of a curve's axes perpendicular to the line, gap between curves, and gap below the
photo."""
AXIS_PERCENTILE = 99.0
"""Percentile of a curve's values that its axis contains; larger values may be cut off."""
Box = tuple[float, float, float, float]
"""Left, bottom, width and height of axes, in inches or as fractions of the figure."""


def draw_laser_line(
    image: npt.ArrayLike, line: LaserLine, *, title: str = "", ax: Axes | None = None
) -> Figure:
    """Return a figure of a laser line in its image, with curves of its std, width, brightness.

    The curves share the photo's axis along the line. For a line with one point per column they are
    below the photo, each value under its column; for one with one point per row they are at the
    right, each value in its row.

    Parameters
    ----------
    image : (height, width) or (height, width, 3) array_like
        Image of the line; channels in the order blue, green, red.
    line : LaserLine
        Laser line to draw.
    title : str
        Title above the image, such as the name of the file.
    ax : matplotlib.axes.Axes, optional
        Axes to draw image and line into, without summary and curves. By default a new figure with
        both is drawn.

    Returns
    -------
    matplotlib.figure.Figure
        Figure of `ax`, else a new one. Save it with its ``savefig`` or `render_figure`. Its first
        axes hold the photo, the others the curves.

    Examples
    --------
    >>> rows = np.arange(64)[:, None]
    >>> image = (10 + 90 * np.exp(-0.5 * ((rows - 30.2) / 1.5) ** 2) * np.ones(99)).astype("uint8")
    >>> from lsvision.laser_line.extraction import extract_laser_line
    >>> len(draw_laser_line(image, extract_laser_line(image)).axes)
    4
    """
    if ax is not None:
        _draw_on_photo(ax, image, line)
        set_title(ax, title)
        return get_figure(ax)
    size, photo_box, curve_boxes = _lay_out_figure(np.shape(image), line.direction)
    figure = create_figure(size, dpi=DPI)
    photo = figure.add_axes(_convert_to_fractions(photo_box, size))
    _draw_on_photo(photo, image, line)
    left, top = LEFT_INCH / size[0], 1 - 0.2 / size[1]
    heading = f"{make_printable(title)}\n{summarise_line(line)}".lstrip()
    figure.suptitle(heading, x=left, y=top, ha="left",
                    va="top", fontsize=11, parse_math=False)  # fmt: skip
    for curve, box in zip(_list_curves(line), curve_boxes, strict=True):
        _draw_curve(figure, photo, line, curve, _convert_to_fractions(box, size))
    if line.direction == "columns":  # shared axis: tick labels below the last curve only
        for axes in figure.axes[1:-1]:
            axes.tick_params(labelbottom=False)
        figure.axes[-1].set_xlabel("u / px")
    return figure


def summarise_line(line: LaserLine) -> str:
    """Return a line of text: points, lost points, std, width, saturation and second line.

    Std and width are medians of the points that are not lost, of which there is at least one; for
    the second line see `LaserLine.second_line_fraction`.

    Examples
    --------
    >>> rows = np.arange(64)[:, None]
    >>> image = (10 + 90 * np.exp(-0.5 * ((rows - 30.2) / 1.5) ** 2) * np.ones(99)).astype("uint8")
    >>> from lsvision.laser_line.extraction import extract_laser_line
    >>> summarise_line(extract_laser_line(image)).split(", std")[0]
    '99 columns, 0 lost'
    """
    valid = ~np.isnan(line.std)  # points that are not lost
    return (
        f"{len(line)} {line.direction}, {line.lost} lost, std {np.median(line.std[valid]):.2g} px, "
        f"width {np.median(line.width[valid]):.1f} px, {line.saturated[valid].mean():.0%} at full "
        f"scale, second line in {line.second_line_fraction:.0%}"
    )


def _draw_on_photo(photo: Axes, image: npt.ArrayLike, line: LaserLine) -> None:
    """Draw the image and the points of the line in it, with a legend."""
    show_photo(photo, image)
    limits = photo.axis()
    _draw_points(photo, line.pixels, line.saturated)
    photo.axis(limits)
    draw_legend(photo, marker_scale=4)


def _lay_out_figure(
    shape: tuple[int, ...], direction: str
) -> tuple[tuple[float, float], Box, tuple[Box, Box, Box]]:
    """Return the size of the figure, and the boxes of the photo and the three curves. Units: inch.

    `shape` is that of the image, `direction` that of the line: "columns" or "rows".
    """
    height, width = shape[:2]
    max_width, max_height = MAX_PHOTO_INCH[direction]
    scale = min(max_width / width, max_height / height)
    photo_width, photo_height = scale * width, scale * height
    curves = 3 * CURVE_INCH + 2 * CURVE_GAP_INCH
    offsets = [number * (CURVE_INCH + CURVE_GAP_INCH) for number in range(3)]
    if direction == "columns":
        bottom = BOTTOM_INCH + curves + PHOTO_GAP_INCH
        size = (LEFT_INCH + photo_width + RIGHT_INCH, bottom + photo_height + TOP_INCH)
        first, second, third = (
            (LEFT_INCH, BOTTOM_INCH + offset, photo_width, CURVE_INCH)
            for offset in reversed(offsets)
        )
    else:
        bottom, start = BOTTOM_INCH, LEFT_INCH + photo_width + CURVE_GAP_INCH
        size = (start + curves + RIGHT_INCH, bottom + photo_height + TOP_INCH)
        first, second, third = (
            (start + offset, bottom, CURVE_INCH, photo_height) for offset in offsets
        )
    size = (max(size[0], MIN_WIDTH_INCH), size[1])
    return size, (LEFT_INCH, bottom, photo_width, photo_height), (first, second, third)


def _convert_to_fractions(box: Box, size: tuple[float, float]) -> Box:
    """Return a box in inches as fractions of the figure."""
    return box[0] / size[0], box[1] / size[1], box[2] / size[0], box[3] / size[1]


def _draw_points(axes: Axes, points: Points, saturated: BoolArray) -> None:
    """Draw points (n, 2), the saturated ones in another colour."""
    axes.plot(*points.T, ".", color=LASER_LINE, ms=2, label="laser line")
    axes.plot(*points[saturated].T, ".", color=SATURATED, ms=2, label="at full scale")


def _list_curves(line: LaserLine) -> tuple[tuple[str, FloatArray], ...]:
    """Return the curves along the line: name with unit, and a value for each point."""
    return (
        ("std / px", line.std),
        ("width / px (1 sigma)", line.width),
        ("brightness / DN", line.intensity),
    )


def _draw_curve(
    figure: Figure, photo: Axes, line: LaserLine, curve: tuple[str, FloatArray], box: Box
) -> None:
    """Draw one of `_list_curves` over the line's points, with the photo's axis along the line."""
    name, values = curve
    limits = (0, 1.1 * float(np.nanpercentile(values, AXIS_PERCENTILE)))
    if line.direction == "columns":
        axes = figure.add_axes(box, sharex=photo)
        _draw_points(axes, np.column_stack([line.pixels[:, 0], values]), line.saturated)
        axes.set(ylabel=name, ylim=limits)
    else:
        axes = figure.add_axes(box, sharey=photo)
        _draw_points(axes, np.column_stack([values, line.pixels[:, 1]]), line.saturated)
        axes.set(xlabel=name, xlim=limits)
        axes.tick_params(labelleft=False)
    axes.grid(visible=True, lw=0.4, alpha=0.5)
