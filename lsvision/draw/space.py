"""3D axes: equal scales, and a drawing that fills its area, including all labels."""

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.transforms import Bbox
    from mpl_toolkits.mplot3d import Axes3D

MAX_TICK_INTERVALS = 6
"""Largest number of intervals between ticks on the longest axis; shorter axes get fewer."""
FIT_ITERATIONS = 3
"""Number of scaling steps; one is not enough, because labels keep their size."""


def scale_axes(
    axes: "Axes3D",
    names: Sequence[str] = ("X / mm", "Y / mm", "Z / mm"),
) -> None:
    """Give all axes the same scale, a name with its unit, and ticks in proportion to their length.

    The axes must have their complete content.
    """
    from matplotlib.ticker import MaxNLocator

    lengths = np.array([np.ptp(getattr(axes, f"get_{letter}lim")()) for letter in "xyz"])
    axes.set_box_aspect(lengths)
    fractions = lengths / lengths.max()
    for letter, name, fraction in zip("xyz", names, fractions, strict=True):
        getattr(axes, f"set_{letter}label")(name, labelpad=13, fontsize=11)
        axis = getattr(axes, f"{letter}axis")
        axis.set_major_locator(MaxNLocator(max(2, round(MAX_TICK_INTERVALS * fraction))))
        axis.set_tick_params(pad=8, labelsize=10)  # space between a minus sign and its tick


def fit_into_area(axes: "Axes3D", area: tuple[float, float, float, float]) -> None:
    """Scale and move axes until their drawing, including all labels, fills an area.

    The area is left, bottom, width and height as fractions of the figure, whose layout is not
    automatic.
    """
    left, bottom, width, height = area
    figure = axes.figure
    to_fractions = figure.transFigure.inverted()
    for _ in range(FIT_ITERATIONS):
        figure.draw_without_rendering()
        drawn = _measure_drawn_box(axes).transformed(to_fractions)
        box = axes.get_position(original=True)
        factor = min(width / drawn.width, height / drawn.height)
        shift_x = left + width / 2 - (drawn.x0 + drawn.x1) / 2
        shift_y = bottom + height / 2 - (drawn.y0 + drawn.y1) / 2
        x, y = (box.x0 + box.x1) / 2 + shift_x, (box.y0 + box.y1) / 2 + shift_y  # new centre
        size = factor * box.width, factor * box.height
        axes.set_position((x - size[0] / 2, y - size[1] / 2, *size))


def _measure_drawn_box(axes: "Axes3D") -> "Bbox":
    """Return the tight bounding box of the drawn cuboid, ticks and labels. Units: px."""
    from matplotlib.transforms import Bbox
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    limits = (getattr(axes, f"get_{letter}lim")() for letter in "xyz")
    corners = np.array(list(product(*limits))).T
    x, y, _ = proj_transform(*corners, axes.get_proj())
    box = Bbox.null()
    box.update_from_data_xy(axes.transData.transform(np.column_stack([x, y])))
    renderer = axes.figure.canvas.get_renderer()
    axis_boxes = (getattr(axes, f"{letter}axis").get_tightbbox(renderer) for letter in "xyz")
    return Bbox.union([box, *axis_boxes])
