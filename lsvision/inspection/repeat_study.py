"""Type-1 gauge study: bias and repeatability from repeated measurements of a reference part."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.errors import TooFewPoints
from lsvision.geometry.arrays import rms
from lsvision.inspection.capability import NOT_CLAIMED, require_study_arguments
from lsvision.inspection.variance_intervals import require_finite_values
from lsvision.results.number_format import format_value
from lsvision.results.quantities import Record, replace_nonfinite
from lsvision.results.result import Result

TOLERANCE_FRACTION = 0.2
"""Fraction of the tolerance that six standard deviations may take for Cg = 1."""
SIGNIFICANCE = 0.05
"""p-value below which a bias is called significant."""


@dataclass(frozen=True, eq=False, repr=False)
class RepeatStudy(Result):
    """Result of a type-1 study.

    Parameters
    ----------
    count : int
        Number of repeated measurements.
    mean, std : float
        Mean and standard deviation of the values.
    reference : float
        Reference value of the part.
    bias_interval, std_interval : (float, float)
        Intervals of bias (Student's t) and standard deviation (chi^2), at `level`.
    p_value : float
        Probability of a mean that deviates at least as much from the reference without a bias,
        by Student's t; without spread 1 for a bias of 0, else 0.
    predicted_std : float
        Root mean square of the measurements' standard uncertainties; NaN if none are given.
    tolerance : float, optional
        Width of the tolerance.
    level : float
        Level of confidence of the intervals.
    """

    count: int
    mean: float
    std: float
    reference: float
    bias_interval: tuple[float, float]
    std_interval: tuple[float, float]
    p_value: float
    predicted_std: float = math.nan
    tolerance: float | None = None
    level: float = 0.95

    @property
    def bias(self) -> float:
        """Mean minus reference."""
        return self.mean - self.reference

    @property
    def cg(self) -> float:
        """Capability Cg: a fifth of the tolerance over 6 std; NaN without a tolerance or spread."""
        if self.tolerance is None or self.std == 0:
            return math.nan
        return TOLERANCE_FRACTION * self.tolerance / (6 * self.std)

    @property
    def cgk(self) -> float:
        """Capability Cgk: (tolerance / 10 - abs(bias)) over 3 std; NaN where Cg is."""
        if self.tolerance is None or self.std == 0:
            return math.nan
        return (TOLERANCE_FRACTION / 2 * self.tolerance - abs(self.bias)) / (3 * self.std)

    def to_dict(self) -> Record:
        """Return all numbers, ready for JSON.

        Returns
        -------
        dict
            Numbers of the study, in the unit of the values.
        """
        return {
            "count": self.count,
            "mean": self.mean,
            "reference": self.reference,
            "bias": self.bias,
            "bias_interval": [replace_nonfinite(end) for end in self.bias_interval],
            "p_value": replace_nonfinite(self.p_value),
            "std": self.std,
            "std_interval": [replace_nonfinite(end) for end in self.std_interval],
            "predicted_std": replace_nonfinite(self.predicted_std),
            "tolerance": self.tolerance,
            "cg": replace_nonfinite(self.cg),
            "cgk": replace_nonfinite(self.cgk),
            "level": self.level,
            "note": NOT_CLAIMED,
        }

    def _list_rows(self) -> list[Record]:
        """Return the row of the data frame, with two columns for each interval."""
        record = self.to_dict()
        for name in ("bias", "std"):
            record[f"{name}_low"], record[f"{name}_high"] = record.pop(f"{name}_interval")
        return [record]

    def _summarise(self) -> str:
        return f"bias {self.bias:.4g}, repeatability {self.std:.4g}, {self.count} values"

    def _list_cells(self) -> list[tuple[str, ...]]:
        return []

    def _list_notes(self) -> list[str]:
        """Return all printed lines: bias, repeatability, and what else is known."""
        low, high = self.bias_interval
        low_std, high_std = self.std_interval
        significance = "significant" if self.p_value < SIGNIFICANCE else "not significant"
        mean_std = self.std / math.sqrt(self.count)
        lines = [
            f"{self.count} values, mean {format_value(self.mean, mean_std)}, reference "
            f"{self.reference:g}",
            f"bias {self.bias:.4g}, {100 * self.level:g} % interval {low:.4g} .. {high:.4g} "
            f"({significance}, p {self.p_value:.3f})",
            f"repeatability {self.std:.4g}, interval {low_std:.4g} .. {high_std:.4g}",
        ]
        if math.isfinite(self.predicted_std):
            lines.append(f"standard uncertainty of the measurements {self.predicted_std:.4g}")
        if math.isfinite(self.cg):
            lines.append(
                f"Cg {self.cg:.2f}, Cgk {self.cgk:.2f} of the tolerance {self.tolerance:g}"
            )
        return [*lines, NOT_CLAIMED]


def study_repeats(
    values: Sequence[float],
    reference: float,
    *,
    stds: Sequence[float] = (),
    tolerance: float | None = None,
    level: float = 0.95,
) -> RepeatStudy:
    """Return bias and repeatability of repeated measurements of one part.

    Parameters
    ----------
    values : sequence of float
        Two or more measured values of the same part.
    reference : float
        Reference value of the part.
    stds : sequence of float
        Standard uncertainty of each measurement.
    tolerance : float, optional
        Width of the tolerance.
    level : float
        Level of confidence of the intervals.

    Raises
    ------
    TooFewPoints, LsvisionError
        With fewer than two values; if a value is not finite.
    ValueError
        If the reference or a std is not finite, the tolerance is not above 0, or the level is not
        between 0 and 1.

    Examples
    --------
    >>> study = study_repeats([10000001, 10000003, 10000002], 10000000.0)
    >>> study.bias, study.std
    (2.0, 1.0)
    """
    from scipy.stats import chi2, t

    require_study_arguments(level, tolerance)
    if not (math.isfinite(reference) and np.isfinite(stds).all()):
        raise ValueError(f"expected a finite reference and finite stds, got {reference} and {stds}")
    measured = np.asarray(values, dtype=np.float64)
    count = len(measured)
    if count < 2:
        raise TooFewPoints("a study of repeats", count, 2, "measure the part more often")
    require_finite_values(measured)
    # Subtract the first value: a large mean would cost digits of the standard deviation, and equal
    # values would have a spread by rounding errors of their mean.
    offsets = measured - measured[0]
    bias, std = float(measured[0] - reference + offsets.mean()), float(offsets.std(ddof=1))
    tail, dof = (1 - level) / 2, count - 1
    mean_std = std / math.sqrt(count)
    half_width = float(t.isf(tail, dof)) * mean_std
    return RepeatStudy(
        count=count,
        mean=reference + bias,
        std=std,
        reference=reference,
        bias_interval=(bias - half_width, bias + half_width),
        std_interval=(
            std * math.sqrt(dof / float(chi2.isf(tail, dof))),
            std * math.sqrt(dof / float(chi2.ppf(tail, dof))),
        ),
        p_value=2 * float(t.sf(abs(bias) / mean_std, dof)) if mean_std > 0 else float(bias == 0),
        predicted_std=rms(np.asarray(stds)) if len(stds) else math.nan,
        tolerance=tolerance,
        level=level,
    )
