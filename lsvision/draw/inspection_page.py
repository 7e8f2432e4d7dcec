"""Inspections as one page for people: verdicts, pictures, statistics, and what they rest on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from lsvision.draw.figure_files import svg_element
from lsvision.draw.inspection_figures import draw_judged_profile, draw_series
from lsvision.inspection.capability import NOT_CLAIMED, Capability
from lsvision.inspection.decision import Decision
from lsvision.inspection.inspected import Inspected, Series, series_of, shares_of
from lsvision.inspection.job import Job
from lsvision.inspection.verdict import item_cells
from lsvision.measure import Measurement
from lsvision.results.html import html_environment
from lsvision.results.quantities import Record

MAX_PARTS = 20
"""Measurements that have a section of their own; of more, those that are not OK come first."""
MIN_TREND = 2
"""Measurements from which on a trend is drawn."""


@dataclass(frozen=True)
class InspectionContext:
    """What stands around the verdicts of a page.

    Parameters
    ----------
    job : Job
        The job.
    made : str
        When the page was made.
    calibration_days : float, optional
        Age of the oldest calibration.
    golden : sequence of dict
        Log of the golden part, the oldest check first.
    """

    job: Job
    made: str
    calibration_days: float | None
    golden: Sequence[Record]


def inspection_page(inspected: Sequence[Inspected], context: InspectionContext) -> str:
    """Return a page of one measurement or many.

    Parameters
    ----------
    inspected : sequence of Inspected
        At least one.
    context : InspectionContext
        Job, date, calibration, golden part.

    Returns
    -------
    str
        HTML that needs no other file; laid out for screens, phones and A4 paper.
    """
    several = len(inspected) >= MIN_TREND
    series = series_of(inspected) if several else []
    shown = list(inspected)
    if len(shown) > MAX_PARTS:
        shown.sort(key=lambda each: each.verdict.decision == Decision.OK)
        shown = shown[:MAX_PARTS]
    template = html_environment("lsvision.draw").get_template("inspection.html.j2")
    return template.render(
        context=context,
        provenance=inspected[0].verdict.provenance,
        total=len(inspected),
        shares=shares_of(inspected) if several else [],
        blocked=inspected[0].verdict.blocked,
        series=[_series_values(each) for each in series],
        parts=[_part_values(each) for each in shown],
        left_out=len(inspected) - len(shown),
        note=NOT_CLAIMED,
    )


def _series_values(series: Series) -> dict[str, Any]:
    found = series.capability
    return {
        "heading": f"{series.item}, {series.quantity.heading}",
        "count": len(series.values),
        "picture": svg_element(draw_series(series)),
        "rows": [] if found is None else _capability_rows(found),
    }


def _capability_rows(found: Capability) -> list[tuple[str, str]]:
    low, high = found.cpk_interval
    rows = [
        ("mean", f"{found.mean:.5g}"),
        ("standard deviation", f"{found.std:.3g}"),
        ("Cpk", f"{found.cpk:.2f} ({low:.2f} .. {high:.2f})"),
        ("measurement's share of the variance", f"{100 * found.measurement_share:.0f} %"),
    ]
    if found.cp == found.cp:  # not NaN: both limits are there
        low, high = found.cp_interval
        rows.insert(2, ("Cp", f"{found.cp:.2f} ({low:.2f} .. {high:.2f})"))
    return rows


def _part_values(each: Inspected) -> dict[str, Any]:
    verdict, figure = each.verdict, None
    if isinstance(each.measurement, Measurement):
        figure = draw_judged_profile(each.measurement, verdict)
    name = f"{each.source}, profile {each.profile}" if each.profile else each.source
    return {
        "name": name,
        "decision": str(verdict.decision),
        "cells": item_cells(verdict.items),
        "notes": verdict._notes()[1:],
        "remedies": [f"{r.item}, {r.quantity}: {r.text}" for r in each.remedies],
        "picture": "" if figure is None else svg_element(figure),
    }
