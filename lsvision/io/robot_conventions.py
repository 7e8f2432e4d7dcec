"""Pose conventions of robot makers, as a table; a convention is never guessed.

KUKA, FANUC, Yaskawa and Mitsubishi write the *same* rotation with their letters in different
orders, so a KUKA file read as FANUC gives plausible but wrong poses. The caller therefore must
state the convention.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lsvision.geometry import FloatArray, Pose

LengthUnit = Literal["mm", "m"]
AngleUnit = Literal["deg", "rad"]

MM_PER_UNIT: dict[str, float] = {"mm": 1.0, "m": 1000.0}
RAD_PER_UNIT: dict[str, float] = {"deg": math.pi / 180, "rad": 1.0}
"""Length and angle of one unit. Units: mm, rad."""

MAX_QUATERNION_NORM_ERROR = 1e-3
"""Largest deviation of a quaternion's norm from 1: some files have only four digits."""

MAX_NUMBER = 1e9
"""Largest number of a pose, far above any position or angle; its square does not overflow."""

MAX_ORTHONORMALITY_ERROR = 1e-3
"""Largest entry of R'R - I of a matrix in a file, which is then made orthonormal; also the largest
deviation of its last row from 0 0 0 1."""


@dataclass(frozen=True, slots=True)
class PoseConvention:
    """Convention by which ``base_from_flange`` is written as numbers.

    Parameters
    ----------
    name : str
        Name of the convention.
    fields : tuple of str
        Names of the numbers in their order: position x, y, z, then the rotation; or the 16 of a 4x4
        matrix, row by row.
    rotation : str
        ``"rotvec"``, ``"quaternion wxyz"``, ``"quaternion xyzw"``, ``"matrix"``, or three Euler
        angles as scipy's sequence (upper case = moving axes, lower case = fixed axes), in the
        order of `fields`.
    length_unit, angle_unit : str
        Units of the maker's files.
    """

    name: str
    fields: tuple[str, ...]
    rotation: str
    length_unit: LengthUnit = "mm"
    angle_unit: AngleUnit = "deg"

    @property
    def is_euler(self) -> bool:
        """Whether the rotation is written as three Euler angles."""
        return len(self.rotation) == 3

    @property
    def is_quaternion(self) -> bool:
        """Whether the rotation is written as a quaternion."""
        return self.rotation.startswith("quaternion")


_XYZ = ("x", "y", "z")
"""Names of the position."""
_MATRIX_FIELDS = tuple(f"m{row}{column}" for row in range(4) for column in range(4))
"""Names of the numbers of a matrix, row by row."""

# R takes flange to base. Sources: the makers' manuals as collected in Roboception's
# "pose formats"; Staubli from its own VAL3 manual's wording only.
_TABLE = (
    PoseConvention("ur", (*_XYZ, "rx", "ry", "rz"), "rotvec", "m", "rad"),  # exp([r]x)
    PoseConvention("kuka", (*_XYZ, "a", "b", "c"), "ZYX"),  # Rz(A) Ry(B) Rx(C)
    PoseConvention("fanuc", (*_XYZ, "w", "p", "r"), "xyz"),  # Rz(R) Ry(P) Rx(W)
    PoseConvention("yaskawa", (*_XYZ, "rx", "ry", "rz"), "xyz"),  # Rz(Rz) Ry(Ry) Rx(Rx)
    PoseConvention("mitsubishi", (*_XYZ, "a", "b", "c"), "xyz"),  # Rz(C) Ry(B) Rx(A)
    PoseConvention("kawasaki", (*_XYZ, "o", "a", "t"), "ZYZ"),  # Rz(O) Ry(A) Rz(T)
    PoseConvention("staubli", (*_XYZ, "rx", "ry", "rz"), "XYZ"),  # Rx(Rx) Ry(Ry) Rz(Rz)
    PoseConvention("abb", (*_XYZ, "q1", "q2", "q3", "q4"), "quaternion wxyz"),
    PoseConvention("ros", (*_XYZ, "qx", "qy", "qz", "qw"), "quaternion xyzw", "m"),
    PoseConvention("matrix", _MATRIX_FIELDS, "matrix"),
)

CONVENTIONS: dict[str, PoseConvention] = {row.name: row for row in _TABLE}
"""All conventions by name."""


def find_convention(name: str) -> PoseConvention:
    """Return the convention with a given name.

    Raises
    ------
    ValueError
        If the name is unknown; the message lists all names.
    """
    if name not in CONVENTIONS:
        raise ValueError(
            f"expected a pose convention, one of {', '.join(CONVENTIONS)}; got {name!r}: the same "
            "six numbers mean another rotation in each, so it is never guessed"
        )
    return CONVENTIONS[name]


def check_units(length_unit: str | None, angle_unit: str | None) -> None:
    """Raise ValueError if a unit is neither None nor one of the units of poses."""
    for unit, sizes in ((length_unit, MM_PER_UNIT), (angle_unit, RAD_PER_UNIT)):
        if unit is not None and unit not in sizes:
            raise ValueError(f"expected a unit, one of {', '.join(sizes)}; got {unit!r}")


