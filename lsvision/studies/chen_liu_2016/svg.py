"""Matplotlib figures as SVG that can stand inside a page beside others."""

import io
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH_INCH = 4.6
"""At 72 units an inch a phone shows letters of such a figure at about their own size."""
BLUE, ORANGE, GREEN, PURPLE, GREY = "#0072B2", "#D55E00", "#00805E", "#A8457E", "0.45"
"""Told apart by colour-blind readers."""

_ID = re.compile(r'(\bid="|url\(#|href="#)')
_NOTHING = {"Date": None, "Creator": None, "Format": None, "Type": None}


def new_figure(height_inch: float) -> "Figure":
    """Empty figure of the page's width, with a canvas of its own.

    Parameters
    ----------
    height_inch : float
        Units: inch.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_INCH, height_inch), layout="constrained")
    FigureCanvasSVG(figure)
    return figure


def inline_svg(figure: "Figure", name: str, description: str) -> str:
    """A figure as an ``<svg>`` element; the same figure gives the same text.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        As from `new_figure`.
    name : str
        Stands before every id, so that figures on one page do not take each other's.
    description : str
        What the picture shows, for those who cannot see it.
    """
    import matplotlib as mpl

    content = io.StringIO()
    # Letters stay text: small, sharp, found by a search; ids are else random.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "lsvision"}):
        figure.savefig(content, format="svg", metadata=_NOTHING)
    text = content.getvalue()
    text = _ID.sub(rf"\g<1>{name}-", text[text.index("<svg") :])
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    label = description.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    return text.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
