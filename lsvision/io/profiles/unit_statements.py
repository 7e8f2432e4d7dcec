"""Statements on units and lost points in the lines around the numbers of a text."""

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice, pairwise

from lsvision.io.profiles.units import (
    COUNT_WORD,
    FRACTION_WORDS,
    MM_PER_UNIT,
    NOT_LENGTHS,
    StatedUnit,
    find_mm_per_unit,
    find_unit_in_text,
    parse_unit,
    split_label,
)

MAX_LINE_LENGTH = 300
"""Longest line that may state a unit or a marker of lost points. Units: characters."""
MAX_MENTION_LINES = 1000
"""Maximum number of lines that are searched for a unit in free text."""

_UNIT_KEYS = frozenset(
    "unit units uom einheit einheiten maßeinheit masseinheit unité unités unidad unidades "  # noqa: SIM905
    "unità unidade eenheid enhet enhed yksikkö jednostka jednotka единица единицы birim "
    "单位 單位 単位 단위".split()
)
"""Words of a key whose value is a unit."""
_UNIT_ENDS = ("unit", "units")
_UNIT_REMARKS = frozenset("system measure measurement used name symbol".split())  # noqa: SIM905
"""Words behind that of a unit in a key that is about it."""
_SCALE_KEYS = frozenset(
    "scale scaling scalefactor factor multiplier lsb exponent skalierung skalierungsfaktor faktor "  # noqa: SIM905
    "maßstab massstab umrechnungsfaktor échelle facteur escala scala fattore divisor teiler".split()
)
"""Words of a key whose value is the length of a count."""
_OTHER_KEYS = frozenset(
    "time zeit intensity intensität angle angles winkel temperature temperatur speed "  # noqa: SIM905
    "velocity frequency rate exposure power current voltage serial id number no nr name "
    "type version count control controller device weight force mass pressure gray grey "
    "color colour image plot display encoder camera safety zoom font window".split()
)
"""Words of a key of a quantity that is not a length."""
_STEP_WORDS = frozenset(["lsb", "digit", "digits"])
"""Words for the step of a number, whatever the other words of its line are."""
_LOST_KEYS = frozenset(
    "nodata invalid lost missing fill dropout novalue lostvalue fillvalue".split()  # noqa: SIM905
)
"""Words of a key whose value marks lost points, alone or two joined (no data, fill value)."""
_LOST_COUNT_WORDS = frozenset(
    "points count number of rate share percent pixels total".split()  # noqa: SIM905
)
"""Words of a key whose value counts lost points and marks none."""
_SMALL_WORDS = frozenset("and und et all for each both si of in the".split())  # noqa: SIM905
_LENGTH_WORDS = frozenset(
    "values axes axis length lengths coordinates distances dimension dimensions".split()  # noqa: SIM905
)
"""Words for lengths of any axis."""
_FILLERS = _SMALL_WORDS | _LENGTH_WORDS
"""Words beside a unit that do not change what it is the unit of."""
_AXES = {
    **dict.fromkeys(["x", "lateral", "width"], "x"),
    **dict.fromkeys(["z", "height", "heights", "range", "ranges", "distance", "depth"], "height"),
    **dict.fromkeys(["höhe", "abstand"], "height"),
    "y": "y",
}
"""Axis that a word names."""
# Marks before and behind a comment.
_COMMENT = re.compile(r"^[\s#%!;*/\"'<-]+|[\s\"'*>-]+$")
# "key: value", "key = value", "key, value" or "key is value"; but not "unit 0,1 mm".
_KEY_VALUE = re.compile(
    r"^([^:：=,;\t]{1,60}?)\s*(?:(?:[:：=;\t]|(?<![0-9]),|,(?![0-9]))+|\bis\b|\bare\b|\bequals\b|\bcorresponds\s+to\b"
    r"|\bentspricht\b)\s*(\S.*)$"
)
# "units mm" or "z unit mm".
_KEY_BLANK_VALUE = re.compile(
    rf"^((?:[xyz](?:\s*[/,&+]\s*[xyz])*\s+)?(?:\S*unit\S*|{'|'.join(sorted(_UNIT_KEYS))}))\s+(\S.*)$",
    re.IGNORECASE,
)
# The words of a key such as "xUnit" or "X_UNIT".
_KEY_WORDS = re.compile(r"[A-Z]?[^\W\d_A-Z]+|[A-Z]+(?![^\W\d_A-Z])")
_NAME_BREAK = re.compile(r"_|(?<=[a-z])(?=[A-Z][a-z])")
"""Place between the words of a name such as pixel_to_mm or pixelToMm."""
_AXIS_GROUP = r"(x|y|z|heights?|ranges?|distance|lateral|depth)"
"""Pattern of the name of an axis."""
_UNIT_GROUP = r"([0-9./^*+e-]*\s?[^\W\d_]+)"
"""Pattern of a unit, which may have a factor."""
# "z in um", "z: um" or "z [um]".
_AXIS_UNIT = re.compile(
    rf"\b{_AXIS_GROUP}(?:[ _]?units?)?\b\s*(?:[:=]|\bin\b)?\s*[\[(]?\s*{_UNIT_GROUP}\s*[\])]?"
)
# "z: um" or "z = um", without a number.
_AXIS_EQUALS = re.compile(r"\b(x|y|z|height|range|distance|depth)\s*[:=]\s*([^\W\d_]+)")
# "um (z)".
_UNIT_AXIS = re.compile(rf"{_UNIT_GROUP}\s*[\[(]\s*{_AXIS_GROUP}\b[^\])]*[\])]")
# "heights are stated in um".
_PHRASE = re.compile(
    r"\b((?:lateral|depth|values?|coordinates?|lengths?|distances?|dimensions?|data|numbers?|points?|"
    r"heights?|ranges?|positions?|profiles?|everything|all|columns?|x|y|z)\b"
    r"(?:\s*(?:,|/|and|und|&|are|is|given|stated|expressed|measured|values?|coordinates?|x|y|z))*)"
    r"\s+in\s+(?:(?:units|multiples|increments|steps)\s+of\s+)?"
    r"([0-9./^*-]*(?:e[-+]?[0-9]+)?\s?[^\W\d_%]+)(?![^\W\d_])(?!\s*[*^/·×]\s*[0-9(])"
)
# "per count" or "/digit".
_PER_COUNT = re.compile(rf"(?:/|\bper\b|\bpro\b)\s*{COUNT_WORD}\b", re.IGNORECASE)
# The key of "1 digit = 0.01 mm".
_READING = r"(?:counts?|digits?|lsb|bits?)"
"""Pattern of the names of a sensor's integer steps that are no motion."""
_ONE_COUNT = re.compile(
    rf"1\s*{COUNT_WORD}|(?:one|an?|each|every|per|ein|jede[rs]?)\s*(?:{_READING}|inkrement)"
    r"|(?:digit|lsb)(?:\s+(?:size|value|wert))?",
    re.IGNORECASE,
)
# A unit alone, 0.1 mm, 1e-05 m or 10 um.
_POWER_OF_TEN = re.compile(r"[^ ]+$|(?:1e-?[0-9]+|0?\.?0*1|10+) ")
# The key of "um per count: 10" or "counts/mm: 100".
_RATIO = re.compile(
    rf"(?:.*\s)?(?:(?P<unit>[^\W\d_]+)\s*(?:/|per|pro)\s*{_READING}"
    rf"|{_READING}\s*(?:/|per|pro)\s*(?P<length>[^\W\d_]+))"
)
_NUMBER = re.compile(r"[-+]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?")
"""Number with a decimal point or comma."""

