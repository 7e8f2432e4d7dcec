"""Tables of the report's page, and the table of ``.github/ACCURACY.md``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lsvision.planning.plan import MAX_SECTIONS
from lsvision.studies.chen_liu_2016.ablation import AblationResult
from lsvision.studies.chen_liu_2016.achievability import Achievability
from lsvision.studies.chen_liu_2016.methods import METHODS
from lsvision.studies.chen_liu_2016.paper_pitfalls import Pitfall
from lsvision.studies.chen_liu_2016.published_results import (
    PUBLISHED_AXIS_MM,
    PUBLISHED_BOX_MM,
    QUANTITIES,
)
from lsvision.studies.chen_liu_2016.repeatability import Repeatability
from lsvision.studies.chen_liu_2016.scenes import SceneFigure, Timing
from lsvision.studies.chen_liu_2016.tables import TableRow, pool_errors

README_HEAD = ("Paper's Table", "", "Radius, mm", "θ, °", "φ, °")
"""Names of the columns of `format_readme_table`; the second column names the method."""
ERROR_NAMES = {
    "radius_mm": "Radius error, mm",
    "theta_deg": "θ error, degrees",
    "phi_deg": "φ error, degrees",
}
"""Headings of the errors of each quantity."""
QUANTITY_NAMES = {"radius_mm": "radius, mm", "theta_deg": "θ, °", "phi_deg": "φ, °"}
"""Heading of each quantity."""


@dataclass(frozen=True, slots=True)
class Cell:
    """Cell of a table.

    Parameters
    ----------
    text : str
        Content of the cell.
    mark : {"", "good", "bad"}
        Kind of highlighting.
    """

    text: str
    mark: str = ""


@dataclass(frozen=True, slots=True)
class Row:
    """Row of a table: its name in the first column, and the cells of the others.

    Parameters
    ----------
    name : str
        Text of the first column; of the whole row without `cells`.
    cells : tuple of Cell
        Other cells; none for a heading that spans all columns.
    """

    name: str
    cells: tuple[Cell, ...] = ()

    @property
    def is_group(self) -> bool:
        """Whether the row is a heading for those below it."""
        return not self.cells


@dataclass(frozen=True, slots=True)
class Table:
    """Table of the page.

    Parameters
    ----------
    caption : str
        Text above the table.
    head : tuple of str
        Names of the columns.
    rows : tuple of Row
        Rows from top to bottom.
    """

    caption: str
    head: tuple[str, ...]
    rows: tuple[Row, ...]


def format_significant(value: float, digits: int = 2) -> str:
    """Return a number with some significant digits without exponent; a dash for NaN and infinity.

    Digits before the decimal point are not rounded.

    Examples
    --------
    >>> [format_significant(value) for value in (0.01234, 0.996, 12.6, 123.4, float("nan"))]
    ['0.012', '1.0', '13', '123', '–']
    """
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])  # of the rounded number
    return f"{value:.{max(digits - 1 - exponent, 0)}f}"


def format_readme_table(rows: Sequence[TableRow]) -> str:
    """Return the rms errors of Tables 1-4, as in ``.github/ACCURACY.md``, as a Markdown table.

    The numbers in brackets are the Cramer-Rao bound, which depends on geometry and noise only: a
    test compares them with that file without measuring.
    """
    lines = [_format_markdown_row(*README_HEAD), "|---|---|---|---|---|"]
    for table in sorted({row.printed.table for row in rows}):
        table_rows = [row for row in rows if row.printed.table == table]
        first = table_rows[0].printed
        name = f"{table}: φ = {first.phi_deg:g}°" if table < 4 else "4, welded: φ = 30, 20, 10°"
        printed = [
            format_significant(max(abs(getattr(row.printed.errors, q)) for row in table_rows))
            for q in QUANTITIES
        ]
        lines.append(_format_markdown_row(name, "largest error printed", *printed))
        for method, info in METHODS.items():
            pooled = pool_errors([row.spreads[method] for row in table_rows])
            cells = [
                _format_rms_and_bound(getattr(pooled.rms, q), getattr(pooled.bound, q))
                for q in QUANTITIES
            ]
            lines.append(_format_markdown_row("", f"({info.letter}) {info.name}", *cells))
    return "\n".join(lines) + "\n"


def _format_rms_and_bound(rms: float, bound: float) -> str:
    """Return ``rms (bound)`` as text; "given" for a known radius, whose bound is 0."""
    if bound == 0:
        return "given"
    return f"{format_significant(rms)} ({format_significant(bound)})"


def _format_markdown_row(*cells: str) -> str:
    """Return cells as a row of a Markdown table."""
    return "| " + " | ".join(cells) + " |"


def build_error_table(rows: Sequence[TableRow], number: int) -> Table:
    """Return one of Tables 1-4: printed errors, one section's bound, rms errors of the methods."""
    table_rows = [row for row in rows if row.printed.table == number]
    lines: list[Row] = []
    for quantity in QUANTITIES:
        lines.append(Row(ERROR_NAMES[quantity]))
        lines += [_build_error_row(row, quantity) for row in table_rows]
    head = ("Pipe", "Printed error", "Best possible, one section",
            *(f"({info.letter}) {info.short}" for info in METHODS.values()))  # fmt: skip
    first = table_rows[0].printed
    title = f"single pipes, θ = {first.theta_deg:g}°, φ = {first.phi_deg:g}°"
    if number == 4:
        title = "pipes of 19 mm welded together, θ = 10, 20, 30° at φ = 30, 20, 10°"
    return Table(f"Table {number}: {title}. Typical errors", head, tuple(lines))


