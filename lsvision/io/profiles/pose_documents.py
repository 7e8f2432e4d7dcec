"""Texts, documents and arrays of a robot's poses where profiles are expected.

They are searched only after no profile was found: the message then names them and their option.
"""

import re
from collections.abc import Iterable, Mapping
from itertools import islice
from typing import Any

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.io.pose_programs import NUMBER, find_maker
from lsvision.io.profiles.json_values import is_scalar
from lsvision.io.profiles.pose_tables import POSES_REMEDY, are_pose_matrices

_MAX_DEPTH, _MAX_ITEMS = 5, 8  # levels of a document, and items of each, that are searched
_ROW_LENGTHS = (6, 7, 12, 16)
"""Numbers of a pose in a list: position and rotation, or a matrix."""
_PAIRS = (
    {"position", "orientation"},
    {"translation", "rotation"},
    {"translation", "orientation"},
    {"position", "rotation"},
    {"position", "quaternion"},
    {"t", "q"},
    {"t", "rotation"},
)
"""Keys of the two parts of a pose."""
_POSE_KEYS = [
    {"x", "y", "z", *rotation}
    for rotation in (
        *(("rx", "ry", "rz"), ("qx", "qy", "qz", "qw"), ("a", "b", "c"), ("w", "p", "r")),
        ("roll", "pitch", "yaw"),
    )
]
"""Keys of the numbers of a pose."""
_POSE_KEY = re.compile(
    r"^[ \t]*(?:-[ \t])?[\"']?(?:poses?|position|orientation|translation|rotation|quaternion"
    r"|transform\w*|\w+_from_\w+|\w+2\w+)[\"']?[ \t]*:[ \t]*(?:$|\[|!!)",
    re.MULTILINE | re.IGNORECASE,
)
"""Key of poses in YAML, without a value on its line or with a list."""
_BRACKETED_ROW = re.compile(
    rf"[\[({{]\s*{NUMBER}(?:\s*,\s*{NUMBER}){{5,7}}\s*[\])}}]", re.IGNORECASE
)
"""Six to eight numbers in brackets."""
_NESTED_POSE = re.compile(
    rf"[\[(]\s*[\[(]\s*{NUMBER}(?:\s*,\s*{NUMBER}){{2}}\s*[\])]\s*,"
    rf"\s*[\[(]\s*{NUMBER}(?:\s*,\s*{NUMBER}){{2,3}}\s*[\])]"
)
"""Position and rotation in brackets of their own, as Python prints them."""
_MAX_LENGTH = 200_000  # of a text that is searched
_MIN_BRACKETED_ROWS = 3
"""Smallest number of rows of six to eight numbers in brackets that are poses."""


def reject_pose_text(text: str) -> None:
    """Raise UnreadableFile if a text is a robot program, or a list of poses in brackets or YAML."""
    text = text[:_MAX_LENGTH]
    maker = find_maker(text)
    if maker:
        remedy = POSES_REMEDY.replace("NAME", maker)
        raise UnreadableFile(f"a robot program ({maker}) with poses, no profile: {remedy}")
    rows = list(islice(_BRACKETED_ROW.finditer(text), _MIN_BRACKETED_ROWS))
    has_rows = len(rows) == _MIN_BRACKETED_ROWS
    if has_rows or _POSE_KEY.search(text) or _NESTED_POSE.search(text):
        _reject()


def reject_pose_document(document: Any) -> None:
    """Raise UnreadableFile if a document of JSON or YAML holds poses."""
    if _holds_poses(document, 0):
        _reject()


def reject_pose_arrays(arrays: Mapping[str, Any]) -> None:
    """Raise UnreadableFile if arrays are matrices of poses, or positions and rotations by name."""
    names = {name.lower() for name in arrays}
    shapes = [np.shape(array) for array in arrays.values()]
    has_rotations = any(len(shape) == 3 and shape[1:] == (3, 3) for shape in shapes)
    if any(pair <= names for pair in _PAIRS) or any(map(_is_matrix, arrays.values())):
        _reject()
    if has_rotations and len({shape[0] for shape in shapes}) == 1:
        _reject()


def _reject() -> None:
    """Raise UnreadableFile for a file of robot poses."""
    raise UnreadableFile(f"it holds robot poses and no profile: {POSES_REMEDY}")


def _holds_poses(document: Any, depth: int) -> bool:
    """Return whether an object or list, at a depth, is a pose, a list of poses, or holds some."""
    if depth > _MAX_DEPTH:
        return False
    if isinstance(document, Mapping):
        keys = {str(key).lower() for key in document}
        if any(pose <= keys for pose in (*_PAIRS, *_POSE_KEYS)):
            return True
        return _contains_poses(document.values(), depth)
    if not isinstance(document, list) or not document:
        return False
    if _are_rows(document) or _is_matrix(document) or _is_position_and_rotation(document):
        return True
    return _contains_poses(document, depth)


def _are_rows(items: list[Any]) -> bool:
    """Return whether a list holds rows of numbers, of the same length, which is that of a pose."""
    lengths = {len(item) if isinstance(item, list) else 0 for item in items}
    return (
        len(items) > 1
        and len(lengths) == 1
        and lengths <= set(_ROW_LENGTHS)
        and all(is_scalar(number) for item in items for number in item)
    )


def _contains_poses(values: Iterable[Any], depth: int) -> bool:
    return any(_holds_poses(value, depth + 1) for value in islice(values, _MAX_ITEMS))


def _is_matrix(value: Any) -> bool:
    """Return whether a value is a 4x4 or 3x4 matrix of a pose, or several of them."""
    try:
        array = np.array(value, dtype=np.float64)
    except (ValueError, TypeError, OverflowError):
        return False
    return are_pose_matrices(array[np.newaxis] if array.ndim == 2 else array)


def _is_position_and_rotation(value: list[Any]) -> bool:
    """Return whether a value is a list of three numbers and one of three or four."""
    return (
        len(value) == 2
        and all(isinstance(part, list) and all(map(is_scalar, part)) for part in value)
        and (len(value[0]), len(value[1])) in ((3, 3), (3, 4))
    )
