"""Header of a table of poses: order of the columns, units of lengths and angles."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from lsvision.io.profiles.units import MM_PER_UNIT, split_label
from lsvision.io.robot_conventions import CONVENTIONS, AngleUnit, LengthUnit, PoseConvention

_FIELDS = {field for pose_convention in CONVENTIONS.values() for field in pose_convention.fields}
"""Names of fields in all conventions."""
_ALIASES = {
    **{prefix + axis: axis for prefix in ("p", "t", "pos", "tcp", "trans") for axis in "xyz"},
    **{axis + "pos": axis for axis in "xyz"},
    **{f"rot{axis}": f"r{axis}" for axis in "xyz"},
}
"""Other spellings of fields."""
_ABB_QUATERNION = {"qw": "q1", "qx": "q2", "qy": "q3", "qz": "q4"}
"""ABB's names of the components of a quaternion."""
ANGLE_UNITS: dict[str, AngleUnit] = {
    **dict.fromkeys(["deg", "degree", "degrees", "°"], "deg"),
    "grad": "deg",  # German for degree
    **dict.fromkeys(["rad", "radian", "radians"], "rad"),
}
"""Spellings of the units of angles."""


@dataclass(frozen=True)
class PoseHeader:
    """Columns of the fields of a convention in a table, and the units that its header states.

    Columns are empty if the header does not name all fields: numbers are then in the order of the
    convention. A unit that the header does not state is None.
    """

    columns: tuple[int, ...] = ()
    length_unit: LengthUnit | None = None
    angle_unit: AngleUnit | None = None


def read_pose_header(
    cells: Sequence[str], pose_convention: PoseConvention, skip: int
) -> PoseHeader:
    """Return the columns and units that a header names.

    `skip` is the number of columns before the pose, where a header that names only some fields must
    have them in the order of the convention.

    Raises
    ------
    ValueError
        If it names fields of another convention or at another position, a field twice, or an
        unknown unit.

    Examples
    --------
    >>> read_pose_header(["Z", "Y", "X", "C", "B", "A"], CONVENTIONS["kuka"], 0).columns
    (2, 1, 0, 5, 4, 3)
    """
    labels = [split_label(cell) for cell in cells]
    names = [find_field_name(name, pose_convention) for name, _ in labels]
    missing = [field for field in pose_convention.fields if field not in names]
    repeated = [field for field in pose_convention.fields if names.count(field) > 1]
    if repeated:
        raise ValueError(
            f"the header names {repeated[0]} {names.count(repeated[0])} times: rename one"
        )
    if missing:
        named = {column: name for column, name in enumerate(names) if name in _FIELDS}
        in_order = dict(enumerate(pose_convention.fields, start=skip))
        if not named.items() <= in_order.items():
            raise ValueError(
                f"the header names {' '.join(named.values())} and not {' '.join(missing)} of "
                f"convention {pose_convention.name!r}: check the convention"
            )
        labels = labels[skip : skip + len(pose_convention.fields)]
    columns = tuple(names.index(field) for field in pose_convention.fields if not missing)
    labels = [labels[column] for column in columns] or labels
    by_field = ["" if s is None else s.unit or s.text.lower() for _, s in labels]
    lengths, angles = by_field[:3], by_field[3:]
    if pose_convention.rotation == "matrix":
        lengths, angles = by_field[3:12:4], []  # the last column of the first three rows
    if missing:  # what follows an unknown name may be no unit
        lengths = [unit if unit in MM_PER_UNIT else "" for unit in lengths]
        angles = [unit if unit in ANGLE_UNITS else "" for unit in angles]
    return PoseHeader(
        columns,
        find_common_length_unit(set(lengths) - {""}),
        find_common_angle_unit(set(angles) - {"", "-", "1"}),
    )


def find_field_name(name: str, pose_convention: PoseConvention) -> str:
    """Return the convention's field for a name in a header; the letters of any other name."""
    letters = re.sub(r"[\W_]", "", name)
    letters = _ALIASES.get(letters, letters)
    return _ABB_QUATERNION.get(letters, letters) if pose_convention.name == "abb" else letters


def find_common_length_unit(units: set[str]) -> LengthUnit | None:
    """Return the unit of all lengths of a file from those stated; None if none is stated.

    Raises
    ------
    ValueError
        If they are neither all mm nor all m.
    """
    if not units:
        return None
    if units == {"mm"}:
        return "mm"
    if units == {"m"}:
        return "m"
    raise ValueError(f"lengths in {', '.join(sorted(units))}: expected all in mm, or all in m")


def find_common_angle_unit(units: set[str]) -> AngleUnit | None:
    """Return the unit of all angles of a file from those stated; None if none is stated."""
    if not units:
        return None
    known = {ANGLE_UNITS.get(unit) for unit in units}
    if known == {"deg"}:
        return "deg"
    if known == {"rad"}:
        return "rad"
    raise ValueError(f"angles in {', '.join(sorted(units))}: expected all in deg, or all in rad")
