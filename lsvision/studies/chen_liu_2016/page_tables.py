"""The numbers of the report as tables of the page."""

import math
from collections.abc import Sequence

from lsvision.studies.chen_liu_2016.ablation import AblationResult
from lsvision.studies.chen_liu_2016.accuracy import KNOWN
from lsvision.studies.chen_liu_2016.achievability import Achievability
from lsvision.studies.chen_liu_2016.html import digits, table
from lsvision.studies.chen_liu_2016.methods import METHODS
from lsvision.studies.chen_liu_2016.paper_pitfalls import Pitfall
from lsvision.studies.chen_liu_2016.published_results import (
    PUBLISHED_AXIS_MM,
    PUBLISHED_BOX_MM,
    QUANTITIES,
)
from lsvision.studies.chen_liu_2016.repeatability import Repeatability
from lsvision.studies.chen_liu_2016.report import PaperReport
from lsvision.studies.chen_liu_2016.scenes import SceneFigure
from lsvision.studies.chen_liu_2016.timing import Timing

NAMES = {
    "radius_mm": "Radius error, mm",
    "theta_deg": "θ error, degrees",
    "phi_deg": "φ error, degrees",
}
SHORT = {"radius_mm": "radius, mm", "theta_deg": "θ, °", "phi_deg": "φ, °"}


def error_tables(report: PaperReport) -> list[str]:
    """Tables 1-4: printed error, the bound of one section, and the errors of the five ways."""
    tables = sorted({row.printed.table for row in report.rows})
    return [_error_table(report, number) for number in tables]


def reach_table(reaches: Sequence[Achievability]) -> str:
    """Which printed figures one section can give, and what it would take."""
    rows: list[list[str]] = []
    for number in sorted({reach.table for reach in reaches}):
        rows.append([f"Table {number}"])
        rows += [_reach_row(reach) for reach in reaches if reach.table == number]
    head = ("Quantity", "Largest printed error", "Best possible, one section",
            "Chance of errors so small", "From one section?", "Sections that do",
            "Noise it would take, mm")  # fmt: skip
    return table("The printed errors against the best possible", head, rows)


def timing_table(timings: Sequence[Timing]) -> str:
    """Table 5: the paper's seconds and those of both chains."""
    head = ("Condition", "Paper, Matlab: s", "per pipe: s", "(a) paper’s chain: s", "per pipe: s",
            "(b) lsvision: ms", "per pipe: ms", "Ratio a/b")  # fmt: skip
    rows = []
    for timing in timings:
        printed, each = timing.printed, timing.printed.pipes
        paper, ours = timing.paper.seconds, timing.section.seconds
        rows.append([
            printed.condition, f"{printed.seconds:.3f}", f"{printed.seconds / each:.3f}",
            digits(paper, 3), digits(paper / each, 3),
            digits(1000 * ours), digits(1000 * ours / each), f"{timing.ratio:.0f}",
        ])  # fmt: skip
    return table("Time of one measurement", head, rows)


def recognition_table(timings: Sequence[Timing]) -> str:
    """What both chains reported in the scenes of Table 5."""
    head = ("Condition", "Pipes there", "(a) found", "(a) false", "(b) found", "(b) false")
    rows = [
        [timing.printed.condition, str(timing.pipes), str(timing.paper.found),
         str(timing.paper.false), str(timing.section.found), str(timing.section.false)]
        for timing in timings
    ]  # fmt: skip
    return table("Pipes found, and results that are no pipe", head, rows)


def scene_table(scene: SceneFigure) -> str:
    """What is true of the pipes of a scene, and what was found."""
    rows = []
    for number, pipe in enumerate(scene.pipes, 1):
        truth = (pipe.true_radius_mm, pipe.true_theta_deg, pipe.true_phi_deg)
        found = (pipe.radius_mm, pipe.theta_deg, pipe.phi_deg)
        for name, true, value in zip(SHORT.values(), truth, found, strict=True):
            shown = "! not found" if value is None else f"{value[0]:.2f} ± {value[1]:.2f}"
            rows.append([f"pipe {number}, {name}", f"{true:.2f}", shown])
    return table(f"{scene.false} results that are no pipe", ("", "true", "found"), rows)


