"""A measured number beside its goal."""

from dataclasses import dataclass
from math import inf, isfinite


@dataclass(frozen=True)
class Number:
    """Row of the report: a quantity and its value.

    The goal is reached from `low` to `high`, both included; a value without them has no goal.
    """

    what: str
    value: float
    low: float = -inf
    high: float = inf
    unit: str = ""
    note: str = ""

    @property
    def has_goal(self):
        return isfinite(self.low) or isfinite(self.high)

    @property
    def reached(self):
        return self.low <= self.value <= self.high

    @property
    def goal(self):
        if isfinite(self.low) and isfinite(self.high):
            return f"{self.low:g} to {self.high:g}"
        if isfinite(self.low):
            return f">= {self.low:g}"
        return f"<= {self.high:g}" if isfinite(self.high) else ""

    def __str__(self):
        verdict = ("ok" if self.reached else "SHORT") if self.has_goal else ""
        row = f"{self.what:54} {self.value:10.4g} {self.unit:4} {self.goal:>13} {verdict:5}"
        return f"{row} {self.note}".rstrip()


def print_numbers(title, numbers):
    """Print rows below a title, each as soon as it is measured."""
    print(f"\n{title}")
    for number in numbers:
        print(f"  {number}", flush=True)


def missed(numbers):
    """Return the rows whose goal is not reached, as text."""
    return [str(number) for number in numbers if number.has_goal and not number.reached]
