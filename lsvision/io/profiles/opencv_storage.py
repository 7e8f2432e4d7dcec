"""Profiles in OpenCV's FileStorage: YAML, XML or JSON written by `cv2.FileStorage`.

OpenCV's own reader is not used: it does not check a matrix's header (an ``opencv-matrix`` without
``cols`` corrupts the heap) and ends the process where lists nest deeply.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.files.json_text import MAX_DEPTH, NestedTooDeep, parse_json
from lsvision.geometry import FloatArray
from lsvision.io.profiles.column_roles import has_known_role
from lsvision.io.profiles.columns import profiles_from_table
from lsvision.io.profiles.matrix import is_monotonic
from lsvision.io.profiles.named_columns import profiles_from_named
from lsvision.io.profiles.number_table import NumberTable, numbers_from_cells
from lsvision.io.profiles.pose_documents import reject_pose_text
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.text_encoding import decode_text
from lsvision.io.profiles.unit_statements import find_lost_values, find_unit_statements

MIN_PAIRS = 3
"""Smallest number of points of a list; a shorter one is a matrix or a size."""
TRIPLES = "scan_line"
"""Name of a list that holds x, y, z after one another."""
_MATRIX_TYPE = re.compile(r"(\d{1,3})?[ucwsifdh]")
"""Entry ``dt`` of a matrix: the number of channels, if not 1, and the type of a number."""
_OPENCV_NUMBER = re.compile(
    r"(?<![\w.\"])([-+]?)\.(nan|inf)\b|(?<=[0-9])\.(?=[\s,\]}e])", re.IGNORECASE
)
"""Numbers of OpenCV's JSON that JSON does not have: .Nan, -.Inf and 1."""
_MAX_DIMENSIONS = 32  # of numpy's and OpenCV's arrays
_POINT_KEYS = (TRIPLES, "profile", "points", "line")
"""Keys of a list of points, best first."""
_MIN_NUMBERS = 30  # a shorter list under another name may be a pose or a matrix
# A key with a word as its value, such as "unit: um".
_KEY_WORD = re.compile(r"^[A-Za-z_]\w*:\s*[^\[\s!]")
# A key with a list that contains no other list.
_FLAT_LIST = re.compile(r"^[ \t{]*\"?([A-Za-z_]\w*)\"?[ \t]*:\s*\[([^\[\]]*)\]", re.MULTILINE)
# A list of numbers that would take the YAML parser too long.
_LONG_LIST = re.compile(r"\[([^\[\]{}\"'#&*]{2000,})\]")


def parse_opencv_json(text: str) -> Any:
    """Return the value of a JSON text, which may contain the numbers .Nan, -.Inf and 1. of OpenCV.

    Raises
    ------
    ValueError
        As `parse_json`.
    """
    return parse_json(_OPENCV_NUMBER.sub(_convert_number, text), allow_nan=True)


def _convert_number(match: re.Match[str]) -> str:
    """Return a number of OpenCV's JSON as JSON has it."""
    if match[2] is None:
        return ".0"
    return "NaN" if match[2].lower() == "nan" else f"{match[1].replace('+', '')}Infinity"


def matrix_from_node(key: str, node: Mapping[str, Any]) -> FloatArray:
    """Return the array of an ``opencv-matrix`` or ``opencv-nd-matrix``, its size checked.

    (rows, columns, channels), with all sizes before the channels if there are more than two. The
    key is for messages and may be empty.

    Raises
    ------
    UnreadableFile
        If an entry is missing or not understood, or the sizes do not match the number of its data.
    """
    try:
        sizes = (
            node["sizes"]
            if "sizes" in node
            else [_format_scalar(node["rows"]), _format_scalar(node["cols"])]
        )
        match = _MATRIX_TYPE.fullmatch(_format_scalar(node["dt"]).strip("\"'"))
        if match is None:
            raise ValueError(f"dt {_format_scalar(node['dt'])!r}")
        shape = [int(size) for size in sizes] + [int(match[1] or 1)]
        data = node["data"]
        if not isinstance(data, list):
            raise TypeError("data, which is no list")
        if min(shape) < 0 or len(shape) > _MAX_DIMENSIONS:
            raise ValueError(f"sizes {shape}")
    except (KeyError, ValueError, TypeError) as error:
        raise UnreadableFile(
            f"{_decode_prefix(key)}a matrix with a bad or missing {error}: write it again with "
            "cv2.FileStorage"
        ) from None
    if math.prod(shape) != len(data):
        raise UnreadableFile(
            f"{_decode_prefix(key)}a matrix of {' x '.join(map(str, shape))} numbers, "
            f"got {len(data)}: write it again with cv2.FileStorage"
        )
    return numbers_from_cells([str(item) for item in data]).reshape(shape)