def repeatability_table(repeated: Repeatability) -> str:
    """Spread of centre and axes against the bound and the paper."""
    names = ("centre X", "centre Y", "long semi-axis a", "short semi-axis b (the radius)")
    boxes = (*repeated.box_mm, None, None)
    expected = (*repeated.expected_box_mm, None, None)
    limits = (PUBLISHED_BOX_MM, PUBLISHED_BOX_MM, PUBLISHED_AXIS_MM, PUBLISHED_AXIS_MM)
    rows = []
    for number, name in enumerate(names):
        box, best = boxes[number], expected[number]
        rows.append([
            name, digits(repeated.stds_mm[number]), digits(repeated.bound_stds_mm[number]),
            "" if box is None else digits(box), "" if best is None else digits(best),
            f"{limits[number]:g}",
        ])  # fmt: skip
    head = ("Units: mm", "Spread, one sigma", "Best possible", "Box of all",
            "Box, best possible", "Paper: box, or axes vary by less")  # fmt: skip
    return table(f"{len(repeated.ellipses)} measurements of one position", head, rows)


def ablation_table(costs: Sequence[AblationResult]) -> str:
    """What every variant costs."""
    rows: list[list[str]] = []
    group = ""
    for cost in costs:
        if cost.group != group:
            group = cost.group
            rows.append([group[0].upper() + group[1:]])
        rows.append([cost.name, *(digits(value) for value in (*cost.typical, *cost.worst)),
                     digits(cost.evaluations), str(cost.failed)])  # fmt: skip
    head = ("Chain", "radius, typical", "θ, typical", "φ, typical", "radius, worst", "θ, worst",
            "φ, worst", "evaluations", "no ellipse")  # fmt: skip
    return table(f"Error over the best possible, {costs[0].pipes} pipes", head, rows)


def trap_table(trap: Pitfall) -> str:
    """The numbers that show a trap."""
    rows = []
    for check in trap.checks:
        nothing = math.isnan(check.value)
        rows.append([check.what, "no value (0/0)" if nothing else f"{check.value:.4g}"])
    return table("Checked", ("what", "value"), rows)


def _error_table(report: PaperReport, number: int) -> str:
    own = [row for row in report.rows if row.printed.table == number]
    rows: list[list[str]] = []
    for quantity in QUANTITIES:
        rows.append([NAMES[quantity]])
        for row in own:
            printed = row.printed
            welded = f"φ {printed.phi_deg:g}°, no. {printed.number}"
            cells = [welded if number == 4 else f"r = {printed.radius_mm:g} mm",
                     f"{getattr(printed.errors, quantity):+.3f}".replace("-", "−"),
                     digits(getattr(row.spreads["section"].bound, quantity))]  # fmt: skip
            for spread in row.spreads.values():
                rms = getattr(spread.rms, quantity)
                missed = f" ({spread.missed} missed)" if spread.missed else ""
                cells.append(("given" if rms < KNOWN else digits(rms)) + missed)
            rows.append(cells)
    head = ("Pipe", "Printed error", "Best possible, one section",
            *(f"({info.letter}) {info.short}" for info in METHODS.values()))  # fmt: skip
    first = own[0].printed
    title = f"single pipes, θ = {first.theta_deg:g}°, φ = {first.phi_deg:g}°"
    if number == 4:
        title = "pipes of 19 mm welded together, θ = 10, 20, 30° at φ = 30, 20, 10°"
    return table(f"Table {number}: {title}. Typical errors", head, rows)


def _reach_row(reach: Achievability) -> list[str]:
    unit = reach.quantity.rsplit("_", 1)[1]
    chance = reach.chance
    said = f"{100 * chance:.0f} %" if chance >= 0.01 else "under 1 in 100,000"
    if 1e-5 <= chance < 0.01:
        said = f"1 in {float(f'{1 / chance:.2g}'):,.0f}"
    verdict = "+ yes" if reach.reachable else "! no"
    needed = "over 2048" if reach.sections_needed is None else str(reach.sections_needed)
    return [SHORT[reach.quantity].split(",")[0], f"{reach.largest_printed:.3f} {unit}",
            f"{digits(reach.best_sigma)} {unit}", said, verdict, needed,
            digits(reach.noise_needed_mm)]  # fmt: skip