def _build_error_row(row: TableRow, quantity: str) -> Row:
    """Return printed error, bound and rms error of each method for a quantity of a pipe."""
    printed = row.printed
    name = f"r = {printed.radius_mm:g} mm"
    if printed.table == 4:
        name = f"φ {printed.phi_deg:g}°, no. {printed.number}"
    errors = []
    for statistics in row.spreads.values():
        rms = getattr(statistics.rms, quantity)
        missed = f" ({statistics.missed} missed)" if statistics.missed else ""
        given = getattr(statistics.bound, quantity) == 0  # the radius is known
        errors.append(("given" if given else format_significant(rms)) + missed)
    return _build_row(
        name,
        f"{getattr(printed.errors, quantity):+.3f}".replace("-", "−"),
        format_significant(getattr(row.spreads["section"].bound, quantity)),
        *errors,
    )


def build_achievability_table(results: Sequence[Achievability]) -> Table:
    """Return the table of printed errors that one section reaches, and of the sections needed."""
    rows: list[Row] = []
    for number in sorted({result.table for result in results}):
        rows.append(Row(f"Table {number}"))
        rows += [_build_achievability_row(result) for result in results if result.table == number]
    head = ("Quantity", "Largest printed error", "Best possible, one section",
            "Probability of errors so small", "From one section?", "Sections needed",
            "Noise needed, mm")  # fmt: skip
    return Table("The printed errors against the best possible", head, tuple(rows))


def _build_achievability_row(result: Achievability) -> Row:
    """Return a row of `build_achievability_table`."""
    unit = result.quantity.rsplit("_", 1)[1]
    return Row(
        QUANTITY_NAMES[result.quantity].split(",")[0],
        (
            Cell(f"{result.largest_printed:.3f} {unit}"),
            Cell(f"{format_significant(result.best_sigma)} {unit}"),
            Cell(_format_probability(result.chance)),
            Cell("yes", "good") if result.reachable else Cell("no", "bad"),
            Cell(str(result.sections_needed or f"over {MAX_SECTIONS}")),
            Cell(format_significant(result.noise_needed_mm)),
        ),
    )


def _format_probability(probability: float) -> str:
    """Return a probability in percent, a small one as ``1 in n``."""
    if probability >= 0.01:
        return f"{100 * probability:.0f} %"
    if probability >= 1e-5:
        return f"1 in {float(f'{1 / probability:.2g}'):,.0f}"
    return "under 1 in 100,000"


def build_timing_table(timings: Sequence[Timing]) -> Table:
    """Return Table 5: the times of the paper and of both pipelines."""
    head = ("Condition", "Paper, Matlab: s", "per pipe: s", "(a) paper’s pipeline: s",
            "per pipe: s", "(b) lsvision: ms", "per pipe: ms", "Ratio a/b")  # fmt: skip
    rows = []
    for timing in timings:
        printed, pipes = timing.printed, timing.printed.pipes
        paper_s, lsvision_ms = timing.paper.seconds, 1000 * timing.section.seconds
        rows.append(_build_row(
            printed.condition, f"{printed.seconds:.3f}", f"{printed.seconds / pipes:.3f}",
            format_significant(paper_s, 3), format_significant(paper_s / pipes, 3),
            format_significant(lsvision_ms), format_significant(lsvision_ms / pipes),
            f"{timing.ratio:.0f}",
        ))  # fmt: skip
    return Table("Time of one measurement", head, tuple(rows))