def _format_scalar(value: Any) -> str:
    """Return the text of a scalar; XML gives it as a list of one word."""
    if isinstance(value, list) and len(value) == 1:
        value = value[0]
    if isinstance(value, str | int | float):
        return str(value)
    raise ValueError(f"{value!r:.40}")


def table_from_points(key: str, values: FloatArray) -> NumberTable:
    """Return the table of points, under their usual names.

    They are numbers in turn, (n,): triples under the key ``scan_line`` if their number is a
    multiple of 3; or rows (n, k), or (k, n) if n is larger.

    Raises
    ------
    UnreadableFile
        If a list is neither one of pairs nor one of triples, or an array has more dimensions.
    """
    if values.ndim == 2:
        rows = values if values.shape[1] <= values.shape[0] else values.T
    elif values.ndim > 2:
        raise UnreadableFile(
            f"{_decode_prefix(key)}expected points of n x 2 or n x 3 numbers, got "
            f"{' x '.join(map(str, values.shape))}: write one profile per matrix"
        )
    elif values.size % 3 == 0 and (key == TRIPLES or values.size % 2 or is_constant(values[1::3])):
        rows = values.reshape(-1, 3)
    elif values.size % 2 == 0:
        rows = values.reshape(-1, 2)
    else:
        raise UnreadableFile(
            f"expected pairs or triples, as [x, y, z, x, ...], got {values.size} numbers: "
            "write a matrix of n rows"
        )
    return NumberTable.of_points(rows)


def find_flat_width(key: str, values: FloatArray) -> int | None:
    """Return how many numbers of a flat list, (n,), are one point; None if it has no points.

    A list under the key ``scan_line`` holds triples if its length is a multiple of 3.
    """
    if key == TRIPLES and values.size % 3 == 0:
        return 3
    for width in (3, 2):
        if values.size % width == 0 and values.size >= MIN_PAIRS * width:
            rows = values.reshape(-1, width)
            in_plane = width == 2 or is_constant(rows[:, 1])
            if in_plane and is_monotonic(rows[:, 0]):
                return width
    return None


def is_constant(values: FloatArray) -> bool:
    """Return whether all numbers that are not lost are the same."""
    return len(np.unique(values[np.isfinite(values)])) <= 1


def _decode_prefix(key: str) -> str:
    return f"{key}: " if key else ""


