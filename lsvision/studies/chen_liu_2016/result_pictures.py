"""Pictures of Tables 1-4, of Figures 14-16 and of the ablation."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lsvision.draw import draw_on_axes
from lsvision.geometry import FloatArray
from lsvision.studies.chen_liu_2016.methods import METHODS, Method
from lsvision.studies.chen_liu_2016.published_results import (
    PUBLISHED_BOX_MM,
    QUANTITIES,
    PublishedRow,
)
from lsvision.studies.chen_liu_2016.repeatability import Repeatability
from lsvision.studies.chen_liu_2016.scenes import SceneFigure
from lsvision.studies.chen_liu_2016.svg import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    inline_svg,
    new_figure,
)
from lsvision.studies.chen_liu_2016.tables import TableRow, pool_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NAMES = {"radius_mm": "radius / mm", "theta_deg": "θ / °", "phi_deg": "φ / °"}
"""Of the quantities, as axes show them."""
COLOURS: dict[Method, str] = {
    "paper": ORANGE, "section": BLUE, "known": PURPLE, "two": GREEN, "twenty": "black",
}  # fmt: skip
SIGMAS_DRAWN = 3.0


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
