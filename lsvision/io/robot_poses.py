"""Robot poses from files, in a convention the caller states, and poses of an encoder axis."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from lsvision.errors import UnreadableFile
from lsvision.geometry import Pose
from lsvision.io.file_names import find_files
from lsvision.io.pose_rows import PoseRows, read_pose_rows
from lsvision.io.robot_conventions import (
    CONVENTIONS,
    AngleUnit,
    LengthUnit,
    PoseConvention,
    check_units,
    find_convention,
    pose_from_numbers,
)

_Unit = TypeVar("_Unit", LengthUnit, AngleUnit)

MAX_REACH_MM = 20_000.0
"""Largest distance of a flange from its base; above it, mm were probably read as m. Units: mm."""
MAX_SPREAD_MM = 5_000.0
"""Largest extent of the flange positions in a calibration or scan. Units: mm."""
MIN_POSITION_MM = 5.0
"""Smallest distance of the farthest flange from the origin of its base; below it, m were probably
read as mm. Units: mm."""
SAME_POSE_MM, SAME_POSE_RAD = 0.01, 1e-5
"""Extent of the positions (mm), and difference of the entries of the rotation matrices (rad), below
which all poses are the same."""
MAX_ANGLE_RAD = 2 * np.pi * 1.001
"""Largest angle or length of a rotation vector in rad, one revolution with room for rounding; a
larger number is in deg."""
MIN_ANGLE_RAD = np.radians(1)
"""Angles that are all below it, as numbers, are nearly 0 both in rad and in deg."""


def read_robot_poses(
    path: str | Path,
    convention: str,
    *,
    length_unit: LengthUnit | None = None,
    angle_unit: AngleUnit | None = None,
    skip_columns: int = 0,
) -> list[Pose]:
    """Read poses of a robot's flange from a CSV, text, JSON or YAML file.

    One pose per row. In JSON and YAML: a list of rows, or one list of rows under one key; a row
    is a list (nested as in ``[[x, y, z], [qx, qy, qz, qw]]`` or a 4x4), a mapping with the
    convention's field names, or a ROS message. In text: separated by commas, blanks, tabs or
    semicolons (then with a decimal comma if the file has one), brackets ignored, ``#`` begins a
    comment, one header line, and a row of units below it, allowed; with a header that names all
    fields, columns are taken by name and units as stated, also in comments (``# angles in rad``).
    Positions of KUKA (``E6POS``, ``FRAME``), FANUC (``.ls``), ABB (``robtarget``), Mitsubishi,
    Yaskawa (``.jbi`` with ``RECTAN``) and UR (``movel(p[...])``) programs are read from their text.
    A folder or a pattern denotes files of one pose each.

    Parameters
    ----------
    path : path
        ``.json``, ``.rob`` (JSON), ``.yaml``, ``.yml``; anything else is text.
    convention : str
        Convention of the file, see `pose_from_numbers`; never guessed.
    length_unit, angle_unit : str, optional
        Units of the file, if not the maker's. An explicit unit is accepted unless the motion is
        impossible.
    skip_columns : int
        Columns before the pose in a text file without named columns (a number, a time stamp).

    Returns
    -------
    list of Pose
        ``base_from_flange``, in the order of the file. Units: mm.

    Raises
    ------
    ValueError
        If the convention or a unit is unknown.
    UnreadableFile
        If the file is missing or cannot be parsed, a count of numbers is wrong, a rotation is
        invalid, units are implausible, or the robot did not move.

    Examples
    --------
    >>> poses = read_robot_poses("calibration/example/pipe_poses.csv", "kuka")
    >>> len(poses), poses[0].translation.shape
    (6, (3,))
    """
    pose_convention = find_convention(convention)
    check_units(length_unit, angle_unit)
    table = _read_files(path, pose_convention, skip_columns)
    length_unit = length_unit or table.length_unit
    angle_unit = angle_unit or table.angle_unit
    poses = []
    for number, row in enumerate(table.rows, start=1):
        try:
            pose = pose_from_numbers(
                row, convention, length_unit=length_unit, angle_unit=angle_unit
            )
        except ValueError as error:
            raise UnreadableFile(f"{path}: pose {number}: {error}") from error
        poses.append(pose)
    in_file = "" if table.may_state_units else "write the poses as CSV and "
    for problem in (
        _find_angle_problem(np.array(table.rows), pose_convention, angle_unit, in_file),
        _find_motion_problem(poses, length_unit, in_file),
    ):
        if problem:
            raise UnreadableFile(f"{path}: {problem}")
    return poses


def find_pose_files(path: str | Path) -> list[Path]:
    """Return the files that a path, a folder or a pattern names, in natural order.

    Raises
    ------
    UnreadableFile
        If a folder or a pattern names none, or a folder cannot be listed.
    """
    files = find_files(str(path), frozenset())
    if not files:
        raise UnreadableFile(f"{path}: no file of poses there: check it with ls")
    return files


def _read_files(path: str | Path, pose_convention: PoseConvention, skip_columns: int) -> PoseRows:
    """Return the rows of all files that a path names, and the units that all of them state."""
    files = find_pose_files(path)
    tables = [read_pose_rows(file, pose_convention, skip_columns) for file in files]
    for file, table in zip(files, tables, strict=True):
        if len(files) > 1 and len(table.rows) != 1:
            raise UnreadableFile(
                f"{file}: expected one pose in each of {len(files)} files, got {len(table.rows)}: "
                "write one pose per file, or all in one file"
            )
    rows = [row for table in tables for row in table.rows]
    if not rows:
        raise UnreadableFile(
            f"{path}: expected one pose per row, got no row with numbers: check that it is a file "
            "of poses"
        )
    return PoseRows(
        rows,
        _find_common_unit(path, [table.length_unit for table in tables]),
        _find_common_unit(path, [table.angle_unit for table in tables]),
        all(table.may_state_units for table in tables),
    )


def _find_common_unit(path: str | Path, units: Sequence[_Unit | None]) -> _Unit | None:
    """Return the unit that all files state; None if none of them states one."""
    distinct = set(units)
    if len(distinct) > 1:
        raise UnreadableFile(f"{path}: its files state different units: expected the same in all")
    return units[0]


def build_encoder_poses(count: int, direction: npt.ArrayLike, step: float) -> list[Pose]:
    """Return the poses of a section moved along an encoder axis in equal steps.

    Parameters
    ----------
    count : int
        Number of profiles.
    direction : (3,) array_like
        Direction in which the *section* moves, in the frame of the first one; its length does not
        matter. If the part moves instead, give the opposite of the part's feed.
    step : float
        Feed from one profile to the next. Units: mm.

    Returns
    -------
    list of Pose
        ``base_from_section``, one per profile; the base frame is the first section's own.
        Units: mm.

    Raises
    ------
    ValueError
        If there is no profile, or the step or the direction is zero or not finite.

    Examples
    --------
    >>> build_encoder_poses(3, (0, 0, 1), step=0.5)[2].translation
    array([0., 0., 1.])
    """
    if count < 1:
        raise ValueError(f"expected at least one pose, got count {count}")
    if not (np.isfinite(step) and step != 0):
        raise ValueError(f"expected a step in mm other than 0, got {step}")
    return [Pose.along(direction, index * step) for index in range(count)]


def _find_angle_problem(
    rows: npt.NDArray[np.float64],
    pose_convention: PoseConvention,
    stated: AngleUnit | None,
    in_file: str,
) -> str | None:
    """Return why the unit of the angles is implausible; None if it is plausible or stated.

    `in_file` is what to do before a unit can be stated in the file.
    """
    if stated is not None or not (pose_convention.is_euler or pose_convention.rotation == "rotvec"):
        return None
    largest = float(np.abs(rows[:, 3:]).max())
    if pose_convention.rotation == "rotvec":
        angle = float(np.linalg.norm(rows[:, 3:], axis=1).max())
        if angle > MAX_ANGLE_RAD:
            others = [
                other.name
                for other in CONVENTIONS.values()
                if other.fields == pose_convention.fields and other.is_euler
            ]
            remedy = in_file + _suggest_angle_unit(pose_convention, "deg")
            return (
                f"rotation vector of length {angle:.4g} rad, more than a revolution: for angles of "
                f"another robot with the same columns use --convention {' or '.join(others)}, else "
                f"{remedy}"
            )
    elif MIN_ANGLE_RAD < largest <= MAX_ANGLE_RAD and len(rows) > 1:
        return (
            f"no angle above {largest:.4g}: these look like radians where {pose_convention.name} "
            f"has degrees: {in_file}{_suggest_angle_unit(pose_convention, 'rad')}, or deg if they "
            "are so small"
        )
    return None


def _suggest_angle_unit(pose_convention: PoseConvention, unit: AngleUnit) -> str:
    """Return the remedy that states the unit of the angles in a header."""
    header = ",".join(
        pose_convention.fields[:3]
        + tuple(f"{name} [{unit}]" for name in pose_convention.fields[3:])
    )
    return f"state the unit in a header, {header} (in Python angle_unit='{unit}')"


def _suggest_length_unit(unit: LengthUnit) -> str:
    """Return the remedy that states the unit of lengths in the first line."""
    return f"state the unit in a first line, # lengths in {unit} (in Python length_unit='{unit}')"


def _find_motion_problem(
    poses: Iterable[Pose], stated: LengthUnit | None, in_file: str
) -> str | None:
    """Return why the positions are implausible: their unit, or no motion; None if they are not.

    `in_file` is what to do before a unit can be stated in the file.
    """
    origins = np.array([pose.translation for pose in poses])
    rotations = np.array([pose.rotation for pose in poses])
    max_distance = float(np.linalg.norm(origins, axis=1).max())
    spread = float(np.linalg.norm(np.ptp(origins, axis=0)))
    if max_distance > MAX_REACH_MM or spread > MAX_SPREAD_MM:
        return (
            f"the poses reach {max_distance / 1000:.4g} m from the origin and spread over "
            f"{spread / 1000:.4g} m, probably millimetres read as metres: "
            f"{in_file}{_suggest_length_unit('mm')}"
        )
    if stated is None and max_distance < MIN_POSITION_MM:
        return (
            f"no pose is more than {max_distance:.4g} mm from the origin, probably metres read as "
            f"millimetres: {in_file}{_suggest_length_unit('m')}, or mm if that is correct"
        )
    rotation_change = float(np.abs(rotations - rotations[0]).max())
    if len(origins) > 1 and spread < SAME_POSE_MM and rotation_change < SAME_POSE_RAD:
        return f"all {len(origins)} poses are the same to {SAME_POSE_MM} mm: the robot did not move"
    return None
