"""The figures of the report: matplotlib figures as SVG that stand side by side in one page."""

import html
import io
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lsvision.draw import draw_on_axes
from lsvision.geometry import FloatArray, Points, orthogonal_residuals
from lsvision.studies.chen_liu_2016.methods import METHODS, Method
from lsvision.studies.chen_liu_2016.paper_chain import PaperSettings
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
"""At 72 units an inch a phone shows letters of such a figure at about their own size."""
BLUE, ORANGE, GREEN, PURPLE, GREY = "#0072B2", "#D55E00", "#00805E", "#A8457E", "0.45"
"""Told apart by colour-blind readers."""

_ID = re.compile(r'(\bid="|url\(#|href="#)')
_NOTHING = {"Date": None, "Creator": None, "Format": None, "Type": None}
NAMES = {"radius_mm": "radius / mm", "theta_deg": "θ / °", "phi_deg": "φ / °"}
"""Of the quantities, as axes show them."""
COLOURS: dict[Method, str] = {
    "paper": ORANGE, "section": BLUE, "known": PURPLE, "two": GREEN, "twenty": "black",
}  # fmt: skip
SIGMAS_DRAWN = 3.0
HIGHEST_MM = 3.0
"""Largest r_j that is drawn to scale; windows without an ellipse lie there too."""


def draw_tables(rows: Sequence[TableRow]) -> str:
    """Root mean square error of each way by table, the printed errors and the bound beside."""
    figure = new_figure(6.6)
    panels = figure.subplots(3, 1, sharex=True)
    tables = sorted({row.printed.table for row in rows})
    by_table = [[row for row in rows if row.printed.table == table] for table in tables]
    for axes, quantity in zip(panels, QUANTITIES, strict=True):
        for place, own in enumerate(by_table):
            _draw_table(axes, own, quantity, place)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_ylabel(f"error of {NAMES[quantity]}")
        axes.grid(visible=True, axis="y", lw=0.4, alpha=0.6)
    names = [_under(own[0].printed) for own in by_table]
    panels[-1].set_xticks(range(len(tables)), names)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, fontsize=7.5,
                  frameon=False, columnspacing=1, handletextpad=0.3)  # fmt: skip
    return inline_svg(
        figure, "tables",
        "Errors of radius, theta and phi in Tables 1 to 4 for five ways to measure, beside the "
        "paper's printed errors and the best possible, on a logarithmic scale",
    )  # fmt: skip


def _draw_table(axes: "Axes", own: Sequence[TableRow], quantity: str, place: int) -> None:
    """One table's printed errors, and each way's error on its bound; the first has labels."""
    named = place == 0
    printed = [abs(getattr(row.printed.errors, quantity)) for row in own]
    axes.plot([place - 0.36] * len(own), printed, "_", color="red", ms=12, mew=1.6,
              label="printed in the paper" if named else None)  # fmt: skip
    for step, (way, info) in enumerate(METHODS.items()):
        spread = pool_errors([row.spreads[way] for row in own])
        at = place - 0.2 + 0.14 * step
        rms, bound = getattr(spread.rms, quantity), getattr(spread.bound, quantity)
        if bound > 0:
            axes.plot(at, bound, "_", color="0.3", ms=11, mew=1.2,
                      label="best possible" if named and step == 0 else None)  # fmt: skip
        # A radius that is given has no error, and no place on a logarithmic scale.
        axes.plot(at, rms if bound > 0 else np.nan, "o", color=COLOURS[way], ms=5.5,
                  label=f"({info.letter}) {info.name}" if named else None)  # fmt: skip


def _under(printed: PublishedRow) -> str:
    kind = "welded" if printed.table == 4 else f"φ = {printed.phi_deg:g}°"
    return f"Table {printed.table}\n{kind}"


def draw_scene(scene: SceneFigure, number: int) -> str:
    """A scene of Figures 14 and 15 with what was found in it.

    Parameters
    ----------
    scene : SceneFigure
        The scene.
    number : int
        Its place on the page.
    """
    figure = new_figure(3.8)
    axes = figure.subplots()
    draw_on_axes(axes, scene.section.profile, scene.measurement)
    axes.margins(y=0.15)  # the letters stand above what they name
    axes.legend(loc="lower center", fontsize=7, ncols=2, frameon=False, bbox_to_anchor=(0.5, 1.0))
    shown = "measured points and the pipes found, each with its ellipse and major axis"
    return inline_svg(figure, f"scene{number}", f"{scene.title}: {shown}")


def draw_repeatability(repeatability: Repeatability) -> str:
    """Figure 16: centres of repeated measurements, their box, the paper's, and the bound."""
    figure = new_figure(4.6)
    axes = figure.subplots()
    centres = repeatability.ellipses[:, :2]
    axes.plot(*centres.T, ".", color=BLUE, ms=2.5, alpha=0.6, label="centres measured")
    axes.plot(*_outline(repeatability.bound[:2, :2]).T, "-", color="black", lw=1.2,
              label="best possible, three sigma")  # fmt: skip
    low, high = centres.min(axis=0), centres.max(axis=0)
    axes.plot(*_box(low, high).T, "--", color=GREY, lw=1, label="box of all centres")
    half = PUBLISHED_BOX_MM / 2
    axes.plot(*_box(np.full(2, -half), np.full(2, half)).T, "-", color="red", lw=1.2,
              label="the paper's box, 0.6 mm")  # fmt: skip
    axes.set_aspect("equal")
    axes.set(xlabel="X off the true centre / mm", ylabel="Y off the true centre / mm")
    axes.grid(visible=True, lw=0.4, alpha=0.5)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return inline_svg(figure, "repeatability",
                      "Centres of repeated measurements: a narrow tall cloud, much taller than "
                      "the paper's box")  # fmt: skip


