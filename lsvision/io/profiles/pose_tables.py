"""Tables and arrays that hold the poses of a robot instead of the points of a profile."""

import re
from collections.abc import Sequence

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.io.profiles.number_table import NumberTable
from lsvision.io.robot_conventions import CONVENTIONS, MAX_ORTHONORMALITY_ERROR

_ROTATION_NAMES = frozenset(
    frozenset(convention.fields[3:])
    for convention in CONVENTIONS.values()
    if convention.rotation != "matrix"
) | {frozenset(("roll", "pitch", "yaw"))}
"""Names of the columns that describe a rotation, in lower case."""
# Names such as tx, position.x or pose.position.x, and qw, rot_z or pose.orientation.w.
_POSITION_NAME = re.compile(r"(?:(?:.*[._/ ])?(?:position|translation|trans|pos)[._/ -]?|t)([xyz])")
_ROTATION_NAME = re.compile(
    r"(?:(?:.*[._/ ])?(?:orientation|rotation|quaternion|quat|rot)[._/ -]?|[qr])([wxyz])"
)
_JOINT_NAME = re.compile(r"(?:.*[._/ ])?(?:j|a|q|joint|axis|theta)[._ -]?([1-7])")
"""Name of the angle of a joint."""
_MAX_STRAIGHTNESS = 1e-3
"""Largest deviation of the points of a straight path from its line, in lengths of the path."""
_MAX_SAME_ROTATION = 1e-6
"""Largest difference of numbers of a rotation that does not vary."""
POSES_REMEDY = (
    "give files of profiles here, and the poses of their flange as --poses FILE --convention NAME"
)
"""Remedy for a file of poses where one of profiles is expected."""
_REMEDY = f"{POSES_REMEDY}; if it is a profile, name the columns of x and height with --columns"
"""Remedy for a table that may also be a profile."""


def reject_pose_names(
    table: NumberTable, sections: Sequence[FloatArray], rows: Sequence[IntArray]
) -> None:
    """Raise UnreadableFile if the columns are named as a position and a rotation, of a robot.

    Not if the rotation is the attitude of the sensor: constant in each profile, of which one at
    least is no straight line. `sections` are the points of the profiles, `rows` those in the table.
    """
    rotation = _find_rotation_columns(table.names)
    if rotation is None:
        return
    parts = [table.values[profile][:, rotation] for profile in rows]
    with np.errstate(over="ignore"):
        is_attitude = all(np.ptp(part, axis=0).max() < _MAX_SAME_ROTATION for part in parts)
    if parts and is_attitude and not all(map(_is_straight, sections)):
        return
    rest = ", ".join(name for name in table.names if name)
    raise UnreadableFile(f"its columns {rest} are those of robot poses: {_REMEDY}")


def _find_rotation_columns(names: Sequence[str]) -> list[int] | None:
    """Return the columns of a rotation beside those of a position, or six of joint angles."""
    joints = [c for c, name in enumerate(names) if _JOINT_NAME.fullmatch(name)]
    if len(joints) >= 6:
        return joints
    given = set(names)
    if {"x", "y", "z"} <= given:
        for rotation in _ROTATION_NAMES:
            if rotation <= given:
                return [names.index(name) for name in rotation]
    columns = [c for c, name in enumerate(names) if _ROTATION_NAME.fullmatch(name)]
    positions = {match[1] for name in names if (match := _POSITION_NAME.fullmatch(name))}
    return columns if len(columns) >= 3 and len(positions) == 3 else None


def _is_straight(section: FloatArray) -> bool:
    """Return whether the points, (n, 2) or (n, 3), lie on a straight line."""
    points = section[np.isfinite(section).all(axis=1)]
    if len(points) < 3:
        return True
    with np.errstate(over="ignore", invalid="ignore"):
        centred = points - points.mean(axis=0)
        if not np.isfinite(centred).all():
            return False
        long, short, *_ = np.linalg.svd(centred, compute_uv=False)
    return bool(short <= _MAX_STRAIGHTNESS * long)


def reject_poses(table: NumberTable, columns: list[int]) -> None:
    """Raise UnreadableFile if the columns of numbers, without names, may be robot poses.

    They are 4x4 matrices in one row or in four each, 3x4 matrices, a position and a unit
    quaternion, or six numbers that are no point with a direction or a colour and no pairs; a number
    of the pose or a time may come before.
    """
    values = table.values[:, columns]
    values = values[np.isfinite(values).all(axis=1)]
    if table.names or not len(values):
        return
    found = _find_poses(values)
    if not found and _numbers_rows(values):
        found = _find_poses(values[:, 1:])
    if found:
        count = values.shape[1]
        raise UnreadableFile(f"its rows of {count} look like robot poses ({found}): {_REMEDY}")


def _numbers_rows(values: FloatArray) -> bool:
    """Return whether the first of 7 columns numbers the rows, or that of 8 is a time."""
    with np.errstate(over="ignore"):
        steps = np.diff(values[:, 0])
    return bool(values.shape[1] == 8 and (steps > 0).all()) or bool(
        values.shape[1] == 7 and values[0, 0] in (0, 1) and (steps == 1).all()
    )


def _find_poses(values: FloatArray) -> str:
    """Return what the rows of numbers are if they may be poses, else an empty text."""
    count, rotation = values.shape[1], values[:, 3:]
    if count == 4 and len(values) % 4 == 0 and are_pose_matrices(values.reshape(-1, 4, 4)):
        return "4x4 matrices"
    if count == 16 and are_pose_matrices(values.reshape(-1, 4, 4)):
        return "4x4 matrices"
    if count == 12 and are_pose_matrices(values.reshape(-1, 3, 4)):
        return "3x4 matrices"
    if count == 7 and _is_direction(rotation).all():
        return "position and quaternion"
    if count == 6 and not _are_extras(values):
        return "position and three angles"
    return ""


def _are_extras(values: FloatArray) -> bool:
    """Return whether the last three of six numbers may be a direction, a colour, or more pairs.

    A colour is beside a point of a surface, and not on a straight path.
    """
    others = values[:, 3:]
    if np.array_equal(values[:, 0], values[:, 2]) or _is_direction(others).all():
        return True
    return _is_whole(others) and others.min() >= 0 and not _is_straight(values[:, :3])


def are_pose_matrices(matrices: FloatArray) -> bool:
    """Return whether all matrices, at least one, (n, 4, 4) or (n, 3, 4), are those of poses."""
    if matrices.ndim != 3 or matrices.shape[1:] not in ((4, 4), (3, 4)) or not len(matrices):
        return False
    rotations = matrices[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        errors = np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3))
    last_rows = np.abs(matrices[:, 3:] - [0.0, 0.0, 0.0, 1.0])
    return bool(max(errors.max(), last_rows.max(initial=0)) < MAX_ORTHONORMALITY_ERROR)


def _is_direction(vectors: FloatArray) -> BoolArray:
    """Return whether each vector has the length 1 (n,)."""
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(vectors, axis=1)
    unit: BoolArray = np.abs(lengths - 1) < MAX_ORTHONORMALITY_ERROR
    return unit


def _is_whole(values: FloatArray) -> bool:
    """Return whether all numbers are whole, as colours and counts are."""
    return bool((values == np.round(values)).all())
