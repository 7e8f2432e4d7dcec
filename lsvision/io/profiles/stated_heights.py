"""Direction and offsets of heights that the text of a file states beside its numbers."""

import re
from collections.abc import Iterable
from dataclasses import replace
from itertools import islice

from lsvision.io.profiles.direction_statements import note_unclear_direction, states_away
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.unit_statements import MAX_LINE_LENGTH, MAX_MENTION_LINES

_NUMBER = r"[-+]?(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+)"
_AXIS = r"(?:[xz]|heights?|höhen?|lateral|values?)"
_OFFSET = r"(?:offsets?|versatz|nullpunkt|zero\s*point)"
_OTHER_OFFSET = (
    "(?:trigger|encoder|time|gain|phase|temperature|angles?|frames?|index|intensity|dark|black"
    "|exposure|delay|byte|memory)"
)
"""Word of an offset of another quantity."""
# "z offset = -10 mm", "Offset Z [mm]; -10", "add 10 to z" or "z values relative to 10 mm".
_STATED_OFFSET = re.compile(
    rf"^(?!.*\b{_OTHER_OFFSET}\b)[^:=;]*?\b(?:{_AXIS}[ _.-]?{_OFFSET}|{_OFFSET}(?:[ _.-]?{_AXIS})?)"
    rf"\s*(?:[\[(][^\])]{{0,20}}[\])]\s*)?(?:is\b|[:=,;\t]|\s)\s*({_NUMBER})\s*"
    r"(?:[^\W\d_]{1,12})?\W*$"
    rf"|\b(?:add|subtract)\s+({_NUMBER}).*\b(?:to|from)\s+{_AXIS}\b"
    rf"|\b{_AXIS}\b.*\brelative\s+to\s+({_NUMBER})"
)
# "resolution: 0.01", "pixel size 0.1 mm" or "z resolution [um]; 10"; not "x resolution" or
# "resolution 640 x 480".
_RESOLUTION = re.compile(
    r"^(?!.*\b(?:x|y|lateral|time|angle|angular)\b).*\b(?:resolution|(?:pixel|voxel)\s?size"
    r"|increments?|normali[sz]\w*|conversion)\b\D*(?:0?[.,][0-9]+|[0-9.,]+\s*(?:[uµμ]m|mm))"
    r"(?:\s*(?:[uµμ]m|mm))?(?:\s+per\s+unit)?\W*$|\bfixed[ -]?point\b"
)
_ABOUT_X = re.compile(r"\b(?:x|lateral)\b")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])|_")


def resolve_direction(
    lines: Iterable[str], settings: ReadSettings, *, is_range: bool
) -> tuple[bool, tuple[str, ...]]:
    """Return whether heights grow away from the sensor, and notes on lines that are not used.

    They do if their name is that of a range, or a line states it. The notes are on a direction in
    words that are not understood, and on an offset, which the numbers may contain or not.

    Raises
    ------
    UnreadableFile
        If lines contradict each other.

    Examples
    --------
    >>> resolve_direction(["# z offset: -120 mm"], ReadSettings(), is_range=False)[1]
    ("the line '# z offset: -120 mm' states an offset, which is not added to the points",)
    """
    known = tuple(islice(lines, MAX_MENTION_LINES))
    offsets = tuple(
        f"the line {line.strip()[:80]!r} states an offset, which is not added to the points"
        for line in islice(filter(_states_offset, known), 1)
        if settings.x0 is None or _ABOUT_X.search(_CAMEL.sub(" ", line).lower()) is None
    )
    if is_range or settings.flip is not None:
        return is_range, offsets
    return states_away(known), (*note_unclear_direction(known), *offsets)


def add_direction(
    profiles: RawProfiles, lines: Iterable[str], settings: ReadSettings
) -> RawProfiles:
    """Return the profiles with the direction that lines beside them state; see above."""
    known = tuple(lines)
    away, notes = resolve_direction(known, settings, is_range=profiles.away)
    notes += note_resolution(known, profiles.units, settings)
    return replace(profiles, away=away, notes=tuple(dict.fromkeys((*profiles.notes, *notes))))


def note_resolution(
    lines: Iterable[str], units: tuple[str | None, str | None], settings: ReadSettings
) -> tuple[str, ...]:
    """Return a note on a line that states a resolution, if nothing states the unit of heights.

    It may be the length of a count, or a property of the sensor.

    Examples
    --------
    >>> note_resolution(["resolution_mm: 0.01"], (None, None), ReadSettings())
    ("the line 'resolution_mm: 0.01' may state the length of a count: state --units",)
    """
    if units[1] is not None or settings.units is not None or settings.count_unit is not None:
        return ()
    stated = next(filter(_states_resolution, islice(lines, MAX_MENTION_LINES)), None)
    if stated is None:
        return ()
    return (f"the line {stated.strip()[:80]!r} may state the length of a count: state --units",)


def _states_resolution(line: str) -> bool:
    if len(line) > MAX_LINE_LENGTH:
        return False
    return _RESOLUTION.search(_CAMEL.sub(" ", line).lower()) is not None


def _states_offset(line: str) -> bool:
    """Return whether a line states an offset of the points other than 0."""
    if len(line) > MAX_LINE_LENGTH:
        return False
    match = _STATED_OFFSET.search(_CAMEL.sub(" ", line).lower())
    number = next(filter(None, match.groups()), "0") if match else "0"
    return float(number.replace(",", ".")) != 0
