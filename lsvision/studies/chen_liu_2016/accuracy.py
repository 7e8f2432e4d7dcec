"""The accuracy table of the README, from the bound and from measurements."""

from collections.abc import Sequence

from lsvision.studies.chen_liu_2016.html import digits
from lsvision.studies.chen_liu_2016.methods import METHODS
from lsvision.studies.chen_liu_2016.published_results import QUANTITIES
from lsvision.studies.chen_liu_2016.tables import TableRow, pool_errors

HEAD = ("Paper's Table", "", "Radius, mm", "θ, °", "φ, °")
KNOWN = 1e-4
"""A radius error below is none: the radius was given. Units: mm."""


def readme_table(rows: Sequence[TableRow]) -> str:
    """Typical (root mean square) errors of Tables 1-4 as a Markdown table.

    Parameters
    ----------
    rows : sequence of TableRow
        As from `measure_tables`. The figures in brackets are the Cramer-Rao bound, which
        depends on geometry and noise only: a test can hold them to the README at no cost.

    Returns
    -------
    str
        Ends with a newline.
    """
    lines = ["| " + " | ".join(HEAD) + " |", "|---|---|---|---|---|"]
    for table in sorted({row.printed.table for row in rows}):
        own = [row for row in rows if row.printed.table == table]
        printed = [
            digits(max(abs(getattr(row.printed.errors, quantity)) for row in own))
            for quantity in QUANTITIES
        ]
        lines.append(_line(_name(own), "largest error printed", printed))
        for info, way in zip(METHODS.values(), METHODS, strict=True):
            spread = pool_errors([row.spreads[way] for row in own])
            cells = [
                _cell(getattr(spread.rms, quantity), getattr(spread.bound, quantity))
                for quantity in QUANTITIES
            ]
            lines.append(_line("", f"({info.letter}) {info.name}", cells))
    return "\n".join(lines) + "\n"


def _name(own: Sequence[TableRow]) -> str:
    first = own[0].printed
    if first.table == 4:
        return "4, welded: φ = 30, 20, 10°"
    return f"{first.table}: φ = {first.phi_deg:g}°"


def _cell(rms: float, bound: float) -> str:
    return "given" if bound < KNOWN else f"{digits(rms)} ({digits(bound)})"


def _line(table: str, name: str, cells: Sequence[str]) -> str:
    return "| " + " | ".join([table, name, *cells]) + " |"
