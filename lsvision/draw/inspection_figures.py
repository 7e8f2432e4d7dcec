"""Pictures of inspections: a profile with its limits, and a quantity over many parts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lsvision.draw.figure_files import new_figure
from lsvision.draw.measurement import draw_on_axes
from lsvision.draw.titles import draw_legend, label_once, make_printable
from lsvision.geometry import Ellipse
from lsvision.inspection.decision import Decision
from lsvision.inspection.inspected import Series
from lsvision.inspection.verdict import Verdict
from lsvision.measure import Measurement
from lsvision.results.palette import DECISIONS, LIMITS, POINTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SERIES_INCH, PROFILE_INCH = (7.6, 2.5), (7.6, 4.4)
"""Width and height of the figures of a series and of a profile. Units: inch."""
MARKERS = {Decision.OK: "o", Decision.NG: "X", Decision.UNDECIDED: "D"}
"""Marker shapes, so that verdicts differ in a black-and-white print too."""
MAX_BINS = 30
"""Largest number of bins of the histogram."""
RADII_PER_UNIT = {"radius_mm": 1.0, "diameter_mm": 0.5}
"""Factor from a limit to a radius, for each key whose limits are drawn."""
LEGEND_COLUMNS = 3
"""Columns of the legend of a judged profile: its picture is as wide as half a page."""


def draw_series(series: Series) -> Figure:
    """Return a figure of the trend and the histogram of a quantity, with its limits.

    Parameters
    ----------
    series : Series
        Values in the order of the measurements.

    Returns
    -------
    matplotlib.figure.Figure
        Trend with intervals on the left, histogram on the same axis on the right.
    """
    from matplotlib.ticker import MaxNLocator

    figure = new_figure(SERIES_INCH, layout="constrained")
    trend, histogram = figure.subplots(1, 2, sharey=True, width_ratios=(3, 1))
    _draw_trend(trend, series)
    count = len(series.values)
    bins = int(np.clip(math.ceil(math.sqrt(count)), 1, MAX_BINS))
    histogram.hist(series.values, bins=bins, orientation="horizontal", color=POINTS)
    histogram.set_xlabel("parts")
    limits = [limit for limit in series.limits if math.isfinite(limit)]
    name = "limits" if len(limits) > 1 else "limit"
    for axes in (trend, histogram):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))  # numbers of parts
        for limit in limits:
            axes.axhline(limit, color=LIMITS, lw=1.2, ls="--", label=label_once(axes, name))
    draw_legend(trend)
    return figure


def _draw_trend(axes: Axes, series: Series) -> None:
    """Draw the values with their intervals in the order of the measurements, by verdict."""
    numbers = np.array(series.numbers)
    values = np.array(series.values)
    error_bars = np.abs([values - series.lows, np.subtract(series.highs, values)])
    for decision, marker in MARKERS.items():
        mask = np.array([judged == decision for judged in series.decisions])
        if mask.any():
            axes.errorbar(
                numbers[mask], values[mask], yerr=error_bars[:, mask], fmt=marker, ms=4.5, lw=0.9,
                color=DECISIONS[decision.value], label=str(decision),
            )  # fmt: skip
    axes.set_xlabel("measurement")
    axes.set_ylabel(series.quantity.heading)
    axes.grid(visible=True, lw=0.3, alpha=0.5)


def draw_judged_profile(measurement: Measurement, verdict: Verdict) -> Figure | None:
    """Return a figure of a profile with its ellipses, and the limits of their sizes as dashed ones.

    Parameters
    ----------
    measurement : Measurement
        Judged measurement.
    verdict : Verdict
        Verdict on the measurement.

    Returns
    -------
    matplotlib.figure.Figure or None
        None if the measurement has no profile.
    """
    if measurement.profile is None:
        return None
    figure = new_figure(PROFILE_INCH, layout="constrained")
    axes = figure.add_subplot()
    draw_on_axes(axes, measurement.profile, measurement)
    for item in verdict.parts:
        if item.cylinder is None:
            continue
        ellipse = measurement.cylinders[item.cylinder].ellipse
        for quantity in item.quantities:
            if quantity.key in RADII_PER_UNIT:
                for limit in filter(math.isfinite, quantity.limits):
                    _draw_limit(axes, ellipse, RADII_PER_UNIT[quantity.key] * limit)
        x, y = ellipse.centre
        axes.annotate(
            f"{make_printable(item.name)}: {item.decision}", (x, y), xytext=(0, -16),
            textcoords="offset points", ha="center", fontsize=8, parse_math=False,
            color=DECISIONS[item.decision.value],
        )  # fmt: skip
    draw_legend(axes, columns=LEGEND_COLUMNS)
    return figure


def _draw_limit(axes: Axes, ellipse: Ellipse, radius: float) -> None:
    """Draw the ellipse of a cylinder with the same axis whose radius (mm) is a limit."""
    factor = radius / ellipse.semi_minor
    outline = ellipse.points_at(np.linspace(0, 2 * math.pi, 181))
    scaled = np.add(ellipse.centre, factor * (outline - ellipse.centre))
    axes.plot(*scaled.T, ls="--", lw=0.8, color=LIMITS, zorder=1,
              label=label_once(axes, "limits of the radius"))  # fmt: skip
