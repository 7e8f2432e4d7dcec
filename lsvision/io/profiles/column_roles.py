"""Role of a column, such as x or height, recognised by its name."""

import re
from collections.abc import Container, Iterable, Sequence

from lsvision.io.profiles.column_words import (
    ANGLE_WORDS,
    AXIS_WORDS,
    HEIGHT_WORDS,
    RANGE_WORDS,
    WIDTH_WORDS,
    fold_accents,
)

# Role of a column by its name in lower case, without accents.
_ROLES = {
    **dict.fromkeys(["x", "xs", "px", "position", "lateral", *WIDTH_WORDS], "x"),
    **dict.fromkeys(["y", "ys", "py", "travel"], "y"),
    **dict.fromkeys(["z", "zs", "pz", *HEIGHT_WORDS], "height"),
    **dict.fromkeys(RANGE_WORDS, "range"),
    **dict.fromkeys(ANGLE_WORDS, "angle"),
}
HEIGHT_ROLES = ("height", "range", "y")
"""Roles of a height; y is one if there is no other."""
# A name such as "x_pos" or "position y" is one of these words and an axis.
_AXIS_WORD = rf"(?:{'|'.join(sorted(AXIS_WORDS))})"
_AXIS_NAME = re.compile(rf"([xyz])[ _-]?{_AXIS_WORD}|{_AXIS_WORD}\.?[ _-]?([xyz])")
# A height that grows away from the sensor, such as "-z" or "y_down".
_TURNED = re.compile(r"-\s*(?:z|y|height)|(?:z|y|height)[ _-]?(?:down|away|inverted|neg|negative)")
# Words beside that of a range, in a name such as "z distance" or "distance to the sensor".
_RANGE_REMARKS = frozenset(
    "z measured measuring measurement working target object surface sensor laser value wert "  # noqa: SIM905
    "to from the zum vom al del du au dal del capteur "
    "sensore do od до от датчика".split()
)
# A name such as "scan" or "profile_no" is one of these words, alone or with one of `_SCAN_ENDINGS`.
_SCAN_WORDS = ("scan", "profile", "profil", "frame", "section", "shot")
# A name such as "part" or "sensor_id" is one of these words, alone or with one of `_SCAN_ENDINGS`.
_PART_WORDS = frozenset(
    "part piece workpiece sensor camera head run pass batch lot station serial file job "  # noqa: SIM905
    "measurement layer".split()
)
_SCAN_ENDINGS = ("id", "no", "nr", "num", "number", "index", "idx", "count", "counter")


def find_role(name: str) -> str:
    """Return the role of a lower-case name: x, y, height, range, scan, angle, or the name itself.

    Examples
    --------
    >>> find_role("lateral"), find_role("profile_id"), find_role("FrameNo".lower())
    ('x', 'scan', 'scan')
    >>> find_role("posición x"), find_role("distance to the sensor"), find_role("高度")
    ('x', 'range', 'height')
    >>> find_role("-z"), find_role("y_down")
    ('range', 'range')
    """
    folded = fold_accents(name)
    if folded in _ROLES:
        return _ROLES[folded]
    if is_encoder(name):
        return "y"
    words = [word for word in re.findall(r"[^\W_]+", folded) if word not in _RANGE_REMARKS]
    are_ranges = words and all(_ROLES.get(word) == "range" for word in words)
    if are_ranges or _TURNED.fullmatch(folded):
        return "range"
    if axis := _AXIS_NAME.fullmatch(folded):
        return _ROLES[axis[1] or axis[2]]
    bare = re.sub(r"[_ .-]", "", name)
    for word in _SCAN_WORDS:
        if bare.startswith(word) and bare.removeprefix(word) in ("", *_SCAN_ENDINGS):
            return "scan"
    return name


def is_encoder(name: str) -> bool:
    """Return whether a column of this lower-case name holds the position of an encoder."""
    return name.startswith("encoder")


def select_by_role(names: Sequence[str], texts: Container[int]) -> dict[str, int]:
    """Return the first column in each role, of columns with these lower-case names.

    The columns `texts` hold text, which can only be the number of a profile.
    """
    by_role: dict[str, int] = {}
    for index, name in enumerate(names):
        role = find_role(name)
        if index not in texts or role == "scan":
            by_role.setdefault(role, index)
    return by_role


def has_known_role(name: str) -> bool:
    """Return whether a lower-case name is that of a coordinate, an angle or a profile's number."""
    return find_role(name) in {"x", "y", "height", "range", "scan", "angle"}


def is_coordinate(name: str) -> bool:
    """Return whether a lower-case name is that of a coordinate of points, not of an encoder."""
    return find_role(name) in {"x", "y", "height", "range"} and not is_encoder(name)


def names_section(names: Iterable[str]) -> bool:
    """Return whether lower-case names are those of x and of a height, a range or y."""
    roles = set(map(find_role, names))
    return "x" in roles and not roles.isdisjoint(("height", "range", "y"))


def is_part_name(name: str) -> bool:
    """Return whether a column of this lower-case name identifies parts, sensors or runs.

    Examples
    --------
    >>> is_part_name("part_id"), is_part_name("sensor"), is_part_name("intensity")
    (True, True, False)
    """
    words = name.replace("_", " ").replace("-", " ").split()
    return (
        bool(words) and words[0] in _PART_WORDS and all(word in _SCAN_ENDINGS for word in words[1:])
    )


def identifies_profiles(name: str) -> bool:
    """Return whether a lower-case name is that of a number of profiles, parts, sensors or runs."""
    return find_role(name) == "scan" or is_part_name(name)
