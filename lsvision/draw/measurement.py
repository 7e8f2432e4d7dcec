"""Picture of a profile with its cylinders and rejected arcs (the paper's Figure 15)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lsvision.draw.figures import (
    create_figure,
    draw_legend,
    format_summary_title,
    get_figure,
    label_once,
    set_title,
)
from lsvision.draw.panel import RejectedArc, draw_panel, find_rejected_arcs
from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import FloatArray, Points
from lsvision.measure import Measurement
from lsvision.profile import Profile
from lsvision.results.palette import POINTS, choose_cylinder_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE_INCH, DPI = (13.0, 7.0), 110
"""Width and height of the figure, and resolution of the PNG (1 / inch)."""
AXES_BOX = (0.065, 0.085, 0.605, 0.785)
"""Left, bottom, width and height of the axes, left of the panel, as fractions of the figure."""
MARGIN_FRACTION = 0.05
"""Margin of the drawing, as a fraction of its extent."""
MIN_LABEL_GAP_PX = 22.0
"""Smallest distance between the letters of two rejected arcs, and from a letter to its arc.
Units: px."""
MAX_VECTOR_POINTS = 20_000
"""Number of points above which an SVG contains them as an image, so that the file stays small."""


def draw_measurement(
    profile: Profile, measurement: Measurement, *, title: str = "", ax: Axes | None = None
) -> Figure:
    """Return a figure of a profile with its cylinders and rejected arcs, and their values.

    Parameters
    ----------
    profile : Profile
        Measured profile.
    measurement : Measurement
        Measurement of the profile.
    title : str
        Title above the drawing, such as the name of the file.
    ax : matplotlib.axes.Axes, optional
        Axes to draw into. By default a new figure is drawn, with a panel at the right that lists
        the values of the cylinders and the reasons of the rejections.

    Returns
    -------
    matplotlib.figure.Figure
        Figure of `ax`, else a new one, which pyplot does not know. Save it with its ``savefig``
        method, or convert it with `render_figure`.

    Examples
    --------
    >>> profile = Profile([[0.0, -400.0], [1.0, -400.1]])
    >>> draw_measurement(profile, Measurement((), ()), title="two points").get_suptitle()
    'two points: no cylinder'
    """
    if ax is not None:
        draw_on_axes(ax, profile, measurement)
        set_title(ax, title)
        return get_figure(ax)
    figure = create_figure(SIZE_INCH, dpi=DPI)
    axes = figure.add_axes(AXES_BOX)
    draw_on_axes(axes, profile, measurement)
    rejected = find_rejected_arcs(profile.points, measurement)
    heading = format_summary_title(len(measurement.cylinders), len(rejected), title)
    figure.suptitle(heading, x=AXES_BOX[0], y=0.96, ha="left", fontsize=13,
                    parse_math=False)  # a file name may contain "$" # fmt: skip
    draw_panel(figure, measurement.cylinders, rejected)
    return figure


def draw_on_axes(axes: Axes, profile: Profile, measurement: Measurement) -> None:
    """Draw a measurement into axes in mm: points, ellipses and rejected arcs, at one scale."""
    points = profile.points
    rejected = find_rejected_arcs(points, measurement)
    axes.plot(*points.T, ".", color=POINTS, ms=2.5, label="measured points",
              rasterized=len(points) > MAX_VECTOR_POINTS)  # fmt: skip
    for arc in rejected:
        axes.plot(*points[arc.indices].T, "x", color=arc.colour, ms=4, mew=0.9, zorder=3,
                  label=label_once(axes, "rejected arc"))  # fmt: skip
    for number, cylinder in enumerate(measurement.cylinders, 1):
        _draw_cylinder(axes, points, cylinder, number)
    axes.margins(MARGIN_FRACTION)
    axes.set_aspect("equal", adjustable="datalim")
    label_rejected(axes, points, rejected)
    axes.set_xlabel("X / mm (along the laser line)")
    axes.set_ylabel("Y / mm (up: towards the sensor)")
    axes.grid(visible=True, lw=0.4, alpha=0.5)
    draw_legend(axes)


def _draw_cylinder(axes: Axes, points: Points, cylinder: CylinderSection, number: int) -> None:
    """Draw the points, the ellipse, the major axis if it is determined, and the number."""
    colour, ellipse = choose_cylinder_colour(number), cylinder.ellipse
    axes.plot(*points[cylinder.indices].T, "o", color=colour, ms=3.2, zorder=4,
              label=label_once(axes, "points of a cylinder"))  # fmt: skip
    outline = ellipse.points_at(np.linspace(0, 2 * math.pi, 361))
    axes.plot(*outline.T, "-", color=colour, lw=1.1, zorder=2,
              label=label_once(axes, "fitted ellipse"))  # fmt: skip
    if cylinder.theta_determined:  # otherwise the direction drawn would look like a result
        ends = ellipse.points_at(np.array([0.0, math.pi]))
        axes.plot(*ends.T, "--", color=colour, lw=1.3, zorder=2,
                  label=label_once(axes, "major axis (direction θ)"))  # fmt: skip
    label_box = {"boxstyle": "circle,pad=0.25", "fc": colour, "ec": "white"}
    axes.text(*ellipse.centre, str(number), color="white", fontsize=10, weight="bold", ha="center",
              va="center", zorder=6, clip_on=True, bbox=label_box)  # fmt: skip


def label_rejected(axes: Axes, points: Points, rejected: Sequence[RejectedArc]) -> None:
    """Draw each letter above its arc, moved up until it overlaps none of the letters before it.

    Points may be in px of a photo; letters of arcs outside of the axes are left out.
    """
    # The limits and the equal scale must be final before positions are converted to pixels.
    axes.autoscale_view()
    axes.apply_aspect()
    from_pixels = axes.transData.inverted()
    up, label_pixels = np.array([0.0, MIN_LABEL_GAP_PX]), list[FloatArray]()
    for arc in rejected:
        anchor = points[arc.indices[len(arc.indices) // 2]]
        if not axes.viewLim.contains(*anchor):
            continue
        pixel = axes.transData.transform(anchor) + up
        while any(math.hypot(*(pixel - other)) < MIN_LABEL_GAP_PX for other in label_pixels):
            pixel = pixel + up / 2
        label_pixels.append(pixel)
        position = from_pixels.transform(pixel)
        leader = {"arrowstyle": "-", "color": arc.colour, "lw": 0.8}
        axes.annotate("", anchor, xytext=position, arrowprops=leader, zorder=4)
        box = {"boxstyle": "round,pad=0.2", "fc": arc.colour, "ec": "none"}
        axes.text(*position, arc.letter, color="white", fontsize=9, weight="bold", ha="center",
                  va="center", zorder=5, bbox=box)  # fmt: skip