def read_opencv_storage(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profile of lists with known names (x, z), or of one list of points.

    That list is ``scan_line`` (x, y, z in turn), or else the first under another name of points, or
    the first long one. Heights are assumed to increase towards the sensor.

    Raises
    ------
    UnreadableFile
        If the file cannot be parsed or contains no list of points.
    """
    text = decode_text(content)
    lists, lines = _find_lists(text)
    columns = {
        key: numbers_from_cells(cells)
        for key, cells in lists.items()
        if has_known_role(key.lower())
    }
    statements, lost = find_unit_statements(lines), find_lost_values(lines)
    if len(columns) > 1:
        return replace(profiles_from_named(columns, settings, statements), lost=lost)
    key = min(lists, key=_rank_key, default=None)
    if key is not None and (key in _POINT_KEYS or len(lists[key]) >= _MIN_NUMBERS):
        values = numbers_from_cells(lists[key])
        if key not in _POINT_KEYS and find_flat_width(key, values) is None:
            raise UnreadableFile(
                f"expected points with rising x under {key!r}, got {len(values)} numbers: write "
                "scan_line: [x, y, z, ...] or lists x and z"
            )
    else:
        key, values = _find_first_node(text)
    table = table_from_points(key, np.squeeze(values))
    return profiles_from_table(replace(table, statements=statements, lost=lost), settings)


def _find_lists(text: str) -> tuple[dict[str, list[str]], list[str]]:
    """Return the cells of each list that contains no other one, and lines like ``unit: um``."""
    if text.lstrip().startswith("<"):
        lists = {key: node for key, node in _parse_nodes(text).items() if _is_list_of_words(node)}
        lines = [f"{key}: {' '.join(words)}" for key, words in lists.items()]
        return lists, [line for line in lines if _KEY_WORD.match(line)]
    # Long lists are split here: a YAML parser needs microseconds per number.
    lists = {key: body.split(",") for key, body in _FLAT_LIST.findall(text) if key != "data"}
    return lists, [line for line in text.splitlines() if _KEY_WORD.match(line)]


def _is_list_of_words(node: Any) -> bool:
    return isinstance(node, list) and all(isinstance(word, str) for word in node)


def _rank_key(key: str) -> int:
    """Return the rank of a key among those that may hold points; known names come first."""
    return _POINT_KEYS.index(key) if key in _POINT_KEYS else len(_POINT_KEYS)


def _find_first_node(text: str) -> tuple[str, FloatArray]:
    """Return the key of lowest rank that holds points, and its numbers."""
    nodes = _parse_nodes(text)
    for key in sorted(nodes, key=_rank_key):
        values = _read_numbers(key, nodes[key])
        is_pairs = values.ndim == 2 and values.shape[1] == 2
        if values.size and (key in _POINT_KEYS or is_pairs or values.size >= _MIN_NUMBERS):
            return key, values
    reject_pose_text(text)
    raise UnreadableFile(
        f"no list of points among its keys ({', '.join(nodes)[:200] or 'none'}): "
        "expected scan_line: [x, y, z, ...]"
    )


def _parse_nodes(text: str) -> dict[str, Any]:
    """Return the nodes under the root; an error names what `_parse` does not accept."""
    try:
        return _parse(text)
    except ValueError as error:
        raise UnreadableFile(
            f"not a FileStorage of OpenCV ({str(error)[:200]}): write it again with cv2.FileStorage"
        ) from None


def _parse(text: str) -> dict[str, Any]:
    """Return the nodes under the root; a matrix is a mapping, a long list a list of str.

    Raises
    ------
    ValueError
        If the text is not YAML, JSON or XML of the kind that OpenCV writes.
    """
    start = text.lstrip()[:1]
    if start == "<":
        return _from_xml(text)
    if start == "{":
        root = parse_opencv_json(text)
    else:
        from lsvision.io.yaml_text import parse_yaml

        long_lists: list[list[str]] = []

        def replace_by_placeholder(match: re.Match[str]) -> str:
            long_lists.append(match[1].split(","))
            return f"[\\long list {len(long_lists) - 1}]"

        root = _with_long_lists(
            parse_yaml(_LONG_LIST.sub(replace_by_placeholder, text)), long_lists
        )
    if not isinstance(root, dict):
        raise ValueError(f"expected keys with values, got a {type(root).__name__}")
    return {str(key): value for key, value in root.items()}


def _with_long_lists(node: Any, long_lists: list[list[str]]) -> Any:
    """Return a parsed node in which the placeholders are replaced by the long lists."""
    if isinstance(node, dict):
        return {key: _with_long_lists(value, long_lists) for key, value in node.items()}
    if not isinstance(node, list):
        return node
    if len(node) == 1 and isinstance(node[0], str):
        match = re.fullmatch(r"\\long list (\d{1,9})", node[0])
        if match and int(match[1]) < len(long_lists):
            return long_lists[int(match[1])]
    return [_with_long_lists(value, long_lists) for value in node]


def _from_xml(text: str) -> dict[str, Any]:
    if re.search(r"<!(?:DOCTYPE|ENTITY)", text):
        raise ValueError("expected XML without DOCTYPE and entities, got some: remove them")
    try:
        root = ElementTree.fromstring(text, ElementTree.XMLParser(target=_ShallowTree()))
    except (ElementTree.ParseError, UnicodeError) as error:
        raise ValueError(f"no XML: {error}") from None
    return {element.tag: _convert_xml_node(element) for element in root}


class _ShallowTree(ElementTree.TreeBuilder):
    """Builder of an XML tree with at most `MAX_DEPTH` levels.

    OpenCV nests a matrix in a list of mappings five deep.
    """

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def start(self, tag: Any, attrs: Any, /) -> ElementTree.Element:
        """Open an element."""
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise NestedTooDeep
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ElementTree.Element:
        """Close an element."""
        self._depth -= 1
        return super().end(tag)


def _convert_xml_node(element: ElementTree.Element) -> Any:
    """Return words for an element without children, a list for children ``_``, else a mapping."""
    children = list(element)
    if not children:
        return (element.text or "").split()
    if all(child.tag == "_" for child in children):
        return [_convert_xml_node(child) for child in children]
    return {child.tag: _convert_xml_node(child) for child in children}


def _read_numbers(key: str, node: Any) -> FloatArray:
    """Return the numbers of a node; empty if it is neither a matrix nor a list."""
    if isinstance(node, Mapping):
        return matrix_from_node(key, node) if {"rows", "sizes"} & set(node) else np.empty(0)
    if not isinstance(node, list):
        return np.empty(0)
    if node and all(isinstance(item, list) for item in node):
        if len({len(item) for item in node}) != 1:
            return np.empty(0)
        flat = [cell for item in node for cell in item]
        rows = _numbers_from_list(flat)
        return rows.reshape(len(node), -1) if rows.size else rows
    return _numbers_from_list(node)


def _numbers_from_list(items: list[Any]) -> FloatArray:
    """Return the numbers of a list; empty if an item is not a number."""
    if any(isinstance(item, list | Mapping | bool) or item is None for item in items):
        return np.empty(0)
    try:
        return numbers_from_cells([str(item) for item in items])
    except UnreadableFile:
        return np.empty(0)