_BARE_UNIT = re.compile(
    r"(?<![^\W_])(?<![0-9.])(?<![0-9.] )"
    r"(?:um|[µμ]m?|nm|cm|dm|mils?|thous?|inch(?:es)?|microns?|micras?|мкм|нм|см|дм|дюйм\w*"
    r"|pulgadas?|polegadas?|pouces?|pollic[ei]|(?:микро|нано|санти)метр\w*|микрон\w*"
    r"|(?:mi[ck]r[oóô]|nan[oó]|[cz]ent[ií]|d[eé][cz]i)m[eèé]t(?:er|re|ro|ri)s?)(?![^\W_])"
    # These languages have no blanks between words.
    r"|[微厘纳奈]米|英寸|マイクロメートル|ミクロン|センチ|インチ|마이크로미터|나노미터|센티미터|인치"
)
"""A unit other than mm without a number before it: most likely that of the file's numbers."""
# "tenths of a mm" or "1/10 mm".
_FRACTION = re.compile(
    rf"(?<![^\W_])(?:{'|'.join(FRACTION_WORDS)})\s+(?:of\s+(?:an?\s+)?|d\w*\s*)?(?:mm|m[ei]\w+)"
    r"|1/10+\s?mm"
)
_LENGTH = r"(?:mm|[uµμ]m|nm|m|microns?|inch)\b"
"""A unit of length behind a number."""
# "values in 0.01 mm" or "coords x0.01mm"; but not "data interval 0.1 mm".
_SMALL_UNIT = re.compile(
    r"^(?!.*\b(?:resolution|accuracy|precision|step:|pitch|spacing|interval|apart|noise|tolerance"
    r"|filter\w*|std|rounded)\b).*\b(?:values?|coordinates?|coords?|numbers?|lengths?|units?|lsb|digits?|steps\s+of"
    r"|werte|angaben|ma(?:ß|ss)e|valeurs|valores)\b"
    r".*?(?:0[.,]0*1|1e-[0-9]+|1/10+|\b10*)\s*(?:[uµμ]m|mm|milli\w+|micr\w+)\b"
)
"""Fraction of a mm that values have."""
# A line like "multiply by 0.01", "converted to mm", "counts per mm", "100 counts = 1 mm", "0.01 mm
# = 1 digit", "in units of 0.01 mm", "mm = raw / 100", "z = raw * 0.01", "mm*1e-3", "0.1 mm/px" or
# "scale factor 0.01".
_CONVERSION = re.compile(
    r"\b(?:multiply|multiplied|divide\w*)\b.*?(?:[0-9]|\bby\b)|\bto\s+(?:mm|m|um)\b"
    rf"|{COUNT_WORD}\s*(?:/|per|pro)\s*[^\W\d_]+"
    rf"|\b{_READING}\b.*[0-9]\s*{_LENGTH}|[0-9]\s*{_LENGTH}.*\b{_READING}\b"
    rf"|\b(?:units|multiples|increments|counts)\s+of\s+[0-9]"
    r"|\bmm[\])]?\s*=.*[*/·×]|=\s*\(?\s*(?:raw|counts?|digits?|values?|[xz])\w*\)?\s*[*/·×]"
    rf"|\bin\s+{_LENGTH}\s*[*/^·×]\s*[0-9(]|\bmm\s*(?:/|per)\s*(?:px|pixel)"
    r"|\bquanti[sz]\w*\b.*[0-9]|\bquantum\b.*[0-9]|\b(?:tenths|hundredths|thousandths|dmm)\b"
    r"|^\W*[x*×]\s*10+\s*mm\b|(?<![0-9] )(?<![0-9])\bmm\s*[x×]\s*10+\b(?!\s*mm)|\btimes\s+mm\b"
    r"|\b[0-9]+\s*(?:/|per)\s*mm\b|\b10\s*(?:\^|\*\*)\s*-[0-9]\s*mm\b|\bmm\s*[*·]\s*[0-9]"
    rf"|\b(?:z|x|heights?)\s*=\s*[^=]*(?:[a-z]\w*\)?\s*[*·×]|[*·×]\s*\(?\s*[a-z])"
    r"|\b(?:pixel|image)\s+coordinates\b|\bin\s+pixels?\b|\buncalibrated\b"
    r"|\b(?:scale|scaling|multiplier|(?:conversion|unit|calibration)\s+factor|\w*faktor"
    r"|skalierung|ma(?:ß|ss)stab)(?:\s+factor)?(?:\s+[xz])?\s+(?!1(?:[.,]0*)?(?:\s*:\s*1)?$)[0-9.]"
)


