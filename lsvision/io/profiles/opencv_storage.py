"""Profiles in OpenCV's FileStorage: YAML, XML or JSON written by `cv2.FileStorage`.

OpenCV's own reader is not used: it does not check a matrix's header (an ``opencv-matrix`` without
``cols`` corrupts the heap) and ends the process where lists nest deeply.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.column_roles import has_known_role
from lsvision.io.profiles.columns import profiles_from_table
from lsvision.io.profiles.json_points import flat_width
from lsvision.io.profiles.named_columns import profiles_from_named
from lsvision.io.profiles.number_cells import numbers_from_cells
from lsvision.io.profiles.opencv_matrix import (
    TRIPLES,
    matrix_from_node,
    parse_opencv_json,
    table_from_points,
)
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.text_encoding import decode_text
from lsvision.io.profiles.unit_statements import find_lost_values, find_unit_statements

_POINT_KEYS = (TRIPLES, "profile", "points", "line")
_MIN_NUMBERS = 30  # a shorter list under another name may be a pose or a matrix
# A key with a word as its value, such as "unit: um".
_KEY_WORD = re.compile(r"^[A-Za-z_]\w*:\s*[^\[\s!]")
# A key with a list that contains no other list.
_FLAT_LIST = re.compile(r"^[ \t{]*\"?([A-Za-z_]\w*)\"?[ \t]*:\s*\[([^\[\]]*)\]", re.MULTILINE)
# A list of numbers that would take the YAML parser too long.
_LONG_LIST = re.compile(r"\[([^\[\]{}\"'#&*]{2000,})\]")
_MAX_XML_DEPTH = 16


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
    key = min(lists, key=_rank, default=None)
    if key is not None and (key in _POINT_KEYS or len(lists[key]) >= _MIN_NUMBERS):
        values = numbers_from_cells(lists[key])
        if key not in _POINT_KEYS and flat_width(key, values) is None:
            raise UnreadableFile(
                f"expected points with rising x under {key!r}, got {len(values)} numbers: write "
                "scan_line: [x, y, z, ...] or lists x and z"
            )
    else:
        key, values = _first_node(text)
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


def _rank(key: str) -> int:
    """Return the rank of a key among those that may hold points; known names come first."""
    return _POINT_KEYS.index(key) if key in _POINT_KEYS else len(_POINT_KEYS)


def _first_node(text: str) -> tuple[str, FloatArray]:
    """Return the key of lowest rank that holds points, and its numbers."""
    nodes = _parse_nodes(text)
    for key in sorted(nodes, key=_rank):
        values = _numbers(key, nodes[key])
        is_pairs = values.ndim == 2 and values.shape[1] == 2
        if values.size and (key in _POINT_KEYS or is_pairs or values.size >= _MIN_NUMBERS):
            return key, values
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
        raise ValueError("expected XML without DOCTYPE and entities")
    try:
        root = ElementTree.fromstring(text, ElementTree.XMLParser(target=_ShallowTree()))
    except (ElementTree.ParseError, UnicodeError) as error:
        raise ValueError(f"no XML: {error}") from None
    return {element.tag: _xml_node(element) for element in root}


class _ShallowTree(ElementTree.TreeBuilder):
    """Builder of an XML tree of limited depth."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def start(self, tag: Any, attrs: Any, /) -> ElementTree.Element:
        """Open an element."""
        self._depth += 1
        if self._depth > _MAX_XML_DEPTH:
            raise ValueError(f"expected at most {_MAX_XML_DEPTH} levels of nesting, got more")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ElementTree.Element:
        """Close an element."""
        self._depth -= 1
        return super().end(tag)


def _xml_node(element: ElementTree.Element) -> Any:
    """Return words for an element without children, a list for children ``_``, else a mapping."""
    children = list(element)
    if not children:
        return (element.text or "").split()
    if all(child.tag == "_" for child in children):
        return [_xml_node(child) for child in children]
    return {child.tag: _xml_node(child) for child in children}


def _numbers(key: str, node: Any) -> FloatArray:
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
