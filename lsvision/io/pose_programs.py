"""Positions in programs of KUKA (``E6POS``, ``FRAME``), FANUC, ABB, Mitsubishi, Yaskawa and UR."""

import re
from pathlib import Path

from lsvision.errors import UnreadableFile
from lsvision.io.robot_conventions import PoseConvention

NUMBER = r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
"""Pattern of a number in a program."""
# A position such as {X 100, Y 0, ...} or {E6POS: X 100, ...}, and one of joint angles, {A1 0, ...}.
_KUKA = re.compile(
    r"\{\s*(?:(?:E6POS|POS|FRAME|E3POS)\s*)?(?::\s*)?(X\s+[-+.0-9][^{}]*)\}", re.IGNORECASE
)
_KUKA_AXES = re.compile(r"\{\s*(?:(?:E6AXIS|AXIS)\s*)?(?::\s*)?A1\s[^{}]*\}", re.IGNORECASE)
_KUKA_FIELD = re.compile(rf"(?<![A-Z0-9])([A-Z][A-Z0-9]*)\s+({NUMBER})", re.IGNORECASE)
# A position such as P[1:"weld"] { X = 100 mm, ... }, its user frame and its tool, UF : 1, UT : 2.
_FANUC = re.compile(r"\bP\[\s*([0-9]{1,9})[^\]]{0,200}\]\s*\{([^{}]*)\}", re.IGNORECASE)
_FANUC_FIELD = re.compile(r"\b([XYZWPR])\s*=\s*([^\s,;}]+)[ \t]*([A-Z]*)", re.IGNORECASE)
_FANUC_FRAME = re.compile(r"\b(U[FT])\s*:\s*(\S{1,40}?)\s*,", re.IGNORECASE)


def _build_numbers_pattern(count: int) -> str:
    """Return the pattern of numbers between commas."""
    return r"\s*,\s*".join([NUMBER] * count)


# A robtarget [[x, y, z], [q1, q2, q3, q4], [axis configuration], [external axes]].
_ABB = re.compile(
    rf"\[\s*\[\s*({_build_numbers_pattern(3)})\s*\]\s*,\s*\[\s*({_build_numbers_pattern(4)})\s*\]\s*,"
    rf"\s*\[\s*{_build_numbers_pattern(4)}\s*\]\s*,\s*\["
)
_ABB_WORK_OBJECT = re.compile(r"\\WObj\s*:=\s*(\w+)", re.IGNORECASE)
# A position (x, y, z, a, b, c, additional axes)(structure flag 1, structure flag 2).
_MITSUBISHI = re.compile(
    rf"\(\s*({_build_numbers_pattern(6)})\s*(?:,[-+\s0-9.,]*)?\)\s*\(\s*[0-9]*\s*,\s*[-+]?[0-9]*\s*\)"
)
# Positions of a Yaskawa job (JBI): joint pulses, or x, y, z, Rx, Ry, Rz in the frame of POSTYPE.
_YASKAWA = re.compile(r"^//POS\b", re.MULTILINE)
_YASKAWA_POSITION = re.compile(rf"^C[0-9]+\s*=\s*({_build_numbers_pattern(6)})\s*$", re.MULTILINE)
_YASKAWA_START = re.compile(r"^C[0-9]+\s*=", re.MULTILINE)
# Motions of a UR script, such as movel(p[x, y, z, rx, ry, rz], v=0.1).
_UR = re.compile(r"\bmove[jlpc]\s*\(")
_UR_POSITION = re.compile(
    rf"\bmove[jlp]\s*\(\s*(?:pose\s*=\s*)?p\[\s*({_build_numbers_pattern(6)})\s*\]\s*[,)]"
)
_UR_TOOL = re.compile(r"\bset_tcp\s*\(\s*([^)]*?)\s*\)")
# A section of a Kawasaki program (AS), whose positions are sorted by name and not by motion.
_KAWASAKI = re.compile(r"^\.(?:PROGRAM|TRANS|JOINTS)\b", re.MULTILINE)
# Positions of a Staubli data file (VAL3), sorted by name as well.
_STAUBLI = re.compile(r"<\w+\b[^<>]*\brx\s*=\s*\"[^<>]*>")
# Starts of positions, which must be complete: P1=( of Mitsubishi, robtarget p1:= of ABB.
_MITSUBISHI_START = re.compile(r"\bP\w*\s*=\s*\(", re.IGNORECASE)
_ABB_START = re.compile(r"\brobtarget\s+\w+(?:\{[0-9]+\})?\s*:=", re.IGNORECASE)
_MITSUBISHI_SETTING = re.compile(r"[0-9\s]*P_", re.IGNORECASE)  # such as P_TOOL


