"""HTML page of an inspection: verdicts, pictures, statistics, and provenance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from lsvision.draw.figures import (
    create_figure,
    draw_legend,
    label_once,
    make_printable,
    render_svg_element,
)
from lsvision.draw.measurement import draw_on_axes
from lsvision.geometry import Ellipse
from lsvision.inspection.capability import NOT_CLAIMED, Capability
from lsvision.inspection.decision import Decision
from lsvision.inspection.job import Job
from lsvision.inspection.judged_measurements import (
    JudgedMeasurement,
    Series,
    collect_series,
    count_verdicts,
)
from lsvision.inspection.verdict import Verdict, explain_verdict, format_item_cells
from lsvision.measure import Measurement
from lsvision.results.html import build_html_environment
from lsvision.results.palette import DECISIONS, LIMITS, POINTS
from lsvision.results.quantities import Record

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
MAX_DRAWN_MEASUREMENTS = 20
"""Largest number of measurements with a section of their own; of more, those that are not OK come
first."""
MIN_TREND_MEASUREMENTS = 2
"""Smallest number of measurements for a trend and for counts of the verdicts."""


def draw_series(series: Series) -> Figure:
    """Return a figure of the trend of a quantity with intervals, its histogram, and its limits."""
    from matplotlib.ticker import MaxNLocator

    figure = create_figure(SERIES_INCH, layout="constrained")
    trend, histogram = figure.subplots(1, 2, sharey=True, width_ratios=(3, 1))
    _draw_trend(trend, series)
    count = len(series.values)
    bins = int(np.clip(math.ceil(math.sqrt(count)), 1, MAX_BINS))
    histogram.hist(series.values, bins=bins, orientation="horizontal", color=POINTS)
    histogram.set_xlabel("parts")
    limits = [limit for limit in series.limits if math.isfinite(limit)]
    name = "limits" if len(limits) > 1 else "limit"
    for axes, ticks in ((trend, 10), (histogram, 4)):
        axes.xaxis.set_major_locator(MaxNLocator(ticks, integer=True))  # numbers of parts
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

    None if the measurement has no profile.
    """
    if measurement.profile is None:
        return None
    figure = create_figure(PROFILE_INCH, layout="constrained")
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


@dataclass(frozen=True)
class InspectionContext:
    """Content of a page apart from the verdicts.

    `made` is the date and time of the page, `calibration_days` the age of the oldest calibration in
    days (None if unknown, or the job names none), `golden` the log of the golden part, the oldest
    check first, `not_judged` the reasons why files are not judged.
    """

    job: Job
    made: str
    calibration_days: float | None
    golden: Sequence[Record]
    not_judged: Sequence[str] = ()


def render_inspection_page(
    measurements: Sequence[JudgedMeasurement], context: InspectionContext
) -> str:
    """Return the HTML page of one measurement or many.

    It has no references to other files, and is laid out for screens, phones and A4 paper.
    """
    several = len(measurements) >= MIN_TREND_MEASUREMENTS
    series = collect_series(measurements) if several else []
    shown = list(measurements)
    if len(shown) > MAX_DRAWN_MEASUREMENTS:
        shown.sort(key=lambda judged: judged.verdict.decision == Decision.OK)  # False is first
        shown = shown[:MAX_DRAWN_MEASUREMENTS]
    template = build_html_environment("lsvision.draw").get_template("inspection.html.j2")
    return template.render(
        context=context,
        provenance=measurements[0].verdict.provenance,
        total=len(measurements),
        counts=count_verdicts(measurements) if several else [],
        colours=DECISIONS,
        blocked=measurements[0].verdict.blocked,
        series=[_describe_series(one_series) for one_series in series],
        parts=[_describe_part(judged) for judged in shown],
        left_out=len(measurements) - len(shown),
        note=NOT_CLAIMED,
    )


def _describe_series(series: Series) -> dict[str, Any]:
    """Return the values of a quantity over all measurements for the template of the page."""
    capability = series.capability
    return {
        "heading": f"{series.item}, {series.quantity.heading}",
        "count": len(series.values),
        "picture": render_svg_element(draw_series(series)),
        "rows": [] if capability is None else _list_capability_rows(capability),
    }


def _list_capability_rows(capability: Capability) -> list[tuple[str, str]]:
    """Return the rows of a capability table: name and value; Cp only if there are two limits."""
    rows = [
        ("mean", f"{capability.mean:.5g}"),
        ("standard deviation", f"{capability.std:.3g}"),
        ("Cpk", _format_index(capability.cpk, capability.cpk_interval, capability.level)),
        (
            "measurement's fraction of the variance",
            f"{100 * capability.measurement_fraction:.0f} %",
        ),
    ]
    if not math.isnan(capability.cp):
        index = _format_index(capability.cp, capability.cp_interval, capability.level)
        rows.insert(2, ("Cp", index))
    return rows


def _format_index(index: float, interval: tuple[float, float], level: float) -> str:
    """Return the cell of Cp or Cpk: value and interval with its level of confidence."""
    low, high = interval
    return f"{index:.2f} ({100 * level:g} % interval {low:.2f} .. {high:.2f})"


def _describe_part(judged: JudgedMeasurement) -> dict[str, Any]:
    """Return the values of a judged measurement for the template of the page."""
    verdict, figure = judged.verdict, None
    if isinstance(judged.measurement, Measurement):
        figure = draw_judged_profile(judged.measurement, verdict)
    name = f"{judged.source}, profile {judged.profile}" if judged.profile else judged.source
    return {
        "name": name,
        "decision": str(verdict.decision),
        "cells": format_item_cells(verdict.items),
        "notes": explain_verdict(verdict),
        "remedies": [str(remedy) for remedy in judged.remedies],
        "picture": "" if figure is None else render_svg_element(figure),
    }
