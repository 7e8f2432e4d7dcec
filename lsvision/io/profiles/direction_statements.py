"""Statements on the direction of heights in the lines around the numbers of a text."""

import re
from collections.abc import Iterable
from itertools import islice

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.unit_statements import MAX_LINE_LENGTH, MAX_MENTION_LINES

_SENSOR = r"(?:the\s+|dem\s+)?(?:sensor|scanner|camera|laser|gauge)"
_AWAY = re.compile(
    rf"\baway\s+from\s+{_SENSOR}|\b(?:vom|von)\s+{_SENSOR}\s+weg"
    r"|\bpositive\s+down(?:wards?)?\b|\bdown(?:wards?)?\s+(?:is\s+)?positive\b"
)
_TOWARDS = re.compile(
    rf"\btowards?\s+{_SENSOR}|\bzum\s+{_SENSOR}\b"
    r"|\bpositive\s+up(?:wards?)?\b|\bup(?:wards?)?\s+(?:is\s+)?positive\b"
)
_HEIGHT = re.compile(r"\b(?:z|heights?|ranges?|depth|values?|distances?|höhen?|abstand)\b")
"""Name of a height."""
# "z = 200 mm away from the sensor" is a place, and no direction.
_DIRECTION = re.compile(
    r"\b(?:point|grow|increase|increasing|rise|rising|positive|ax[ei]s|direction|achse|zeigt)"
)


def states_away(lines: Iterable[str]) -> bool:
    """Return whether a line states that heights grow away from the sensor.

    Raises
    ------
    UnreadableFile
        If another one states the opposite.

    Examples
    --------
    >>> states_away(["# z axis points away from the sensor"]), states_away(["# z = 2 mm"])
    (True, False)
    """
    short = (line[:MAX_LINE_LENGTH].lower() for line in islice(lines, MAX_MENTION_LINES))
    statements = [line for line in short if _HEIGHT.search(line) and _DIRECTION.search(line)]
    is_away = any(map(_AWAY.search, statements))
    if is_away and any(map(_TOWARDS.search, statements)):
        raise UnreadableFile(
            "it states that heights grow away from the sensor, and towards it: use --flip or "
            "--no-flip"
        )
    return is_away
