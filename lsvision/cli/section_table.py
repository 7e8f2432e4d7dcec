"""Measurements as text: a table of cylinders, each number with standard deviation and interval."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lsvision.detection.arcs import Rejection
    from lsvision.ellipse.section import CylinderSection
    from lsvision.measure import Measurement
    from lsvision.profile import Profile


def measurement_lines(
    measurement: "Measurement", profile: "Profile", *, verbose: bool
) -> list[str]:
    """Return the lines of a profile's table, or why there is no cylinder, and the rejected arcs.

    Parameters
    ----------
    measurement : Measurement
        Measurement of the profile.
    profile : Profile
        Measured profile.
    verbose : bool
        Whether to add notes on correlated residuals, and the rejected arcs in the order of the
        profile.
    """
    from lsvision.ellipse.section_table import section_cells
    from lsvision.results.summaries import counted
    from lsvision.results.tables import text_table

    rejections = sorted(measurement.rejections, key=lambda r: (r.arc.start, r.arc.stop))
    rejected = f"{counted(len(rejections), 'arc')} rejected"
    lines = text_table(section_cells(measurement.cylinders))
    if not measurement.cylinders:
        reason = measurement.reason
        more = f" ({rejected}: -v lists them)" if len(rejections) > 1 and not verbose else ""
        lines = [f"no cylinder found: {reason}{more}"]
    if verbose:
        lines += _correlation_notes(measurement.cylinders)
    if verbose and rejections:
        lines += [
            f"{rejected}:",
            *(_rejection_line(rejection, profile) for rejection in rejections),
        ]
    return lines


def _correlation_notes(cylinders: Sequence["CylinderSection"]) -> list[str]:
    """Return a note for each cylinder whose intervals are wider for correlated residuals."""
    return [
        f"  {number}: residuals correlated over {cylinder.residual_correlation:.1f} points along "
        "the line: intervals widened (the sensor smooths, or the cylinder is not exact)"
        for number, cylinder in enumerate(cylinders, 1)
        if cylinder.residual_correlation > 1
    ]


def _rejection_line(rejection: "Rejection", profile: "Profile") -> str:
    """Return the indices of a rejected arc's points, its range of x and the reason as one line."""
    arc = rejection.arc
    x = arc.of(profile)[:, 0]
    finite = [value for value in x.tolist() if math.isfinite(value)]
    where = f", x {min(finite):.1f} to {max(finite):.1f} mm" if finite else ""
    return f"  points {arc.start} to {arc.stop - 1}{where}: {rejection.reason}"
