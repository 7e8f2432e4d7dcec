"""Poses as rows of numbers, from robot programs, text, JSON and YAML files."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lsvision.errors import UnreadableFile
from lsvision.files.json_text import parse_json
from lsvision.files.limited_reading import read_text
from lsvision.io.pose_header import (
    ANGLE_UNITS,
    PoseHeader,
    find_common_angle_unit,
    find_common_length_unit,
    find_field_name,
    read_pose_header,
)
from lsvision.io.pose_matrices import find_printed_matrices
from lsvision.io.pose_programs import read_program_rows
from lsvision.io.profiles.json_values import iterate_lines_on_units
from lsvision.io.profiles.unit_statements import find_unit_statements
from lsvision.io.profiles.units import NOT_LENGTHS, StatedUnit, parse_unit, split_label
from lsvision.io.robot_conventions import CONVENTIONS, AngleUnit, LengthUnit, PoseConvention
from lsvision.io.yaml_text import parse_yaml

_LETTER = re.compile(r"[^\W\d_eE]")
"""Letter of a name or a unit; e and E are also those of 1e3."""
_COMMA_NUMBER = re.compile(r"[-+]?[0-9]+(?:,[0-9]+)?(?:[eE][-+]?[0-9]+)?")
"""Number with a decimal comma between digits, or a whole number."""
_CONVENTION = re.compile(r"\bconvention[\"']?\s*[:=]\s*[\"']?(\w+)", re.IGNORECASE)
"""Statement of the convention in a comment."""
_QUOTED = re.compile(r'"([^"]*)"')
"""Cell in quotes."""
_ASSIGNMENT = re.compile(r"^(?:\w+\s+)?\w[\w.]*(?:\[[0-9]+\](?:\.\w+)?)?\s*:?=\s*(?=\{)")
"""Start of a line such as "trsf p1 = {100, 0, 50, 0, 90, 0}" of Staubli."""
_ANGLE_UNIT = re.compile(
    rf"(?<![\w.])(?<![0-9] )(?:{'|'.join(ANGLE_UNITS)})(?!\w| ?c\b|/s)", re.IGNORECASE
)
"""Unit of angles without a number before it, as in "tilt 30 deg"; not deg C or deg/s."""


@dataclass(frozen=True)
class PoseRows:
    """Numbers of each pose in a file, in the order of the convention's fields, and stated units.

    `may_state_units` is whether the file may have a header with units: JSON and YAML have none, but
    keys such as ``unit`` and ``angle_unit`` beside the list.
    """

    rows: list[list[float]]
    length_unit: LengthUnit | None = None
    angle_unit: AngleUnit | None = None
    may_state_units: bool = True


def read_pose_rows(path: Path, pose_convention: PoseConvention, skip_columns: int) -> PoseRows:
    """Read the numbers of each pose in a file, in the order of the convention's fields.

    ``.json`` and ``.rob`` are JSON, ``.yaml`` and ``.yml`` YAML, anything else text, in which
    `skip_columns` precede the pose if the columns have no names.

    Raises
    ------
    UnreadableFile
        If the file is missing, is not of the format of its suffix, or has rows of another length.
    """
    text = read_text(path)
    suffix = path.suffix.lower()
    if suffix in {".json", ".rob", ".yaml", ".yml"}:
        parse = parse_json if suffix in {".json", ".rob"} else parse_yaml
        document = _parse(path, text, parse)
        lines = iterate_lines_on_units(document) if isinstance(document, Mapping) else ()
        stated = _find_stated_units(path, [f"# {line}" for line in lines], pose_convention)
        rows = _read_structured_rows(document, pose_convention, path)
        return PoseRows(rows, stated.length_unit, stated.angle_unit, may_state_units=False)
    program = read_program_rows(path, text, pose_convention)
    if program is not None:
        return PoseRows(program, pose_convention.length_unit, pose_convention.angle_unit)
    matrices = find_printed_matrices(text)
    if matrices is None:
        return _read_text_rows(path, text, pose_convention, skip_columns)
    if pose_convention.rotation != "matrix":
        raise UnreadableFile(
            f"{path}: expected poses in convention {pose_convention.name!r}, got {len(matrices)} "
            "4x4 matrices: use --convention matrix"
        )
    return PoseRows(
        matrices, _find_stated_units(path, text.splitlines(), pose_convention).length_unit
    )


def _parse(path: Path, text: str, parse: Callable[[str], Any]) -> Any:
    try:
        return parse(text)
    except ValueError as error:
        raise UnreadableFile(
            f"{path}: expected robot poses in {path.suffix[1:]}, got: {error}"
        ) from None


def _read_structured_rows(
    document: Any, pose_convention: PoseConvention, path: Path
) -> list[list[float]]:
    """Return the rows of a list of poses in JSON or YAML."""
    if isinstance(document, Mapping):
        lists = {
            key: value
            for key, value in document.items()
            if isinstance(value, list) and not any(isinstance(item, str) for item in value)
        }
        if len(lists) != 1:
            raise UnreadableFile(
                f"{path}: expected one list of poses under one key, got {len(lists)} lists "
                f"({', '.join(map(str, lists)) or 'none'}): leave one"
            )
        (document,) = lists.values()
    if not isinstance(document, list):
        raise UnreadableFile(
            f"{path}: expected a list of poses, got {type(document).__name__}: write one"
        )
    try:
        return [_flatten(row, pose_convention) for row in document]
    except (TypeError, ValueError, OverflowError) as error:
        raise UnreadableFile(f"{path}: expected rows of numbers: {error}") from error


def _flatten(row: Any, pose_convention: PoseConvention) -> list[float]:
    """Return the numbers of a pose: fields by name, or nested lists in their order."""
    if isinstance(row, Mapping):
        named = {str(key).lower(): value for key, value in row.items()}
        if isinstance(named.get("pose"), Mapping):  # of a message with a header
            return _flatten(named["pose"], pose_convention)
        if pose_convention.name == "ros":
            named |= _read_fields_of_message(named)
        missing = [field for field in pose_convention.fields if field not in named]
        if missing:
            raise ValueError(
                f"expected fields {' '.join(pose_convention.fields)}, missing {' '.join(missing)}"
            )
        return [float(named[field]) for field in pose_convention.fields]
    if isinstance(row, Sequence) and not isinstance(row, str):
        return [number for item in row for number in _flatten(item, pose_convention)]
    return [float(row)]


def _read_fields_of_message(message: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a ROS message Pose or Transform; none of another mapping."""
    for position_key, rotation_key in (("position", "orientation"), ("translation", "rotation")):
        position, rotation = message.get(position_key), message.get(rotation_key)
        if isinstance(position, Mapping) and isinstance(rotation, Mapping):
            return {**position, **{f"q{axis}": value for axis, value in rotation.items()}}
    return {}


