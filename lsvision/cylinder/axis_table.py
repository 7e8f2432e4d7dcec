"""Quantities of a cylinder in space, as cells of a table and as a record."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, get_args

from lsvision.results.number_format import decimals_for, format_std, format_value
from lsvision.results.quantities import Record, json_numbers

if TYPE_CHECKING:
    from lsvision.cylinder.fit_result import CylinderFit

AxisQuantity = Literal[
    "radius", "point_x", "point_y", "point_z", "direction_x", "direction_y", "direction_z"
]
"""Quantities that have an interval: lengths in mm, and components of a unit vector."""
AXIS_QUANTITIES: tuple[AxisQuantity, ...] = get_args(AxisQuantity)

AXIS_HEADER = ("radius mm", "direction x y z", "± deg", "point x y z mm", "± mm")
COVARIANCE_ORDER = "point along e_phi, e_theta (mm), direction along them (rad), radius (mm)"


def axis_cells(fit: "CylinderFit") -> tuple[str, ...]:
    """Return the cells of a cylinder in the columns of `AXIS_HEADER`; `±` is one sigma."""
    direction_decimals = decimals_for(fit.direction_std)
    point_decimals = decimals_for(fit.position_std)
    return (
        format_value(fit.radius, fit.radius_std),
        " ".join(f"{component:+z.{direction_decimals}f}" for component in fit.direction),
        format_std(math.degrees(fit.direction_std)),
        " ".join(f"{coordinate:z.{point_decimals}f}" for coordinate in fit.point),
        format_std(fit.position_std),
    )


def axis_record(fit: "CylinderFit") -> Record:
    """Return axis, radius and covariance, ready for JSON: lengths in mm, angles in deg.

    Only the covariance of the direction is in rad, as its order states.
    """
    return {
        "point_mm": json_numbers(fit.point),
        "position_std_mm": fit.position_std,
        "direction": json_numbers(fit.direction),
        "direction_std_deg": math.degrees(fit.direction_std),
        "radius_mm": fit.radius,
        "radius_std_mm": fit.radius_std,
        "covariance_order": COVARIANCE_ORDER,
        "covariance": [json_numbers(row) for row in fit.covariance],
    }


def axis_row(record: Record, interval: Sequence[float]) -> Record:
    """Return the columns of a data frame from the record of a cylinder.

    `interval` is the 95 % interval of the radius. Units: mm.
    """
    x, y, z = record["point_mm"]
    u, v, w = record["direction"]
    low, high = interval
    return {
        "radius_mm": record["radius_mm"],
        "radius_std_mm": record["radius_std_mm"],
        "radius_low_95_mm": low,
        "radius_high_95_mm": high,
        "point_x_mm": x,
        "point_y_mm": y,
        "point_z_mm": z,
        "position_std_mm": record["position_std_mm"],
        "direction_x": u,
        "direction_y": v,
        "direction_z": w,
        "direction_std_deg": record["direction_std_deg"],
    }
