"""Titles and legends, the same in all pictures, also in axes of the caller."""

from typing import TYPE_CHECKING

from lsvision.results.summaries import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_TITLE_CHARACTERS = 95
LAST_SUPPORTED_CHARACTER = "\u058f"
"""Matplotlib's own font has no glyphs for most scripts beyond Armenian."""


def printable_title(title: str) -> str:
    """Return a title with ``?`` for glyphs that the font lacks, and only its end if it is long.

    Examples
    --------
    >>> printable_title("管.csv"), len(printable_title("folder/" * 40))
    ('?.csv', 98)
    """
    text = "".join(c if c.isprintable() and c <= LAST_SUPPORTED_CHARACTER else "?" for c in title)
    return text if len(text) <= MAX_TITLE_CHARACTERS else "..." + text[-MAX_TITLE_CHARACTERS:]


def summary_title(cylinders: int, rejected: int, title: str) -> str:
    """Return a title followed by the numbers of cylinders and rejected arcs.

    Examples
    --------
    >>> summary_title(2, 1, "pair.csv")
    'pair.csv: 2 cylinders, 1 arc rejected'
    """
    summary = f"{cylinders or 'no'} cylinder{'' if cylinders in {0, 1} else 's'}"
    if rejected:
        summary += f", {counted(rejected, 'arc')} rejected"
    text = printable_title(title)
    return f"{text}: {summary}" if text else summary


def label_once(axes: "Axes", label: str) -> str | None:
    """Return the label, or an ignored one if it is in the legend of the axes already."""
    return None if label in axes.get_legend_handles_labels()[1] else label


def draw_legend(axes: "Axes", *, marker_scale: float = 1.6, columns: int = 6) -> None:
    """Put the legend of axes above them, where it hides nothing; in one row if it has few names."""
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, frameon=False, fontsize=9,
        borderaxespad=0.2, columnspacing=1.2, handlelength=1.8, markerscale=marker_scale,
    )  # fmt: skip


def figure_of(ax: "Axes") -> "Figure":
    """Return the figure of axes, also of axes in a subfigure."""
    figure: Figure = ax.figure.figure
    return figure


def set_title(ax: "Axes", title: str) -> None:
    """Set the title of axes, ``?`` for glyphs that the font lacks; an empty one is ignored."""
    if title:
        ax.set_title(printable_title(title), loc="left", parse_math=False, pad=24)