_PROGRAMS = (
    ("kuka", _KUKA),
    ("fanuc", _FANUC),
    ("abb", _ABB),
    ("mitsubishi", _MITSUBISHI),
    ("yaskawa", _YASKAWA),
    ("ur", _UR),
    ("kawasaki", _KAWASAKI),
    ("staubli", _STAUBLI),
)
"""Name of the convention of each maker, and the pattern of its programs."""


def find_maker(text: str) -> str:
    """Return the convention of the robot program that a text is; empty if it is none.

    Examples
    --------
    >>> find_maker("LIN {X 100, Y 0, Z 50, A 0, B 90, C 0}"), find_maker("x, z")
    ('kuka', '')
    """
    return next((maker for maker, pattern in _PROGRAMS if pattern.search(text)), "")


def read_program_rows(
    path: Path, text: str, pose_convention: PoseConvention
) -> list[list[float]] | None:
    """Return the positions of a robot program in the order of the convention's fields.

    None if the text, a whole file, is no robot program. The path is for messages.

    Raises
    ------
    UnreadableFile
        For joint angles, positions that are incomplete or were never taught, several bases, user
        frames, work objects, tools or motion groups, or a convention other than the maker's.
    """
    readers = {
        "kuka": _parse_kuka_rows,
        "fanuc": _parse_fanuc_rows,
        "abb": _parse_abb_rows,
        "mitsubishi": _parse_mitsubishi_rows,
        "yaskawa": _parse_yaskawa_rows,
        "ur": _parse_ur_rows,
    }
    maker = find_maker(text)
    if maker in readers:
        if pose_convention.name != maker:
            raise UnreadableFile(
                f"{path}: expected convention {maker!r} for the {maker.upper()} program, got "
                f"{pose_convention.name!r}: use --convention {maker}"
            )
        return readers[maker](path, text, pose_convention)
    if _KUKA_AXES.search(text):
        raise UnreadableFile(
            f"{path}: joint angles (E6AXIS) instead of positions: write E6POS or FRAME of the "
            "flange"
        )
    if maker == "kawasaki":
        raise UnreadableFile(
            f"{path}: a Kawasaki program, which is not read: write X Y Z O A T of its positions as "
            "text, one line per pose in the order of the motion"
        )
    if maker == "staubli":
        raise UnreadableFile(
            f"{path}: a Staubli data file, which is not read: write x y z rx ry rz of its poses as "
            "text, one line per pose in the order of the motion"
        )
    return None


def _parse_kuka_rows(path: Path, text: str, pose_convention: PoseConvention) -> list[list[float]]:
    rows, text = [], _without_kuka_settings(text)
    for name, kind in (("BASE_NO", "in several bases"), ("TOOL_NO", "of several tools")):
        numbers = list(dict.fromkeys(re.findall(rf"\b{name}\s+([0-9]+)", text, re.IGNORECASE)))
        _require_one(path, kind, name, numbers)
    for number, aggregate in enumerate(_KUKA.findall(text), 1):
        values = {name.lower(): float(value) for name, value in _KUKA_FIELD.findall(aggregate)}
        rows.append(_order_fields(path, f"position {number}", values, pose_convention))
    return rows


def _without_kuka_settings(text: str) -> str:
    """Return the text without comments (from a semicolon on) and system variables ($TOOL = ...)."""
    lines = (line.partition(";")[0] for line in text.split("\n"))
    return "\n".join(line for line in lines if not line.lstrip().startswith("$"))


def _parse_fanuc_rows(path: Path, text: str, pose_convention: PoseConvention) -> list[list[float]]:
    """Return the positions of a FANUC program (LS), one row each, in the order of the file."""
    rows, frames = [], []
    for name, body in _FANUC.findall(text):
        position = f"P[{name}]"
        values: dict[str, float] = {}
        for field, cell, unit in _FANUC_FIELD.findall(body):
            expected = "mm" if field.upper() in "XYZ" else "deg"
            if unit and unit.lower() != expected:
                raise UnreadableFile(
                    f"{path}: {position}: expected {field} in {expected}, got {unit}"
                )
            if field.lower() in values:
                raise UnreadableFile(
                    f"{path}: {position}: {field} occurs twice: write the positions of one motion "
                    "group"
                )
            try:
                values[field.lower()] = float(cell)
            except ValueError:
                raise UnreadableFile(
                    f"{path}: {position}: {field} is {cell[:20]!r}: the position was never taught"
                ) from None
        frames.append({name.upper(): n for name, n in reversed(_FANUC_FRAME.findall(body))})
        rows.append(_order_fields(path, position, values, pose_convention))
    for name, kind in (("UF", "in several user frames"), ("UT", "of several tools")):
        numbers = list(dict.fromkeys(frame.get(name, "none") for frame in frames))
        _require_one(path, kind, name, numbers)
    return rows


