"""Many judged measurements: counts of the verdicts, and the series of each quantity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lsvision.inspection.capability import Capability, binomial_interval, estimate_capability
from lsvision.inspection.decision import Decision, QuantityVerdict
from lsvision.inspection.remedies import Remedy
from lsvision.inspection.verdict import Verdict, build_verdict_rows
from lsvision.measure import Measurement
from lsvision.results.quantities import Quantity, Record
from lsvision.scan.scan_result import ScanMeasurement


@dataclass(frozen=True, eq=False)
class JudgedMeasurement:
    """A measurement with its verdict.

    `source` is the file, or the folder of a scan; `profile` the index of the profile in its file, 0
    for a scan. The remedies are measurements that would decide the undecided quantities.
    """

    source: str
    profile: int
    measurement: Measurement | ScanMeasurement
    verdict: Verdict
    remedies: tuple[Remedy, ...] = ()

    @property
    def record(self) -> Record:
        """Source, index of the profile, verdict and remedies, ready for JSON."""
        return {
            "source": self.source,
            "profile": self.profile,
            **self.verdict.to_dict(),
            "remedies": [
                {"item": remedy.item, "quantity": remedy.quantity, "sections": remedy.sections,
                 "text": remedy.text}
                for remedy in self.remedies
            ],
        }  # fmt: skip

    @property
    def rows(self) -> list[Record]:
        """Rows of CSV and Parquet."""
        head = {"source": self.source, "profile": self.profile}
        return [head | row for row in build_verdict_rows(self.verdict)]


@dataclass(frozen=True)
class VerdictCount:
    """Number of verdicts of one kind, and the 95 % confidence interval of their probability."""

    decision: Decision
    count: int
    interval: tuple[float, float]


@dataclass(frozen=True)
class Series:
    """A quantity of a part or relation in all measurements that determine it.

    `numbers` are the numbers, from 1, of these measurements among all measurements. Values,
    standard uncertainties and interval ends are in the same order. They are in the unit of the
    quantity, and so are the limits, which are infinite if there is none.
    """

    item: str
    quantity: Quantity
    limits: tuple[float, float]
    numbers: tuple[int, ...]
    values: tuple[float, ...]
    stds: tuple[float, ...]
    lows: tuple[float, ...]
    highs: tuple[float, ...]
    decisions: tuple[Decision, ...]

    @property
    def capability(self) -> Capability | None:
        """Cp and Cpk; None without limits, with fewer than two values, or without spread."""
        try:
            return estimate_capability(self.values, self.limits, self.stds)
        except ValueError:
            return None


def count_verdicts(measurements: Sequence[JudgedMeasurement]) -> list[VerdictCount]:
    """Count each kind of verdict, with the interval of its probability."""
    total = len(measurements)
    counts = []
    for decision in Decision:
        count = sum(measurement.verdict.decision == decision for measurement in measurements)
        counts.append(VerdictCount(decision, count, binomial_interval(count, total)))
    return counts


def collect_series(measurements: Sequence[JudgedMeasurement]) -> list[Series]:
    """Return the series of each quantity that was determined, in the order of first appearance."""
    verdicts: dict[tuple[str, str], dict[int, QuantityVerdict]] = {}
    for number, measurement in enumerate(measurements, 1):
        for item in measurement.verdict.items:
            for quantity in item.quantities:
                if quantity.estimate.determined and math.isfinite(quantity.estimate.value):
                    verdicts.setdefault((item.name, quantity.key), {})[number] = quantity
    series = []
    for (name, _), by_number in verdicts.items():
        quantities = list(by_number.values())
        estimates = [quantity.estimate for quantity in quantities]
        series.append(
            Series(
                item=name,
                quantity=estimates[0].quantity,
                limits=quantities[0].limits,
                numbers=tuple(by_number),
                values=tuple(estimate.value for estimate in estimates),
                stds=tuple(estimate.std for estimate in estimates),
                lows=tuple(estimate.interval[0] for estimate in estimates),
                highs=tuple(estimate.interval[1] for estimate in estimates),
                decisions=tuple(quantity.decision for quantity in quantities),
            )
        )
    return series
