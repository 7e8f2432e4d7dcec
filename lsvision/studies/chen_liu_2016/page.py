"""Report as one self-contained HTML page, for readers who do not know the code.

The text is in ``templates/report.html.j2``; this module computes the numbers in it.
"""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from lsvision.results.html import build_html_environment
from lsvision.studies.chen_liu_2016.ablation import SECTION_SETTINGS
from lsvision.studies.chen_liu_2016.achievability import SIGNIFICANCE
from lsvision.studies.chen_liu_2016.methods import Method
from lsvision.studies.chen_liu_2016.pictures import (
    draw_recognition,
    draw_repeatability,
    draw_scene,
    draw_screening,
    draw_smoothing,
    draw_tables,
)
from lsvision.studies.chen_liu_2016.published_results import (
    PUBLISHED_AXIS_MM,
    PUBLISHED_BOX_MM,
    Triple,
)
from lsvision.studies.chen_liu_2016.repeatability import POSITION, phi_std_of_axes
from lsvision.studies.chen_liu_2016.report import PaperReport
from lsvision.studies.chen_liu_2016.report_tables import (
    build_ablation_table,
    build_achievability_table,
    build_error_table,
    build_pitfall_table,
    build_repeatability_table,
    build_scene_table,
    build_timing_table,
    format_significant,
    match_table,
)
from lsvision.studies.chen_liu_2016.tables import ErrorStatistics, pool_errors

if TYPE_CHECKING:
    from jinja2 import Environment

MAX_COST_RATIO = 1.1
"""Ratio of a variant's errors to those of the complete pipeline up to which it is as accurate."""


def render_report_page(report: PaperReport) -> str:
    """Return the report as one self-contained HTML page: pictures inline, no other files."""

    def pooled(method: Method, table: int) -> ErrorStatistics:
        """Return the errors of a method over all pipes of a table."""
        rows = [row for row in report.rows if row.printed.table == table]
        return pool_errors([row.spreads[method] for row in rows])

    return (
        _build_environment()
        .get_template("report.html.j2")
        .render(
            report=report,
            pictures=_draw_pictures(report),
            tables=_build_tables(report),
            pooled=pooled,
            largest_printed=_find_largest_printed_errors(report, table=3),
            unreachable=_count_unreachable_errors(report),
            published_box_mm=PUBLISHED_BOX_MM,
            published_axis_mm=PUBLISHED_AXIS_MM,
            phi_std_of_published_axes=phi_std_of_axes(
                PUBLISHED_AXIS_MM / 2, POSITION.radius_mm, 10.0
            ),
            jump_fraction=SECTION_SETTINGS.jump_fraction,
            max_cost_percent=100 * (MAX_COST_RATIO - 1),
            variants_without_cost=_list_variants_without_cost(report),
        )
    )


@cache
def _build_environment() -> "Environment":
    """Return the environment of this package's templates, with its filters."""
    environment = build_html_environment("lsvision.studies.chen_liu_2016")
    environment.filters["significant"] = format_significant
    environment.filters["anchor"] = _build_anchor
    return environment


def _build_anchor(heading: str) -> str:
    """Return the fragment identifier of a heading: letters, digits, and hyphens for spaces."""
    return "".join(c for c in heading.lower() if c.isalnum() or c == " ").replace(" ", "-")


def _draw_pictures(report: PaperReport) -> dict[str, Any]:
    """Return every figure of the page as SVG."""
    return {
        "tables": draw_tables(report.rows),
        "recognition": draw_recognition(report.steps),
        "screening": draw_screening(report.steps),
        "smoothing": draw_smoothing(report.steps),
        "scenes": [draw_scene(scene, number) for number, scene in enumerate(report.scenes)],
        "repeatability": draw_repeatability(report.repeatability),
    }


def _build_tables(report: PaperReport) -> dict[str, Any]:
    """Return every table of the page."""
    numbers = sorted({row.printed.table for row in report.rows})
    return {
        "errors": [build_error_table(report.rows, number) for number in numbers],
        "achievability": build_achievability_table(report.achievability),
        "timing": build_timing_table(report.timings),
        "matches": match_table(report.timings),
        "scenes": [build_scene_table(scene) for scene in report.scenes],
        "repeatability": build_repeatability_table(report.repeatability),
        "ablation": build_ablation_table(report.ablation),
        "pitfalls": [build_pitfall_table(pitfall) for pitfall in report.pitfalls],
    }


def _find_largest_printed_errors(report: PaperReport, table: int) -> Triple:
    """Return the largest absolute error of each quantity in a table of the paper."""
    results = [result for result in report.achievability if result.table == table]
    return Triple(**{result.quantity: result.largest_printed for result in results})


@dataclass(frozen=True, slots=True)
class _UnreachableErrors:
    """Groups of printed errors (a quantity of a table) that are too small for one section.

    Parameters
    ----------
    groups : int
        Number of groups at the report's noise.
    groups_at_figure_16_noise : int
        Number of groups at the noise at which centres from one section fill the box of Figure 16.
    sections_needed : int
        Sections 1 mm apart that reach all groups that a scan can reach; 0 without such a group.
    """

    groups: int
    groups_at_figure_16_noise: int
    sections_needed: int


def _count_unreachable_errors(report: PaperReport) -> _UnreachableErrors:
    """Return how many groups of printed errors are too small for one section."""
    unreachable = [result for result in report.achievability if not result.reachable]
    noise_ratio = report.repeatability.noise_of_printed_box_mm / report.noise_mm
    return _UnreachableErrors(
        groups=len(unreachable),
        groups_at_figure_16_noise=sum(
            result.compute_chance_at(noise_ratio) < SIGNIFICANCE for result in report.achievability
        ),
        sections_needed=max((result.sections_needed or 0 for result in unreachable), default=0),
    )


def _list_variants_without_cost(report: PaperReport) -> list[str]:
    """Return the names of variants with all errors within `MAX_COST_RATIO` of the pipeline's."""
    complete, *variants = report.ablation
    limits = MAX_COST_RATIO * np.array([*complete.typical, *complete.worst])
    return [
        result.name
        for result in variants
        if (np.array([*result.typical, *result.worst]) < limits).all()
    ]
