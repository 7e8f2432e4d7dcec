"""Units of length as written in files and options, with an optional scale."""

import re
from dataclasses import dataclass

MM_PER_UNIT = {
    "nm": 1e-6,
    "um": 1e-3,
    "mm": 1.0,
    "cm": 10.0,
    "dm": 100.0,
    "m": 1e3,
    "km": 1e6,
    "mil": 0.0254,
    "in": 25.4,
    "ft": 304.8,
}
"""Length of each unit in which coordinates may be given. Units: mm."""

MAX_LABEL_LENGTH = 200
"""Longest label or text that may state a unit. Units: characters."""

_SPELLINGS = {
    "nm": "nanometer nanometre nanometers nanometres nanómetros nanometri нм 纳米 奈米 나노미터",
    "um": "µm μm µ μ micron microns micrometer micrometre micrometers micrometres mikrometer "
    "micromètre micromètres micra micras micrómetro micrómetros micrômetro micrômetros micrometro "
    "micrometri mikrometr mikron мкм микрон микроны микрометр микрометры 微米 ミクロン "
    "マイクロメートル 마이크로미터",
    "mm": "millimeter millimetre millimeters millimetres millimètre millimètres milímetro "
    "milímetros millimetro millimetri milimetr мм миллиметр миллиметры 毫米 公釐 ミリ ミリメートル "
    "밀리미터",
    "cm": "centimeter centimetre centimeters centimetres zentimeter centimètre centimètres "
    "centímetro centímetros centimetro centimetri centymetr см сантиметр сантиметры 厘米 公分 "
    "センチ センチメートル 센티미터",
    "dm": "decimeter decimetre decimeters decimetres dezimeter décimètre дм",
    "m": "meter metre meters metres mètre mètres metro metros metri м метр метры 米 公尺 "
    "メートル 미터",
    "km": "kilometer kilometre kilometers kilometres км",
    "mil": "mils thou thous",
    "in": "inch inches zoll pouce pouces pulgada pulgadas polegada polegadas pollice pollici duim "
    "дюйм дюймы 英寸 インチ 인치",
    "ft": "foot feet",
}
"""Words for each unit in several languages."""
_WORDS = {word: unit for unit, words in _SPELLINGS.items() for word in words.split()}
_WORDS.update({unit: unit for unit in MM_PER_UNIT})
_WORDS.update({'"': "in", "''": "in"})

FRACTION_WORDS = {
    **dict.fromkeys(["tenth", "tenths", "zehntel", "dixième", "dixièmes"], 0.1),
    **dict.fromkeys(["hundredth", "hundredths", "hundertstel", "centième", "centièmes"], 0.01),
    **dict.fromkeys(["thousandth", "thousandths", "tausendstel", "millième", "millièmes"], 1e-3),
}
"""Words for a tenth, a hundredth and a thousandth of a unit."""
_WIDE_CHARACTERS = str.maketrans(
    {"（": "(", "）": ")", "［": "[", "］": "]", "【": "[", "】": "]", "：": ":"}
    | {"㎚": "nm", "㎛": "µm", "㎜": "mm", "㎝": "cm", "㎞": "km"}
)
"""Brackets and units of East Asian texts that have the width of two letters."""
_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+")
"""Digits and signs of exponents such as 10⁻³."""
COUNT_WORD = r"(?:counts?|digits?|lsb|incr?|increments?|steps?|ticks?|bits?|units?|inkremente?)"
"""Pattern of the names of a sensor's integer steps."""
_SCALED = re.compile(
    r"(?:(?P<numerator>[0-9]+)\s*/\s*(?P<denominator>[0-9]+)"  # 1/10 mm
    # 5x10^-3 mm
    r"|(?:(?P<mantissa>[0-9]+)\s*[x*·×]\s*)?10\s*(?:\^|\*\*)\s*\(?(?P<power>[-+]?[0-9]+)\)?"
    r"|(?P<scale>(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:e[-+]?[0-9]+)?)"  # 0.1 mm
    rf"|(?P<fraction>{'|'.join(sorted(FRACTION_WORDS, key=len, reverse=True))}))?"  # tenth of a mm
    r"\s*(?:of\s+an?|of|[x*·×])?\s*"
    r"(?P<word>[^\W\d_]+|\"|'')\.?"
    r"(?:\s*/\s*(?P<divisor>[0-9]+))?"  # mm/100
    rf"(?:\s*(?:/|per|pro)\s*{COUNT_WORD})?"  # um per digit
)
"""Unit of length with a scale before or after it."""
_POWER_OF_TEN = re.compile(r"10[-+][0-9]+")
"""Power of ten whose sign for the power was lost, 10-3."""

