"""HTML page of an inspection: verdicts, pictures, statistics, and provenance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from lsvision.draw.figure_files import svg_element
from lsvision.draw.inspection_figures import draw_judged_profile, draw_series
from lsvision.inspection.capability import NOT_CLAIMED, Capability
from lsvision.inspection.decision import Decision
from lsvision.inspection.inspected import JudgedMeasurement, Series, collect_series, count_verdicts
from lsvision.inspection.job import Job
from lsvision.inspection.verdict import explain_verdict, item_cells
from lsvision.measure import Measurement
from lsvision.results.html import html_environment
from lsvision.results.palette import DECISIONS
from lsvision.results.quantities import Record

MAX_PARTS = 20
"""Largest number of measurements with a section of their own; of more, those that are not OK come
first."""
MIN_TREND = 2
"""Smallest number of measurements for a trend and for counts of the verdicts."""


@dataclass(frozen=True)
class InspectionContext:
    """Content of a page apart from the verdicts.

    Parameters
    ----------
    job : Job
        Job of the inspection.
    made : str
        Date and time of the page.
    calibration_days : float, optional
        Age of the oldest calibration; None if it is unknown, or the job names none. Units: days.
    golden : sequence of dict
        Log of the golden part, the oldest check first.
    """

    job: Job
    made: str
    calibration_days: float | None
    golden: Sequence[Record]


def inspection_page(inspected: Sequence[JudgedMeasurement], context: InspectionContext) -> str:
    """Return the HTML page of one measurement or many.

    Parameters
    ----------
    inspected : sequence of JudgedMeasurement
        Measurements with their verdicts, at least one.
    context : InspectionContext
        Job, date, calibration, golden part.

    Returns
    -------
    str
        Page without references to other files, laid out for screens, phones and A4 paper.
    """
    several = len(inspected) >= MIN_TREND
    series = collect_series(inspected) if several else []
    shown = list(inspected)
    if len(shown) > MAX_PARTS:
        shown.sort(key=lambda judged: judged.verdict.decision == Decision.OK)  # False is first
        shown = shown[:MAX_PARTS]
    template = html_environment("lsvision.draw").get_template("inspection.html.j2")
    return template.render(
        context=context,
        provenance=inspected[0].verdict.provenance,
        total=len(inspected),
        counts=count_verdicts(inspected) if several else [],
        colours=DECISIONS,
        blocked=inspected[0].verdict.blocked,
        series=[_series_values(one_series) for one_series in series],
        parts=[_part_values(judged) for judged in shown],
        left_out=len(inspected) - len(shown),
        note=NOT_CLAIMED,
    )


def _series_values(series: Series) -> dict[str, Any]:
    """Return the values of a quantity over all measurements for the template of the page."""
    capability = series.capability
    return {
        "heading": f"{series.item}, {series.quantity.heading}",
        "count": len(series.values),
        "picture": svg_element(draw_series(series)),
        "rows": [] if capability is None else _capability_rows(capability),
    }


def _capability_rows(capability: Capability) -> list[tuple[str, str]]:
    """Return the rows of a capability table: name and value; Cp only if there are two limits."""
    low, high = capability.cpk_interval
    rows = [
        ("mean", f"{capability.mean:.5g}"),
        ("standard deviation", f"{capability.std:.3g}"),
        ("Cpk", f"{capability.cpk:.2f} ({low:.2f} .. {high:.2f})"),
        (
            "measurement's fraction of the variance",
            f"{100 * capability.measurement_fraction:.0f} %",
        ),
    ]
    if not math.isnan(capability.cp):
        low, high = capability.cp_interval
        rows.insert(2, ("Cp", f"{capability.cp:.2f} ({low:.2f} .. {high:.2f})"))
    return rows


def _part_values(judged: JudgedMeasurement) -> dict[str, Any]:
    """Return the values of a judged measurement for the template of the page."""
    verdict, figure = judged.verdict, None
    if isinstance(judged.measurement, Measurement):
        figure = draw_judged_profile(judged.measurement, verdict)
    name = f"{judged.source}, profile {judged.profile}" if judged.profile else judged.source
    return {
        "name": name,
        "decision": str(verdict.decision),
        "cells": item_cells(verdict.items),
        "notes": explain_verdict(verdict),
        "remedies": [str(remedy) for remedy in judged.remedies],
        "picture": "" if figure is None else svg_element(figure),
    }
