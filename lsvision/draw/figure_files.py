"""New figures, and figures as PNG, SVG or an element of a page."""

import io
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = ("png", "svg")
"""Formats of a picture file."""

_SALT_LOCK = threading.Lock()
"""Held while a global setting of matplotlib has another value."""


def new_figure(
    size: tuple[float, float], *, dpi: float | None = None, layout: str = "none"
) -> "Figure":
    """Return an empty white figure of a size in inches, with its own canvas.

    Parameters
    ----------
    size : tuple of float
        Width and height. Units: inch.
    dpi : float, optional
        Resolution of a PNG; matplotlib's default if None. Units: 1 / inch.
    layout : str
        Layout engine of matplotlib, such as "constrained".
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=dpi, facecolor="white", layout=layout)
    FigureCanvasAgg(figure)
    return figure


def figure_bytes(figure: "Figure", picture_format: str) -> bytes:
    """Return a figure as a PNG or SVG file; the same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Figure, as from `draw_measurement`.
    picture_format : {"png", "svg"}
        Format of the file.

    Returns
    -------
    bytes
        The whole file.

    Raises
    ------
    ValueError
        For another format.
    """
    if picture_format not in FORMATS:
        raise ValueError(f"expected a format among {', '.join(FORMATS)}, got {picture_format!r}")
    content = io.BytesIO()
    if picture_format == "png":
        figure.savefig(content, format="png")
    else:
        _save_svg(figure, content)
    return content.getvalue()


def svg_element(figure: "Figure") -> str:
    """Return a figure as an ``<svg>`` element of an HTML page."""
    text = figure_bytes(figure, "svg").decode("utf-8")
    return text[text.index("<svg") :]


def _save_svg(figure: "Figure", content: io.BytesIO) -> None:
    """Write a figure as SVG; the same figure gives the same bytes."""
    import matplotlib as mpl

    # The ids inside an SVG are random unless this global setting has a value.
    with _SALT_LOCK:
        salt = mpl.rcParams["svg.hashsalt"]
        mpl.rcParams["svg.hashsalt"] = "lsvision"
        try:
            figure.savefig(content, format="svg", metadata={"Date": None})
        finally:
            mpl.rcParams["svg.hashsalt"] = salt
