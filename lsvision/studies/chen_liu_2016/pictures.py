"""Figures of the report, as SVG elements of one page."""

import html
import io
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lsvision.draw import draw_on_axes
from lsvision.draw.figures import create_figure
from lsvision.geometry import FloatArray, Points, orthogonal_residuals
from lsvision.results.palette import CYLINDERS, REJECTED
from lsvision.studies.chen_liu_2016.methods import METHODS, Method
from lsvision.studies.chen_liu_2016.paper_pipeline import PaperSettings
from lsvision.studies.chen_liu_2016.published_results import (
    PUBLISHED_BOX_MM,
    QUANTITIES,
    PublishedRow,
)
from lsvision.studies.chen_liu_2016.repeatability import Repeatability
from lsvision.studies.chen_liu_2016.scenes import SceneFigure
from lsvision.studies.chen_liu_2016.steps import StepExample
from lsvision.studies.chen_liu_2016.tables import TableRow, pool_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_INCH = 4.6
"""Width of a figure; on a phone its letters have about the size of the text. Units: inch."""
BLUE, GREEN, PURPLE, _ = CYLINDERS
ORANGE, GREY = REJECTED[0], "0.45"
"""Colours of methods and of lines without one."""

# Beginning of an id in SVG, or of a reference to one.
_ID_OR_REFERENCE = re.compile(r'(\bid="|url\(#|href="#)')
# Without the date, the same figure gives the same text.
_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}
AXIS_NAMES = {"radius_mm": "radius / mm", "theta_deg": "θ / °", "phi_deg": "φ / °"}
"""Labels of the quantities on the axes."""
COLOURS: dict[Method, str] = {
    "paper": ORANGE, "section": BLUE, "known": PURPLE, "two": GREEN, "twenty": "black",
}  # fmt: skip
"""Colour of each method in all figures."""
ELLIPSE_SIGMAS = 3.0
"""Size of the covariance ellipse of the bound, in standard deviations."""
RESIDUAL_LIMIT_MM = 1.5
"""Half the height of the picture of accurate screening. Units: mm."""
MAX_RESIDUAL_MM = 3.0
"""Upper end of the axis of r_j, at which windows without an ellipse are drawn, too. Units: mm."""


def draw_tables(rows: Sequence[TableRow]) -> str:
    """Return a picture of the rms error of each method by table, with printed errors and bound."""
    figure = create_figure((WIDTH_INCH, 6.6), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    tables = sorted({row.printed.table for row in rows})
    by_table = [[row for row in rows if row.printed.table == table] for table in tables]
    for axes, quantity in zip(panels, QUANTITIES, strict=True):
        for position, table_rows in enumerate(by_table):
            _draw_table(axes, table_rows, quantity, position)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_ylabel(f"error of {AXIS_NAMES[quantity]}")
        axes.grid(visible=True, axis="y", lw=0.4, alpha=0.6)
    names = [_format_tick_label(table_rows[0].printed) for table_rows in by_table]
    panels[-1].set_xticks(range(len(tables)), names)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, fontsize=7.5,
                  frameon=False, columnspacing=1, handletextpad=0.3)  # fmt: skip
    return _render_inline_svg(
        figure, "tables",
        "Errors of radius, theta and phi in Tables 1 to 4 for five ways to measure, beside the "
        "paper's printed errors and the best possible, on a logarithmic scale",
    )  # fmt: skip


def _draw_table(axes: "Axes", rows: Sequence[TableRow], quantity: str, position: int) -> None:
    """Draw one table at an x position; the first one adds the entries of the legend."""
    first = position == 0
    printed = [abs(getattr(row.printed.errors, quantity)) for row in rows]
    axes.plot([position - 0.36] * len(rows), printed, "_", color="red", ms=12, mew=1.6,
              label="printed in the paper" if first else None)  # fmt: skip
    for step, (method, info) in enumerate(METHODS.items()):
        pooled = pool_errors([row.spreads[method] for row in rows])
        x = position - 0.2 + 0.14 * step
        rms, bound = getattr(pooled.rms, quantity), getattr(pooled.bound, quantity)
        if bound > 0:
            axes.plot(x, bound, "_", color="0.3", ms=11, mew=1.2,
                      label="best possible" if first and step == 0 else None)  # fmt: skip
        # A given radius has no error, and zero has no place on a logarithmic scale.
        axes.plot(x, rms if bound > 0 else np.nan, "o", color=COLOURS[method], ms=5.5,
                  label=f"({info.letter}) {info.name}" if first else None)  # fmt: skip