@dataclass(frozen=True)
class UnitStatement:
    """Unit stated by a line without numbers of points; its text is the line if not understood.

    The axis is ``"x"``, ``"y"`` or ``"height"``; None where the line states the unit of all
    lengths.
    """

    unit: StatedUnit
    axis: str | None = None


def find_unit_statements(lines: Iterable[str]) -> tuple[UnitStatement, ...]:
    """Return the units that comments and ``key: value`` lines state.

    Examples
    --------
    >>> [s.unit.unit for s in find_unit_statements(["# unit: um", "exposure: 2 ms", "x in mm"])]
    ['um', 'mm']
    """
    statements: dict[UnitStatement, None] = {}
    for line in lines:
        for statement in _parse_statements(line):
            statements[statement] = None
    return tuple(statements)


def states_unit(line: str) -> bool:
    """Return whether a line states a unit, and therefore is not a header."""
    return any(True for _ in _parse_statements(line))


def find_unit_mentions(lines: Iterable[str]) -> tuple[str, ...]:
    """Return the lines that mention a unit other than mm or a conversion, in free text.

    Examples
    --------
    >>> find_unit_mentions(["# saved by ACME in um", "# laser of 450 nm", "# 100 digits/mm"])
    ('# saved by ACME in um', '# 100 digits/mm')
    """
    short = (line for line in islice(lines, MAX_MENTION_LINES) if len(line) <= MAX_LINE_LENGTH)
    return tuple(line for line in short if _mentions_unit(line))


