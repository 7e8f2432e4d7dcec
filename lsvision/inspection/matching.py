"""Assignment of measured cylinders to parts: by position, order or radius."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.section import CylinderSection
from lsvision.inspection.job_tables import Part
from lsvision.inspection.relate import MeasuredCylinder

MAX_RADIUS_DEVIATION = 0.2
"""Relative deviation from the expected radius beyond which a cylinder is another part."""


@dataclass(frozen=True)
class Matching:
    """Assignment of cylinders to parts.

    `cylinders` has the index of the cylinder of each part that was found, `additional` the indices
    of cylinders that are not parts of the job. `owners` is for parts whose cylinder already belongs
    to an earlier part: it has the name of that earlier part.
    """

    cylinders: Mapping[str, int]
    additional: tuple[int, ...]
    owners: Mapping[str, str]


def match_parts(parts: Sequence[Part], cylinders: Sequence[MeasuredCylinder]) -> Matching:
    """Return the assignment of cylinders to parts.

    A part with windows is assigned the cylinder that lies in them and nearest to their middle; a
    part with an order, the cylinder of that number, from left to right in a profile. Of the
    remaining cylinders as many as possible are assigned to the other parts, each with a relative
    deviation of the radius of at most 20 %, such that the sum of the deviations is smallest.
    """
    matched: dict[str, int] = {}
    owners: dict[str, str] = {}
    for part in parts:
        index = _match_by_position_or_order(part, cylinders)
        if index is None:
            continue
        owner = next((name for name, taken in matched.items() if taken == index), None)
        if owner is None:
            matched[part.name] = index
        else:
            owners[part.name] = owner
    unassigned = [index for index in range(len(cylinders)) if index not in matched.values()]
    by_radius = [part for part in parts if not part.windows and part.order is None]
    matched |= _match_by_radius(by_radius, cylinders, unassigned)
    additional = tuple(index for index in unassigned if index not in matched.values())
    return Matching(matched, additional, owners)


def _match_by_position_or_order(part: Part, cylinders: Sequence[MeasuredCylinder]) -> int | None:
    """Return the index of the part's cylinder; None without one, or without position and order."""
    if part.order is not None:
        return part.order - 1 if part.order <= len(cylinders) else None
    if not part.windows:
        return None
    distances: dict[int, float] = {}
    for index, cylinder in enumerate(cylinders):
        position = cylinder.centre if isinstance(cylinder, CylinderSection) else cylinder.point
        axes = zip("xyz", map(float, position), strict=False)  # a section has no z
        pairs = [(coordinate, part.windows[a]) for a, coordinate in axes if a in part.windows]
        if all(low <= coordinate <= high for coordinate, (low, high) in pairs):
            middles = (coordinate - (low / 2 + high / 2) for coordinate, (low, high) in pairs)
            distances[index] = math.hypot(*middles)
    return min(distances, key=distances.__getitem__, default=None)


def _match_by_radius(
    parts: Sequence[Part], cylinders: Sequence[MeasuredCylinder], unassigned: Sequence[int]
) -> dict[str, int]:
    """Return the index of each part's cylinder, assigned by the smallest sum of deviations."""
    if not parts or not unassigned:
        return {}
    from scipy.optimize import linear_sum_assignment

    expected_radii = np.array([part.expected_radius for part in parts], dtype=np.float64)
    radii = np.array([cylinders[index].radius for index in unassigned])
    deviations = np.abs(radii / expected_radii[:, None] - 1)
    forbidden_cost = 1.0 + len(parts)  # more than all permitted deviations together
    rows, columns = linear_sum_assignment(
        np.where(deviations > MAX_RADIUS_DEVIATION, forbidden_cost, deviations)
    )
    return {
        parts[row].name: unassigned[column]
        for row, column in zip(rows, columns, strict=True)
        if deviations[row, column] <= MAX_RADIUS_DEVIATION
    }
