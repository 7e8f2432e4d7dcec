"""Profiles of several items of a list in one, with their attributes."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.settings import RawProfiles

_POSITIONS_LEFT_OUT = "positions along the travel left out: {} of {} profiles have none"
"""Note on positions that only some profiles have."""


def build_empty_profile() -> RawProfiles:
    """Return one profile without points, which keeps its place among others."""
    return RawProfiles(sections=[np.full((1, 2), np.nan)])


def join_profiles(parts: Sequence[RawProfiles]) -> RawProfiles:
    """Return all profiles in one, in their order.

    Attributes that a profile lacks are left out of its own, and positions are kept if all profiles
    have one. Profiles without points have the units and the direction of the others; those without
    a unit that of the others, with a note.

    Raises
    ------
    UnreadableFile
        If units or directions differ.
    """
    with_points = [part for part in parts if not _is_empty(part)] or list(parts)
    units, unit_notes = _find_common_units(with_points)
    if units is None or len({(part.position_unit, part.away) for part in with_points}) > 1:
        raise UnreadableFile(
            "its profiles differ in their units, or in the direction of heights: write all alike, "
            "or one file per profile"
        )
    attributes = [row for part in parts for row in part.attributes or [{}] * len(part.sections)]
    positions = [part.positions for part in parts if part.positions is not None]
    notes = dict.fromkeys(chain(*(part.notes for part in parts), unit_notes))
    count = sum(len(part.sections) for part in parts)
    if positions and len(positions) < len(parts):
        missing = count - sum(map(len, positions))
        notes[_POSITIONS_LEFT_OUT.format(missing, count)] = None
    return replace(
        with_points[0],
        units=units,
        sections=[section for part in parts for section in part.sections],
        attributes=tuple(attributes) if any(attributes) else (),
        positions=tuple(chain(*positions)) if len(positions) == len(parts) else None,
        notes=tuple(notes),
        lost=tuple(dict.fromkeys(value for part in parts for value in part.lost)),
        ignored=tuple(dict.fromkeys(column for part in parts for column in part.ignored)),
    )


def add_attributes(profiles: RawProfiles, attributes: Mapping[str, float | str]) -> RawProfiles:
    """Return the profiles with attributes of the object around them.

    Of those with the same name, the one in the inner object, nearer to the points, is kept.
    """
    if not attributes or not profiles.sections:
        return profiles
    inner: Sequence[Mapping[str, float | str]] = profiles.attributes
    inner = inner or [{}] * len(profiles.sections)
    return replace(profiles, attributes=tuple({**attributes, **row} for row in inner))


def _find_common_units(
    parts: Sequence[RawProfiles],
) -> tuple[tuple[str | None, str | None] | None, tuple[str, ...]]:
    """Return the units of x and height that all, or some and no others, state; None if they differ.

    And a note if some profiles state none.
    """
    by_axis = [set(units) - {None} for units in zip(*(part.units for part in parts), strict=True)]
    if max(map(len, by_axis)) > 1:
        return None, ()
    x, height = (next(iter(units), None) for units in by_axis)
    lacking = sum(part.units != (x, height) for part in parts)
    if not lacking:
        return (x, height), ()
    stated = " and ".join(dict.fromkeys(filter(None, (x, height))))
    return (x, height), (f"{lacking} of {len(parts)} profiles state no unit: taken as {stated}",)


def _is_empty(part: RawProfiles) -> bool:
    return all(np.isnan(section).all() for section in part.sections)
