"""Tables 1-4: errors of the five methods, the printed errors and the Cramer-Rao bound."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.studies.chen_liu_2016.cases import Case
from lsvision.studies.chen_liu_2016.methods import (
    METHODS,
    Estimate,
    Method,
    case_bound,
    compute_case_errors,
    measure_case,
)
from lsvision.studies.chen_liu_2016.published_results import QUANTITIES, PublishedRow, Triple

ProgressCallback = Callable[[str], None]
"""Function that is called with a short text before each computation."""


@dataclass(frozen=True, slots=True)
class ErrorStatistics:
    """Errors of one method on one pipe.

    Parameters
    ----------
    runs, missed : int
        Number of measurements, and of those that did not report the pipe.
    bias : Triple
        Mean error; NaN if the pipe was never found.
    rms : Triple
        Root mean square error; NaN if the pipe was never found.
    bound : Triple
        Cramer-Rao bound: smallest standard deviation of any unbiased method.
    """

    runs: int
    missed: int
    bias: Triple
    rms: Triple
    bound: Triple


@dataclass(frozen=True, slots=True)
class TableRow:
    """Row of Tables 1-4, measured again.

    Parameters
    ----------
    printed : PublishedRow
        Row as printed in the paper.
    spreads : mapping of Method to ErrorStatistics
        Errors of each method, in the order of `METHODS`.
    """

    printed: PublishedRow
    spreads: Mapping[Method, ErrorStatistics]


def measure_tables(
    cases: Sequence[Case],
    runs: Mapping[Method, int],
    *,
    noise_mm: float,
    seed: int = 0,
    progress: ProgressCallback = lambda _: None,
) -> tuple[TableRow, ...]:
    """Measure the pipes of the paper's tables many times by every method.

    `runs` are the numbers of measurements of each case by each method, from a random seed on, with
    the noise along the ray in mm; `progress` is called with a text before each case. Return a row
    for each pipe, in the order of the cases.
    """
    rows: list[TableRow] = []
    for case in cases:
        row = case.rows[0]
        progress(f"table {row.table}: radius {row.radius_mm:g} mm, phi {row.phi_deg:g} deg")
        spreads = {
            method: _compute_statistics(case, method, range(seed, seed + runs[method]), noise_mm)
            for method in METHODS
        }
        for pipe, printed in enumerate(case.rows):
            rows.append(TableRow(printed, {method: spreads[method][pipe] for method in METHODS}))
    return tuple(rows)


def pool_errors(spreads: Sequence[ErrorStatistics]) -> ErrorStatistics:
    """Return pooled statistics of one method: rms of rms and of bound, mean of the bias.

    Rms and bias are weighted by the measurements that found a pipe.
    """
    found_counts = np.array([float(spread.runs - spread.missed) for spread in spreads])
    equal_weights = np.ones(len(spreads))

    def mean(field: str, power: int, weights: FloatArray) -> Triple:
        """Return the weighted power mean of a field: 1 is the mean, 2 the root mean square."""
        values = np.array([_list_numbers(getattr(spread, field)) for spread in spreads])
        with np.errstate(invalid="ignore"):  # 0 / 0 = NaN if no pipe was found
            mean_power = weights @ np.nan_to_num(values) ** power / weights.sum()
        return Triple(*(mean_power ** (1 / power)).tolist())

    runs = sum(spread.runs for spread in spreads)
    missed = sum(spread.missed for spread in spreads)
    bias, rms = mean("bias", 1, found_counts), mean("rms", 2, found_counts)
    return ErrorStatistics(runs, missed, bias, rms, mean("bound", 2, equal_weights))


def _compute_statistics(
    case: Case, method: Method, seeds: range, noise_mm: float
) -> tuple[ErrorStatistics, ...]:
    """Return the statistics of a method for each pipe of a case, one measurement for each seed."""
    measured = [measure_case(case, method, seed, noise_mm=noise_mm) for seed in seeds]
    bounds = case_bound(case, method, noise_mm=noise_mm)
    return tuple(
        _compute_pipe_statistics(
            [estimates[pipe] for estimates in measured], case, pipe, bounds[pipe]
        )
        for pipe in range(len(case.rows))
    )


def _compute_pipe_statistics(
    estimates: Sequence[Estimate | None], case: Case, pipe: int, bound: Triple
) -> ErrorStatistics:
    """Return statistics of the estimates of one pipe; None stands for a missed pipe."""
    errors = [_list_numbers(compute_case_errors(e, case, pipe)) for e in estimates if e is not None]
    missed = len(estimates) - len(errors)
    if not errors:
        undetermined = Triple(np.nan, np.nan, np.nan)
        return ErrorStatistics(len(estimates), missed, undetermined, undetermined, bound)
    values = np.array(errors)
    bias = Triple(*values.mean(axis=0).tolist())
    rms = Triple(*np.sqrt((values**2).mean(axis=0)).tolist())
    return ErrorStatistics(len(estimates), missed, bias, rms, bound)


def _list_numbers(triple: Triple) -> list[float]:
    """Return the three numbers of a triple, in the order of `QUANTITIES`."""
    return [getattr(triple, name) for name in QUANTITIES]
