"""A scan as text: cylinders in the base frame, and the shape of each."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from lsvision.cli.section_table import reason_without_cylinder

if TYPE_CHECKING:
    from lsvision.scan import ScanMeasurement, ScannedCylinder, TubeShape
    from lsvision.scan.shape import FormDeviation

HEADER = (
    "",
    "radius mm",
    "direction x y z",
    "± deg",
    "point x y z mm",
    "± mm",
    "sections",
    "points",
)
SIGNIFICANCE = 0.01
"""Level of the tests of shape."""


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
        List what was refused; else only the longest track is told if nothing was found.
    """
    count = len(scan.measurements)
    profiles = f"{count} profile{'' if count == 1 else 's'}"
    refused = [f"  sections {_spans(r.sections)}: {r.reason}" for r in scan.rejections]
    if scan.cylinders:
        lines = [f"{profiles}, base frame, {sigma}", *_table(scan.cylinders)]
        for number, (tube, shape) in enumerate(zip(scan.cylinders, shapes, strict=True), 1):
            lines += [f"  {number}: {line}" for line in _remarks(tube, shape)]
    else:
        lines = [f"{profiles}: no cylinder found: {_reason_without_cylinder(scan)}"]
        if len(refused) > 1 and not verbose:
            lines[0] += f" ({len(refused)} tracks refused: -v lists them)"
    if verbose and refused:
        lines += [f"refused: {len(refused)}", *refused]
    return lines


def _reason_without_cylinder(scan: "ScanMeasurement") -> str:
    """What is said of the longest track, or else of the first section that holds nothing."""
    if scan.rejections:
        return max(scan.rejections, key=lambda rejection: len(rejection.sections)).reason
    empty = [section for section in scan.measurements if not section.cylinders]
    return reason_without_cylinder(empty[0]) if empty else "no section goes with another"


def _table(cylinders: "Sequence[ScannedCylinder]") -> list[str]:
    rows = [HEADER, *(_row(number, tube) for number, tube in enumerate(cylinders, 1))]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADER))]
    return [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def _row(number: int, tube: "ScannedCylinder") -> tuple[str, ...]:
    from lsvision.draw import decimals_for, format_std, format_value

    places, point_places = decimals_for(tube.direction_std), decimals_for(tube.position_std)
    return (
        str(number),
        format_value(tube.radius, tube.radius_std),
        " ".join(f"{part:+.{places}f}" for part in tube.direction),
        format_std(math.degrees(tube.direction_std)),
        " ".join(f"{part:.{point_places}f}" for part in tube.point),
        format_std(tube.position_std),
        _spans(tube.sections),
        str(len(tube.points)),
    )


def _remarks(tube: "ScannedCylinder", shape: "TubeShape | None") -> list[str]:
    low, high = tube.axial_range
    remarks = [f"seen from {low:.1f} to {high:.1f} mm along the axis from its point"]
    if tube.twin is not None:
        x, y, z = tube.twin.direction
        remarks.append(
            f"one section alone: its twin ({x:+.4f} {y:+.4f} {z:+.4f}) fits as well; a second "
            "section tells"
        )
    if shape is not None:
        remarks += _shape_lines(shape)
    return remarks


def _shape_lines(shape: "TubeShape") -> list[str]:
    from lsvision.draw import format_value

    bow = (
        f"{format_value(shape.bow.size, shape.bow.size_std)} mm over {2 * shape.half_length:.0f} mm"
    )
    if shape.bow.is_significant(SIGNIFICANCE):
        bow += f", a radius of {format_value(shape.bow_radius / 1e3, shape.bow_radius_std / 1e3)} m"
    slope = 1e3 * shape.taper_slope
    slope_std = 1e3 * shape.taper.size_std / shape.half_length
    ovality = format_value(100 * shape.ovality, 100 * shape.ovality_std)
    return [
        f"bow {bow} ({_verdict(shape.bow)})",
        f"taper {format_value(slope, slope_std)} mm/m ({_verdict(shape.taper)})",
        f"ovality {ovality} % ({_verdict(shape.ovality_terms)})",
    ]


def _verdict(deviation: "FormDeviation") -> str:
    return "significant" if deviation.is_significant(SIGNIFICANCE) else "not significant"


def _spans(sections: Sequence[int]) -> str:
    """``0-4, 7`` of (0, 1, 2, 3, 4, 7)."""
    spans: list[list[int]] = []
    for section in sections:
        if spans and section == spans[-1][1] + 1:
            spans[-1][1] = section
        else:
            spans.append([section, section])
    return ", ".join(f"{low}-{high}" if high > low else str(low) for low, high in spans)
