"""Result of `lsvision.relate`: distance, angle, gap and flush of two cylinders."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from lsvision.geometry import FloatArray
from lsvision.geometry.equality import ComparedByValue
from lsvision.inspection.uncertain import Uncertain
from lsvision.results.number_format import format_std
from lsvision.results.quantities import (
    LEVEL,
    Estimate,
    Quantity,
    Record,
    convert_numbers_to_json,
    flatten_record,
)
from lsvision.results.result import Result

RELATION_QUANTITIES = {
    quantity.name: quantity
    for quantity in (
        Quantity("distance", "mm"),
        Quantity("angle", "deg"),
        Quantity("gap", "mm"),
        Quantity("flush", "mm"),
    )
}
"""Quantities of two cylinders, by name."""


@dataclass(frozen=True, eq=False)
class Seam(ComparedByValue):
    """Line midway between the surfaces of two cylinders, base frame.

    Parameters
    ----------
    points : (2, 3) ndarray
        Point of each axis at which the cylinders are compared; see `crossing`. Units: mm.
    point : (3,) ndarray
        Middle of the gap between both surfaces, on the line through `points`. Units: mm.
    point_covariance : (3, 3) ndarray
        Covariance of `point`; without a crossing it is singular along `direction`, because any
        point along the seam is valid. Units: mm^2.
    direction : (3,) ndarray
        Unit vector midway between both directions: along a weld between pipes that touch along
        their length.
    direction_std : float
        Root mean square angle of `direction` to the true one; pi / 2 if the axes may be
        perpendicular. Units: rad.
    crossing : bool
        Whether `points` are the ends of the common perpendicular of the axes, because it lies
        within the observed length of both cylinders or the angle of the axes exceeds 70 deg;
        otherwise they are in the middle of the length along which both were observed.
    """

    points: FloatArray
    point: FloatArray
    point_covariance: FloatArray
    direction: FloatArray
    direction_std: float
    crossing: bool

    @property
    def point_std(self) -> float:
        """Root mean square distance of `point` from the true one. Units: mm."""
        return math.sqrt(float(self.point_covariance.trace()))

    def to_record(self) -> Record:
        """Return the points, direction and their uncertainties, ready for JSON."""
        return {
            "points_mm": [convert_numbers_to_json(point) for point in self.points],
            "seam_point_mm": convert_numbers_to_json(self.point),
            "seam_point_std_mm": self.point_std,
            "seam_direction": convert_numbers_to_json(self.direction),
            "seam_direction_std_deg": math.degrees(self.direction_std),
            "crossing": self.crossing,
        }


@dataclass(frozen=True, eq=False, repr=False)
class Relation(Result):
    """Distances and angle between two cylinders.

    Parameters
    ----------
    quantities : mapping of str to Uncertain
        ``distance``, ``angle``, ``gap`` and, where a direction for it is known, ``flush``.
        Units: mm, rad.
    seam : Seam, optional
        Point and direction midway between both surfaces; only of cylinders in space.

    Examples
    --------
    >>> import lsvision as lsv
    >>> section = lsv.simulate.random_section("welded_pair", 5, noise_mm=0.02)
    >>> left, right = lsv.measure_cylinders(section.profile).cylinders
    >>> relation = lsv.relate(left, right)
    >>> low, high = relation.interval("gap")
    >>> low < relation.gap < high
    True
    >>> relation.estimate("gap").value == relation.to_dict()["gap_mm"]
    True
    """

    quantities: Mapping[str, Uncertain]
    seam: Seam | None = None

    @property
    def distance(self) -> float:
        """Distance of both centres in the section, or of both axes in space. Units: mm."""
        return self.quantities["distance"].value

    @property
    def distance_std(self) -> float:
        """Standard uncertainty of `distance`. Units: mm."""
        return self.quantities["distance"].std

    @property
    def angle(self) -> float:
        """Angle between both axes, at most 90 deg. Units: rad.

        For two sections, the smallest angle that the unknown signs of their tilts allow.
        """
        return self.quantities["angle"].value

    @property
    def angle_std(self) -> float:
        """Standard uncertainty of `angle`. Units: rad."""
        return self.quantities["angle"].std

    @property
    def gap(self) -> float:
        """Distance of both surfaces, negative if they overlap. Units: mm."""
        return self.quantities["gap"].value

    @property
    def gap_std(self) -> float:
        """Standard uncertainty of `gap`. Units: mm."""
        return self.quantities["gap"].std

    def interval(self, quantity: str, level: float = LEVEL) -> tuple[float, float]:
        """Return the interval that contains the true value with probability `level`.

        Parameters
        ----------
        quantity : {"distance", "angle", "gap", "flush"}
            Units: mm, or rad for the angle.
        level : float
            Between 0 and 1.

        Returns
        -------
        low, high : float
            Ends of the interval; at least 0 for distance and angle.

        Raises
        ------
        ValueError
            If the quantity is none of these, or is flush and no direction for it was given; if the
            level is not between 0 and 1.
        """
        if quantity not in self.quantities:
            raise ValueError(
                f"expected a quantity among {', '.join(self.quantities)}, got {quantity!r}"
            )
        if not 0 < level < 1:
            raise ValueError(f"expected a level between 0 and 1, got {level}")
        return self.quantities[quantity].interval(level)

    def estimate(self, name: str, level: float = LEVEL) -> Estimate:
        """Return a quantity in its unit, mm or deg, with its interval.

        Parameters
        ----------
        name : {"distance", "angle", "gap", "flush"}
            Name of the quantity.
        level : float
            Level of confidence of the interval, between 0 and 1.

        Returns
        -------
        Estimate
            Value, standard uncertainty and interval at `level`.

        Raises
        ------
        ValueError
            See `interval`.
        """
        interval = self.interval(name, level)
        quantity, number = RELATION_QUANTITIES[name], self.quantities[name]
        ends = quantity.convert_to_unit(interval)
        return Estimate(quantity, number.value * quantity.scale, number.std * quantity.scale, ends)

    def to_dict(self) -> Record:
        """Return the quantities with their intervals and the seam, ready for JSON.

        Returns
        -------
        dict
            Lengths in ``*_mm``, angles in ``*_deg``.
        """
        record: Record = {}
        for name in self.quantities:
            record |= self.estimate(name).record
        return record if self.seam is None else record | self.seam.to_record()

    def _list_rows(self) -> list[Record]:
        """Return the row of the data frame, with two columns for each interval."""
        return [flatten_record(self.to_dict(), tuple(RELATION_QUANTITIES.values()))]

    def _summarise(self) -> str:
        estimates = [self.estimate(name) for name in self.quantities]
        return ", ".join(
            f"{estimate.quantity.name} {estimate.text} {estimate.quantity.unit_text}"
            for estimate in estimates
        )

    def _list_cells(self) -> list[tuple[str, ...]]:
        estimates = [self.estimate(name) for name in self.quantities]
        return [
            ("", *(estimate.quantity.heading for estimate in estimates)),
            ("", *(estimate.text for estimate in estimates)),
            ("95 %", *(estimate.interval_text for estimate in estimates)),
        ]

    def _list_notes(self) -> list[str]:
        """Return the line on the seam below the table, if there is a seam."""
        seam = self.seam
        if seam is None:
            return []
        point = " ".join(f"{coordinate:z.3f}" for coordinate in seam.point)
        x, y, z = seam.direction
        where = "nearest approach" if seam.crossing else "middle of the common length"
        return [
            f"seam ({point}) ± {format_std(seam.point_std)} mm, direction ({x:+z.4f} {y:+z.4f} "
            f"{z:+z.4f}) ± {format_std(math.degrees(seam.direction_std))} deg, at the {where}"
        ]
