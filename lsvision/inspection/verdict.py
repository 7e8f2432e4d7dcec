"""Result of `lsvision.judge`: decision on each part and relation, with the reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from lsvision.inspection.decision import (
    QUANTITY_HEADER,
    Decision,
    QuantityVerdict,
    format_quantity_cells,
    select_worst_decision,
)
from lsvision.inspection.job_tables import find_part
from lsvision.results.quantities import Record
from lsvision.results.result import Result

ROW_KEYS = ("quantity", "value", "std", "low", "high", "level", "min", "max", "margin_sigmas")
"""Keys of `QuantityVerdict.to_dict` that are columns of their own in a table."""

VERDICT_SCHEMA = "lsvision.verdict/1"
"""Name and version of the JSON form of a verdict."""


@dataclass(frozen=True, eq=False, repr=False)
class ItemVerdict(Result):
    """Verdict on a part, or on a relation between two parts.

    Parameters
    ----------
    name : str
        Name of the part, or of both parts of a relation.
    quantities : tuple of QuantityVerdict
        Verdicts in the order of printed tables; empty for a missing part, and for a relation with
        one.
    cylinder : int, optional
        Index of the measured cylinder; None for a relation and for a missing part.
    decided : Decision, optional
        Decision instead of the worst one on the quantities: NG or undecided for an item without
        quantities, such as a missing part; undecided if nothing can be decided now.
    reason : str
        Reason of `decided`; empty if that is None.
    """

    name: str
    quantities: tuple[QuantityVerdict, ...] = ()
    cylinder: int | None = None
    decided: Decision | None = None
    reason: str = ""

    @property
    def decision(self) -> Decision:
        """`decided` if it is given, else the worst decision on the quantities."""
        if self.decided is not None:
            return self.decided
        return select_worst_decision(quantity.decision for quantity in self.quantities)

    def to_dict(self) -> Record:
        """Return name, decision, reason and quantities, ready for JSON.

        Returns
        -------
        dict
            ``cylinder`` counts from 0 in the measurement's order.
        """
        return {
            "name": self.name,
            "decision": str(self.decision),
            "reason": self.reason,
            "cylinder": self.cylinder,
            "quantities": [quantity.to_dict() for quantity in self.quantities],
        }

    def _summarise(self) -> str:
        return f"{self.name}: {self.decision}" + (f", {self.reason}" if self.reason else "")

    def _list_cells(self) -> list[tuple[str, ...]]:
        return format_item_cells([self])


@dataclass(frozen=True)
class Provenance:
    """Provenance of a verdict.

    Parameters
    ----------
    job, hash : str
        Name of the job, and SHA-256 of its canonical form.
    revision : int
        Revision of the job.
    version : str
        Version of lsvision.
    calibration : mapping
        Name, date and hash of each calibration file, by the job's key.
    """

    job: str
    revision: int
    hash: str
    version: str
    calibration: Mapping[str, Mapping[str, str | None]] = field(default_factory=dict, hash=False)

    def to_record(self) -> Record:
        """Return the provenance, ready for JSON."""
        return {
            "job": self.job,
            "revision": self.revision,
            "job_hash": self.hash,
            "version": self.version,
            "calibration": {key: dict(file) for key, file in self.calibration.items()},
        }


@dataclass(frozen=True, eq=False, repr=False)
class Verdict(Result):
    """Verdict on a profile or a scan by its job.

    Parameters
    ----------
    parts, relations : tuple of ItemVerdict
        Verdicts on parts and relations, in the order of the job.
    additional : tuple of int
        Indices of cylinders that are not parts of the job.
    notes : tuple of str
        Further messages, such as that two parts seem to be exchanged.
    provenance : Provenance
        Job, version, calibration.
    blocked : str
        Reason why nothing can be decided, such as that the check of the golden part (the
        reference) is overdue or failed. Otherwise empty.
    additional_is_ng : bool
        Whether an additional cylinder makes the verdict NG.
    undecided_passes : bool
        Whether a one-bit output is true for an undecided verdict.

    Examples
    --------
    >>> import lsvision as lsv
    >>> job = lsv.Job.load("fixtures/jobs/welded_pair.toml")
    >>> measurement = lsv.measure_cylinders(lsv.read_profile("fixtures/welded_pair.csv"))
    >>> verdict = lsv.judge(measurement, job)
    >>> verdict.decision == "NG", verdict.part("left").quantities[0].key
    (True, 'phi_deg')
    >>> verdict.to_dict()["decision"]
    'NG'
    """

    parts: tuple[ItemVerdict, ...]
    relations: tuple[ItemVerdict, ...]
    additional: tuple[int, ...]
    notes: tuple[str, ...]
    provenance: Provenance
    blocked: str = ""
    additional_is_ng: bool = False
    undecided_passes: bool = False

    @property
    def items(self) -> tuple[ItemVerdict, ...]:
        """Parts, then relations."""
        return (*self.parts, *self.relations)

    @property
    def decision(self) -> Decision:
        """The worst of all parts and relations; undecided if `blocked` states a reason.

        NG with an additional cylinder if `additional_is_ng`.
        """
        if self.blocked:
            return Decision.UNDECIDED
        decisions = [item.decision for item in self.items]
        if self.additional_is_ng and self.additional:
            decisions.append(Decision.NG)
        return select_worst_decision(decisions)

    @property
    def passed(self) -> bool:
        """Whether a one-bit output is true: OK, or undecided if `undecided_passes`."""
        undecided = self.decision == Decision.UNDECIDED and self.undecided_passes
        return self.decision == Decision.OK or undecided

    def part(self, name: str) -> ItemVerdict:
        """Return the verdict of a part.

        Parameters
        ----------
        name : str
            Name of the part in the job.

        Returns
        -------
        ItemVerdict
            Verdict of the part with that name.

        Raises
        ------
        ValueError
            If there is no part with that name.
        """
        return find_part({item.name: item for item in self.parts}, name)

    def to_dict(self) -> Record:
        """Return the verdict as plain numbers and text, ready for JSON.

        Returns
        -------
        dict
            With job, revision, hash, version and calibration.
        """
        return {
            "schema": VERDICT_SCHEMA,
            "decision": str(self.decision),
            "passed": self.passed,
            "reason": self.blocked,
            **self.provenance.to_record(),
            "parts": [item.to_dict() for item in self.parts],
            "relations": [item.to_dict() for item in self.relations],
            "additional": list(self.additional),
            "notes": list(self.notes),
        }

    def _summarise(self) -> str:
        items = ", ".join(f"{item.name} {item.decision}" for item in self.items)
        return f"{self.decision} ({items})"

    def _list_cells(self) -> list[tuple[str, ...]]:
        return format_item_cells(self.items)

    def _list_notes(self) -> list[str]:
        """Return the lines below the table: decision and its explanation."""
        return [f"{self.decision}", *explain_verdict(self)]

    def _list_rows(self) -> list[Record]:
        return build_verdict_rows(self)


def explain_verdict(verdict: Verdict) -> list[str]:
    """Return lines with the reasons of all that is not OK, and the notes."""
    reasons = [
        f"{item.name}: {item.reason}"
        for item in verdict.items
        if item.reason not in ("", verdict.blocked)
    ]
    not_ok = [
        f"{item.name}, {quantity.estimate.quantity.heading}: {quantity.reason}"
        for item in verdict.items
        for quantity in item.quantities
        if quantity.decision != Decision.OK
    ]
    blocked = [verdict.blocked] if verdict.blocked else []
    return [*blocked, *reasons, *not_ok, *verdict.notes]


def format_item_cells(items: Sequence[ItemVerdict]) -> list[tuple[str, ...]]:
    """Return the cells of a table: the header, then one row per quantity."""
    rows: list[tuple[str, ...]] = [QUANTITY_HEADER]
    for item in items:
        if not item.quantities:
            rows.append((item.name, "", "", "", "", "", str(item.decision)))
        rows += [
            format_quantity_cells(item.name if number == 0 else "", quantity)
            for number, quantity in enumerate(item.quantities)
        ]
    return rows


def build_verdict_rows(verdict: Verdict) -> list[Record]:
    """Return the rows of a table: one per quantity, and one per item without quantities."""
    rows: list[Record] = []
    for item in verdict.items:
        head: Record = {
            "decision": str(verdict.decision),
            "item": item.name,
            "item_decision": str(item.decision),
        }
        quantities = [quantity.to_dict() for quantity in item.quantities] or [
            dict.fromkeys(ROW_KEYS)
        ]
        for record in quantities:
            values = {key: record[key] for key in ROW_KEYS}
            values["quantity_decision"] = record.get("decision")
            values["reason"] = record.get("reason") or item.reason or verdict.blocked
            rows.append(head | values | _list_provenance_columns(verdict.provenance))
    return rows


def _list_provenance_columns(provenance: Provenance) -> Record:
    """Return the columns of a table that state job and version."""
    record = provenance.to_record()
    return {key: record[key] for key in ("job", "revision", "job_hash", "version")}