NOT_LENGTHS = frozenset(
    "px pix pixel pixels count counts digit digits lsb inc incr increment increments "  # noqa: SIM905
    "inkremente tick ticks raw step steps bit bits v volt volts mv ma deg degree degrees "
    "grad ° rad radian radians mrad s sec ms us µs ns min h hz khz % percent a.u. au dn adu "
    "arb".split()
)
"""Words for units of other quantities than length, and for no unit at all."""

_REMARKS = frozenset(
    "sensor lateral height range distance depth axis horizontal vertical left right "  # noqa: SIM905
    "towards away up down top bottom filtered smoothed corrected calibrated absolute relative "
    "float double int integer".split()
)
"""Text in round brackets after a name that is not a unit."""
# Labels such as "x [mm]"; "x_mm", "x in mm" or "x/mm"; "xmm".
_BRACKETED = re.compile(r"^(.*?)\s*([\[({<])\s*([^\])}>]*?)\s*[\])}>]\s*(.*)$")
_SUFFIXED = re.compile(r"^(.+?)(\s+in\s+|,?[\s_/:-]+)([^\s_/:]+)$")
# Labels such as "z_0.1_mm", "z in 1/10 mm", "z_1e-5_m" or "z_tenth_mm"; the 2 of "z_2_mm" is
# rather a number of the column.
_SCALED_SUFFIX = re.compile(
    r"^([^\W\d_]+)(?:\s+in\s+|[\s_:/-]+)"
    r"((?:[0-9]*[./,^][0-9.,^-]*|[0-9.]+e[-+]?[0-9]+"
    rf"|{'|'.join(sorted(FRACTION_WORDS, key=len, reverse=True))})[\s_]*[^\W\d_]+)$"
)
_SHORT = re.compile(r"^([xyzhrd])(mm|um|µm|μm|nm|cm)$")


@dataclass(frozen=True)
class StatedUnit:
    """A unit of length as the text of a file states it.

    `unit` is the name that `find_mm_per_unit` takes; None if the text is not understood.
    """

    text: str
    unit: str | None


def parse_unit(text: str) -> str | None:
    """Return the name of a unit of length with its scale; None if the text is no such unit.

    Examples
    --------
    >>> parse_unit("µm"), parse_unit("1/10 mm"), parse_unit("10um"), parse_unit("furlong")
    ('um', '0.1 mm', '10 um', None)
    """
    if len(text) > MAX_LABEL_LENGTH:
        return None
    narrow = text.translate(_WIDE_CHARACTERS).translate(_SUPERSCRIPTS)
    normalised = " ".join(narrow.strip().lower().split())
    normalised = _POWER_OF_TEN.sub(lambda match: f"10^{match[0][2:]}", normalised, count=1)
    match = _SCALED.fullmatch(normalised)
    if match is None or match["word"] not in _WORDS:
        return None
    scale = _parse_scale(match)
    if not 0 < scale < float("inf"):
        return None
    unit = _WORDS[match["word"]]
    return unit if scale == 1 else f"{scale:.12g} {unit}"


