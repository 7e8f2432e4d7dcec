"""Text of a commented job file, from the cylinders of a measured profile and a tolerance."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Sequence

from lsvision.ellipse.section import CylinderSection
from lsvision.inspection.job import Job
from lsvision.inspection.job_tables import MAX_NAME_LENGTH
from lsvision.inspection.limits import LIMIT_DECIMALS
from lsvision.inspection.relate import relate
from lsvision.inspection.relation import Relation
from lsvision.results.number_format import format_value

MAX_GAP_STEP = 1e-3
"""Largest step to which the largest permissible gap is rounded. Units: mm."""

HEAD = """\
# A job for lsvision: lsvision job check FILE lists its mistakes, lsvision inspect FILE
# PROFILES judges by it. Lengths are in mm, angles in deg, as the names say.
schema = 1
name = {name}
revision = 1  # increase it with every change

[measure]
radius_mm = [{low:g}, {high:g}]  # where cylinders are searched
# sensor = "lps36hi"  # or range_std_mm = 0.05 at reference_range_mm = 400: the noise
"""
PART = """
[[part]]
name = "part {number}"
x_mm = [{left:.12g}, {right:.12g}]  # which cylinder: by position; or order = {number}
radius_mm = {{ nominal = {radius:.12g}, upper = {tolerance:.12g}, lower = -{tolerance:.12g} }}
# measured: {text}
# known_radius_mm = [{radius:.12g}, 0.05]  # a known radius and its sigma make phi more precise
# phi_deg = {{ max = 5 }}  # measured {phi:.1f}
# centre_x_mm = {{ nominal = {x:.1f}, upper = 1, lower = -1 }}
"""
RELATION = """
[[relation]]
between = ["part {first}", "part {second}"]
gap_mm = {{ max = {gap:.12g} }}  # measured {text}
"""
TAIL = """
[decision]
level = 0.95  # OK and NG are each wrong with a probability of at most 2.5 %
undecided = "ng"  # how an output of one bit (OK or NG) shows an undecided verdict
# extra_std = { radius_mm = 0.01 }  # not in the fit: temperature, repeatability

