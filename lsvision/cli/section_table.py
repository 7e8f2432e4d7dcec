"""Measurements as text: a table of cylinders, each number with its sigma and interval."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lsvision.detection.arcs import Rejection
    from lsvision.ellipse.section import CylinderSection
    from lsvision.measure import Measurement
    from lsvision.profile import Profile

HEADER = ("", "radius mm", "theta deg", "phi deg", "centre x mm", "centre y mm", "points")
LEVEL = 0.95


def cylinder_table(cylinders: Sequence["CylinderSection"]) -> list[str]:
    """Lines of a table: two for each cylinder, values with one sigma, then 95 % intervals."""
    rows: list[tuple[str, ...]] = [HEADER]
    for number, cylinder in enumerate(cylinders, 1):
        rows += _rows(number, cylinder)
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADER))]
    return [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def measurement_lines(
    measurement: "Measurement", profile: "Profile", *, verbose: bool
) -> list[str]:
    """What a profile holds: the table, or that there is nothing; and what was refused.

    Parameters
    ----------
    measurement : Measurement
        What was found.
    profile : Profile
        Where it was found.
    verbose : bool
        Say which residuals are correlated, and list the refused arcs from left to right; else
        only the longest is told if nothing was found.
    """
    rejections = sorted(measurement.rejections, key=lambda r: (r.arc.start, r.arc.stop))
    refused = f"{len(rejections)} arc{'' if len(rejections) == 1 else 's'} refused"
    lines = cylinder_table(measurement.cylinders)
    if not measurement.cylinders:
        reason = reason_without_cylinder(measurement)
        more = f" ({refused}: -v lists them)" if len(rejections) > 1 and not verbose else ""
        lines = [f"no cylinder found: {reason}{more}"]
    if verbose:
        lines += _correlation_notes(measurement.cylinders)
    if verbose and rejections:
        lines += [f"{refused}:", *(_refusal(rejection, profile) for rejection in rejections)]
    return lines


def reason_without_cylinder(measurement: "Measurement") -> str:
    """Why a profile holds no cylinder: what is said of the longest of its refused arcs."""
    longest = max(measurement.rejections, key=lambda r: r.arc.stop - r.arc.start, default=None)
    return "no valid point" if longest is None else longest.reason


def _correlation_notes(cylinders: Sequence["CylinderSection"]) -> list[str]:
    return [
        f"  {number}: residuals correlated along the line, {cylinder.residual_correlation:.1f} "
        "points count as one: intervals widened (sensor smooths, or no exact cylinder)"
        for number, cylinder in enumerate(cylinders, 1)
        if cylinder.residual_correlation > 1
    ]


def _rows(number: int, cylinder: "CylinderSection") -> list[tuple[str, ...]]:
    deg = math.degrees(1.0)
    x_std, y_std = (math.sqrt(variance) for variance in cylinder.covariance.diagonal()[:2])
    x, y = cylinder.centre
    cells = [
        _with_sigma(value * scale, std * scale, _interval(cylinder, quantity, scale))
        for quantity, value, std, scale in (
            ("radius", cylinder.radius, cylinder.radius_std, 1.0),
            ("theta", cylinder.theta, cylinder.theta_std, deg),
            ("phi", cylinder.phi, cylinder.phi_std, deg),
            ("centre_x", x, x_std, 1.0),
            ("centre_y", y, y_std, 1.0),
        )
    ]
    values, intervals = ([cell[line] for cell in cells] for line in (0, 1))
    if not cylinder.theta_determined:
        values[1] = "not determinable"
    return [
        (str(number), *values, str(len(cylinder.indices))),
        (f"{LEVEL:.0%}".replace("%", " %"), *intervals, ""),
    ]


def _interval(cylinder: "CylinderSection", quantity: str, scale: float) -> tuple[float, float]:
    low, high = cylinder.interval(quantity, LEVEL)  # type: ignore[arg-type] # names of the table
    return low * scale, high * scale


def _with_sigma(value: float, std: float, interval: tuple[float, float]) -> tuple[str, str]:
    from lsvision.draw import decimals_for, format_value

    low, high = interval
    places = decimals_for(std)
    return format_value(value, std), f"{low:.{places}f} .. {high:.{places}f}"


def _refusal(rejection: "Rejection", profile: "Profile") -> str:
    arc = rejection.arc
    x = arc.of(profile)[:, 0]
    seen = [value for value in x.tolist() if math.isfinite(value)]
    where = f", x {min(seen):.1f} to {max(seen):.1f} mm" if seen else ""
    return f"  points {arc.start} to {arc.stop - 1}{where}: {rejection.reason}"