def _format_tick_label(printed: PublishedRow) -> str:
    """Return the label of a table for the x axis."""
    kind = "welded" if printed.table == 4 else f"φ = {printed.phi_deg:g}°"
    return f"Table {printed.table}\n{kind}"


def draw_scene(scene: SceneFigure, number: int) -> str:
    """Return a picture of a scene of Figures 14 and 15 with the pipes found in it.

    The number of the scene on the page makes the ids in the SVG unique.
    """
    figure = create_figure((WIDTH_INCH, 3.8), layout="constrained")
    axes = figure.subplots()
    draw_on_axes(axes, scene.section.profile, scene.measurement)
    axes.margins(y=0.15)  # space for the letters above the points
    _draw_legend_above(axes)
    content = "measured points and the pipes found, each with its ellipse and major axis"
    return _render_inline_svg(figure, f"scene{number}", f"{scene.title}: {content}")


def _draw_legend_above(axes: "Axes") -> None:
    """Draw the legend above the axes, in two columns."""
    axes.legend(fontsize=7, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)


def draw_repeatability(repeatability: Repeatability) -> str:
    """Return Figure 16: repeated centres, their bounding box, the paper's box, and the bound."""
    figure = create_figure((WIDTH_INCH, 4.6), layout="constrained")
    axes = figure.subplots()
    centres = repeatability.ellipses[:, :2]
    axes.plot(*centres.T, ".", color=BLUE, ms=2.5, alpha=0.6, label="centres measured")
    axes.plot(*_draw_covariance_ellipse(repeatability.bound[:2, :2]).T, "-", color="black", lw=1.2,
              label="best possible, three sigma")  # fmt: skip
    low, high = centres.min(axis=0), centres.max(axis=0)
    axes.plot(*_build_box(low, high).T, "--", color=GREY, lw=1, label="box of all centres")
    half = PUBLISHED_BOX_MM / 2
    axes.plot(*_build_box(np.full(2, -half), np.full(2, half)).T, "-", color="red", lw=1.2,
              label=f"the paper's box, {PUBLISHED_BOX_MM:g} mm")  # fmt: skip
    axes.set_aspect("equal")
    axes.set(xlabel="X off the true centre / mm", ylabel="Y off the true centre / mm")
    axes.grid(visible=True, lw=0.4, alpha=0.5)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return _render_inline_svg(figure, "repeatability",
                      "Centres of repeated measurements, the box around them, the paper's box, "
                      "and the best possible at three sigma")  # fmt: skip


def _draw_covariance_ellipse(covariance: FloatArray) -> FloatArray:
    """Return points (181, 2) on the `ELLIPSE_SIGMAS` ellipse of a covariance (2, 2)."""
    angles = np.linspace(0, 2 * np.pi, 181)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    ellipse: FloatArray = ELLIPSE_SIGMAS * circle @ np.linalg.cholesky(covariance).T
    return ellipse