def _read_text_rows(path: Path, text: str, pose_convention: PoseConvention, skip: int) -> PoseRows:
    """Return the rows of a text table with the units that its header or comments state."""
    lines = text.splitlines()
    numbered = [(n, cells) for n, line in enumerate(lines, 1) if (cells := _split_cells(line))]
    names, numbered = _separate_header(lines, numbered, pose_convention)
    stated = _find_stated_units(path, lines, pose_convention)
    try:
        header = read_pose_header(names, pose_convention, skip) if names else PoseHeader()
    except ValueError as error:
        raise UnreadableFile(f"{path}: {error}") from error
    rows = []
    for number, cells in numbered:
        location = f"{path}: line {number}"
        if len(cells) <= max(header.columns, default=0):
            raise UnreadableFile(
                f"{location}: expected a number under each name, got {len(cells)}: complete the row"
            )
        pose_cells = [cells[column] for column in header.columns] or cells[skip:]
        rows.append(_parse_row(pose_cells, pose_convention, location))
    return PoseRows(
        rows, header.length_unit or stated.length_unit, header.angle_unit or stated.angle_unit
    )


_NumberedCells = tuple[int, list[str]]
"""Number of a line, and its cells."""


def _separate_header(
    lines: Sequence[str], numbered: list[_NumberedCells], pose_convention: PoseConvention
) -> tuple[list[str], list[_NumberedCells]]:
    """Return the names of the columns, empty without a header, and the rows below it.

    The names are in the first row, then a row of units may follow, or in a comment. Numbers 0, 1,
    2, ... of the columns, as pandas writes them, are no pose.
    """
    first = numbered[0][1] if numbered else []
    if [cell for cell in first if cell] == [str(k) for k in range(sum(map(bool, first)))]:
        return [], numbered[1:]
    if not any(map(_LETTER.search, first)) or any(map(_is_number, first)):
        return _find_commented_header(lines, numbered, pose_convention), numbered
    units = numbered[1][1] if len(numbered) > 1 else []
    if len(units) != len(first) or not all(map(_is_unit, units)):
        return first, numbered[1:]
    names = [f"{name} [{unit.strip('[]()')}]" for name, unit in zip(first, units, strict=True)]
    return names, numbered[2:]


