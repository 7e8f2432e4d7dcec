"""Contradictions between the tables of a job: ambiguous parts, limits that no cylinder can meet."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

from lsvision.detection.radius_range import NOMINAL_SPREAD
from lsvision.inspection.job_mistakes import Location
from lsvision.inspection.job_tables import Golden, Measure, Part, RelationLimits
from lsvision.inspection.limits import POSSIBLE_RANGES, Limits, quantity_from_key

LocatedMistake = tuple[Location, str]
"""Location in the job, and what is wrong there."""


def find_ambiguous_parts(parts: Sequence[Part]) -> list[LocatedMistake]:
    """Return the mistakes of parts that have the same name or select the same cylinder."""
    mistakes: list[LocatedMistake] = []
    for (_, first), (number, second) in itertools.combinations(enumerate(parts), 2):
        location = ("part", number)
        if first.name == second.name:
            mistakes.append(
                ((*location, "name"), f"two parts are named {first.name!r}: rename one")
            )
        if first.order is not None and first.order == second.order:
            mistakes.append(
                (
                    (*location, "order"),
                    f"{first.name!r} and {second.name!r} select the same cylinder, order "
                    f"{first.order}: give each part an order of its own",
                )
            )
        if first.windows and second.windows and _overlap(first, second):
            mistakes.append(
                (
                    (*location, f"{next(iter(second.windows))}_mm"),
                    f"{first.name!r} and {second.name!r} select the same cylinder: their windows "
                    "overlap; separate the windows",
                )
            )
    return mistakes


def _overlap(first: Part, second: Part) -> bool:
    """Return whether some position lies in the windows of both parts; common edges do not count."""
    unlimited = (float("-inf"), float("inf"))
    for axis in "xyz":
        low_1, high_1 = first.windows.get(axis, unlimited)
        low_2, high_2 = second.windows.get(axis, unlimited)
        if max(low_1, low_2) >= min(high_1, high_2):
            return False
    return True


def find_unknown_parts(
    parts: Sequence[Part], relations: Sequence[RelationLimits]
) -> list[LocatedMistake]:
    """Return the mistakes of relations that name unknown parts."""
    names = [part.name for part in parts]
    mistakes: list[LocatedMistake] = []
    for number, relation in enumerate(relations):
        location = ("relation", number, "between")
        first, second = relation.between
        mistakes += [
            (location, f"no part is named {name!r}: the parts are {', '.join(map(repr, names))}")
            for name in relation.between
            if name not in names
        ]
        if first == second:
            mistakes.append((location, f"expected two parts, got {first!r} twice"))
    return mistakes


def find_limits_of_known_values(
    measure: Measure,
    parts: Sequence[Part],
    relations: Sequence[RelationLimits],
    golden: Golden | None,
) -> list[LocatedMistake]:
    """Return the mistakes of limits that a known radius or tilt of all cylinders would decide.

    With the known radius of a part, its radius is judged as measured without it.
    """
    keys_by_known = {
        "known_radius_mm": ("radius_mm", "diameter_mm"),
        "known_phi_deg": ("phi_deg", "angle_deg"),
    }
    mistakes: list[LocatedMistake] = []
    for known, keys in keys_by_known.items():
        if getattr(measure, known) is None:
            continue
        remedy = (
            "write known_radius_mm under [[part]] instead" if "radius" in known else "leave it out"
        )
        message = f"would be compared with {known} of [measure], whatever the points say: {remedy}"
        places = [
            location for location, _ in _list_limits(parts, relations) if location[-1] in keys
        ]
        if golden is not None and "radius_mm" in keys:
            places.append(("golden", "radius_mm"))
        mistakes += [(place, f"{place[-1]} {message}") for place in places]
    return mistakes


def find_impossible_limits(
    measure: Measure, parts: Sequence[Part], relations: Sequence[RelationLimits]
) -> list[LocatedMistake]:
    """Return the mistakes of limits that no cylinder can meet: it would always be NG.

    They lie outside the possible values of their quantity, or those of radius and diameter exclude
    each other or the search range.
    """
    mistakes: list[LocatedMistake] = []
    for location, limits in _list_limits(parts, relations):
        key = str(location[-1])
        smallest, largest = POSSIBLE_RANGES.get(key, (-math.inf, math.inf))
        if _are_apart(limits.ends, (smallest, largest)):
            unit = quantity_from_key(key).unit_text
            possible = (
                f"{smallest:g} to {largest:g}" if largest < math.inf else f"from {smallest:g}"
            )
            mistakes.append(
                (location, f"{key}: limits {_format_range(limits.ends)} hold no possible value: "
                 f"expected some {possible} {unit}")
            )  # fmt: skip
    for number, part in enumerate(parts):
        mistakes += _find_excluded_radius(measure, part, number)
    return mistakes


def _find_excluded_radius(measure: Measure, part: Part, number: int) -> Iterator[LocatedMistake]:
    """Yield the mistakes of a part whose radius cannot be within all its limits at once."""
    radius = part.radius_mm.ends if part.radius_mm is not None else None
    half = tuple(end / 2 for end in part.diameter_mm.ends) if part.diameter_mm is not None else None
    if radius is not None and half is not None and _are_apart(radius, half):
        yield (
            ("part", number, "diameter_mm"),
            f"diameter_mm: half of it, {_format_range(half)}, excludes "
            f"radius_mm {_format_range(radius)}: leave one out",
        )
    searched = measure.radius_mm
    if searched is None:
        return
    if not isinstance(searched, tuple):
        searched = (searched * (1 - NOMINAL_SPREAD), searched * (1 + NOMINAL_SPREAD))
    for key, ends in (("radius_mm", radius), ("diameter_mm", half)):
        if ends is not None and _are_apart(ends, searched):
            yield (
                ("part", number, key),
                f"{key}: radius {_format_range(ends)} is not searched: radius_mm of [measure] is "
                f"{_format_range(searched)}",
            )


def _list_limits(
    parts: Sequence[Part], relations: Sequence[RelationLimits]
) -> list[tuple[Location, Limits]]:
    """Return all limits of parts and relations with their locations in the job."""
    tables = [("part", number, part.limits) for number, part in enumerate(parts)]
    tables += [("relation", number, each.limits) for number, each in enumerate(relations)]
    return [
        ((table, number, key), limits)
        for table, number, limits_by_key in tables
        for key, limits in limits_by_key.items()
    ]


def _are_apart(first: tuple[float, ...], second: tuple[float, ...]) -> bool:
    return first[1] < second[0] or second[1] < first[0]


def _format_range(ends: tuple[float, ...]) -> str:
    """Return a range as text, such as ``18.9 .. 19.1``."""
    low, high = ends
    if low == -math.inf:
        return f"<= {high:.9g}"
    return f">= {low:.9g}" if high == math.inf else f"{low:.9g} .. {high:.9g}"
