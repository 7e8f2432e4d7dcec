"""Verdict on one quantity: decision by its interval and limits, with the reason."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lsvision.inspection.decision import Decision, decide
from lsvision.results.quantities import Estimate, Record, finite_or_none
from lsvision.results.result import Result


@dataclass(frozen=True, eq=False, repr=False)
class QuantityVerdict(Result):
    """Verdict on one quantity, in the unit of its estimate.

    Parameters
    ----------
    estimate : Estimate
        Value, standard uncertainty and interval at the job's level, both with the job's
        ``extra_std``; a periodic angle is shifted next to its limits.
    limits : (float, float)
        Smallest and largest permissible value; infinite if there is none.
    decision : Decision
        OK or NG if the interval lies inside or outside the limits, else undecided.
    reason : str
        Reason with numbers.
    level : float
        Level of confidence of the interval.
    """

    estimate: Estimate
    limits: tuple[float, float]
    decision: Decision
    reason: str
    level: float = 0.95

    @property
    def key(self) -> str:
        """Key of the quantity in the job: name and unit, such as ``phi_deg``."""
        return f"{self.estimate.quantity.name}_{self.estimate.quantity.unit}"

    @property
    def margin(self) -> float:
        """Distance of the value from the nearer limit, over its std; negative outside.

        Infinite if the std is 0.
        """
        lower, upper = self.limits
        distance = min(self.estimate.value - lower, upper - self.estimate.value)
        if self.estimate.std == 0:
            return math.copysign(math.inf, distance)
        return distance / self.estimate.std

    @property
    def limits_text(self) -> str:
        """Limits as text, such as ``18.9 .. 19.1`` or ``<= 2``."""
        lower, upper = self.limits
        if lower == -math.inf:
            return f"<= {upper:.9g}"
        return f">= {lower:.9g}" if upper == math.inf else f"{lower:.9g} .. {upper:.9g}"

    def to_dict(self) -> Record:
        """Return value, interval, limits, margin, decision and reason, ready for JSON.

        Returns
        -------
        dict
            Values in the unit that the key in ``quantity`` ends with.
        """
        low, high = self.estimate.interval
        return {
            "quantity": self.key,
            "value": finite_or_none(self.estimate.value),
            "std": finite_or_none(self.estimate.std),
            "low": finite_or_none(low),
            "high": finite_or_none(high),
            "level": self.level,
            "min": finite_or_none(self.limits[0]),
            "max": finite_or_none(self.limits[1]),
            "margin_sigmas": finite_or_none(self.margin),
            "decision": str(self.decision),
            "reason": self.reason,
        }

    def _summary(self) -> str:
        return f"{self.key} {self.estimate.text}: {self.decision}, {self.reason}"

    def _cells(self) -> list[tuple[str, ...]]:
        return [QUANTITY_HEADER, quantity_cells("", self)]


QUANTITY_HEADER = ("", "quantity", "value", "interval", "limits", "margin", "")
"""Header of a table of verdicts; the first column is the item, the last the decision."""


def quantity_cells(name: str, verdict: QuantityVerdict) -> tuple[str, ...]:
    """Return the row of a quantity, with the columns of `QUANTITY_HEADER`."""
    estimate = verdict.estimate
    margin = f"{verdict.margin:+.1f} sigma" if estimate.determined else ""
    interval = estimate.interval_text if estimate.determined else ""
    return (
        name, estimate.quantity.heading, estimate.text, interval, verdict.limits_text, margin,
        str(verdict.decision),
    )  # fmt: skip


def judge_quantity(
    estimate: Estimate, limits: tuple[float, float], level: float
) -> QuantityVerdict:
    """Return the verdict of a quantity, with its reason.

    Parameters
    ----------
    estimate : Estimate
        Estimate with its interval at `level`, including the job's ``extra_std``.
    limits : (float, float)
        Lower and upper limit in the unit of the quantity.
    level : float
        Level of confidence of the interval.

    Returns
    -------
    QuantityVerdict
        Undecided if the value is not determined or an end of its interval is not finite.
    """
    if not estimate.determined or not all(map(math.isfinite, estimate.interval)):
        reason = "not determinable from this measurement"
        return QuantityVerdict(estimate, limits, Decision.UNDECIDED, reason, level)
    decision = decide(estimate.interval, limits)
    return QuantityVerdict(estimate, limits, decision, _reason(estimate, limits, decision), level)


def _reason(estimate: Estimate, limits: tuple[float, float], decision: Decision) -> str:
    """Return how the interval lies relative to the limits, with numbers."""
    low, high = estimate.interval
    lower, upper = limits
    interval, unit = estimate.interval_text, estimate.quantity.unit_text
    if decision == Decision.OK:
        return f"interval {interval} {unit} lies inside the limits"
    if decision == Decision.NG:
        side = f"below {lower:.9g}" if high < lower else f"above {upper:.9g}"
        return f"interval {interval} {unit} lies wholly {side}"
    crossed = [
        f"{limit:.9g}"
        for limit, is_crossed in ((lower, low < lower <= high), (upper, low <= upper < high))
        if is_crossed
    ]
    word = "limits" if len(crossed) > 1 else "limit"
    return f"interval {interval} {unit} contains the {word} {' and '.join(crossed)}"
