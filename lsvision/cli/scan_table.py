"""Scan as text: cylinders in the base frame, and the shape of each."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lsvision.scan import ScanMeasurement, ScannedCylinder, TubeShape


def scan_lines(
    scan: "ScanMeasurement",
    shapes: "Sequence[TubeShape | None]",
    caption: str,
    *,
    verbose: bool,
) -> list[str]:
    """Return the lines of a scan's table, with remarks on each cylinder below.

    Parameters
    ----------
    scan : ScanMeasurement
        Measurement of the scan.
    shapes : sequence of TubeShape or None
        Shape of each cylinder; None where it has too few sections.
    caption : str
        Errors that the standard deviations include, from `motion_uncertainty_caption`.
    verbose : bool
        Whether to list the rejected tracks.
    """
    from lsvision.results.summaries import counted
    from lsvision.results.tables import text_table
    from lsvision.scan.scan_table import tube_cells

    profiles = counted(len(scan.measurements), "profile")
    rejected = [f"  {rejection}" for rejection in scan.rejections]
    if scan.cylinders:
        lines = [f"{profiles}, base frame, {caption}", *text_table(tube_cells(scan.cylinders))]
        for number, (tube, shape) in enumerate(zip(scan.cylinders, shapes, strict=True), 1):
            lines += [f"  {number}: {line}" for line in _remarks(tube, shape)]
    else:
        lines = [f"{profiles}: no cylinder found: {scan.reason}"]
        if len(rejected) > 1 and not verbose:
            lines[0] += f" ({len(rejected)} tracks rejected: -v lists them)"
    if verbose and rejected:
        lines += [f"rejected: {len(rejected)}", *rejected]
    return lines


def _remarks(tube: "ScannedCylinder", shape: "TubeShape | None") -> list[str]:
    """Return the lines below the table on a cylinder: its axial range, twin and shape."""
    from lsvision.scan.scan_table import twin_note
    from lsvision.scan.shape_result import shape_lines

    low, high = tube.axial_range
    remarks = [f"measured from {low:z.1f} to {high:z.1f} mm along the axis from its point"]
    if tube.twin is not None:
        remarks.append(twin_note(tube.twin))
    if shape is not None:
        remarks += shape_lines(shape)
    return remarks
