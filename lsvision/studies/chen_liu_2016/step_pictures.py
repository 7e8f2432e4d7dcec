"""Figures 5-10: recognition, screening, smoothing and homogenising on one section."""

from typing import TYPE_CHECKING

import numpy as np

from lsvision.draw import draw_on_axes
from lsvision.geometry import Points, orthogonal_residuals
from lsvision.paper_pipeline import PaperSettings
from lsvision.studies.chen_liu_2016.steps import StepExample
from lsvision.studies.chen_liu_2016.svg import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    inline_svg,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HIGHEST_MM = 3.0
"""Largest r_j that is drawn to scale; windows without an ellipse lie there too."""


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
