"""Sections of cylinders as a table: quantities and columns of text output and files."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from lsvision.results.quantities import LEVEL, Quantity, Record, flatten_record

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


def format_section_cells(sections: "Sequence[CylinderSection]") -> list[tuple[str, ...]]:
    """Return the cells of a table: per section a row of values with std, and one of intervals.

    Parameters
    ----------
    sections : sequence of CylinderSection
        Sections, numbered from 1 in the table.

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


def build_section_row(record: Record) -> Record:
    """Return the row of a data frame or CSV file, from the record of a section.

    Parameters
    ----------
    record : dict
        Result of `CylinderSection.to_dict`.

    Returns
    -------
    dict
        Row with the columns `SECTION_COLUMNS`.
    """
    row = flatten_record(record, SECTION_QUANTITIES) | {"points": len(record["indices"])}
    return {column: row[column] for column in SECTION_COLUMNS}
