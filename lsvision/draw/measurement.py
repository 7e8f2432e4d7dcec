"""A profile with what was found in it and what was refused (the paper's Figure 15)."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lsvision.draw.panel import colour_of, draw_panel
from lsvision.draw.rejected import RejectedArc, rejected_arcs
from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import FloatArray, Points
from lsvision.measure import Measurement
from lsvision.profile import Profile

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE_INCH, DPI = (13.0, 7.0), 110
TITLE_COLUMNS = 95
MARGIN = 0.05
"""Share of the drawing left free around what it shows."""
LABEL_GAP_PX = 22.0
"""Least distance between the letters of refused arcs."""
RASTERISE_POINTS = 20_000
"""From here on an SVG holds the points as an image."""
LAST_SUPPORTED_CHARACTER = "\u058f"
"""Matplotlib's own font has no glyphs for most scripts beyond Armenian."""


def draw_measurement(profile: Profile, measurement: Measurement, *, title: str = "") -> "Figure":
    """Draw a profile with its cylinders and refused arcs, and a panel that explains both.

    Parameters
    ----------
    profile : Profile
        What was measured.
    measurement : Measurement
        What was found in it.
    title : str
        Above the drawing, as the name of the file.

    Returns
    -------
    matplotlib.figure.Figure
        With a canvas of its own. Save it with its ``savefig`` or `figure_bytes`.

    Examples
    --------
    >>> profile = Profile([[0.0, -400.0], [1.0, -400.1]])
    >>> draw_measurement(profile, Measurement((), ()), title="two points").get_suptitle()
    'two points: no cylinder'
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=SIZE_INCH, dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.065, 0.085, 0.605, 0.785))
    draw_on_axes(axes, profile, measurement)
    refused = rejected_arcs(profile.points, measurement)
    shown = summary_title(len(measurement.cylinders), len(refused), title)
    figure.suptitle(shown, x=0.065, y=0.96, ha="left", fontsize=13,
                    parse_math=False)  # fmt: skip
    draw_panel(figure, measurement.cylinders, refused)
    return figure


def draw_on_axes(axes: "Axes", profile: Profile, measurement: Measurement) -> None:
    """Draw into axes of the caller's: points, arcs, ellipses, major axes, refused arcs.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Gets the same scale on both axes. Units: mm.
    profile : Profile
        What was measured.
    measurement : Measurement
        What was found in it.
    """
    points = profile.points
    refused = rejected_arcs(points, measurement)
    axes.plot(*points.T, ".", color="0.55", ms=2.5, label="measured points",
              rasterized=len(points) > RASTERISE_POINTS)  # fmt: skip
    for arc in refused:
        axes.plot(*points[arc.indices].T, "x", color=arc.colour, ms=4, mew=0.9, zorder=3,
                  label=_once(axes, "refused arc"))  # fmt: skip
    for number, cylinder in enumerate(measurement.cylinders, 1):
        _draw_cylinder(axes, points, cylinder, number)
    axes.margins(MARGIN)
    axes.set_aspect("equal", adjustable="datalim")
    _label_rejected(axes, points, refused)
    axes.set_xlabel("X / mm (along the laser line)")
    axes.set_ylabel("Y / mm (up: towards the sensor)")
    axes.grid(visible=True, lw=0.4, alpha=0.5)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=6, frameon=False, fontsize=9,
                borderaxespad=0.2, columnspacing=1.2, handlelength=1.8)  # fmt: skip


def _draw_cylinder(axes: "Axes", points: Points, cylinder: CylinderSection, number: int) -> None:
    colour, ellipse = colour_of(number), cylinder.ellipse
    axes.plot(*points[cylinder.indices].T, "o", color=colour, ms=3.2, zorder=4,
              label=_once(axes, "points of a cylinder"))  # fmt: skip
    outline = ellipse.points_at(np.linspace(0, 2 * math.pi, 361))
    axes.plot(*outline.T, "-", color=colour, lw=1.1, zorder=2,
              label=_once(axes, "fitted ellipse"))  # fmt: skip
    if cylinder.theta_determined:  # else the eye would take its direction for a result
        tips = ellipse.points_at(np.array([0.0, math.pi]))
        axes.plot(*tips.T, "--", color=colour, lw=1.3, zorder=2,
                  label=_once(axes, "major axis (direction θ)"))  # fmt: skip
    badge = {"boxstyle": "circle,pad=0.25", "fc": colour, "ec": "white"}
    axes.text(*ellipse.centre, str(number), color="white", fontsize=10, weight="bold", ha="center",
              va="center", zorder=6, clip_on=True, bbox=badge)  # fmt: skip


def _label_rejected(axes: "Axes", points: Points, refused: Sequence[RejectedArc]) -> None:
    """Letters above the arcs, each moved up until it is clear of those before it."""
    axes.autoscale_view()
    axes.apply_aspect()
    to_pixels = axes.transData
    up, placed = np.array([0.0, LABEL_GAP_PX]), list[FloatArray]()
    for arc in refused:
        anchor = points[arc.indices[len(arc.indices) // 2]]
        spot = to_pixels.transform(anchor) + up
        while any(math.hypot(*(spot - other)) < LABEL_GAP_PX for other in placed):
            spot = spot + up / 2
        placed.append(spot)
        place = to_pixels.inverted().transform(spot)
        leader = {"arrowstyle": "-", "color": arc.colour, "lw": 0.8}
        axes.annotate("", anchor, xytext=place, arrowprops=leader, zorder=4)
        box = {"boxstyle": "round,pad=0.2", "fc": arc.colour, "ec": "none"}
        axes.text(*place, arc.letter, color="white", fontsize=9, weight="bold", ha="center",
                  va="center", zorder=5, bbox=box)  # fmt: skip


def _once(axes: "Axes", label: str) -> str | None:
    """The label, unless the legend has it."""
    return None if label in axes.get_legend_handles_labels()[1] else label


def summary_title(cylinders: int, refused: int, title: str) -> str:
    """What a picture holds, in a line behind its title; both counted."""
    verdict = f"{cylinders or 'no'} cylinder{'' if cylinders in {0, 1} else 's'}"
    if refused:
        verdict += f", {refused} arc{'' if refused == 1 else 's'} refused"
    shown = "".join(c if c.isprintable() and c <= LAST_SUPPORTED_CHARACTER else "?" for c in title)
    if len(shown) > TITLE_COLUMNS:
        shown = "..." + shown[-TITLE_COLUMNS:]
    return f"{shown}: {verdict}" if shown else verdict
