"""A laser line as it was extracted: on the image, and column by column."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lsvision.draw.photo import show_photo
from lsvision.laser_line.extraction import LaserLine

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE_INCH, DPI = (13.0, 14.0), 100
AXIS_PERCENTILE = 99.0
"""Percentile of a curve that still fits its axes."""
COLOUR, SATURATED = "#00B7EB", "#D55E00"


def draw_laser_line(image: npt.ArrayLike, line: LaserLine, *, title: str = "") -> "Figure":
    """Draw a laser line into its image, with its std, width and brightness below.

    Parameters
    ----------
    image : (height, width) or (height, width, 3) array_like
        From which it was extracted; blue first.
    line : LaserLine
        The line.
    title : str
        Above the image, as the name of the file.

    Returns
    -------
    matplotlib.figure.Figure
        Save it with its ``savefig`` or `figure_bytes`. Its first axes hold the photo.

    Examples
    --------
    >>> rows = np.arange(64)[:, None]
    >>> image = (10 + 90 * np.exp(-0.5 * ((rows - 30.2) / 1.5) ** 2) * np.ones(99)).astype("uint8")
    >>> from lsvision.laser_line.extraction import extract_laser_line
    >>> len(draw_laser_line(image, extract_laser_line(image)).axes)
    4
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=SIZE_INCH, dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    photo = figure.add_axes((0.075, 0.4, 0.905, 0.55))
    show_photo(photo, image)
    limits = photo.axis()
    photo.plot(*line.pixels.T, ".", color=COLOUR, ms=1.5, label="line")
    photo.plot(*line.pixels[line.saturated].T, ".", color=SATURATED, ms=1.5, label="at full scale")
    photo.axis(limits)
    photo.legend(loc="upper right", markerscale=6, fontsize=9)
    name = f"{title}: " if title else ""
    figure.suptitle(f"{name}{line_summary(line)}", x=0.075, y=0.98, ha="left", fontsize=12,
                    parse_math=False)  # fmt: skip
    _draw_curves(figure, line)
    return figure


def line_summary(line: LaserLine) -> str:
    """One line for people: points, lost, std, width, saturation.

    Examples
    --------
    >>> rows = np.arange(64)[:, None]
    >>> image = (10 + 90 * np.exp(-0.5 * ((rows - 30.2) / 1.5) ** 2) * np.ones(99)).astype("uint8")
    >>> from lsvision.laser_line.extraction import extract_laser_line
    >>> line_summary(extract_laser_line(image)).split(", std")[0]
    '99 columns, 0 lost'
    """
    found = ~np.isnan(line.std)
    return (
        f"{len(line)} {line.direction}, {line.lost} lost, std {np.median(line.std[found]):.2g} px, "
        f"width {np.median(line.width[found]):.1f} px, {line.saturated[found].mean():.0%} at full "
        f"scale, second line in {line.second_line_fraction:.0%}"
    )


def _draw_curves(figure: "Figure", line: LaserLine) -> None:
    along = line.pixels[:, 0 if line.direction == "columns" else 1]
    rows = (("std / px", line.std), ("width / px (one sigma)", line.width),
            ("brightness / DN", line.intensity))  # fmt: skip
    for place, (name, values) in enumerate(rows):
        axes = figure.add_axes((0.075, 0.045 + 0.11 * (2 - place), 0.905, 0.095))
        axes.plot(along, values, ".", color="0.35", ms=2)
        axes.plot(along[line.saturated], values[line.saturated], ".", color=SATURATED, ms=2)
        axes.set_ylabel(name, fontsize=8)
        axes.grid(visible=True, lw=0.4, alpha=0.5)
        axes.set_xlim(0, len(line) - 1)
        axes.set_ylim(0, 1.1 * float(np.nanpercentile(values, AXIS_PERCENTILE)))
        if place < 2:
            axes.tick_params(labelbottom=False)
        else:
            axes.set_xlabel("u / px" if line.direction == "columns" else "v / px")
