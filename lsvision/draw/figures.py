"""Figures in one style: new ones, their titles, legends and photos, and figures as files."""

import io
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lsvision.files.atomic_files import write_atomic
from lsvision.results.summaries import format_count

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FORMATS = ("png", "svg")
"""Formats of a picture file."""

_SALT_LOCK = threading.Lock()
"""Held while a global setting of matplotlib has another value."""
MAX_TITLE_CHARACTERS = 95
"""Largest length of a title, and number of characters that are kept of a longer one after "...":
about the width of the figure."""
WHITE_PERCENTILE = 99.9
"""Percentile of an image deeper than 8 bit from which pixels are shown white."""


def create_figure(
    size: tuple[float, float], *, dpi: float | None = None, layout: str = "none"
) -> "Figure":
    """Return an empty white figure of a size in inches, with its own canvas.

    `dpi` is the resolution of a PNG, matplotlib's default if None; `layout` is a layout engine of
    matplotlib, such as "constrained".
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=dpi, facecolor="white", layout=layout)
    FigureCanvasAgg(figure)
    return figure


def render_figure(figure: "Figure", picture_format: str) -> bytes:
    """Return a figure as a PNG or SVG file; the same figure gives the same bytes.

    Raises
    ------
    ValueError
        If the format is neither "png" nor "svg".
    """
    if picture_format not in FORMATS:
        raise ValueError(f"expected a format among {', '.join(FORMATS)}, got {picture_format!r}")
    content = io.BytesIO()
    if picture_format == "png":
        figure.savefig(content, format="png")
    else:
        _save_svg(figure, content)
    return content.getvalue()


def write_figure(path: Path, figure: "Figure") -> None:
    """Write a figure as PNG or SVG, by the suffix of the path, atomically."""
    write_atomic(path, render_figure(figure, path.suffix[1:].lower()))


def render_svg_element(figure: "Figure") -> str:
    """Return a figure as an ``<svg>`` element of an HTML page."""
    text = render_figure(figure, "svg").decode("utf-8")
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


def make_printable(title: str) -> str:
    """Return a title with ``?`` for characters without a glyph; of a long one ``...`` and its end.

    Examples
    --------
    >>> make_printable("管.csv"), len(make_printable("folder/" * 40))
    ('?.csv', 98)
    """
    from matplotlib.font_manager import FontProperties, findfont, get_font

    has_glyph = get_font(findfont(FontProperties())).get_char_index
    text = "".join(
        character if character.isprintable() and has_glyph(ord(character)) else "?"
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
        summary += f", {format_count(rejected, 'arc')} rejected"
    text = make_printable(title)
    return f"{text}: {summary}" if text else summary


def label_once(axes: "Axes", label: str) -> str | None:
    """Return the label; None, which matplotlib omits, if an artist in the axes has it already."""
    return None if label in axes.get_legend_handles_labels()[1] else label


def draw_legend(axes: "Axes", *, marker_scale: float = 1.6, columns: int = 6) -> None:
    """Draw the legend above the axes, where it hides no data.

    `marker_scale` is the size of its markers relative to those in the axes, `columns` the largest
    number of entries in a row.
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


def show_photo(axes: "Axes", image: npt.ArrayLike) -> None:
    """Show an image in axes in pixels, (0, 0) at the centre of the top left pixel, v downwards.

    The image is (height, width) or (height, width, 3): blue, green, red. 8 bit is shown as it is;
    deeper images are scaled, because cameras of 10 and 12 bit use the lower bits; NaN is black.
    """
    array = np.asarray(image)
    if array.dtype != np.uint8:
        array = np.nan_to_num(array.astype(np.float64), posinf=0.0, neginf=0.0)
        white = float(np.percentile(array, WHITE_PERCENTILE))
        white = white if white > 0 else 1.0  # a black image
        array = (np.clip(array / white, 0, 1) * 255).astype(np.uint8)
    rgb = array if array.ndim == 2 else array[..., ::-1]
    axes.imshow(rgb, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    axes.set_xlabel("u / px")
    axes.set_ylabel("v / px")
