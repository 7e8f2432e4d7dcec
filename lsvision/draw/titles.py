"""Titles and legends in one style for all figures, also for axes that the caller passes."""

from typing import TYPE_CHECKING

from lsvision.results.summaries import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_TITLE_CHARACTERS = 95
"""Largest length of a title, and number of characters that are kept of a longer one after "...":
about the width of the figure."""
LAST_SUPPORTED_CHARACTER = "\u058f"
"""End of the Armenian block: the default font of matplotlib lacks most scripts after it."""


def make_printable(title: str) -> str:
    """Return a title with ``?`` for characters without a glyph; of a long one ``...`` and its end.

    Examples
    --------
    >>> make_printable("管.csv"), len(make_printable("folder/" * 40))
    ('?.csv', 98)
    """
    text = "".join(
        character if character.isprintable() and character <= LAST_SUPPORTED_CHARACTER else "?"
        for character in title
    )
    return text if len(text) <= MAX_TITLE_CHARACTERS else "..." + text[-MAX_TITLE_CHARACTERS:]


def format_summary_title(cylinders: int, rejected: int, title: str) -> str:
    """Return a title followed by the numbers of cylinders and rejected arcs.

    Examples
    --------
    >>> format_summary_title(2, 1, "pair.csv")
    'pair.csv: 2 cylinders, 1 arc rejected'
    """
    summary = f"{cylinders or 'no'} cylinder{'' if cylinders in {0, 1} else 's'}"
    if rejected:
        summary += f", {counted(rejected, 'arc')} rejected"
    text = make_printable(title)
    return f"{text}: {summary}" if text else summary


def label_once(axes: "Axes", label: str) -> str | None:
    """Return the label; None, which matplotlib omits, if an artist in the axes has it already."""
    return None if label in axes.get_legend_handles_labels()[1] else label


def draw_legend(axes: "Axes", *, marker_scale: float = 1.6, columns: int = 6) -> None:
    """Draw the legend above the axes, where it hides no data.

    Parameters
    ----------
    axes : Axes
        Axes whose labelled artists are listed.
    marker_scale : float
        Size of the markers in the legend relative to those in the axes.
    columns : int
        Largest number of entries in a row.
    """
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, frameon=False, fontsize=9,
        borderaxespad=0.2, columnspacing=1.2, handlelength=1.8, markerscale=marker_scale,
    )  # fmt: skip


def get_figure(axes: "Axes") -> "Figure":
    """Return the top-level figure of the axes, also if they are in a subfigure."""
    figure: Figure = axes.figure.figure
    return figure


def set_title(axes: "Axes", title: str) -> None:
    """Set the title of axes, as `make_printable` returns it, above their legend; "" sets none."""
    if title:
        axes.set_title(make_printable(title), loc="left", parse_math=False, pad=24)