def _is_unit(cell: str) -> bool:
    """Return whether a cell below the names holds a unit, or the sign of none."""
    word = cell.strip("[]() ").lower()
    return word in NOT_LENGTHS or word in ("", "-", "1") or parse_unit(word) is not None


def _find_commented_header(
    lines: Sequence[str], numbered: Sequence[_NumberedCells], pose_convention: PoseConvention
) -> list[str]:
    """Return the column names in the last comment above the first row of cells.

    Empty unless there is one name for each cell, and x, y and z are among them.
    """
    if not numbered:
        return []
    number, cells = numbered[0]
    comments = [line.strip().lstrip("#%/ ") for line in lines[: number - 1] if line.strip()]
    names = _split_cells(comments[-1]) if comments else []
    fields = [find_field_name(split_label(name)[0], pose_convention) for name in names]
    return names if len(names) == len(cells) and {"x", "y", "z"} <= set(fields) else []


def _find_stated_units(
    path: Path, lines: Sequence[str], pose_convention: PoseConvention
) -> PoseHeader:
    """Return the units that the comments state, for all lengths and for all angles.

    Raises
    ------
    UnreadableFile
        If they state several, one of lengths that is neither mm nor m, or another convention.
    """
    comments = [line for line in lines if line.lstrip().startswith(("#", "%", "//"))]
    _check_convention(path, comments, pose_convention)
    lengths = {
        statement.unit.unit or statement.unit.text
        for statement in find_unit_statements(comments)
        if statement.axis is None and not _is_about_angles(statement.unit)
    }
    has_angles = pose_convention.is_euler or pose_convention.rotation == "rotvec"
    angles = {unit.lower() for line in comments for unit in _ANGLE_UNIT.findall(line)}
    try:
        return PoseHeader(
            length_unit=find_common_length_unit(lengths),
            angle_unit=find_common_angle_unit(angles) if has_angles else None,
        )
    except ValueError as error:
        raise UnreadableFile(f"{path}: {error}") from error


def _check_convention(path: Path, comments: Sequence[str], expected: PoseConvention) -> None:
    """Raise UnreadableFile if comments such as ``# convention: kuka`` state another convention."""
    for stated in _CONVENTION.findall("\n".join(comments)):
        if stated.lower() in CONVENTIONS and stated.lower() != expected.name:
            raise UnreadableFile(
                f"{path}: it states convention {stated!r}, not {expected.name!r}: use --convention "
                f"{stated.lower()}, or correct the file"
            )


def _is_about_angles(stated: StatedUnit) -> bool:
    """Return whether a statement names units of angles only, as ``rotation unit: deg``."""
    value, count = _ANGLE_UNIT.subn("", re.split("[:=]", stated.text)[-1])
    return stated.unit is None and count > 0 and _LETTER.search(value) is None


def _parse_row(cells: list[str], pose_convention: PoseConvention, location: str) -> list[float]:
    """Return the numbers of a row; errors begin with its location."""
    if len(cells) != len(pose_convention.fields):
        raise UnreadableFile(
            f"{location}: expected {len(pose_convention.fields)} numbers "
            f"({' '.join(pose_convention.fields)}), got "
            f"{len(cells)}: check the convention {pose_convention.name!r}; if there are more "
            "columns, name them in a header (in Python skip_columns=1 drops the first)"
        )
    try:
        return [float(cell) for cell in cells]
    except ValueError as error:
        raise UnreadableFile(f"{location}: expected numbers only: {error}") from error


def _split_cells(line: str) -> list[str]:
    """Return the cells of a line without comment, quotes and brackets; empty if nothing remains."""
    line = line.split("#", maxsplit=1)[0].strip()
    line = _QUOTED.sub(lambda quoted: quoted[1].replace(",", "."), line)
    line = re.sub(r"^\w+\s*:?=\s*p\[|\bp\[", "[", line)  # as Universal Robots write a pose
    line = _ASSIGNMENT.sub("", line)
    bare = re.sub(r"[()\[\]{}]", " ", line).strip().rstrip(",")
    is_header = _LETTER.search(line) is not None  # brackets are those of units
    if ";" in line:  # European spreadsheets: decimal comma
        text = line if is_header else bare
        return [cell.strip().replace(",", ".") for cell in text.rstrip("; ").split(";")]
    if all(map(_COMMA_NUMBER.fullmatch, words := bare.split())) and len(words) > 1:
        return [word.replace(",", ".") for word in words]
    if is_header and "\t" in line and "," not in line:
        return [cell.strip() for cell in line.split("\t") if cell.strip()]
    return [cell.strip() for cell in bare.split(",")] if "," in bare else bare.split()


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
