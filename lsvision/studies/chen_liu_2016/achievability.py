"""Comparison of the paper's errors with the bound of one section, and the sections they need."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lsvision.errors import DegenerateGeometry
from lsvision.planning import AccuracyTarget, Feed, SensorView, sections_needed
from lsvision.studies.chen_liu_2016.cases import (
    INCIDENCE_LIMIT_DEG,
    PITCH_MM,
    STANDOFF_MM,
    build_paper_sensor,
)
from lsvision.studies.chen_liu_2016.published_results import QUANTITIES
from lsvision.studies.chen_liu_2016.tables import TableRow, pool_errors

SIGNIFICANCE = 0.05
"""Significance level of the test whether an efficient method has such small errors."""
SPACING_MM = 1.0
"""Spacing of the sections of a scan. Units: mm."""
SIGMAS_WITHIN = 2.0
"""Largest printed error over the standard deviation of a sufficient scan: 95 % of its errors are
smaller."""


@dataclass(frozen=True, slots=True)
class Achievability:
    """Errors of one quantity in one table, compared with the bound of one section.

    Parameters
    ----------
    table : int
        Number of the table, 1 to 4.
    quantity : str
        Field of `Triple`; its name ends in the unit.
    largest_printed : float
        Largest modulus of the printed errors. Unit of the quantity.
    best_sigma : float
        Cramer-Rao bound of one section: standard deviation, root mean square over the table's
        pipes. Unit of the quantity.
    pipes : int
        Number of printed errors.
    chi_square : float
        Sum of the squared printed errors over their bounds.
    sections_needed : int or None
        Number of sections 1 mm apart for which 95 % of the errors are below `largest_printed`,
        for the table's worst pipe; None if `MAX_SECTIONS` (2048) are not enough. Predicted for
        pipes that stand alone: the neighbour in Table 4, which hides a few points, is left out.
    noise_needed_mm : float
        Noise along the ray at which one section has 95 % of the errors below `largest_printed`, for
        the table's worst pipe. Units: mm.
    """

    table: int
    quantity: str
    largest_printed: float
    best_sigma: float
    pipes: int
    chi_square: float
    sections_needed: int | None
    noise_needed_mm: float

    @property
    def chance(self) -> float:
        """Probability of errors as small as the printed ones by an efficient method, in [0, 1]."""
        return self.compute_chance_at(1.0)

    def compute_chance_at(self, noise_ratio: float) -> float:
        """Return `chance` for a noise, and thus a bound, that is larger by a ratio."""
        from scipy.special import chdtr

        return float(chdtr(self.pipes, self.chi_square / noise_ratio**2))

    @property
    def reachable(self) -> bool:
        """Whether the probability for one section reaches `SIGNIFICANCE`."""
        return self.chance >= SIGNIFICANCE


def compare_with_bound(rows: Sequence[TableRow], *, noise_mm: float) -> tuple[Achievability, ...]:
    """Return the errors of each quantity in each table, compared with the bound of one section.

    The rows are those of all tables; the bounds are valid for the noise along the ray, in mm.
    """
    tables = sorted({row.printed.table for row in rows})
    return tuple(
        _compare([row for row in rows if row.printed.table == table], quantity, noise_mm)
        for table in tables
        for quantity in QUANTITIES
    )


def _compare(rows: Sequence[TableRow], quantity: str, noise_mm: float) -> Achievability:
    """Return the comparison of one quantity of one table with the bound."""
    printed = [abs(getattr(row.printed.errors, quantity)) for row in rows]
    stds = [getattr(row.spreads["section"].bound, quantity) for row in rows]
    largest = max(printed)
    best = getattr(pool_errors([row.spreads["section"] for row in rows]).bound, quantity)
    squares = sum((error / std) ** 2 for error, std in zip(printed, stds, strict=True))
    return Achievability(
        table=rows[0].printed.table,
        quantity=quantity,
        largest_printed=largest,
        best_sigma=best,
        pipes=len(rows),
        chi_square=squares,
        sections_needed=_count_sections_needed(rows, quantity, largest / SIGMAS_WITHIN, noise_mm),
        noise_needed_mm=noise_mm * largest / (SIGMAS_WITHIN * max(stds)),
    )


def _count_sections_needed(
    rows: Sequence[TableRow], quantity: str, std: float, noise_mm: float
) -> int | None:
    """Return the number of sections that reach a std for every pipe; None as in `Achievability`.

    The unit of `std` is that of the quantity.
    """
    view = SensorView(
        sensor=build_paper_sensor(noise_mm),
        standoff=STANDOFF_MM,
        pitch=PITCH_MM,
        incidence_limit=math.radians(INCIDENCE_LIMIT_DEG),
    )
    target = {
        "radius_mm": AccuracyTarget(radius_std=std),
        "theta_deg": AccuracyTarget(theta_std=math.radians(std)),
        "phi_deg": AccuracyTarget(phi_std=math.radians(std)),
    }[quantity]
    pipes = {(row.printed.radius_mm, row.printed.theta_deg, row.printed.phi_deg) for row in rows}
    max_sections = 0
    for radius, theta_deg, phi_deg in sorted(pipes):
        try:
            scan = sections_needed(
                radius, math.radians(theta_deg), math.radians(phi_deg),
                target=target, view=view, feed=Feed(spacing=SPACING_MM),
            )  # fmt: skip
        except DegenerateGeometry:
            return None
        max_sections = max(max_sections, scan.sections)
    return max_sections
