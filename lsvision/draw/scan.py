"""Picture of the points and cylinders of a scan in 3D."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from lsvision.draw.figures import (
    create_figure,
    format_summary_title,
    get_figure,
    label_once,
    set_title,
)
from lsvision.draw.space import fit_into_area, scale_axes
from lsvision.geometry import FloatArray, Points
from lsvision.results.number_format import format_std, format_value, with_minus_signs
from lsvision.results.palette import POINTS, choose_cylinder_colour
from lsvision.results.picture import AZIMUTH_DEG, ELEVATION_DEG
from lsvision.results.summaries import format_count
from lsvision.scan import ScanMeasurement, ScannedCylinder
from lsvision.scan.shape import triangulate_cylinder

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

SIZE_INCH, DPI = (13.0, 8.0), 110
"""Width and height of the figure, and resolution of the PNG (1 / inch)."""
DRAWING_AREA = (0.03, 0.03, 0.66, 0.83)
"""Left, bottom, width, height of the drawing with all its labels, as fractions of the figure."""
MAX_POINTS = 6000
"""Largest number of measured points drawn; more would overlap."""
FACETS = 40
"""Number of flat strips that approximate a drawn cylinder."""
Vertical = Literal["y", "z"]
"""Axis of the base frame that is drawn upwards."""
MIN_FACING_COSINE = -0.3
"""Smallest horizontal component of the mean outward normal of the measured sides towards the
viewer; below it the cylinders would be seen from behind, and the view is turned."""
PANEL_LEFT, PANEL_TOP, PANEL_LINE_HEIGHT = 0.715, 0.86, 0.024
"""Left and top of the panel and height of its lines, as fractions of the figure."""
MAX_FULL_CYLINDERS, MAX_CYLINDERS = 4, 9
"""Number of cylinders up to which the panel has all values of each, and largest number of cylinders
in the panel; more than `MAX_FULL_CYLINDERS` have two lines each."""


def draw_scan(
    scan: ScanMeasurement,
    points: Points,
    *,
    title: str = "",
    vertical: Vertical = "y",
    ax: "Axes3D | None" = None,
) -> "Figure":
    """Return a figure of all points of a scan, its cylinders and their axes.

    Parameters
    ----------
    scan : ScanMeasurement
        Measurement of the scan.
    points : (n, 3) ndarray
        All points of the scan, base frame. Units: mm.
    title : str
        Title above the drawing.
    vertical : {"y", "z"}
        Axis that is drawn upwards: Y of a section frame, towards the sensor, or Z of a robot's
        base frame.
    ax : mpl_toolkits.mplot3d.Axes3D, optional
        Draw into these axes (``projection="3d"``), without the panel; by default a new
        figure is made.

    Returns
    -------
    matplotlib.figure.Figure
        Figure of `ax`, else a new one with its own canvas. Points far from all cylinders are left
        out.

    Raises
    ------
    TypeError
        If `ax` is two-dimensional.

    Examples
    --------
    >>> draw_scan(ScanMeasurement((), (), ()), np.zeros((3, 3)), title="empty").get_suptitle()
    'empty: no cylinder'
    """
    import mpl_toolkits.mplot3d  # noqa: F401 - registers the projection

    if ax is not None:
        if not hasattr(ax, "get_zlim"):
            raise TypeError(
                f"expected 3D axes, got {type(ax).__name__}: make them with "
                'figure.add_subplot(projection="3d")'
            )
        _draw_in_space(ax, scan, points, vertical)
        set_title(ax, title)
        return get_figure(ax)
    figure = create_figure(SIZE_INCH, dpi=DPI)
    axes = figure.add_axes(DRAWING_AREA, projection="3d")
    _draw_in_space(axes, scan, points, vertical)
    fit_into_area(axes, DRAWING_AREA)
    figure.suptitle(format_summary_title(len(scan.cylinders), 0, title), x=0.03, y=0.96, ha="left",
                    fontsize=13, parse_math=False)  # fmt: skip
    figure.legend(*axes.get_legend_handles_labels(), loc="upper left", bbox_to_anchor=(0.02, 0.925),
                  ncols=4, frameon=False, fontsize=9, markerscale=2.5)  # fmt: skip
    _draw_panel(figure, scan)
    return figure


def _draw_in_space(
    axes: "Axes3D", scan: ScanMeasurement, points: Points, vertical: Vertical
) -> None:
    """Draw the points near the cylinders, and the cylinders, from the side that was measured."""
    axes.view_init(
        ELEVATION_DEG, _choose_azimuth_deg(scan.cylinders, vertical), vertical_axis=vertical
    )
    _draw_points(axes, _select_points_near_cylinders(points, scan))
    for number, cylinder in enumerate(scan.cylinders, 1):
        _draw_cylinder(axes, cylinder, number)
    scale_axes(axes)


def _choose_azimuth_deg(cylinders: Sequence[ScannedCylinder], vertical: Vertical) -> float:
    """Return the azimuth of the view: the default, unless it shows the cylinders from behind."""
    if not cylinders:
        return AZIMUTH_DEG
    outward = [
        cylinder.points.mean(axis=0) - _find_axis_ends(cylinder, 0.0).mean(axis=0)
        for cylinder in cylinders
    ]
    measured_side = np.mean([vector / np.linalg.norm(vector) for vector in outward], axis=0)
    # Matplotlib counts the azimuth from the axis after the vertical one, in the cyclic order xyz.
    x, y, z = measured_side
    first, second = (z, x) if vertical == "y" else (x, y)

    def towards_viewer(azimuth_deg: float) -> float:
        angle = math.radians(azimuth_deg)
        return float(first * math.cos(angle) + second * math.sin(angle))

    if towards_viewer(AZIMUTH_DEG) >= MIN_FACING_COSINE:
        return AZIMUTH_DEG
    return max((AZIMUTH_DEG + turn for turn in (90.0, 180.0, 270.0)), key=towards_viewer)


def _select_points_near_cylinders(points: Points, scan: ScanMeasurement) -> Points:
    """Return the points in the bounding box of all cylinders, extended by half its longest side.

    Without cylinders all points.
    """
    if not scan.cylinders:
        return points
    corners = np.concatenate(
        [triangulate_cylinder(cylinder, FACETS)[0] for cylinder in scan.cylinders]
    )
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.5 * float((high - low).max())
    near: Points = points[((points > low - margin) & (points < high + margin)).all(axis=1)]
    return near


def _draw_points(axes: "Axes3D", points: Points) -> None:
    """Draw at most `MAX_POINTS` of the points, evenly selected."""
    sample = points[:: max(1, math.ceil(len(points) / MAX_POINTS))]
    axes.plot(*sample.T, ".", color=POINTS, ms=1.6, zorder=1, label="measured points")


def _draw_cylinder(axes: "Axes3D", cylinder: ScannedCylinder, number: int) -> None:
    """Draw the points, the transparent surface, the axis and the number of a cylinder."""
    colour = choose_cylinder_colour(number)
    axes.plot(*cylinder.points.T, ".", color=colour, ms=2.4, zorder=3,
              label=label_once(axes, "points of a cylinder"))  # fmt: skip
    corners, triangles = triangulate_cylinder(cylinder, FACETS)
    axes.plot_trisurf(
        *corners.T, triangles=triangles, color=colour, alpha=0.18, linewidth=0, zorder=2
    )
    ends = _find_axis_ends(cylinder, 0.15)
    axes.plot(*ends.T, "-.", color=colour, lw=1.5, zorder=4, label=label_once(axes, "fitted axis"))
    badge = {"boxstyle": "circle,pad=0.25", "fc": colour, "ec": "white"}
    axes.text(*ends[1], str(number), color="white", fontsize=10, weight="bold", ha="center",
              va="center", zorder=6, bbox=badge)  # fmt: skip


def _find_axis_ends(cylinder: ScannedCylinder, extension: float) -> FloatArray:
    """Return the (2, 3) ends of the measured part of the axis, each moved outwards by a fraction.

    Units: mm.
    """
    low, high = cylinder.axial_range
    margin = extension * (high - low)
    return cylinder.point + np.outer([low - margin, high + margin], cylinder.direction)


def _draw_panel(figure: "Figure", scan: ScanMeasurement) -> None:
    """Write the values of each cylinder into a panel on the right."""
    y, full = PANEL_TOP, len(scan.cylinders) <= MAX_FULL_CYLINDERS
    for number, cylinder in enumerate(scan.cylinders[:MAX_CYLINDERS], 1):
        badge = {"boxstyle": "circle,pad=0.25", "fc": choose_cylinder_colour(number), "ec": "none"}
        figure.text(PANEL_LEFT, y - 0.006, f"{number}", color="white", fontsize=10, weight="bold",
                    va="top", bbox=badge)  # fmt: skip
        lines = _format_value_lines(cylinder) if full else _format_value_lines(cylinder)[:2]
        figure.text(PANEL_LEFT + 0.025, y, with_minus_signs("\n".join(lines)), fontsize=9.5,
                    va="top", family="monospace", parse_math=False)  # fmt: skip
        y -= PANEL_LINE_HEIGHT * (len(lines) + 1.5)
    left_out = len(scan.cylinders) - MAX_CYLINDERS
    if left_out > 0:
        figure.text(PANEL_LEFT, y, f"... {left_out} more: see the table", fontsize=9.5, va="top")


def _format_value_lines(cylinder: ScannedCylinder) -> list[str]:
    """Return the values of a cylinder as lines of text, the most important first."""
    direction = ", ".join(f"{value:+z.4f}" for value in cylinder.direction)
    point = ", ".join(f"{value:z.2f}" for value in cylinder.point)
    sections = format_count(len(cylinder.sections), "section")
    lines = [
        f"radius {format_value(cylinder.radius, cylinder.radius_std)} mm",
        f"axis   ({direction})",
        f"       ± {format_std(float(np.degrees(cylinder.direction_std)))}°",
        f"point  ({point}) mm",
        f"measured over {cylinder.axial_range[1] - cylinder.axial_range[0]:.1f} mm in {sections}",
    ]
    return [*lines, "one of two possible axes"] if cylinder.ambiguous else lines