def _parse_abb_rows(path: Path, text: str, _: PoseConvention) -> list[list[float]]:
    """Return the positions of an ABB program (RAPID), without its comments, from ! on."""
    text = "\n".join(line.partition("!")[0] for line in text.split("\n"))
    work_objects = list(dict.fromkeys(_ABB_WORK_OBJECT.findall(text)))
    _require_one(path, "in several work objects", "WObj", work_objects)
    rows = [_split_numbers(",".join(groups)) for groups in _ABB.findall(text)]
    _require_all(path, len(rows), _ABB_START.findall(text))
    return rows


def _parse_mitsubishi_rows(path: Path, text: str, _: PoseConvention) -> list[list[float]]:
    """Return the positions of a Mitsubishi program, without its comments (from ' on) and settings.

    Settings are system variables, whose names begin with P_.
    """
    lines = (line.partition("'")[0] for line in text.split("\n"))
    text = "\n".join(line for line in lines if not _MITSUBISHI_SETTING.match(line))
    rows = [_split_numbers(numbers) for numbers in _MITSUBISHI.findall(text)]
    _require_all(path, len(rows), _MITSUBISHI_START.findall(text))
    return rows


def _parse_yaskawa_rows(path: Path, text: str, _: PoseConvention) -> list[list[float]]:
    """Return the positions C00000, C00001, ... of a Yaskawa job in the order of the file."""
    if re.search(r"^///PULSE\b", text, re.MULTILINE):
        raise UnreadableFile(
            f"{path}: pulses of the joints instead of positions: save it as a relative job, with "
            "///RECTAN"
        )
    for name, kind in (
        ("POSTYPE", "in several frames"),
        ("USER", "in several user frames"),
        ("TOOL", "of several tools"),
    ):
        numbers = re.findall(rf"^///{name}\s+(\S+)", text, re.MULTILINE)
        _require_one(path, kind, name, list(dict.fromkeys(numbers)))
    rows = [_split_numbers(numbers) for numbers in _YASKAWA_POSITION.findall(text)]
    _require_all(path, len(rows), _YASKAWA_START.findall(text))
    return rows


def _parse_ur_rows(path: Path, text: str, _: PoseConvention) -> list[list[float]]:
    """Return the poses p[...] that a UR script moves to, without its comments (from # on)."""
    text = "\n".join(line.partition("#")[0] for line in text.split("\n"))
    _require_one(path, "of several tools", "TCP", list(dict.fromkeys(_UR_TOOL.findall(text))))
    rows = [_split_numbers(numbers) for numbers in _UR_POSITION.findall(text)]
    motions = len(_UR.findall(text))
    if motions > len(rows):
        raise UnreadableFile(
            f"{path}: {motions} motions in it, and {len(rows)} of them to a pose: write each as "
            "movel(p[x, y, z, rx, ry, rz]), without joint angles, variables and arcs"
        )
    return rows


def _require_all(path: Path, count: int, starts: list[str]) -> None:
    """Raise UnreadableFile if there are more starts of positions than complete ones."""
    if len(starts) > count:
        raise UnreadableFile(
            f"{path}: {len(starts)} positions begin in it, and {count} are complete: write all "
            "numbers of each, also those of its configuration"
        )


def _split_numbers(text: str) -> list[float]:
    return [float(cell) for cell in text.split(",")]


def _require_one(path: Path, kind: str, name: str, numbers: list[str]) -> None:
    """Raise UnreadableFile if positions are of several tools, or in several frames."""
    if len(numbers) > 1:
        raise UnreadableFile(
            f"{path}: positions {kind} ({name} {', '.join(numbers)}): teach all in one"
        )


def _order_fields(
    path: Path, position: str, values: dict[str, float], pose_convention: PoseConvention
) -> list[float]:
    """Return the values of a position in the order of the convention's fields."""
    missing = [field for field in pose_convention.fields if field not in values]
    if missing:
        raise UnreadableFile(
            f"{path}: {position}: no {' '.join(missing)} in it: write positions, not joint angles"
        )
    return [values[field] for field in pose_convention.fields]