def find_mm_per_unit(unit: str) -> float:
    """Return the length in mm of a unit from `parse_unit`, or of any text that it understands.

    Raises
    ------
    ValueError
        If it is not a unit of length.

    Examples
    --------
    >>> find_mm_per_unit("um"), find_mm_per_unit("0.1 mm")
    (0.001, 0.1)
    """
    name = parse_unit(unit)
    if name is None:
        raise ValueError(f"expected a unit of length, got {unit!r}")
    scale, _, word = name.rpartition(" ")
    return (float(scale) if scale else 1.0) * MM_PER_UNIT[word]


def find_unit_in_text(text: str) -> StatedUnit:
    """Return the unit that a text states."""
    return StatedUnit(text.strip(), parse_unit(text))


def split_label(label: str) -> tuple[str, StatedUnit | None]:
    """Return the lower-case name of a column's label, and the unit it states; None without one.

    Examples
    --------
    >>> split_label("Height [µm]")
    ('height', StatedUnit(text='µm', unit='um'))
    >>> split_label("z_mm")[1].unit, split_label("X [1/10 mm]")[1].unit, split_label("x")
    ('mm', '0.1 mm', ('x', None))
    >>> split_label("z [furlong]")[1]
    StatedUnit(text='furlong', unit=None)
    """
    word = " ".join(label.translate(_WIDE_CHARACTERS).strip().strip("\"'").split()).lower()
    if len(word) > MAX_LABEL_LENGTH:
        return word, None
    bracketed = _BRACKETED.match(word)
    if bracketed:
        return _from_brackets(*bracketed.groups())
    short = _SHORT.match(word)
    if short:
        return short[1], find_unit_in_text(short[2])
    scaled = _SCALED_SUFFIX.match(word)
    if scaled and parse_unit(scaled[2].replace("_", " ")) is not None:
        return scaled[1], find_unit_in_text(scaled[2].replace("_", " "))
    suffixed = _SUFFIXED.match(word)
    if suffixed:
        name, mark, suffix = suffixed.groups()
        if parse_unit(suffix) is not None or suffix in NOT_LENGTHS or "/" in mark:
            return _strip_marks(name), find_unit_in_text(suffix)
    return word, None


def _from_brackets(
    before: str, bracket: str, inside: str, after: str
) -> tuple[str, StatedUnit | None]:
    """Return the name and the unit of a label such as ``x [mm]``.

    The unit is None for empty brackets, ``-`` or ``1``, and a remark such as ``(left)``.
    """
    name = _strip_marks(before) or _strip_marks(after)
    if not inside or inside in ("-", "1"):
        return name, None
    inside = re.sub(r"^in\s+(?=\S)", "", inside)  # "(in um)" states um; "(in)" alone is an inch
    stated = find_unit_in_text(inside)
    first = re.split(r"[\s,;:]+", inside)[0]
    if stated.unit is None and parse_unit(first) is not None and bracket != "[":
        stated = find_unit_in_text(first)  # as "(mm, towards the sensor)"
    words = inside.split()
    if stated.unit is None and bracket == "(" and (len(words) > 2 or set(words) <= _REMARKS):
        return name, None
    return name, stated


def _strip_marks(name: str) -> str:
    """Return a name without the marks around it, but with the minus sign of ``-z``."""
    bare = name.strip(" _:-/,")
    return f"-{bare}" if re.match(r"[ _:/,]*-[^\W\d_]", name) else bare


def _parse_scale(match: re.Match[str]) -> float:
    """Return the factor of a unit, 0.1 of ``1/10 mm`` or ``mm/10``; 0 for a division by 0."""
    scale = 1.0
    if match["numerator"]:
        denominator = float(match["denominator"])
        scale = float(match["numerator"]) / denominator if denominator else 0.0
    elif match["power"]:
        scale = float(match["mantissa"] or 1) * 10.0 ** max(-99, min(99, int(match["power"])))
    elif match["scale"]:
        scale = float(match["scale"].replace(",", "."))
    elif match["fraction"]:
        scale = FRACTION_WORDS[match["fraction"]]
    divisor = float(match["divisor"] or 1)
    return scale / divisor if divisor else 0.0