def match_table(timings: Sequence[Timing]) -> Table:
    """Return the table of pipes found and false results of both pipelines (scenes of Table 5)."""
    head = ("Condition", "Pipes present", "(a) found", "(a) false", "(b) found", "(b) false")
    rows = [
        _build_row(timing.printed.condition, str(timing.pipes), str(timing.paper.found),
             str(timing.paper.false), str(timing.section.found), str(timing.section.false))
        for timing in timings
    ]  # fmt: skip
    return Table("Pipes found, and results that are not pipes", head, tuple(rows))


def build_scene_table(scene: SceneFigure) -> Table:
    """Return the table of true and measured values of the pipes in a scene."""
    rows = []
    for number, pipe in enumerate(scene.pipes, 1):
        true_values = (pipe.true_radius_mm, pipe.true_theta_deg, pipe.true_phi_deg)
        results = (pipe.radius_mm, pipe.theta_deg, pipe.phi_deg)
        for name, true, result in zip(QUANTITY_NAMES.values(), true_values, results, strict=True):
            measured = Cell("not found", "bad")
            if result is not None:
                measured = Cell(f"{result[0]:.2f} ± {result[1]:.2f}")
            rows.append(Row(f"pipe {number}, {name}", (Cell(f"{true:.2f}"), measured)))
    return Table(f"{scene.false} results that are not pipes", ("", "true", "found"), tuple(rows))


def build_repeatability_table(repeatability: Repeatability) -> Table:
    """Return the table of std of centre and semi-axes, the bound, and the paper's figures."""
    names = ("centre X", "centre Y", "long semi-axis a", "short semi-axis b (the radius)")
    boxes = [format_significant(side) for side in repeatability.box_mm]
    bound_boxes = [format_significant(side) for side in repeatability.expected_box_mm]
    limits = (PUBLISHED_BOX_MM, PUBLISHED_BOX_MM, PUBLISHED_AXIS_MM, PUBLISHED_AXIS_MM)
    rows = [
        _build_row(
            name, format_significant(std), format_significant(bound), box, bound_box, f"{limit:g}"
        )
        for name, std, bound, box, bound_box, limit in zip(
            names, repeatability.stds_mm, repeatability.bound_stds_mm,
            [*boxes, "", ""], [*bound_boxes, "", ""], limits, strict=True,
        )
    ]  # fmt: skip
    head = ("Units: mm", "Standard deviation", "Best possible", "Box of all",
            "Box, best possible", "Paper: box, or axes vary by less")  # fmt: skip
    count = len(repeatability.ellipses)
    return Table(f"{count} measurements of one position", head, tuple(rows))


def build_ablation_table(results: Sequence[AblationResult]) -> Table:
    """Return the table of errors of every variant in units of the bound."""
    rows: list[Row] = []
    group = ""
    for result in results:
        if result.group != group:
            group = result.group
            rows.append(Row(group[0].upper() + group[1:]))
        errors = [format_significant(value) for value in (*result.typical, *result.worst)]
        evaluations = format_significant(result.evaluations)
        rows.append(_build_row(result.name, *errors, evaluations, str(result.failed)))
    head = ("Pipeline", "radius, typical", "θ, typical", "φ, typical", "radius, worst", "θ, worst",
            "φ, worst", "evaluations", "no ellipse")  # fmt: skip
    return Table(f"Error over the best possible, {results[0].pipes} pipes", head, tuple(rows))


def build_pitfall_table(pitfall: Pitfall) -> Table:
    """Return the table of numbers that demonstrate a pitfall."""
    rows = [
        _build_row(
            check.description, "no value (0/0)" if math.isnan(check.value) else f"{check.value:.4g}"
        )
        for check in pitfall.checks
    ]
    return Table("Checked", ("quantity", "value"), tuple(rows))


def _build_row(name: str, *texts: str) -> Row:
    """Return a row of cells without highlighting."""
    return Row(name, tuple(Cell(text) for text in texts))
