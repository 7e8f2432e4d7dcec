"""A scan as text: cylinders in the base frame, and the shape of each."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lsvision.scan import ScanMeasurement, ScannedCylinder, TubeShape


def scan_lines(
    scan: "ScanMeasurement",
    shapes: "Sequence[TubeShape | None]",
    sigma: str,
    *,
    verbose: bool,
) -> list[str]:
    """What a scan holds: the table, and below it what is special about each cylinder.

    Parameters
    ----------
    scan : ScanMeasurement
        What was found.
    shapes : sequence of TubeShape or None
        Of each cylinder.
    sigma : str
        What the errors are, from `motion_uncertainty_caption`.
    verbose : bool
        List what was refused; else it is only counted if nothing was found.
    """
    from lsvision.results.tables import text_table
    from lsvision.scan.scan_table import tube_cells

    count = len(scan.measurements)
    profiles = f"{count} profile{'' if count == 1 else 's'}"
    refused = [f"  {rejection}" for rejection in scan.rejections]
    if scan.cylinders:
        lines = [f"{profiles}, base frame, {sigma}", *text_table(tube_cells(scan.cylinders))]
        for number, (tube, shape) in enumerate(zip(scan.cylinders, shapes, strict=True), 1):
            lines += [f"  {number}: {line}" for line in _remarks(tube, shape)]
    else:
        hint = f" ({len(refused)} tracks refused: -v says why)" if refused and not verbose else ""
        lines = [f"{profiles}: no cylinder found{hint}"]
    if verbose and refused:
        lines += [f"refused: {len(refused)}", *refused]
    return lines


def _remarks(tube: "ScannedCylinder", shape: "TubeShape | None") -> list[str]:
    from lsvision.scan.scan_table import twin_note
    from lsvision.scan.shape_result import shape_lines

    low, high = tube.axial_range
    remarks = [f"seen from {low:.1f} to {high:.1f} mm along the axis from its point"]
    if tube.twin is not None:
        remarks.append(twin_note(tube.twin))
    if shape is not None:
        remarks += shape_lines(shape)
    return remarks
