"""x of heights without x, stated as start and step in the text of a file."""

import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import islice

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.stated_units import select_for_axis
from lsvision.io.profiles.unit_statements import (
    MAX_LINE_LENGTH,
    MAX_MENTION_LINES,
    find_unit_statements,
)
from lsvision.io.profiles.units import find_mm_per_unit, parse_unit

_STEP = r"(?:step(?:\s?size)?|pitch|spacing|increment|inc|delta|res(?:olution)?)"
_START = r"(?:start|first|begin|min|origin|offset|0)"
_VALUE = (
    r"\s*(?:[\[(]\s*(?P<key_unit>[^\W\d_]+)\s*[\])]\s*)?(?:[:=,;\t]|\bis\b|\s)\s*"
    r"(?P<number>[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:e[-+]?[0-9]+)?)"
    r"\s*(?P<unit>[^\W\d_]+)?"
)
# "dx = 0.1 mm", "XPitch;0.1" or "step x: 0.1".
_DX = re.compile(rf"(?<!\w)(?:dx|(?:x|lateral|point)[ .-]?{_STEP}|{_STEP} x){_VALUE}")
# "x0 = -3", "x start: -3" or "XStart;-3".
_X0 = re.compile(rf"(?<!\w)(?:(?:x|lateral)[ .-]?{_START}|{_START} x){_VALUE}")
_CAMEL = re.compile(r"(?<=[a-zA-Z])(?=[A-Z][a-z])|_")


def read_with_stated_positions(
    read: Callable[[ReadSettings], RawProfiles],
    lines: Callable[[], Iterable[str]],
    settings: ReadSettings,
) -> RawProfiles:
    """Return the profiles of `read`; if it fails, with x as the lines state it.

    A note then says so.

    Raises
    ------
    UnreadableFile
        The first error of `read` if it fails with x of the lines, too, or these state none.
    """
    try:
        return read(settings)
    except UnreadableFile as error:
        positions = _find_positions(lines()) if settings.dx is None else {}
        if not positions:
            raise
        try:
            profiles = read(replace(settings, x0=positions.get("x0"), dx=positions["dx"]))
        except UnreadableFile:
            raise error from None
    stated = " and ".join(f"{name} = {value:g} mm" for name, value in positions.items())
    return replace(profiles, notes=(*profiles.notes, f"x of the heights by {stated} in the file"))


def _find_positions(lines: Iterable[str]) -> dict[str, float]:
    """Return the start ``x0``, if any, and the step ``dx`` that lines state; empty without a step.

    They are in mm; in another stated unit of x, or with contradicting values, none are returned.

    Examples
    --------
    >>> _find_positions(["# x0=-3, dx=0.1"]), _find_positions(["XPitch [um];50"])
    ({'x0': -3.0, 'dx': 0.1}, {'dx': 0.05})
    """
    known = [line for line in islice(lines, MAX_MENTION_LINES) if len(line) <= MAX_LINE_LENGTH]
    about_x = select_for_axis(find_unit_statements(known), "x")
    if any(statement.unit.unit != "mm" for statement in about_x):
        return {}
    positions: dict[str, float] = {}
    for name, pattern in (("x0", _X0), ("dx", _DX)):
        texts = (_CAMEL.sub(" ", line).lower() for line in known)
        values = {_to_mm(match) for text in texts for match in pattern.finditer(text)}
        if len(values) > 1:
            return {}
        positions |= dict.fromkeys([name] * len(values), *values)
    return positions if positions.get("dx") else {}


def _to_mm(match: re.Match[str]) -> float:
    """Return the stated number in mm, which is the unit of one without."""
    unit = parse_unit(match["unit"] or match["key_unit"] or "mm")
    return float(match["number"]) * find_mm_per_unit(unit or "mm")
