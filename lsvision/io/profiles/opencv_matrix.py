"""JSON and matrices of OpenCV's FileStorage; the matrices of its YAML and XML, too."""

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.files.json_text import parse_json
from lsvision.geometry import FloatArray
from lsvision.io.profiles.number_cells import numbers_from_cells
from lsvision.io.profiles.number_table import NumberTable

TRIPLES = "scan_line"
"""Name of a list that holds x, y, z after one another."""
_MATRIX_TYPE = re.compile(r"(\d{1,3})?[ucwsifdh]")
"""Entry ``dt`` of a matrix: the number of channels, if not 1, and the type of a number."""
_OPENCV_NUMBER = re.compile(
    r"(?<![\w.\"])([-+]?)\.(nan|inf)\b|(?<=[0-9])\.(?=[\s,\]}e])", re.IGNORECASE
)
"""Numbers of OpenCV's JSON that JSON does not have: .Nan, -.Inf and 1."""
_MAX_DIMENSIONS = 32  # of numpy's and OpenCV's arrays


def parse_opencv_json(text: str) -> Any:
    """Return the value of a JSON text, which may contain the numbers .Nan, -.Inf and 1. of OpenCV.

    Raises
    ------
    ValueError
        As `parse_json`.
    """
    return parse_json(_OPENCV_NUMBER.sub(_plain_number, text), allow_nan=True)


def _plain_number(match: re.Match[str]) -> str:
    """Return a number of OpenCV's JSON as JSON has it."""
    if match[2] is None:
        return ".0"
    return "NaN" if match[2].lower() == "nan" else f"{match[1].replace('+', '')}Infinity"


def matrix_from_node(key: str, node: Mapping[str, Any]) -> FloatArray:
    """Return the array of an ``opencv-matrix`` or ``opencv-nd-matrix``, its size checked.

    Parameters
    ----------
    key : str
        Name in messages; may be empty.
    node : mapping
        Entries of the matrix's node.

    Returns
    -------
    (rows, columns, channels) ndarray
        With all sizes before the channels if there are more than two.

    Raises
    ------
    UnreadableFile
        If an entry is missing or not understood, or the sizes do not match the number of its data.
    """
    try:
        sizes = (
            node["sizes"]
            if "sizes" in node
            else [_scalar_text(node["rows"]), _scalar_text(node["cols"])]
        )
        match = _MATRIX_TYPE.fullmatch(_scalar_text(node["dt"]).strip("\"'"))
        if match is None:
            raise ValueError(f"dt {_scalar_text(node['dt'])!r}")
        shape = [int(size) for size in sizes] + [int(match[1] or 1)]
        data = node["data"]
        if not isinstance(data, list):
            raise TypeError("data, which is no list")
        if min(shape) < 0 or len(shape) > _MAX_DIMENSIONS:
            raise ValueError(f"sizes {shape}")
    except (KeyError, ValueError, TypeError) as error:
        raise UnreadableFile(
            f"{_prefix(key)}a matrix with a bad or missing {error}: write it again with "
            "cv2.FileStorage"
        ) from None
    if math.prod(shape) != len(data):
        raise UnreadableFile(
            f"{_prefix(key)}a matrix of {' x '.join(map(str, shape))} numbers, got {len(data)}: "
            "write it again with cv2.FileStorage"
        )
    return numbers_from_cells([str(item) for item in data]).reshape(shape)


def _scalar_text(value: Any) -> str:
    """Return the text of a scalar; XML gives it as a list of one word."""
    if isinstance(value, list) and len(value) == 1:
        value = value[0]
    if isinstance(value, str | int | float):
        return str(value)
    raise ValueError(f"{value!r:.40}")


def table_from_points(key: str, values: FloatArray) -> NumberTable:
    """Return the table of a list or an array of points, under their usual names.

    Parameters
    ----------
    key : str
        Key of the matrix; ``scan_line`` holds triples if its length is a multiple of 3.
    values : (n,) or (n, k) ndarray
        Numbers in turn, or rows of points; (k, n) if n is larger.

    Raises
    ------
    UnreadableFile
        If a list is neither one of pairs nor one of triples, or an array has more dimensions.
    """
    if values.ndim == 2:
        rows = values if values.shape[1] <= values.shape[0] else values.T
    elif values.ndim > 2:
        raise UnreadableFile(
            f"{_prefix(key)}expected points of n x 2 or n x 3 numbers, got "
            f"{' x '.join(map(str, values.shape))}"
        )
    elif values.size % 3 == 0 and (key == TRIPLES or values.size % 2 or is_constant(values[1::3])):
        rows = values.reshape(-1, 3)
    elif values.size % 2 == 0:
        rows = values.reshape(-1, 2)
    else:
        raise UnreadableFile(
            f"expected pairs or triples, as [x, y, z, x, ...], got {values.size} numbers"
        )
    return NumberTable.of_points(rows)


def is_constant(values: FloatArray) -> bool:
    """Return whether all numbers that are not lost are the same."""
    return len(np.unique(values[np.isfinite(values)])) <= 1


def _prefix(key: str) -> str:
    return f"{key}: " if key else ""
