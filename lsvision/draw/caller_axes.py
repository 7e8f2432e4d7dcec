"""Drawing into axes of the caller."""

from typing import TYPE_CHECKING

from lsvision.draw.titles import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure_of(ax: "Axes") -> "Figure":
    """Return the figure of axes, also of axes in a subfigure."""
    figure: Figure = ax.figure.figure
    return figure


def set_title(ax: "Axes", title: str) -> None:
    """Set the title of axes, ``?`` for glyphs that the font lacks; an empty one is ignored."""
    if title:
        ax.set_title(printable(title), loc="left", parse_math=False, pad=24)
