"""Decision OK, NG or undecided on a quantity, by the guard band of ISO 14253-1, with the reason."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from lsvision.inspection.uncertain import two_sided_factor
from lsvision.results.quantities import Estimate, Record, replace_nonfinite
from lsvision.results.result import Result

QUANTITY_HEADER = ("", "quantity", "value", "interval", "limits", "margin", "")
"""Header of a table of verdicts; the first column is the item, the last the decision."""


class Decision(StrEnum):
    """Decision on a quantity, a part or a whole measurement: OK, NG (not good) or undecided.

    Examples
    --------
    >>> Decision.OK == "OK", select_worst_decision([Decision.OK, Decision.UNDECIDED])
    (True, <Decision.UNDECIDED: 'undecided'>)
    """

    OK = "OK"
    NG = "NG"
    UNDECIDED = "undecided"


_SEVERITY = {Decision.OK: 0, Decision.UNDECIDED: 1, Decision.NG: 2}
"""Rank of each decision; that on a whole is the highest of its parts."""


def select_worst_decision(decisions: Iterable[Decision]) -> Decision:
    """Return the worst of several decisions (NG, then undecided, then OK); OK if there are none."""
    return max(decisions, key=_SEVERITY.__getitem__, default=Decision.OK)


def decide(interval: tuple[float, float], limits: tuple[float, float]) -> Decision:
    """Return the decision: OK if the interval lies inside the limits, NG outside, else undecided.

    The interval contains the true value at the job's level: with 0.95 each false answer has a
    probability of at most 2.5 %. Limits are infinite where there is none.

    Examples
    --------
    >>> [decide(ends, (18.9, 19.1)).value for ends in ((18.95, 19.05), (19.05, 19.2), (19.2, 19.3))]
    ['OK', 'undecided', 'NG']
    """
    low, high = interval
    lower, upper = limits
    if lower <= low and high <= upper:
        return Decision.OK
    return Decision.NG if high < lower or low > upper else Decision.UNDECIDED


def widen_interval(
    value: float, interval: tuple[float, float], extra_std: float, level: float
) -> tuple[float, float]:
    """Return an interval whose half widths include a further uncertainty, added in quadrature.

    Definition: ``value - hypot(value - low, z extra_std)`` and likewise above, with the normal
    quantile z of the level. The interval need not be symmetric about the value; `extra_std` is what
    the fit does not contain and is independent of it, such as the effect of temperature.

    Examples
    --------
    >>> low, high = widen_interval(19.0, (18.97, 19.04), 0.03 / 1.96, 0.95)
    >>> f"{low:.3f} {high:.3f}"
    '18.958 19.050'
    """
    low, high = interval
    extra = two_sided_factor(level) * extra_std
    return value - math.hypot(value - low, extra), value + math.hypot(high - value, extra)


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
            "value": replace_nonfinite(self.estimate.value),
            "std": replace_nonfinite(self.estimate.std),
            "low": replace_nonfinite(low),
            "high": replace_nonfinite(high),
            "level": self.level,
            "min": replace_nonfinite(self.limits[0]),
            "max": replace_nonfinite(self.limits[1]),
            "margin_sigmas": replace_nonfinite(self.margin),
            "decision": str(self.decision),
            "reason": self.reason,
        }

    def _summarise(self) -> str:
        return f"{self.key} {self.estimate.text}: {self.decision}, {self.reason}"

    def _list_cells(self) -> list[tuple[str, ...]]:
        return [QUANTITY_HEADER, format_quantity_cells("", self)]


def format_quantity_cells(name: str, verdict: QuantityVerdict) -> tuple[str, ...]:
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

    The estimate has its interval at `level`, including the job's ``extra_std``; the limits are in
    its unit. Undecided if the value is not determined or an end of its interval is not finite.
    """
    if not estimate.determined or not all(map(math.isfinite, estimate.interval)):
        reason = "not determinable from this measurement"
        return QuantityVerdict(estimate, limits, Decision.UNDECIDED, reason, level)
    decision = decide(estimate.interval, limits)
    return QuantityVerdict(
        estimate, limits, decision, _explain_decision(estimate, limits, decision), level
    )


def _explain_decision(estimate: Estimate, limits: tuple[float, float], decision: Decision) -> str:
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
