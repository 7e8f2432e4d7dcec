"""Profiles in OpenCV's FileStorage: YAML, XML or JSON written by `cv2.FileStorage`."""

import re
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.column_roles import is_known_role
from lsvision.io.profiles.columns import profiles_from_table
from lsvision.io.profiles.json_points import flat_width
from lsvision.io.profiles.named_columns import profiles_from_named
from lsvision.io.profiles.number_rows import numbers_from_cells
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.text_table import TextTable, decode_text
from lsvision.io.profiles.unit_statements import lost_statements, unit_statements

_TRIPLES = "scan_line"
_KEYS = (_TRIPLES, "profile", "points", "line")
_FEWEST_NUMBERS = 30  # a list under another name as short as a pose or a matrix is no profile
_KEY_WORD = re.compile(r"^[A-Za-z_]\w*:\s*[^\[\s!]")
_FLAT_LIST = re.compile(r"^[\s{]*\"?([A-Za-z_]\w*)\"?\s*:\s*\[([^\[\]]*)\]", re.MULTILINE)


def read_opencv_storage(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Profile under the key ``scan_line`` (x, y, z after one another), or the first list there.

    Heights are taken to grow towards the sensor.

    Raises
    ------
    UnreadableFile
        If OpenCV cannot parse the file or there is no list of points in it.
    """
    text = decode_text(content)
    columns = {
        key: numbers_from_cells(body.split(","))
        for key, body in _FLAT_LIST.findall(text)
        if is_known_role(key.lower())
    }
    if len(columns) > 1:
        return profiles_from_named(columns, settings, unit_statements(_lines_of_words(text)))
    # FileNode.at walks from the start each time, so long lists are parsed here, not by OpenCV
    lists = {key: body.split(",") for key, body in _FLAT_LIST.findall(text) if key != "data"}
    key = min(lists, key=_rank, default=None)
    if key is not None and (key in _KEYS or len(lists[key]) >= _FEWEST_NUMBERS):
        values = numbers_from_cells(lists[key])
        if key not in _KEYS and flat_width(key, values) is None:
            raise UnreadableFile(
                f"{len(values)} numbers under {key!r} are no points with rising x: want scan_line: "
                "[x, y, z, ...] or lists x and z"
            )
    else:
        key, values = _first_node(text)
    table = _as_table(key, np.squeeze(values))
    lines = _lines_of_words(text)
    stated = replace(table, statements=unit_statements(lines), lost=lost_statements(lines))
    return profiles_from_table(stated, settings)


def _lines_of_words(text: str) -> list[str]:
    """Lines as ``unit: um``, without lists and what is nested."""
    return [line for line in text.splitlines() if _KEY_WORD.match(line)]


def _rank(key: str) -> int:
    return _KEYS.index(key) if key in _KEYS else len(_KEYS)


def _first_node(text: str) -> tuple[str, FloatArray]:
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        keys = list(root.keys()) if root.isMap() else []
        for key in sorted(keys, key=_rank):
            values = _numbers(root.getNode(key))
            pairs = values.ndim == 2 and values.shape[1] == 2
            if values.size and (key in _KEYS or pairs or values.size >= _FEWEST_NUMBERS):
                return key, values
    except (cv2.error, SystemError, ValueError, UnicodeError):
        raise UnreadableFile("OpenCV cannot parse it: write it anew with cv2.FileStorage") from None
    raise UnreadableFile(
        f"no list of points among its keys ({', '.join(keys) or 'none'}): "
        "want scan_line: [x, y, z, ...]"
    )


def _numbers(node: Any) -> FloatArray:
    if node.isMap():
        matrix = node.mat() if {"rows", "sizes"} & set(node.keys()) else None
        return np.empty(0) if matrix is None else np.asarray(matrix, dtype=np.float64)
    items = [node.at(index) for index in range(node.size())] if node.isSeq() else []
    if items and all(item.isSeq() for item in items):
        rows = [[item.at(k).real() for k in range(item.size())] for item in items]
        return np.array(rows) if len({len(row) for row in rows}) == 1 else np.empty(0)
    known = all(item.isReal() or item.isInt() for item in items)
    return np.array([item.real() for item in items]) if known else np.empty(0)


def _as_table(key: str, values: FloatArray) -> TextTable:
    if values.ndim == 2:
        rows = values if values.shape[1] <= values.shape[0] else values.T
    elif values.size % 3 == 0 and (key == _TRIPLES or values.size % 2 or _is_one(values[1::3])):
        rows = values.reshape(-1, 3)
    elif values.size % 2 == 0:
        rows = values.reshape(-1, 2)
    else:
        raise UnreadableFile(
            f"{values.size} numbers in it are neither pairs nor triples: want [x, y, z, x, ...]"
        )
    names = {2: ("x", "z"), 3: ("x", "y", "z")}.get(rows.shape[1], ())
    return TextTable(rows, names, (None,) * rows.shape[1])


def _is_one(values: FloatArray) -> bool:
    return len(np.unique(values[np.isfinite(values)])) <= 1