def _mentions_unit(line: str) -> bool:
    """Return whether a line mentions a unit or a conversion, and is about lengths."""
    text = line.lower()
    words = set(_KEY_WORDS.findall(text))
    if words & _OTHER_KEYS and not words & (_LENGTH_WORDS | _STEP_WORDS):
        return False
    if _BARE_UNIT.search(text) or _FRACTION.search(text):
        return True
    small = _SMALL_UNIT.search(text)
    if small is not None and re.search(r"\b10*\s*(?:mm|milli\w+)$", small[0]) is None:
        return True
    return _CONVERSION.search(_NAME_BREAK.sub(" ", line).lower()) is not None


def find_lost_values(lines: Iterable[str]) -> tuple[float, ...]:
    """Return the lost-point markers in ``key: value`` lines like ``# invalid value: -9999``.

    Examples
    --------
    >>> find_lost_values(["NODATA_value -9999", "# lost points: 12"])
    (-9999.0,)
    """
    markers: dict[float, None] = {}
    for line in lines:
        if len(line) > MAX_LINE_LENGTH:
            continue
        text = _COMMENT.sub("", line)
        number = re.search(rf"^(.*?)[\s:=,;]+({_NUMBER.pattern})$", text)
        if number is None:
            continue
        key = re.split(r"[\W_]+", number[1].lower())
        words = {*key, *map("".join, pairwise(key))}
        if words & _LOST_KEYS and not words & _LOST_COUNT_WORDS:
            markers[float(number[2].replace(",", "."))] = None
    return tuple(filter(math.isfinite, markers))


def _parse_statements(line: str) -> Iterator[UnitStatement]:
    """Yield the statements of a comment line on units, such as ``unit: mm``."""
    text = "" if len(line) > MAX_LINE_LENGTH else _COMMENT.sub("", line).strip()
    if not text:
        return
    unit = parse_unit(text.strip("[](){} "))
    if unit is not None and _may_be_unit(unit):
        yield UnitStatement(StatedUnit(text, unit))
        return
    key_value = _KEY_VALUE.match(text) or _KEY_BLANK_VALUE.match(text)
    if key_value and (found := tuple(_parse_key_value(key_value[1], key_value[2], text))):
        yield from found
        return
    yield from _parse_axes(text.lower())
    if line.lstrip().startswith(("#", "%", "//", "!", "*")) or key_value or " in " in text:
        for subject, word in _PHRASE.findall(text.lower()):
            if parse_unit(word) is not None or word.strip() in NOT_LENGTHS:
                words = set(re.findall(r"\w+", subject))
                yield UnitStatement(find_unit_in_text(word), _find_axis(words))


def _parse_key_value(key: str, value: str, line: str) -> Iterator[UnitStatement]:
    """Yield the statements of a key and its value: a unit, that of a count or an axis, a scale."""
    words = _split_key(key)
    axis, is_length = _find_axis(words), not words & _OTHER_KEYS
    if words & _UNIT_KEYS and is_length and _names_unit(key):
        yield from _parse_unit_value(value, line, axis)
    elif (unit := _parse_count_unit(key, value, words)) is not None:
        yield UnitStatement(StatedUnit(line, unit), axis)
    elif words & _SCALE_KEYS and is_length:
        yield from _parse_scale(key, value, line, axis)
    elif words <= set(_AXES) and (unit := parse_unit(value.strip("[](){} "))) is not None:
        yield from _parse_axis_value(unit, line, axis, is_named=bool(words))


def _parse_axis_value(
    unit: str, line: str, axis: str | None, *, is_named: bool
) -> Iterator[UnitStatement]:
    """Yield the statement of an axis and a length: ``z = 20 mm`` is a place, ``z = 0.5 mm`` may be.

    So may a line without the name of an axis, ``10 = 1 mm``.
    """
    is_clear = is_named and _POWER_OF_TEN.match(unit) is not None
    if _may_be_unit(unit) or not is_named:
        yield UnitStatement(StatedUnit(line, unit if is_clear else None), axis)


def _parse_axes(text: str) -> Iterator[UnitStatement]:
    """Yield the units of several axes, such as ``x: mm, z: um``, if the text has no other words."""
    pairs = _AXIS_EQUALS.findall(text)
    others = set(re.findall(r"\w+", _AXIS_EQUALS.sub("", text)))
    if len(pairs) > 1 and others <= _FILLERS and all(parse_unit(unit) for _, unit in pairs):
        yield from (UnitStatement(find_unit_in_text(unit), _AXES[name]) for name, unit in pairs)


