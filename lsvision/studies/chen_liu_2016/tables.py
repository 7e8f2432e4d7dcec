"""Tables 1-4: errors of the five ways beside the printed figures and the Cramer-Rao bound."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.studies.chen_liu_2016.cases import Case
from lsvision.studies.chen_liu_2016.methods import (
    METHODS,
    Method,
    case_bound,
    case_errors,
    measure_case,
)
from lsvision.studies.chen_liu_2016.published_results import QUANTITIES, PublishedRow, Triple

ProgressCallback = Callable[[str], None]
"""Takes a line about what is being worked on."""


@dataclass(frozen=True, slots=True)
class ErrorStatistics:
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
    printed : PublishedRow
        What the paper says.
    spreads : mapping of Method to ErrorStatistics
        In the order of `METHODS`.
    """

    printed: PublishedRow
    spreads: Mapping[Method, ErrorStatistics]


def measure_tables(
    cases: Sequence[Case],
    runs: Mapping[Method, int],
    *,
    noise_mm: float,
    seed: int = 0,
    say: ProgressCallback = lambda _: None,
) -> tuple[TableRow, ...]:
    """Measure the pipes of the paper's tables many times in every way.

    Parameters
    ----------
    cases : sequence of Case
        As from `paper_cases`.
    runs : mapping of Method to int
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
                   for way in METHODS}  # fmt: skip
        for pipe, printed in enumerate(case.rows):
            rows.append(TableRow(printed, {way: spreads[way][pipe] for way in METHODS}))
    return tuple(rows)


def pool_errors(spreads: Sequence[ErrorStatistics]) -> ErrorStatistics:
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
    return ErrorStatistics(runs, missed, mean("bias", 1, found), mean("rms", 2, found),
                  mean("bound", 2, every))  # fmt: skip


def _spreads(case: Case, way: Method, seeds: range, noise_mm: float) -> tuple[ErrorStatistics, ...]:
    measured = [measure_case(case, way, seed, noise_mm=noise_mm) for seed in seeds]
    bounds = case_bound(case, way, noise_mm=noise_mm)
    return tuple(
        _spread([found[pipe] for found in measured], case, pipe, bounds[pipe])
        for pipe in range(len(case.rows))
    )


def _spread(
    measured: Sequence[tuple[float, float, float] | None], case: Case, pipe: int, bound: Triple
) -> ErrorStatistics:
    errors = [_numbers(case_errors(found, case, pipe)) for found in measured if found is not None]
    missed = len(measured) - len(errors)
    if not errors:
        nothing = Triple(np.nan, np.nan, np.nan)
        return ErrorStatistics(len(measured), missed, nothing, nothing, bound)
    values = np.array(errors)
    bias = Triple(*values.mean(axis=0).tolist())
    rms = Triple(*np.sqrt((values**2).mean(axis=0)).tolist())
    return ErrorStatistics(len(measured), missed, bias, rms, bound)


def _numbers(triple: Triple) -> list[float]:
    return [getattr(triple, name) for name in QUANTITIES]
