"""Repeatability and reproducibility of a measurement: crossed analysis of variance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.errors import TooFewPoints
from lsvision.geometry import FloatArray
from lsvision.inspection.capability import NOT_CLAIMED, require_study_arguments
from lsvision.inspection.variance_intervals import (
    compute_sums_of_squares,
    mean_square_interval,
    require_finite_values,
)
from lsvision.results.quantities import Record, replace_nonfinite
from lsvision.results.result import Result

POOLING_ALPHA = 0.25
"""p-value of the interaction above which it is pooled with the repeatability (AIAG)."""
NDC_FACTOR = 1.41
"""Factor in the number of distinct categories (AIAG)."""
VARIATION_SIGMAS = 6.0
"""Width of the variation of a component, in standard deviations (AIAG)."""


@dataclass(frozen=True)
class AnovaRow:
    """A row of the table of the analysis of variance.

    Parameters
    ----------
    source : str
        Source of the variation, such as ``operators``.
    degrees_of_freedom : int
        Degrees of freedom of the sum of squares.
    sum_of_squares : float
        Sum of the squared deviations, in the square of the measured unit.
    f, p : float
        F statistic and its p-value; NaN without an F test.
    """

    source: str
    degrees_of_freedom: int
    sum_of_squares: float
    f: float = math.nan
    p: float = math.nan

    @property
    def mean_square(self) -> float:
        """Sum of squares over degrees of freedom."""
        return self.sum_of_squares / self.degrees_of_freedom


@dataclass(frozen=True)
class Component:
    """A component of the variance, as a standard deviation with its interval.

    Parameters
    ----------
    name : str
        Name of the component, such as ``repeatability``.
    variance : float
        Its variance; an estimate below 0 is set to 0.
    interval : (float, float)
        Confidence interval of the standard deviation.
    """

    name: str
    variance: float
    interval: tuple[float, float]

    @property
    def std(self) -> float:
        """Standard deviation."""
        return math.sqrt(self.variance)


@dataclass(frozen=True, eq=False, repr=False)
class GaugeStudy(Result):
    """Result of a crossed gauge study.

    Parameters
    ----------
    rows : tuple of AnovaRow
        Parts, operators, interaction, repeatability; of the full model, without pooling.
    components : tuple of Component
        Repeatability, reproducibility, gauge (the sum of both), parts, total.
    pooled : bool
        Whether the interaction was pooled with the repeatability.
    tolerance : float, optional
        Width of the tolerance.
    level : float
        Level of confidence of the intervals.
    """

    rows: tuple[AnovaRow, ...]
    components: tuple[Component, ...]
    pooled: bool
    tolerance: float | None = None
    level: float = 0.95

    def get_component(self, name: str) -> Component:
        """Return the component with a given name."""
        return next(component for component in self.components if component.name == name)

    def compute_fraction_of_total(self, name: str) -> float:
        """Return the std of a component over that of the total (%study variation / 100).

        NaN if all values are equal.
        """
        total = self.get_component("total").std
        return self.get_component(name).std / total if total > 0 else math.nan

    def compute_fraction_of_tolerance(self, name: str) -> float:
        """Return six stds of a component over the tolerance (%tolerance / 100); NaN without one."""
        if self.tolerance is None:
            return math.nan
        return VARIATION_SIGMAS * self.get_component(name).std / self.tolerance

    @property
    def distinct_categories(self) -> int | None:
        """Number of classes of parts that the measurement distinguishes (ndc), at least 1.

        None if the gauge has no variance, as of values that are rounded too coarsely.
        """
        gauge = self.get_component("gauge").std
        if gauge == 0:
            return None
        return max(int(NDC_FACTOR * self.get_component("parts").std / gauge), 1)

    def to_dict(self) -> Record:
        """Return table, components and fractions, ready for JSON.

        Returns
        -------
        dict
            Variances in the square of the measured unit.
        """
        return {
            "anova": [
                {
                    "source": row.source,
                    "degrees_of_freedom": row.degrees_of_freedom,
                    "sum_of_squares": row.sum_of_squares,
                    "mean_square": row.mean_square,
                    "f": replace_nonfinite(row.f),
                    "p": replace_nonfinite(row.p),
                }
                for row in self.rows
            ],
            "interaction_pooled": self.pooled,
            "components": {
                component.name: {
                    "variance": component.variance,
                    "std": component.std,
                    "std_interval": list(component.interval),
                    "percent_of_total": replace_nonfinite(
                        100 * self.compute_fraction_of_total(component.name)
                    ),
                    "percent_of_tolerance": replace_nonfinite(
                        100 * self.compute_fraction_of_tolerance(component.name)
                    ),
                }
                for component in self.components
            },
            "level": self.level,
            "distinct_categories": self.distinct_categories,
            "note": NOT_CLAIMED,
        }

    def _list_rows(self) -> list[Record]:
        """Return a row of the data frame for each component, with two columns for its interval."""
        rows = []
        for name, component in self.to_dict()["components"].items():
            low, high = component.pop("std_interval")
            rows.append({"component": name} | component | {"std_low": low, "std_high": high})
        return rows

    def _summarise(self) -> str:
        gauge = 100 * self.compute_fraction_of_total("gauge")
        return f"gauge {gauge:.1f} % of total, {self._categories_text}"

    @property
    def _categories_text(self) -> str:
        if self.distinct_categories is None:
            return "ndc not determinable (repeated values are equal: more digits?)"
        return f"ndc {self.distinct_categories}"

    def _list_cells(self) -> list[tuple[str, ...]]:
        """Return the header of the printed table, and a row for each component."""
        interval = f"{100 * self.level:g} % interval"
        header: tuple[str, ...] = ("", "std", interval, "% of total", "% of tolerance")
        rows = [header]
        for component in self.components:
            low, high = component.interval
            fractions = (
                self.compute_fraction_of_total(component.name),
                self.compute_fraction_of_tolerance(component.name),
            )
            rows.append(
                (
                    component.name,
                    f"{component.std:.6g}",
                    f"{low:.4g} .. {high:.4g}",
                    *(f"{100 * part:.2f}" if math.isfinite(part) else "" for part in fractions),
                )
            )
        return rows

    def _list_notes(self) -> list[str]:
        """Return the lines below the table: analysis of variance, pooling, limits of the study."""
        lines = [
            f"{row.source}: {row.degrees_of_freedom} degrees of freedom, sum of squares "
            f"{row.sum_of_squares:.6g}, mean square {row.mean_square:.6g}"
            + (f", F {row.f:.4g}, p {row.p:.3f}" if math.isfinite(row.f) else "")
            for row in self.rows
        ]
        pooled = "pooled with repeatability" if self.pooled else "not pooled"
        return [
            *lines,
            f"interaction {pooled} (limit p = {POOLING_ALPHA:g}); {self._categories_text}",
            NOT_CLAIMED,
        ]


def study_gauge(
    values: FloatArray, tolerance: float | None = None, level: float = 0.95
) -> GaugeStudy:
    """Analyse a balanced crossed study: every operator measures every part equally often.

    Parameters
    ----------
    values : (parts, operators, trials) array_like
        Measured values, at least two of each.
    tolerance : float, optional
        Width of the tolerance, in the same unit.
    level : float
        Level of confidence of the intervals.

    Raises
    ------
    ValueError
        If the values have another number of dimensions, the tolerance is not above 0, or the level
        is not between 0 and 1.
    TooFewPoints, LsvisionError
        With fewer than two parts, operators or trials; if a value is not finite.

    References
    ----------
    AIAG, Measurement Systems Analysis, 4th edition, appendix A; for the intervals see
    `lsvision.inspection.variance_intervals`.
    """
    require_study_arguments(level, tolerance)
    table = np.asarray(values, dtype=np.float64)
    if table.ndim != 3:
        raise ValueError(f"expected values of shape (parts, operators, trials), got {table.shape}")
    for factor, count in zip(("parts", "operators", "trials"), table.shape, strict=True):
        if count < 2:
            raise TooFewPoints(f"a gauge study by {factor}", count, 2, f"measure more {factor}")
    require_finite_values(table)
    rows = _analyse_variance(table)
    pooled = rows[2].p > POOLING_ALPHA
    components = _estimate_components(rows, table.shape, pooled=pooled, level=level)
    return GaugeStudy(rows, components, pooled, tolerance, level)


def _analyse_variance(table: FloatArray) -> tuple[AnovaRow, ...]:
    """Return the rows of parts, operators, interaction and repeatability, with their F tests."""
    from scipy.stats import f

    p, o, r = table.shape
    dofs = (p - 1, o - 1, (p - 1) * (o - 1), p * o * (r - 1))
    squares = compute_sums_of_squares(table)
    means = [square / dof for square, dof in zip(squares, dofs, strict=True)]
    # For each row, the row whose mean square is the divisor of its F statistic.
    divisors = {"parts": 2, "operators": 2, "interaction": 3, "repeatability": None}
    rows = []
    for row, (name, divisor) in enumerate(divisors.items()):
        ratio = p_value = math.nan
        if divisor is not None and means[divisor] > 0:
            ratio = means[row] / means[divisor]
            p_value = float(f.sf(ratio, dofs[row], dofs[divisor]))
        rows.append(AnovaRow(name, dofs[row], squares[row], ratio, p_value))
    return tuple(rows)


def _estimate_components(
    rows: Sequence[AnovaRow], shape: tuple[int, ...], *, pooled: bool, level: float
) -> tuple[Component, ...]:
    """Return the components of the variance; `shape` is (parts, operators, trials)."""
    sums = [(row.sum_of_squares, row.degrees_of_freedom) for row in rows]
    if pooled:
        square, dof = np.add(sums[2], sums[3])
        sums[2:] = [(square, dof)]
    means = [square / dof for square, dof in sums]
    dofs = [dof for _, dof in sums]
    coefficients = _compute_mean_square_coefficients(shape, pooled=pooled)
    # A negative variance counts as 0, also within a sum.
    variances = {name: max(float(row @ means), 0.0) for name, row in coefficients.items()}
    combinations = {
        "repeatability": ("repeatability",),
        "reproducibility": ("operators", "interaction"),
        "gauge": ("repeatability", "operators", "interaction"),
        "parts": ("parts",),
        "total": ("repeatability", "operators", "interaction", "parts"),
    }
    components = []
    for name, terms in combinations.items():
        combined = np.sum([coefficients[term] for term in terms], axis=0).tolist()
        interval = _std_interval(mean_square_interval(combined, means, dofs, level))
        components.append(Component(name, sum(variances[term] for term in terms), interval))
    return tuple(components)


def _compute_mean_square_coefficients(
    shape: tuple[int, ...], *, pooled: bool
) -> dict[str, FloatArray]:
    """Return the coefficients of the mean squares in the variance of each effect.

    The mean squares are those of parts, operators, interaction and repeatability, (4,); or of
    parts, operators and the pooled repeatability, (3,). In both, row 2 is the one that those of
    parts and operators are compared with.
    """
    parts, operators, trials = shape
    rows = np.eye(3 if pooled else 4)
    return {
        "repeatability": rows[-1],
        "operators": (rows[1] - rows[2]) / (parts * trials),
        "interaction": (rows[2] - rows[-1]) / trials,
        "parts": (rows[0] - rows[2]) / (operators * trials),
    }


def _std_interval(interval: tuple[float, float]) -> tuple[float, float]:
    """Return the interval of a standard deviation from that of its variance."""
    low, high = interval
    return math.sqrt(low), math.sqrt(high)
