"""Statements on the direction of heights in the lines around the numbers of a text."""

import re
from collections.abc import Iterable
from itertools import islice

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.unit_statements import MAX_LINE_LENGTH, MAX_MENTION_LINES

_ARTICLE = r"(?:the\s+|dem\s+|der\s+|das\s+|an?\s+)?"
_SENSOR = rf"{_ARTICLE}(?:laser\s+)?(?:sensors?|scanner|camera|laser|gauge|kamera)\b"
_OBJECT = rf"{_ARTICLE}(?:obje[ck]ts?|parts?|targets?|work\s?pieces?|surface|table|werkstück)\b"
_DISTANCE = r"(?:distances?|ranges?|depths?|abst[aä]nde?|entfernung|distanz|tiefe)"
_BEAM = r"(?:laser\s+|light\s+)?beam"
_AWAY = re.compile(
    rf"\baway(?:\s+from\s+{_SENSOR})?|\b(?:vom|von)\s+{_SENSOR}\s+weg"
    rf"|\b(?:to|towards?|zum)\s+{_OBJECT}|\b(?:down(?:wards?)?|nach\s+unten|vers\s+le\s+bas|hacia\s+abajo|fa?u?rther|deeper)\b"
    rf"|\b(?:with|mit)\s+{_ARTICLE}(?:(?:in|zu)\w+\s+|growing\s+)?{_DISTANCE}\b"
    rf"(?:\s+(?:to|from|zum|vom)\s+{_SENSOR})?"
    rf"|\b(?:in|along)\s+(?:the\s+)?(?:(?:viewing|{_BEAM})\s+direction|(?:direction\s+of\s+)?(?:the\s+)?{_BEAM})"
)
"""Place away from the sensor."""
_FROM_SENSOR = re.compile(
    rf"\b(?:point|grow|increase|increasing|ris(?:e|ing)|positive|zeigt)\w*\s.*\b(?:from|vom|von)\s+{_SENSOR}"
)
"""Motion away from the sensor; "from the sensor" alone is where the numbers come from."""
_TOWARDS = re.compile(
    rf"\b(?:to|towards?|zum|zur)\s+{_SENSOR}|\b(?:up(?:wards?)?|nach\s+oben|closer|nearer)\b"
)
"""Place towards the sensor."""
_RISING = re.compile(
    r"\b(?:point|grow|increase|increasing|ris(?:e|ing)|positi[vf]|ax[ei]s|direction|orientation|sign|larger"
    r"|bigger|greater|higher|measured|achse|richtung|zeigt|steigt|wächst|größer|nimmt\b.*\bzu\b|zunehmend)"
)
"""What heights do towards the place in their line; in "z = 200 mm away" they do nothing."""
_FALLING = re.compile(
    r"\b(?:decrease|decreasing|fall|negative|smaller|shrink|sinkt|kleiner|nimmt\b.*\bab\b|abnehmend)"
)
_TO_SENSOR = re.compile(rf"{_DISTANCE}\s+(?:to|from|zum|vom)\s+{_SENSOR}")
"""A quantity of its own, which is no place."""
_HEIGHT = re.compile(rf"\b(?:z|heights?|values?|höhen?|{_DISTANCE})\b")
"""Name of a height."""
_BARE_DIRECTION = re.compile(
    r"\b(?:z|heights?)(?:[- ]?ax[ei]s)?(?:\s+(?:direction|orientation|sign|positive))?"
    rf"\s*(?:\[[^\]]{{0,20}}\]\s*)?[:=,;(-]?\s*(?:is\s+)?(?={_AWAY.pattern}|{_TOWARDS.pattern})"
)
"""Name of a height directly before a place, as in "z down"."""
_IS_DISTANCE = re.compile(
    r"\b(?:z|heights?|values?|höhen?)\s*(?:values?\s*)?(?:\[[^\]]{0,20}\]\s*)?"
    r"(?:[:=(]|\bis\b|\bare\b|\bist\b|\b(?:mean|denote|give|hold|contain|represent)s?\b)\s*(?:the\s+|der\s+|an?\s+|measured\s+)*"
    rf"{_DISTANCE}\s*(?:$|[)\].,;]|(?:measured\s+)?(?:from|to|vom|zum)\s+(?:{_SENSOR}|{_OBJECT}))"
    rf"|\b{_DISTANCE}\s+(?:(?:values?\s*)?[(=]|ax[ei]s)\s*z\b"
)
"""A height that is a distance, as in "z = distance from the sensor" or "z (range)"."""
# "near is small", "high values are far".
_IS = r"(?:[^\w,;]+(?:is(?:t)?|are|means?|values?|numbers?|z|sind|werte|the))*[^\w,;]+"
_NEAR, _FAR = r"(?:near\w*|close\w*|nah\w*)", r"(?:far\w*|further|fern\w*|weit\w*|distant)"
_SMALL, _LARGE = r"(?:small\w*|low\w*|klein\w*)", r"(?:large\w*|big\w*|high\w*|groß\w*|great\w*)"
_SIZE_AWAY, _SIZE_TOWARDS = (
    re.compile(rf"\b(?:{a}{_IS}{b}|{b}{_IS}{a}|{c}{_IS}{d}|{d}{_IS}{c})\b")
    for a, b, c, d in ((_NEAR, _SMALL, _FAR, _LARGE), (_NEAR, _LARGE, _FAR, _SMALL))
)
"""Sizes of heights that are near and far."""
_FORMULA = re.compile(
    r"\b(?:z|h|heights?|höhen?|y|dist\w*|ranges?|abstand)\s*=\s*(?:[\w.]+\s+)?-\s*\(?[^\W\d_]"
    r"|=\s*[\w.]*[0-9]-[^\W\d_]"
)
"""Height as a difference, as in "z = z0 - value" or "z = -raw"."""
_TURNED = re.compile(r"\b(?:invert|flip|mirror|revers|gespiegelt|umgekehrt)\w*")
_OFF = re.compile(r"\b(?:no|not|none|off|false|0|nein|aus|non|never)\b")
"""Values of a setting that is not used."""
_SWITCHED_OFF = re.compile(r"[:=,;\t]\s*(?:no|off|false|0|nein|aus|non)\W*$")
_QUALITY = re.compile(
    r"\b(?:accurac|precision|resolution|repeatab|noise|error|std|intensit|uncertaint|genauigkeit)"
)
"""Quantity that depends on the height and says nothing on its direction."""
_UNCLEAR = re.compile(
    rf"{_SENSOR}|\b(?:away|towards?|down\w*|up|upwards?|invert\w*|flip\w*|mirror\w*|beam)\b"
)
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])|_")


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
    >>> states_away(["# Z increases with distance"]), states_away(["# z = distance to the sensor"])
    (True, True)
    """
    signs = set(map(_find_direction, _list_short_lines(lines)))
    if {1, -1} <= signs:
        raise UnreadableFile(
            "it states that heights grow away from the sensor, and towards it: use --flip or "
            "--no-flip"
        )
    return 1 in signs


def note_unclear_direction(lines: Iterable[str]) -> tuple[str, ...]:
    """Return a note on the first line that may state the direction of heights in other words.

    Empty if a line states it in words that `states_away` understands.

    Examples
    --------
    >>> note_unclear_direction(["z is flipped?", "z axis inverted"])[0][:38]
    "the line 'z is flipped?' may state the"
    """
    short = _list_short_lines(lines)
    if any(map(_find_direction, short)):
        return ()
    unclear = next(filter(_may_state_direction, short), None)
    if unclear is None:
        return ()
    return (
        f"the line {unclear.strip()[:80]!r} may state the direction of heights: state --flip or "
        "--no-flip",
    )


def _list_short_lines(lines: Iterable[str]) -> list[str]:
    return [line[:MAX_LINE_LENGTH] for line in islice(lines, MAX_MENTION_LINES)]


def _split_words(line: str) -> str:
    """Return a line in lower case with the words of names such as zDirection or z_direction."""
    return _CAMEL.sub(" ", line).lower()


def _find_direction(line: str) -> int:
    """Return 1 if a line states that heights grow away from the sensor, -1 towards it, else 0."""
    text = _split_words(line)
    if _SWITCHED_OFF.search(text) or _QUALITY.search(text):
        return 0
    if by_size := bool(_SIZE_AWAY.search(text)) - bool(_SIZE_TOWARDS.search(text)):
        return by_size
    if _IS_DISTANCE.search(text):
        return 1
    # What remains must name a height: "decreases with distance" does not.
    place_words = _AWAY.sub(" ", text)
    rest = _TO_SENSOR.sub(" ", place_words)
    is_falling, is_rising = bool(_FALLING.search(text)), bool(_RISING.search(text))
    is_towards = bool(_TOWARDS.search(rest))
    is_away = place_words != text or _FROM_SENSOR.search(rest) is not None
    if is_away == is_towards or _HEIGHT.search(rest) is None:
        return 0
    if not (is_falling or is_rising or _BARE_DIRECTION.search(text)):
        return 0
    return 1 if is_away != is_falling else -1


def _may_state_direction(line: str) -> bool:
    """Return whether a line is about a height and its direction, a difference, or a reversal."""
    text = _split_words(line)
    if _FORMULA.search(text) or re.search(rf"\b(?:zero|origin)\b.*\bat\s+{_SENSOR}", text):
        return True
    if _SWITCHED_OFF.search(text):
        return _BARE_DIRECTION.search(text) is not None
    if _TURNED.search(text) and not _OFF.search(text):
        about_x = re.search(r"\b(?:x|y|lateral|colou?rs?|image)\b", text)
        return bool(_HEIGHT.search(text)) or (about_x is None and len(text.split()) <= 3)
    is_distance = _TO_SENSOR.search(text) or re.search(r"\bz\s+(?:sign|direction)\W*-1\b", text)
    if is_distance and not re.search(r"[0-9]\s*(?:mm|cm|m)\b", text):
        return True
    return bool(
        re.search(r"\b(?:z|heights?|höhen?)\b", text)
        and (_RISING.search(text) or _FALLING.search(text) or "measured from" in text)
        and _UNCLEAR.search(text)
        and not re.search("[0-9]", text)
        and not _QUALITY.search(text)
    )
