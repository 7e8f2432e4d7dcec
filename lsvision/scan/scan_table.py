"""Cylinders of a scan as a table."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from lsvision.cylinder.axis_table import AXIS_HEADER, axis_cells
from lsvision.geometry import Cylinder

if TYPE_CHECKING:
    from lsvision.scan.scan_result import ScannedCylinder


def tube_cells(tubes: "Sequence[ScannedCylinder]") -> list[tuple[str, ...]]:
    """Return the cells of a table: a header and one row per cylinder, numbers with one sigma."""
    rows: list[tuple[str, ...]] = [("", *AXIS_HEADER, "sections", "points")]
    for number, tube in enumerate(tubes, 1):
        points = str(len(tube.points))
        rows.append((str(number), *axis_cells(tube.fit), format_ranges(tube.sections), points))
    return rows


def twin_notes(tubes: "Sequence[ScannedCylinder]") -> list[str]:
    """Return a numbered line for each cylinder that was measured in one section only."""
    return [
        f"  {number}: {twin_note(tube.twin)}"
        for number, tube in enumerate(tubes, 1)
        if tube.twin is not None
    ]


def twin_note(twin: Cylinder) -> str:
    """Return a line with the other possible direction of a cylinder of one section only."""
    x, y, z = twin.direction
    return (
        f"one section alone: its twin ({x:+z.4f} {y:+z.4f} {z:+z.4f}) fits equally well; a second "
        "section decides"
    )


def format_ranges(sections: Sequence[int]) -> str:
    """Return ascending indices as text, with consecutive ones as ranges.

    Examples
    --------
    >>> format_ranges((0, 1, 2, 3, 4, 7))
    '0-4, 7'
    """
    runs: list[list[int]] = []
    for section in sections:
        if runs and section == runs[-1][1] + 1:
            runs[-1][1] = section
        else:
            runs.append([section, section])
    return ", ".join(f"{low}-{high}" if high > low else str(low) for low, high in runs)
