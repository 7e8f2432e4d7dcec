"""Sections of cylinders as a table: the one list of the numbers that people and files get."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from lsvision.results.quantities import LEVEL, Quantity, Record, flat_row

if TYPE_CHECKING:
    from lsvision.ellipse.section import CylinderSection

SECTION_QUANTITIES = (
    Quantity("radius", "mm"),
    Quantity("theta", "deg"),
    Quantity("phi", "deg"),
    Quantity("centre_x", "mm"),
    Quantity("centre_y", "mm"),
)
"""Numbers of a section, in the order of tables, JSON, CSV and data frames."""

SECTION_COLUMNS = (
    *(column for quantity in SECTION_QUANTITIES for column in quantity.columns),
    "theta_determined",
    "points",
)
"""Columns of CSV and data frames."""


def section_cells(sections: "Sequence[CylinderSection]") -> list[tuple[str, ...]]:
    """Cells of a table: two rows a section, values with one sigma, then 95 % intervals.

    Parameters
    ----------
    sections : sequence of CylinderSection
        Numbered from 1.

    Returns
    -------
    list of tuple of str
        The first row is the header.
    """
    rows = [("", *(quantity.heading for quantity in SECTION_QUANTITIES), "points")]
    for number, section in enumerate(sections, 1):
        estimates = section.estimates
        points = str(len(section.indices))
        rows.append((str(number), *(estimate.text for estimate in estimates), points))
        rows.append((f"{100 * LEVEL:.0f} %", *(e.interval_text for e in estimates), ""))
    return rows


def section_row(record: Record) -> Record:
    """Row of a data frame or of CSV, from the record of a section.

    Parameters
    ----------
    record : dict
        As `CylinderSection.to_dict` gives it.

    Returns
    -------
    dict
        Its columns are `SECTION_COLUMNS`.
    """
    row = flat_row(record, SECTION_QUANTITIES) | {"points": len(record["indices"])}
    return {column: row[column] for column in SECTION_COLUMNS}
