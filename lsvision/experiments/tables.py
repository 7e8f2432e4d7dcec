"""Tables 1-4: errors of the five ways beside the printed figures and the Cramer-Rao bound."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.experiments.cases import Case
from lsvision.experiments.printed import QUANTITIES, PrintedRow, Triple
from lsvision.experiments.ways import WAYS, Way, bound_of, error_of, measure_case
from lsvision.shapes import FloatArray

Say = Callable[[str], None]
"""Takes a line about what is being worked on."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Errors of one way on one pipe.

    Parameters
    ----------
    runs, missed : int
        Measurements, and how many of them did not report the pipe.
    bias : Triple
        Mean error. NaN where the pipe was never found, as the others.
    rms : Triple
        Root mean square error.
    bound : Triple
        Smallest one sigma of any unbiased method.
    """

    runs: int
    missed: int
    bias: Triple
    rms: Triple
    bound: Triple


@dataclass(frozen=True, slots=True)
class TableRow:
    """A row of Tables 1-4, measured again.

    Parameters
    ----------
    printed : PrintedRow
        What the paper says.
    spreads : mapping of Way to Spread
        In the order of `WAYS`.
    """

    printed: PrintedRow
    spreads: Mapping[Way, Spread]


def measure_tables(
    cases: Sequence[Case],
    runs: Mapping[Way, int],
    *,
    noise_mm: float,
    seed: int = 0,
    say: Say = lambda _: None,
) -> tuple[TableRow, ...]:
    """Measure the pipes of the paper's tables many times in every way.

    Parameters
    ----------
    cases : sequence of Case
        As from `paper_cases`.
    runs : mapping of Way to int
        How often each way measures each case.
    noise_mm : float
        One sigma along the ray. Units: mm.
    seed : int
        Of the first measurement; the next count on.
    say : callable
        Told of each case.

    Returns
    -------
    tuple of TableRow
        One for each pipe, in the order of the cases.
    """
    rows: list[TableRow] = []
    for case in cases:
        row = case.rows[0]
        say(f"table {row.table}: radius {row.radius_mm:g} mm, phi {row.phi_deg:g} deg")
        spreads = {way: _spreads(case, way, range(seed, seed + runs[way]), noise_mm)
                   for way in WAYS}  # fmt: skip
        for pipe, printed in enumerate(case.rows):
            rows.append(TableRow(printed, {way: spreads[way][pipe] for way in WAYS}))
    return tuple(rows)


def pool(spreads: Sequence[Spread]) -> Spread:
    """Several pipes as one: root mean squares of rms and bound, mean of the bias."""
    found = np.array([float(spread.runs - spread.missed) for spread in spreads])
    every = np.ones(len(spreads))

    def mean(field: str, power: int, weights: FloatArray) -> Triple:
        values = np.array([_numbers(getattr(spread, field)) for spread in spreads])
        with np.errstate(invalid="ignore"):  # none found: 0 / 0 is the NaN that says so
            total = weights @ np.nan_to_num(values) ** power / weights.sum()
        return Triple(*(total ** (1 / power)).tolist())

    runs = sum(spread.runs for spread in spreads)
    missed = sum(spread.missed for spread in spreads)
    return Spread(runs, missed, mean("bias", 1, found), mean("rms", 2, found),
                  mean("bound", 2, every))  # fmt: skip


def _spreads(case: Case, way: Way, seeds: range, noise_mm: float) -> tuple[Spread, ...]:
    measured = [measure_case(case, way, seed, noise_mm=noise_mm) for seed in seeds]
    bounds = bound_of(case, way, noise_mm=noise_mm)
    return tuple(
        _spread([found[pipe] for found in measured], case, pipe, bounds[pipe])
        for pipe in range(len(case.rows))
    )


def _spread(
    measured: Sequence[tuple[float, float, float] | None], case: Case, pipe: int, bound: Triple
) -> Spread:
    errors = [_numbers(error_of(found, case, pipe)) for found in measured if found is not None]
    missed = len(measured) - len(errors)
    if not errors:
        nothing = Triple(np.nan, np.nan, np.nan)
        return Spread(len(measured), missed, nothing, nothing, bound)
    values = np.array(errors)
    bias = Triple(*values.mean(axis=0).tolist())
    rms = Triple(*np.sqrt((values**2).mean(axis=0)).tolist())
    return Spread(len(measured), missed, bias, rms, bound)


def _numbers(triple: Triple) -> list[float]:
    return [getattr(triple, name) for name in QUANTITIES]
