"""Sections and cylinders of a scan in space."""

from typing import TYPE_CHECKING

import numpy as np

from lsvision.draw.panel import colour_of
from lsvision.geometry import FloatArray, Points
from lsvision.scan import ScanMeasurement, ScannedCylinder
from lsvision.scan.surface import tube_surface

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

SIZE_INCH, DPI = (13.0, 8.0), 110
MAX_POINTS = 6000
"""Of the scan; more only make one blot."""
FACETS = 40
ELEVATION_DEG, AZIMUTH_DEG = 25.0, -60.0


def draw_scan(scan: ScanMeasurement, points: Points, *, title: str = "") -> "Figure":
    """Draw all points of a scan, the cylinders found and their axes.

    Parameters
    ----------
    scan : ScanMeasurement
        What was found.
    points : (n, 3) ndarray
        All points of the scan, base frame. Units: mm.
    title : str
        Above the drawing.

    Returns
    -------
    matplotlib.figure.Figure
        With a canvas of its own. Y is up, as towards the sensor of a section frame. Points far
        from every cylinder are left out.
    """
    import mpl_toolkits.mplot3d  # noqa: F401 - registers the projection
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=SIZE_INCH, dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.02, 0.70, 0.9), projection="3d")
    axes.view_init(ELEVATION_DEG, AZIMUTH_DEG, vertical_axis="y")
    _draw_points(axes, _about_cylinders(points, scan))
    for number, tube in enumerate(scan.cylinders, 1):
        _draw_tube(axes, tube, number)
    for axis in "xyz":
        getattr(axes, f"set_{axis}label")(f"{axis.upper()} / mm", labelpad=12)
        getattr(axes, f"{axis}axis").set_major_locator(MaxNLocator(5))
    axes.set_aspect("equal")
    count = len(scan.cylinders)
    found = f"{count or 'no'} cylinder{'' if count in {0, 1} else 's'}"
    headline = f"{title}: {found}" if title else found
    figure.suptitle(headline, x=0.03, y=0.97, ha="left", fontsize=13, parse_math=False)
    _draw_numbers(figure, scan)
    return figure


def _about_cylinders(points: Points, scan: ScanMeasurement) -> Points:
    """Points within the cylinders' box and half its size around; all without cylinders."""
    if not scan.cylinders:
        return points
    corners = np.concatenate([tube_surface(tube, FACETS)[0] for tube in scan.cylinders])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.5 * float((high - low).max())
    near: Points = points[((points > low - margin) & (points < high + margin)).all(axis=1)]
    return near


def _draw_points(axes: "Axes3D", points: Points) -> None:
    few = points[:: max(1, len(points) // MAX_POINTS)]
    axes.plot(*few.T, ".", color="0.6", ms=1.2, zorder=1)


def _draw_tube(axes: "Axes3D", tube: ScannedCylinder, number: int) -> None:
    colour = colour_of(number)
    axes.plot(*tube.points.T, ".", color=colour, ms=2.0, zorder=3)
    corners, triangles = tube_surface(tube, FACETS)
    axes.plot_trisurf(
        *corners.T, triangles=triangles, color=colour, alpha=0.18, linewidth=0, zorder=2
    )
    ends = _ends(tube, 0.15)
    axes.plot(*ends.T, "-.", color=colour, lw=1.5, zorder=4)
    badge = {"boxstyle": "circle,pad=0.25", "fc": colour, "ec": "white"}
    axes.text(*ends[1], str(number), color="white", fontsize=10, weight="bold", ha="center",
              va="center", zorder=6, bbox=badge)  # fmt: skip


def _ends(tube: ScannedCylinder, beyond: float) -> FloatArray:
    """(2, 3) ends of the axis as seen, and so much of its length more."""
    low, high = tube.axial_range
    more = beyond * (high - low)
    return tube.point + np.outer([low - more, high + more], tube.direction)


def _draw_numbers(figure: "Figure", scan: ScanMeasurement) -> None:
    lines = 0
    for number, tube in enumerate(scan.cylinders, 1):
        y = 0.86 - 0.028 * lines
        badge = {"boxstyle": "circle,pad=0.25", "fc": colour_of(number), "ec": "none"}
        figure.text(0.715, y, f"{number}", color="white", fontsize=10, weight="bold", va="top",
                    bbox=badge)  # fmt: skip
        text = _numbers_of(tube)
        figure.text(
            0.74, y + 0.006, text, fontsize=9.5, va="top", family="monospace", parse_math=False
        )
        lines += text.count("\n") + 2


def _numbers_of(tube: ScannedCylinder) -> str:
    from lsvision.draw.number_format import format_value

    x, y, z = tube.direction
    sections = f"{len(tube.sections)} section{'' if len(tube.sections) == 1 else 's'}"
    text = (
        f"radius {format_value(tube.radius, tube.radius_std)} mm\n"
        f"axis ({x:+.4f}, {y:+.4f}, {z:+.4f})\n"
        f"     ± {np.degrees(tube.direction_std):.2g}°\n"
        f"seen over {tube.axial_range[1] - tube.axial_range[0]:.1f} mm in {sections}"
    )
    return f"{text}\none of two twins" if tube.ambiguous else text
