"""Tables that hold the poses of a robot instead of the points of a profile."""

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import BoolArray, FloatArray
from lsvision.io.profiles.number_table import NumberTable
from lsvision.io.robot_conventions import CONVENTIONS, MAX_ORTHONORMALITY_ERROR

_ROTATION_NAMES = frozenset(
    frozenset(convention.fields[3:])
    for convention in CONVENTIONS.values()
    if convention.rotation != "matrix"
) | {frozenset(("roll", "pitch", "yaw"))}
"""Names of the columns that describe a rotation, in lower case."""
_REMEDY = (
    "give files of profiles here, and the poses of their flange as --poses FILE --convention NAME; "
    "if it is a profile, name the columns of x and height with --columns"
)


def refuse_matrices(table: NumberTable) -> None:
    """Raise UnreadableFile if each row holds the 16 numbers of a 4x4 matrix of a pose."""
    if _are_matrices(table.values):
        raise UnreadableFile(f"each row is a 4x4 matrix, as of robot poses: {_REMEDY}")


def refuse_likely_poses(table: NumberTable, columns: list[int]) -> None:
    """Raise UnreadableFile if the columns of numbers may be a position and a rotation.

    They are if they are named so. Without names these are six numbers that are no point with a
    direction or a colour, or seven of which the last four are a unit quaternion.
    """
    names = set(table.names)
    if {"x", "y", "z"} <= names and any(rotation <= names for rotation in _ROTATION_NAMES):
        rest = ", ".join(name for name in table.names if name)
        raise UnreadableFile(f"its columns {rest} are those of robot poses: {_REMEDY}")
    values = table.values[:, columns]
    values = values[np.isfinite(values).all(axis=1)]
    if table.names or not len(values):
        return
    rotation = values[:, 3:]
    if len(columns) == 6 and not _is_direction(rotation).all() and not _is_whole(rotation):
        found = "position and three angles"
    elif len(columns) == 7 and _is_direction(rotation).all():
        found = "position and quaternion"
    else:
        return
    raise UnreadableFile(f"its rows of {len(columns)} look like robot poses ({found}): {_REMEDY}")


def _are_matrices(values: FloatArray) -> bool:
    """Return whether each row holds the 16 numbers of a 4x4 matrix of a pose."""
    if values.shape[1] != 16 or not len(values) or not np.isfinite(values).all():
        return False
    matrices = values.reshape(-1, 4, 4)
    rotations = matrices[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        errors = rotations.transpose(0, 2, 1) @ rotations - np.eye(3)
    last_rows = matrices[:, 3] - [0.0, 0.0, 0.0, 1.0]
    return bool(max(np.abs(errors).max(), np.abs(last_rows).max()) < MAX_ORTHONORMALITY_ERROR)


def _is_direction(vectors: FloatArray) -> BoolArray:
    """Return whether each vector has the length 1 (n,)."""
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(vectors, axis=1)
    unit: BoolArray = np.abs(lengths - 1) < MAX_ORTHONORMALITY_ERROR
    return unit


def _is_whole(values: FloatArray) -> bool:
    """Return whether all numbers are whole, as colours and counts are."""
    return bool((values == np.round(values)).all())
