"""Titles and legends, alike in all pictures."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAX_TITLE_CHARACTERS = 95
LAST_SUPPORTED_CHARACTER = "\u058f"
"""Matplotlib's own font has no glyphs for most scripts beyond Armenian."""


def printable(title: str) -> str:
    """A title with ``?`` for what the font cannot show, and its end only if it is too long.

    Examples
    --------
    >>> printable("管.csv"), len(printable("folder/" * 40))
    ('?.csv', 98)
    """
    shown = "".join(c if c.isprintable() and c <= LAST_SUPPORTED_CHARACTER else "?" for c in title)
    return shown if len(shown) <= MAX_TITLE_CHARACTERS else "..." + shown[-MAX_TITLE_CHARACTERS:]


def summary_title(cylinders: int, refused: int, title: str) -> str:
    """What a picture holds, in a line behind its title; both counted.

    Examples
    --------
    >>> summary_title(2, 1, "pair.csv")
    'pair.csv: 2 cylinders, 1 arc refused'
    """
    verdict = f"{cylinders or 'no'} cylinder{'' if cylinders in {0, 1} else 's'}"
    if refused:
        verdict += f", {refused} arc{'' if refused == 1 else 's'} refused"
    shown = printable(title)
    return f"{shown}: {verdict}" if shown else verdict


def label_once(axes: "Axes", label: str) -> str | None:
    """The label, unless the legend of the axes has it."""
    return None if label in axes.get_legend_handles_labels()[1] else label


def draw_legend(axes: "Axes", *, marker_scale: float = 1.6) -> None:
    """The legend of axes in one row above them, where it hides nothing."""
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=6, frameon=False, fontsize=9,
        borderaxespad=0.2, columnspacing=1.2, handlelength=1.8, markerscale=marker_scale,
    )  # fmt: skip
