"""Drawing into axes that the caller brings."""

from typing import TYPE_CHECKING

from lsvision.draw.titles import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure_of(ax: "Axes") -> "Figure":
    """Return the whole figure in which axes stand, also those of a subfigure."""
    figure: Figure = ax.figure.figure
    return figure


def set_title(ax: "Axes", title: str) -> None:
    """Put a title above axes, as far as the font has its characters; an empty one leaves theirs."""
    if title:
        ax.set_title(printable(title), loc="left", parse_math=False, pad=24)