def pose_from_numbers(
    numbers: Sequence[float],
    convention: str,
    *,
    length_unit: LengthUnit | None = None,
    angle_unit: AngleUnit | None = None,
) -> Pose:
    """Return the pose with the numbers that a robot shows.

    Parameters
    ----------
    numbers : sequence of float
        As many as the convention has fields: 6 (position and angles or rotation vector),
        7 (position and quaternion) or 16 (4x4 row by row).
    convention : str
        One of `CONVENTIONS`: ``ur`` (m, rad), ``kuka``, ``fanuc``, ``yaskawa``,
        ``mitsubishi``, ``kawasaki``, ``staubli`` (mm, deg), ``abb`` (mm, w first), ``ros``
        (m, w last), ``matrix`` (mm, row-major).
    length_unit : {"mm", "m"}, optional
        Unit of the positions, if not the maker's.
    angle_unit : {"deg", "rad"}, optional
        Unit of the angles; quaternions and matrices have none.

    Returns
    -------
    Pose
        ``base_from_flange``. Units: mm.

    Raises
    ------
    ValueError
        If the convention or a unit is unknown, the count is wrong, a number is not finite or above
        `MAX_NUMBER`, a quaternion is not of length 1, or a matrix is not that of a rotation and a
        translation.

    Examples
    --------
    >>> pose = pose_from_numbers([100, 0, 500, 90, 0, 0], "kuka")
    >>> pose.apply_one([10.0, 0.0, 0.0]).round(6)
    array([100.,  10., 500.])
    """
    pose_convention = find_convention(convention)
    values = np.asarray(numbers, dtype=np.float64).ravel()
    if len(values) != len(pose_convention.fields):
        raise ValueError(
            f"expected {len(pose_convention.fields)} numbers ({' '.join(pose_convention.fields)}) "
            f"for convention {pose_convention.name!r}, got {len(values)}"
        )
    if not np.isfinite(values).all():
        raise ValueError(f"expected finite numbers, got {_format_value(values)}")
    if np.abs(values).max() > MAX_NUMBER:
        raise ValueError(f"expected numbers up to {MAX_NUMBER:g}, got {_format_value(values)}")
    check_units(length_unit, angle_unit)
    mm_per_unit = MM_PER_UNIT[length_unit or pose_convention.length_unit]
    if pose_convention.rotation == "matrix":
        return _pose_from_matrix(values.reshape(4, 4), mm_per_unit)
    rad_per_unit = RAD_PER_UNIT[angle_unit or pose_convention.angle_unit]
    rotation = _build_rotation_matrix(values[3:], pose_convention, rad_per_unit)
    return Pose(rotation, values[:3] * mm_per_unit)


def _build_rotation_matrix(
    values: FloatArray, pose_convention: PoseConvention, rad_per_unit: float
) -> FloatArray:
    """Return the rotation matrix (3, 3) of a quaternion, a rotation vector or Euler angles."""
    from scipy.spatial.transform import Rotation

    if pose_convention.is_quaternion:
        norm = float(np.linalg.norm(values))
        if abs(norm - 1) > MAX_QUATERNION_NORM_ERROR:
            raise ValueError(
                f"expected a quaternion of length 1, got length {norm:.4f}: {_format_value(values)}"
            )
        xyzw = np.roll(values, -1) if pose_convention.rotation.endswith("wxyz") else values
        matrix: FloatArray = Rotation.from_quat(xyzw / norm).as_matrix()
    elif pose_convention.rotation == "rotvec":
        matrix = Rotation.from_rotvec(values * rad_per_unit).as_matrix()
    else:
        matrix = Rotation.from_euler(pose_convention.rotation, values * rad_per_unit).as_matrix()
    return matrix


def _pose_from_matrix(matrix: FloatArray, mm_per_unit: float) -> Pose:
    """Return the pose of a 4x4 matrix, after a check and with an orthonormal rotation."""
    rotation = matrix[:3, :3]
    deviation = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if deviation > MAX_ORTHONORMALITY_ERROR or not np.allclose(
        matrix[3], (0, 0, 0, 1), rtol=0, atol=MAX_ORTHONORMALITY_ERROR
    ):
        raise ValueError(
            "expected a 4x4 matrix of a rotation, with last row 0 0 0 1, got R'R off by "
            f"{deviation:.3g} and last row {_format_value(matrix[3])}: if it is written column by "
            "column, transpose it"
        )
    u, _, vh = np.linalg.svd(rotation)
    if np.linalg.det(rotation) < 0:
        raise ValueError("expected a rotation, got a matrix of determinant -1: a reflection")
    return Pose(u @ vh, matrix[:3, 3] * mm_per_unit)


def _format_value(values: FloatArray) -> str:
    return " ".join(f"{value:g}" for value in values.tolist())