def _split_key(key: str) -> set[str]:
    """Return the words of a key in lower case; of ``heightunit`` also height and unit."""
    words = {word.lower() for word in _KEY_WORDS.findall(key)}
    for word in list(words):
        for ending in ("units", "unit"):
            if word.endswith(ending) and word != ending:
                words |= {ending, word.removesuffix(ending)}
                break
    return words


def _names_unit(key: str) -> bool:
    """Return whether a key is about a unit, as ``z unit`` and ``unit of x``, not ``unit cell``."""
    words = [word.lower() for word in _KEY_WORDS.findall(key)]
    units = [k for k, word in enumerate(words) if word in _UNIT_KEYS or word.endswith(_UNIT_ENDS)]
    behind = set(words[units[-1] + 1 :]) if units else set()
    return behind <= _FILLERS | _UNIT_REMARKS | set(_AXES)


def _find_axis(words: set[str]) -> str | None:
    """Return the axis that the words of a key name; None if they name none, or several."""
    axes = {_AXES[word] for word in words if word in _AXES}
    return axes.pop() if len(axes) == 1 else None


def _parse_unit_value(value: str, line: str, axis: str | None) -> Iterator[UnitStatement]:
    """Yield the statements of a value: one unit, or one for each axis."""
    value = value.strip().strip("\"'[](){} ").rstrip(",;. ")
    unit = parse_unit(value)
    if unit is not None:
        yield UnitStatement(StatedUnit(value, unit), axis)
        return
    pairs = _AXIS_UNIT.findall(line.lower())
    if not pairs or any(parse_unit(text) is None for _, text in pairs):
        pairs = [(name, text) for text, name in _UNIT_AXIS.findall(line.lower())]
    by_axis = [
        UnitStatement(find_unit_in_text(text), _AXES[name]) for name, text in pairs if name in _AXES
    ]
    if by_axis and all(statement.unit.unit for statement in by_axis):
        yield from by_axis
        return
    words = [word for word in re.split(r"[\s,;/()\[\]]+", value.lower()) if word]
    units = {parse_unit(word) for word in words} - {None}
    unknown_words = [w for w in words if not parse_unit(w) and w not in _FILLERS | NOT_LENGTHS]
    if len(units) == 1 and not unknown_words:
        yield UnitStatement(StatedUnit(value, units.pop()), axis)
    else:
        yield UnitStatement(StatedUnit(line, None), axis)


def _parse_scale(key: str, value: str, line: str, axis: str | None) -> Iterator[UnitStatement]:
    """Yield the statement of a scale: a length is the unit; 1 states nothing; else unknown.

    The length may have its unit in the key, as in ``scale [mm]: 0.01``.
    """
    text = value.strip().strip("\"'[](){} ")
    unit, key_unit = parse_unit(text), split_label(key)[1]
    if _NUMBER.fullmatch(text) and key_unit is not None:
        unit = parse_unit(f"{text} {key_unit.unit}")
    elif text == "1:1" or (_NUMBER.fullmatch(text) and float(text.replace(",", ".")) == 1):
        return
    yield UnitStatement(StatedUnit(text if parse_unit(text) else line, unit), axis)


def _parse_count_unit(key: str, value: str, words: set[str]) -> str | None:
    """Return the unit that a key and its value state as the length of a count; None without one.

    As in ``1 digit = 0.01 mm``, ``resolution: 0.01 mm/digit`` and ``counts_per_mm: 100``; `words`
    are those of the key.
    """
    unit = parse_unit(value.strip("[](){} "))
    is_count = unit is None or _ONE_COUNT.fullmatch(key) is not None
    if words & _OTHER_KEYS - ({"count"} if is_count else set()):
        return None
    if unit is None:
        return _parse_ratio(key, value)
    return unit if is_count or _PER_COUNT.search(value) else None


def _may_be_unit(unit: str) -> bool:
    """Return whether a length such as "0.1 mm" may be a unit, and no place such as "20 mm"."""
    return unit in MM_PER_UNIT or find_mm_per_unit(unit) < 1


def _parse_ratio(key: str, value: str) -> str | None:
    """Return the unit of counts stated by ``um per count: 10`` or ``counts_per_mm: 100``."""
    match = _RATIO.fullmatch(key.replace("_", " ").strip().lower())
    number = _NUMBER.fullmatch(value.strip())
    if match is None or number is None:
        return None
    size = float(number[0].replace(",", "."))
    if match["unit"] is not None:
        return parse_unit(f"{size:.12g} {match['unit']}")
    return parse_unit(f"{1 / size:.12g} {match['length']}") if size > 0 else None