def _build_box(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the closed polygon (5, 2) of a box between two opposite corners."""
    (left, bottom), (right, top) = low, high
    return np.array([[left, bottom], [right, bottom], [right, top], [left, top], [left, bottom]])


def draw_recognition(steps: StepExample) -> str:
    """Return Figures 5-7: the section, and below it the largest abs(r_j) of the paper's windows."""
    figure = create_figure((WIDTH_INCH, 5.6), layout="constrained")
    section_axes, residual_axes = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    draw_on_axes(section_axes, steps.section.profile, steps.measurement)
    section_axes.set_aspect("equal", adjustable="box")
    section_axes.margins(y=0.15)
    section_axes.set_xlabel("")
    _draw_legend_above(section_axes)
    x, largest = steps.windows.T
    residual_axes.plot(x, np.minimum(largest, MAX_RESIDUAL_MM), "-", color=GREY, lw=0.8)
    limit = PaperSettings().sensor_error_mm
    accepted = largest < limit
    residual_axes.plot(
        x[accepted], largest[accepted], ".", color=ORANGE, ms=4, label="passes for an ellipse"
    )
    residual_axes.axhline(limit, color=PURPLE, lw=1, ls="--", label=f"sensor error, {limit:g} mm")
    residual_axes.set(
        ylim=(0, MAX_RESIDUAL_MM),
        xlabel="X / mm (along the laser line)",
        ylabel="largest |rⱼ| of the window / mm",
    )
    residual_axes.legend(fontsize=8, loc="upper right")
    return _render_inline_svg(
        figure, "recognition",
        "A section with two welded pipes among clutter, and below it the largest residual of "
        "each window of the paper's rough identification",
    )  # fmt: skip


def draw_screening(steps: StepExample) -> str:
    """Return Figures 8 and 9: residuals of one arc from the ellipse of its middle part."""
    figure = create_figure((WIDTH_INCH, 3.0), layout="constrained")
    axes = figure.subplots()
    profile, identified, screened = steps.profile, steps.identified, steps.screened
    points = profile.points[identified.indices]
    residuals = orthogonal_residuals(points, screened.ellipse)
    inliers = np.isin(identified.indices, screened.indices)
    indices = np.arange(identified.arc.start - 12, identified.arc.stop + 12)
    indices = indices[(indices >= 0) & (indices < len(profile.points))]
    neighbours = np.setdiff1d(indices, identified.indices)
    neighbour_residuals = orthogonal_residuals(profile.points[neighbours], screened.ellipse)
    shown = np.abs(neighbour_residuals) < RESIDUAL_LIMIT_MM  # others would stretch the X axis
    axes.plot(profile.points[neighbours[shown], 0], neighbour_residuals[shown], "x", color=GREY,
              ms=4, label="not on the arc (neighbours, jumps)")  # fmt: skip
    axes.plot(points[inliers, 0], residuals[inliers], ".", color=BLUE, label="kept")
    axes.plot(points[~inliers, 0], residuals[~inliers], "D", color=ORANGE, ms=4,
              label="dropped by screening")  # fmt: skip
    limit = PaperSettings().sensor_error_mm
    for value in (-limit, limit):
        axes.axhline(value, color=PURPLE, lw=1, ls="--",
                     label=f"the paper's limit, {limit:g} mm" if value > 0 else None)  # fmt: skip
    axes.set(ylim=(-RESIDUAL_LIMIT_MM, RESIDUAL_LIMIT_MM), xlabel="X / mm",
             ylabel="off the middle part's ellipse / mm")  # fmt: skip
    _draw_legend_above(axes)
    return _render_inline_svg(
        figure, "screening",
        "Residuals of an arc's points to the ellipse of its middle part; end points beyond "
        "the noise are dropped",
    )  # fmt: skip


def draw_smoothing(steps: StepExample) -> str:
    """Return Figure 10: distance of measured and smoothed points from the true ellipse."""
    figure = create_figure((WIDTH_INCH, 3.4), layout="constrained")
    axes = figure.subplots()
    points = steps.profile.points[steps.screened.indices]
    inliers = steps.smoothed.inliers
    truth = min(
        (tube.ellipse for tube in steps.section.truth.tubes),
        key=lambda ellipse: float(np.abs(orthogonal_residuals(points, ellipse)).mean()),
    )

    def plot_residuals(points: Points, style: str, **options: object) -> None:
        axes.plot(points[:, 0], orthogonal_residuals(points, truth), style, **options)

    plot_residuals(points[inliers], ".", color=GREY, ms=4, label="measured")
    if not inliers.all():
        plot_residuals(points[~inliers], "x", color=PURPLE, label="left out as jumps")
    along, over_x = "smoothed along the arc (lsvision)", "smoothed as y over x (the paper's text)"
    plot_residuals(steps.homogenised.points, "-", color=BLUE, lw=1.6, label=along)
    plot_residuals(steps.homogenised_over_x, "-", color=ORANGE, lw=1.6, label=over_x)
    axes.axhline(0.0, color=GREEN, lw=0.8, label="the true pipe")
    axes.set(xlabel="X / mm", ylabel="off the true ellipse / mm")
    _draw_legend_above(axes)
    return _render_inline_svg(
        figure, "smoothing",
        "Distance from the true ellipse of measured points, of points smoothed along the arc, "
        "and of points smoothed as y over x",
    )  # fmt: skip


def _render_inline_svg(figure: "Figure", name: str, description: str) -> str:
    """Return a figure as an ``<svg>`` element; the same figure gives the same text.

    The name is the prefix of every id, which makes the ids of all figures on a page unique; the
    description is for screen readers.
    """
    import matplotlib as mpl

    content = io.StringIO()
    # Text as text, which is small and can be searched; a fixed salt, for the same ids each time.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "lsvision"}):
        figure.savefig(content, format="svg", metadata=_NO_METADATA)
    text = content.getvalue()
    text = _ID_OR_REFERENCE.sub(rf"\g<1>{name}-", text[text.index("<svg") :])
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    label = html.escape(description)
    return text.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