# [golden]  # a reference part; if it is overdue or failed, every verdict is undecided
# radius_mm = 20
# tolerance_mm = 0.05
# every_hours = 8
"""
"""Texts of the parts of a job: head, each part, each relation, and tail."""


def build_job_text(name: str, cylinders: Sequence[CylinderSection], tolerance: float) -> str:
    """Return the text of a job, in TOML, whose limits contain the measured cylinders.

    Nominal radii are rounded to the power of ten at or below a tenth of the tolerance (above 0, in
    mm), windows in x extend to the middle between neighbours, gaps between neighbours may exceed
    the measured ones by the tolerance (rounded to 1 um or to the same power of ten). The cylinders,
    at least one, are from left to right; of the name 80 characters are written.
    """
    radii = [cylinder.radius for cylinder in cylinders]
    tables = [
        HEAD.format(
            name=_quote_toml_string(name[:MAX_NAME_LENGTH]),
            low=_round_multiple(0.6, min(radii)),
            high=_round_multiple(1.5, max(radii)),
        )
    ]
    for number, (cylinder, window) in enumerate(
        zip(cylinders, _choose_x_windows(cylinders), strict=True), 1
    ):
        tables.append(_format_part(number, cylinder, window, tolerance))
    for number, (first, second) in enumerate(itertools.pairwise(cylinders), 1):
        tables.append(_format_relation(number, first, second, tolerance))
    return "".join([*tables, TAIL])


def _quote_toml_string(text: str) -> str:
    """Return a text as a string of TOML, with ``?`` for bytes of a file name that are no text."""
    valid = text.encode(errors="replace").decode()
    # A string in JSON is also one in TOML, except for escaped pairs of surrogates and raw deletes.
    return json.dumps(valid, ensure_ascii=False).replace("\x7f", "\\u007f")


def _compute_nominal_step(tolerance: float) -> float:
    """Return the power of ten at or below a tenth of the tolerance."""
    return 10.0 ** math.floor(math.log10(tolerance / 10))


def _round_nominal_radius(cylinder: CylinderSection, tolerance: float) -> float:
    """Return the nominal radius that a job with a tolerance states for a cylinder. Units: mm."""
    step = _compute_nominal_step(tolerance)
    return round(round(cylinder.radius / step) * step, 9)


def _format_part(
    number: int, cylinder: CylinderSection, window: tuple[float, float], tolerance: float
) -> str:
    """Return the table of a part, numbered from 1, that lies in a window of x (mm)."""
    return PART.format(
        number=number,
        left=window[0],
        right=window[1],
        radius=_round_nominal_radius(cylinder, tolerance),
        tolerance=tolerance,
        text=format_value(cylinder.radius, cylinder.radius_std),
        phi=math.degrees(cylinder.phi),
        x=cylinder.centre[0],
    )


def _format_relation(
    number: int, first: CylinderSection, second: CylinderSection, tolerance: float
) -> str:
    """Return the table of the relation between part `number` and the next one."""
    relation = relate(first, second)
    return RELATION.format(
        first=number,
        second=number + 1,
        gap=_compute_max_gap(relation, tolerance),
        text=format_value(relation.gap, relation.gap_std),
    )


def _compute_max_gap(relation: Relation, tolerance: float) -> float:
    """Return the largest gap that a job with a tolerance permits. Units: mm."""
    step = min(_compute_nominal_step(tolerance), MAX_GAP_STEP)
    return round(round((max(relation.gap, 0.0) + tolerance) / step) * step, 9)


def find_needed_tolerance(job: Job, cylinders: Sequence[CylinderSection]) -> float | None:
    """Return the smallest tolerance with which radii and gaps of a job are OK; None if they are.

    The job is that of `build_job_text` for these cylinders. Rounded up to two digits. Units: mm.
    """
    lower, upper = job.parts[0].limits["radius_mm"].ends
    # Rounded, since with 0.09999999999999964 for 0.1 the nominal would have another step.
    tolerance, level = round((upper - lower) / 2, LIMIT_DECIMALS), job.decision.level

    relations = [relate(first, second) for first, second in itertools.pairwise(cylinders)]

    def largest_deviation(tolerance: float) -> float:
        """Return the tolerance at which the last interval ends at a limit. Units: mm."""
        deviations = [
            tolerance + relation.interval("gap", level)[1] - _compute_max_gap(relation, tolerance)
            for relation in relations
        ]
        for cylinder in cylinders:
            low, high = cylinder.interval("radius", level)
            nominal = _round_nominal_radius(cylinder, tolerance)
            deviations.append(max(nominal - low, high - nominal))
        return max(deviations)

    needed = largest_deviation(tolerance)
    if needed < tolerance:
        return None
    digit = 10.0 ** (math.floor(math.log10(needed)) - 1)
    digits = math.floor(needed / digit) + 1
    # With another tolerance the nominal is rounded to another step.
    while largest_deviation(digits * digit) >= digits * digit:
        digits += 1
    return round(digits * digit, 9)


def _choose_x_windows(cylinders: Sequence[CylinderSection]) -> list[tuple[float, float]]:
    """Return a window of x for each cylinder. Units: mm.

    Windows end midway between neighbouring centres, the outer ones a radius beyond the centre. Ends
    are rounded to 0.1 mm, where a radius is below 1 mm to a tenth of it or less.
    """
    centres = [cylinder.centre[0] for cylinder in cylinders]
    midpoints = [(a + b) / 2 for a, b in itertools.pairwise(centres)]
    left_end, right_end = centres[0] - cylinders[0].radius, centres[-1] + cylinders[-1].radius
    smallest = min(cylinder.radius for cylinder in cylinders)
    decimals = 1 + max(0, -math.floor(math.log10(smallest)))
    ends = [round(end, decimals) for end in (left_end, *midpoints, right_end)]
    return list(itertools.pairwise(ends))


def _round_multiple(factor: float, radius: float) -> float:
    """Return a limit of the searched radii: a multiple of a radius, rounded to two digits."""
    return float(f"{factor * radius:.2g}")
