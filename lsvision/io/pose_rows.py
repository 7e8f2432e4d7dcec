"""Poses as rows of numbers, from robot programs, text, JSON and YAML files."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lsvision.errors import UnreadableFile
from lsvision.files.json_text import parse_json
from lsvision.files.limited_reading import read_text
from lsvision.io.pose_header import ANGLE_UNITS, PoseHeader, common_length_unit, read_pose_header
from lsvision.io.pose_programs import read_program_rows
from lsvision.io.profiles.unit_statements import find_unit_statements
from lsvision.io.profiles.units import split_label
from lsvision.io.robot_conventions import AngleUnit, LengthUnit, PoseConvention
from lsvision.io.yaml_text import parse_yaml

_LETTER = re.compile(r"[^\W\d_eE]")
"""Letter of a name or a unit; e and E are also those of 1e3."""
_COMMA_NUMBER = re.compile(r"[-+]?[0-9]+(?:,[0-9]+)?(?:[eE][-+]?[0-9]+)?")
"""Number with a decimal comma between digits, or a whole number."""


@dataclass(frozen=True)
class PoseRows:
    """Numbers of the poses in a file, and the units that it states.

    Parameters
    ----------
    rows : list of list of float
        Numbers of each pose, in the order of the convention's fields.
    length_unit, angle_unit : str or None
        None where the file states none.
    may_state_units : bool
        Whether the format of the file has a place for units: JSON and YAML have one only for that
        of lengths, a key such as ``unit`` beside the list.
    """

    rows: list[list[float]]
    length_unit: LengthUnit | None = None
    angle_unit: AngleUnit | None = None
    may_state_units: bool = True


def read_pose_rows(path: Path, pose_convention: PoseConvention, skip_columns: int) -> PoseRows:
    """Read the numbers of each pose in a file, in the order of the convention's fields.

    Parameters
    ----------
    path : Path
        ``.json`` and ``.rob`` are JSON, ``.yaml`` and ``.yml`` YAML, anything else text.
    pose_convention : PoseConvention
        Convention of the poses, with the names of the fields.
    skip_columns : int
        Columns before the pose in text without named columns.

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
        items = document.items() if isinstance(document, Mapping) else ()
        try:
            length_unit = _stated_length_unit(
                [f"# {key}: {value}" for key, value in items if isinstance(value, str)]
            )
        except ValueError as error:
            raise UnreadableFile(f"{path}: {error}") from error
        rows = _structured_rows(document, pose_convention, path)
        return PoseRows(rows, length_unit, may_state_units=False)
    program = read_program_rows(path, text, pose_convention)
    return (
        _text_rows(path, text, pose_convention, skip_columns)
        if program is None
        else PoseRows(program, "mm", "deg")  # as KUKA and FANUC write all programs
    )


def _parse(path: Path, text: str, parse: Callable[[str], Any]) -> Any:
    try:
        return parse(text)
    except ValueError as error:
        raise UnreadableFile(
            f"{path}: expected robot poses in {path.suffix[1:]}, got: {error}"
        ) from None


def _structured_rows(
    document: Any, pose_convention: PoseConvention, path: Path
) -> list[list[float]]:
    """Return the rows of a list of poses in JSON or YAML."""
    if isinstance(document, Mapping):
        lists = {key: value for key, value in document.items() if isinstance(value, list)}
        if len(lists) != 1:
            raise UnreadableFile(
                f"{path}: expected one list of poses under one key, got {len(lists)} lists "
                f"({', '.join(map(str, lists)) or 'none'})"
            )
        (document,) = lists.values()
    if not isinstance(document, list):
        raise UnreadableFile(f"{path}: expected a list of poses, got {type(document).__name__}")
    try:
        return [_flatten(row, pose_convention) for row in document]
    except (TypeError, ValueError, OverflowError) as error:
        raise UnreadableFile(f"{path}: expected rows of numbers: {error}") from error


def _flatten(row: Any, pose_convention: PoseConvention) -> list[float]:
    """Return the numbers of a pose: fields by name, or nested lists in their order."""
    if isinstance(row, Mapping):
        named = {str(key).lower(): value for key, value in row.items()}
        missing = [field for field in pose_convention.fields if field not in named]
        if missing:
            raise ValueError(
                f"expected fields {' '.join(pose_convention.fields)}, missing {' '.join(missing)}"
            )
        return [float(named[field]) for field in pose_convention.fields]
    if isinstance(row, Sequence) and not isinstance(row, str):
        return [number for item in row for number in _flatten(item, pose_convention)]
    return [float(row)]


def _text_rows(path: Path, text: str, pose_convention: PoseConvention, skip: int) -> PoseRows:
    """Return the rows of a text table with the units that its header or comments state."""
    lines = text.splitlines()
    numbered = [(n, cells) for n, line in enumerate(lines, 1) if (cells := _split_cells(line))]
    first = numbered[0][1] if numbered else []
    has_names = any(map(_LETTER.search, first)) and not any(map(_is_number, first))
    names = first if has_names else _commented_header(lines, numbered)
    try:
        header = read_pose_header(names, pose_convention, skip) if names else PoseHeader()
        length_unit = header.length_unit or _stated_length_unit(lines)
    except ValueError as error:
        raise UnreadableFile(f"{path}: {error}") from error
    rows = []
    for number, cells in numbered[has_names:]:
        location = f"{path}: line {number}"
        if len(cells) <= max(header.columns, default=0):
            raise UnreadableFile(f"{location}: expected a number under each name, got {len(cells)}")
        pose_cells = [cells[column] for column in header.columns] or cells[skip:]
        rows.append(_parse_row(pose_cells, pose_convention, location))
    return PoseRows(rows, length_unit, header.angle_unit)


def _commented_header(lines: Sequence[str], numbered: Sequence[tuple[int, list[str]]]) -> list[str]:
    """Return the column names in the last comment above the first row of cells.

    Empty unless there is one name for each cell, and x, y and z are among them.
    """
    if not numbered:
        return []
    number, cells = numbered[0]
    comments = [line.strip().lstrip("#%/ ") for line in lines[: number - 1] if line.strip()]
    names = _split_cells(comments[-1]) if comments else []
    fields = [name for name in names if split_label(name)[0] in ("x", "y", "z")]
    return names if len(names) == len(cells) and len(fields) == 3 else []


def _stated_length_unit(lines: Sequence[str]) -> LengthUnit | None:
    """Return the unit of length that the comments state; None without a statement.

    Statements on angles, such as ``all in deg``, do not count.
    """
    comments = [line for line in lines if line.lstrip().startswith(("#", "%", "//"))]
    stated = {
        statement.unit.unit or statement.unit.text
        for statement in find_unit_statements(comments)
        if statement.axis is None and statement.unit.text.lower() not in ANGLE_UNITS
    }
    return common_length_unit(stated)


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
    """Return the cells of a line without its comment and brackets; empty if nothing remains."""
    line = line.split("#", maxsplit=1)[0].strip()
    line = re.sub(r"\bp\[", "[", line)  # as Universal Robots write a pose
    bare = re.sub(r"[()\[\]]", " ", line).strip().rstrip(",")
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
