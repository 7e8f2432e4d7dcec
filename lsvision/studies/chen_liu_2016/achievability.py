"""Which of the paper's figures one section can give at all, and how many sections do."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lsvision.errors import DegenerateGeometry
from lsvision.planning import AccuracyTarget, Feed, SensorView, sections_needed
from lsvision.studies.chen_liu_2016.cases import (
    INCIDENCE_LIMIT_DEG,
    PITCH_MM,
    STANDOFF_MM,
    paper_sensor,
)
from lsvision.studies.chen_liu_2016.published_results import QUANTITIES
from lsvision.studies.chen_liu_2016.tables import TableRow, pool_errors

SIGNIFICANCE = 0.05
"""A set of errors that the best method has less often than this was not drawn by it."""
SPACING_MM = 1.0
"""Between the sections of the scan that would do. Units: mm."""
SIGMAS_WITHIN = 2.0
"""Sections do when 19 of 20 errors stay below the largest printed one."""


@dataclass(frozen=True, slots=True)
class Achievability:
    """One number of one table against the bound of one section.

    Parameters
    ----------
    table : int
        1 to 4.
    quantity : str
        Field of `Triple`: its name ends in the unit.
    largest_printed : float
        Largest error of the table, either sign. Unit of the quantity.
    best_sigma : float
        One sigma of the best possible method from one section, root mean square over the
        table's pipes. Unit of the quantity.
    pipes : int
        Errors that the table prints.
    chi_square : float
        Of the printed errors over their bounds.
    sections_needed : int or None
        Sections 1 mm apart of which 19 of 20 errors stay below `largest_printed`, for the
        table's worst pipe; None where 2048 do not.
    noise_needed_mm : float
        Noise at which one section would do so. Units: mm.
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
        """That the best method's errors are together as small as the printed ones, in [0, 1]."""
        return self.chance_at(1.0)

    def chance_at(self, share: float) -> float:
        """The same with a sensor that has only this share of the noise: the bound is linear."""
        from scipy.special import chdtr

        return float(chdtr(self.pipes, self.chi_square / share**2))

    @property
    def reachable(self) -> bool:
        """Whether one section can give such errors more than one time in twenty."""
        return self.chance >= SIGNIFICANCE


def compare_with_bound(rows: Sequence[TableRow], *, noise_mm: float) -> tuple[Achievability, ...]:
    """Hold each number of each table to the bound of one section.

    Parameters
    ----------
    rows : sequence of TableRow
        Of whole tables.
    noise_mm : float
        One sigma along the ray that the bounds are for. Units: mm.
    """
    tables = sorted({row.printed.table for row in rows})
    return tuple(
        _judge([row for row in rows if row.printed.table == table], quantity, noise_mm)
        for table in tables
        for quantity in QUANTITIES
    )


def _judge(rows: Sequence[TableRow], quantity: str, noise_mm: float) -> Achievability:
    printed = [abs(getattr(row.printed.errors, quantity)) for row in rows]
    sigmas = [getattr(row.spreads["section"].bound, quantity) for row in rows]
    largest = max(printed)
    best = getattr(pool_errors([row.spreads["section"] for row in rows]).bound, quantity)
    squares = sum((error / sigma) ** 2 for error, sigma in zip(printed, sigmas, strict=True))
    return Achievability(
        table=rows[0].printed.table,
        quantity=quantity,
        largest_printed=largest,
        best_sigma=best,
        pipes=len(rows),
        chi_square=squares,
        sections_needed=_sections(rows, quantity, largest / SIGMAS_WITHIN, noise_mm),
        noise_needed_mm=noise_mm * largest / (SIGMAS_WITHIN * max(sigmas)),
    )


def _sections(rows: Sequence[TableRow], quantity: str, sigma: float, noise_mm: float) -> int | None:
    """Of the pipe that needs most."""
    view = SensorView(
        sensor=paper_sensor(noise_mm),
        standoff=STANDOFF_MM,
        pitch=PITCH_MM,
        incidence_limit=math.radians(INCIDENCE_LIMIT_DEG),
    )
    target = {
        "radius_mm": AccuracyTarget(radius_std=sigma),
        "theta_deg": AccuracyTarget(theta_std=math.radians(sigma)),
        "phi_deg": AccuracyTarget(phi_std=math.radians(sigma)),
    }[quantity]
    pipes = {(row.printed.radius_mm, row.printed.theta_deg, row.printed.phi_deg) for row in rows}
    most = 0
    for radius, theta_deg, phi_deg in sorted(pipes):
        try:
            scan = sections_needed(
                radius, math.radians(theta_deg), math.radians(phi_deg),
                target=target, view=view, feed=Feed(spacing=SPACING_MM),
            )  # fmt: skip
        except DegenerateGeometry:
            return None
        most = max(most, scan.sections)
    return most