def _outline(covariance: FloatArray) -> FloatArray:
    turns = np.linspace(0, 2 * np.pi, 181)
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    outline: FloatArray = SIGMAS_DRAWN * circle @ np.linalg.cholesky(covariance).T
    return outline


def _box(low: FloatArray, high: FloatArray) -> FloatArray:
    (left, bottom), (right, top) = low, high
    return np.array([[left, bottom], [right, bottom], [right, top], [left, top], [left, bottom]])


def draw_recognition(steps: StepExample) -> str:
    """Figures 5-7: the section above, the largest r_j of the paper's windows below it."""
    figure = new_figure(5.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    draw_on_axes(above, steps.section.profile, steps.measurement)
    above.set_aspect("equal", adjustable="box")
    above.margins(y=0.15)
    above.set_xlabel("")
    above.legend(loc="lower center", fontsize=7, ncols=2, frameon=False,
                 bbox_to_anchor=(0.5, 1.0))  # fmt: skip
    x, worst = steps.windows.T
    below.plot(x, np.minimum(worst, HIGHEST_MM), "-", color=GREY, lw=0.8)
    limit = PaperSettings().sensor_error_mm
    passed = worst < limit
    below.plot(x[passed], worst[passed], ".", color=ORANGE, ms=4,
               label="passes for an ellipse")  # fmt: skip
    below.axhline(limit, color=PURPLE, lw=1, ls="--", label="sensor error, 0.9 mm")
    below.set(ylim=(0, HIGHEST_MM), xlabel="X / mm (along the laser line)",
              ylabel="largest |rⱼ| of the window / mm")  # fmt: skip
    below.legend(fontsize=8, loc="upper right")
    return inline_svg(
        figure, "recognition",
        "A section with two welded pipes among clutter, and below it the largest residual of "
        "each window of the paper's rough identification",
    )  # fmt: skip


def draw_screening(steps: StepExample) -> str:
    """Figures 8 and 9: residuals of one arc to the ellipse of its middle part."""
    figure = new_figure(3.0)
    axes = figure.subplots()
    profile, before, after = steps.profile, steps.identified, steps.screened
    points = profile.points[before.indices]
    residuals = orthogonal_residuals(points, after.ellipse)
    kept = np.isin(before.indices, after.indices)
    around = np.arange(before.arc.start - 12, before.arc.stop + 12)
    around = around[(around >= 0) & (around < len(profile.points))]
    beyond = np.setdiff1d(around, before.indices)
    off = orthogonal_residuals(profile.points[beyond], after.ellipse)
    axes.plot(profile.points[beyond, 0], off, "x", color=GREY, ms=4,
              label="not on the arc (neighbours, jumps)")  # fmt: skip
    axes.plot(points[kept, 0], residuals[kept], ".", color=BLUE, label="kept")
    axes.plot(points[~kept, 0], residuals[~kept], "D", color=ORANGE, ms=4,
              label="dropped by screening")  # fmt: skip
    limit = PaperSettings().sensor_error_mm
    for value in (-limit, limit):
        axes.axhline(value, color=PURPLE, lw=1, ls="--",
                     label="the paper's limit, 0.9 mm" if value > 0 else None)  # fmt: skip
    axes.set(ylim=(-1.5, 1.5), xlabel="X / mm", ylabel="off the middle part's ellipse / mm")
    axes.legend(fontsize=7, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    return inline_svg(
        figure, "screening",
        "Residuals of an arc's points to the ellipse of its middle part; end points beyond "
        "the noise are dropped",
    )  # fmt: skip


def draw_smoothing(steps: StepExample) -> str:
    """Figure 10: measured, smoothed and homogenised points, as their distance from the truth."""
    figure = new_figure(3.4)
    axes = figure.subplots()
    points = steps.profile.points[steps.screened.indices]
    kept = steps.smoothed.inliers
    truth = min(
        (tube.ellipse for tube in steps.section.truth.tubes),
        key=lambda ellipse: float(np.abs(orthogonal_residuals(points, ellipse)).mean()),
    )

    def show(axes: "Axes", own: Points, style: str, **how: object) -> None:
        axes.plot(own[:, 0], orthogonal_residuals(own, truth), style, **how)

    show(axes, points[kept], ".", color=GREY, ms=4, label="measured")
    if not kept.all():
        show(axes, points[~kept], "x", color=PURPLE, label="left out as jumps")
    show(axes, steps.homogenised.points, "-", color=BLUE, lw=1.6,
         label="smoothed along the arc (lsvision)")  # fmt: skip
    show(axes, steps.literal, "-", color=ORANGE, lw=1.6,
         label="smoothed as y over x (the paper's text)")  # fmt: skip
    axes.axhline(0.0, color=GREEN, lw=0.8, label="the true pipe")
    axes.set(xlabel="X / mm", ylabel="off the true ellipse / mm")
    axes.legend(fontsize=7, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    return inline_svg(
        figure, "smoothing",
        "Distance from the true ellipse of measured points, of points smoothed along the arc, "
        "and of points smoothed as y over x",
    )  # fmt: skip


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
    label = html.escape(description)
    return text.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
