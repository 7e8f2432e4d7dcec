"""Pose matrices as programs print them: four rows of four numbers, with or without brackets."""

import re
from itertools import chain

from lsvision.io.robot_conventions import MAX_ORTHONORMALITY_ERROR

_ROW_IN_BRACKETS = re.compile(r"\[([^\[\]]*)\]")
"""Innermost brackets; a long row in them is on several lines."""
_SEPARATORS = re.compile(r"[,;\s]+")
_LAST_ROW = (0.0, 0.0, 0.0, 1.0)


def find_printed_matrices(text: str) -> list[list[float]] | None:
    r"""Return the 16 numbers of each 4x4 matrix of a pose that a text holds; None if it has others.

    The lines, or the innermost brackets as in the output of ``print``, ``repr`` and MATLAB, have
    one row each, or all numbers of one or several matrices; comments, and words beside the
    brackets, are left out. Each last row is 0 0 0 1. Numbers have decimal points.

    Examples
    --------
    >>> text = "pose 1:\n[[1. 0. 0. 5.]\n [0. 1. 0. 6.]\n [0. 0. 1. 7.]\n [0. 0. 0. 1.]]"
    >>> find_printed_matrices(text)
    [[1.0, 0.0, 0.0, 5.0, 0.0, 1.0, 0.0, 6.0, 0.0, 0.0, 1.0, 7.0, 0.0, 0.0, 0.0, 1.0]]
    """
    bare = "\n".join(line.partition("#")[0] for line in text.splitlines())
    rows = _ROW_IN_BRACKETS.findall(bare) if "[" in bare else bare.splitlines()
    try:
        parsed = [[float(cell) for cell in _SEPARATORS.split(row) if cell] for row in rows]
    except ValueError:
        return None
    if any(len(row) != 4 and len(row) % 16 for row in parsed):
        return None
    numbers = list(chain.from_iterable(parsed))
    matrices = [numbers[start : start + 16] for start in range(0, len(numbers), 16)]
    return matrices if matrices and all(map(_has_last_row, matrices)) else None


def _has_last_row(matrix: list[float]) -> bool:
    """Return whether a list has 16 numbers, the last of which are 0 0 0 1."""
    pairs = zip(matrix[12:], _LAST_ROW, strict=False)
    return len(matrix) == 16 and all(abs(a - b) < MAX_ORTHONORMALITY_ERROR for a, b in pairs)
