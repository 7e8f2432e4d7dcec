"""Rigid transformation, named ``a_from_b`` so that adjacent frames cancel in products."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NoReturn, Self

import numpy as np
import numpy.typing as npt

from lsvision.geometry.arrays import (
    FloatArray,
    Points,
    as_readonly_array,
    as_unit_vector,
    freeze_arrays,
)
from lsvision.geometry.equality import ComparedByValue

ORTHONORMALITY_TOLERANCE = 1e-6
"""Largest entry of R'R - I of a rotation (files contain poses with 6 digits)."""


@dataclass(frozen=True, eq=False)
class Pose(ComparedByValue):
    """Rigid transformation ``a_from_b`` of coordinates in frame b to coordinates in frame a.

    Parameters
    ----------
    rotation : (3, 3) array_like
        Rotation; its columns are the axes of b in a.
    translation : (3,) array_like
        Origin of b in a. Units: mm.

    Raises
    ------
    ValueError
        If `rotation` is not orthonormal to 1e-6 or has a negative determinant, or `translation` is
        not finite.

    Examples
    --------
    >>> base_from_flange = Pose(translation=(0.0, 0.0, 100.0))
    >>> flange_from_section = Pose(translation=(5.0, 0.0, 0.0))
    >>> base_from_section = base_from_flange @ flange_from_section
    >>> base_from_section.apply([[1.0, 2.0, 3.0]])
    array([[  6.,   2., 103.]])
    """

    __array_ufunc__ = None  # A pose does not multiply arrays: use apply.

    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    translation: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        rotation = as_readonly_array(self.rotation, (3, 3), "rotation")
        with np.errstate(over="ignore", invalid="ignore"):  # not finite, and rejected
            deviation = np.abs(rotation.T @ rotation - np.eye(3)).max()
        if not deviation <= ORTHONORMALITY_TOLERANCE:
            raise ValueError(f"expected an orthonormal rotation, got R'R off by {deviation:.3g}")
        if np.linalg.det(rotation) < 0:
            raise ValueError("expected a proper rotation, got determinant -1: a reflection")
        object.__setattr__(self, "rotation", rotation)
        freeze_arrays(self, translation=(3,))
        if not np.isfinite(self.translation).all():
            raise ValueError(f"expected a finite translation in mm, got {self.translation}")

    @classmethod
    def along(cls, direction: npt.ArrayLike, distance: float) -> Self:
        """Return a pure translation, such as the feed along an encoder axis.

        Parameters
        ----------
        direction : (3,) array_like
            Feed direction, of any non-zero length.
        distance : float
            Distance along it. Units: mm.

        Returns
        -------
        Pose
            Translation without rotation.

        Examples
        --------
        >>> Pose.along((0, 0, 2), 10.0).translation
        array([ 0.,  0., 10.])
        """
        unit, _ = as_unit_vector(direction, "feed direction")
        with np.errstate(over="ignore", invalid="ignore"):  # not finite, and rejected
            translation = unit * distance
        return cls(translation=translation)

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike) -> Self:
        """Return the pose of a 4x4 homogeneous matrix.

        Parameters
        ----------
        matrix : (4, 4) array_like
            Homogeneous matrix, row-major; its last column is the translation. Units: mm.

        Returns
        -------
        Pose
            Pose of the same motion.

        Raises
        ------
        ValueError
            If the shape is not (4, 4), the last row is not ``0 0 0 1``, or `Pose` raises.

        Examples
        --------
        >>> Pose.from_matrix(np.eye(4)) == Pose()
        True
        """
        homogeneous = as_readonly_array(matrix, (4, 4), "matrix")
        if not np.allclose(homogeneous[3], (0, 0, 0, 1), rtol=0, atol=ORTHONORMALITY_TOLERANCE):
            last_row = " ".join(f"{number:g}" for number in homogeneous[3])
            raise ValueError(f"expected last row 0 0 0 1, got {last_row}")
        return cls(homogeneous[:3, :3], homogeneous[:3, 3])

    @property
    def matrix(self) -> FloatArray:
        """4x4 homogeneous matrix. Units: mm."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.translation
        return matrix

    def __matmul__(self, other: Pose) -> Pose:
        """Return the composition ``a_from_c = a_from_b @ b_from_c``."""
        if not isinstance(other, Pose):
            raise TypeError(
                f"expected a Pose after @, got {type(other).__name__}: Pose.from_matrix "
                "converts a 4x4 matrix, and pose.apply(points) transforms points"
            )
        # The nearest rotation to the product: long products stay orthonormal.
        u, _, vh = np.linalg.svd(self.rotation @ other.rotation)
        return Pose(u @ vh, self.apply_one(other.translation))

    def __rmatmul__(self, other: object) -> NoReturn:
        """Raise a TypeError with the remedy: the left operand of ``@`` is not a pose."""
        raise TypeError(
            f"expected a Pose before @, got {type(other).__name__}: Pose.from_matrix converts "
            "a 4x4 matrix"
        )

    def inverse(self) -> Pose:
        """Return the inverse transformation, ``b_from_a``.

        Returns
        -------
        Pose
            ``b_from_a`` of ``a_from_b``.

        Examples
        --------
        >>> Pose.along((0, 0, 1), 10.0).inverse().translation.tolist()
        [0.0, 0.0, -10.0]
        """
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: npt.ArrayLike) -> Points:
        """Return points of frame b in frame a.

        Parameters
        ----------
        points : (n, 3) or (n, 2) array_like
            Points in frame b; two columns are points of the section plane z = 0. Units: mm.

        Returns
        -------
        (n, 3) ndarray
            Points in frame a. Units: mm.

        Raises
        ------
        ValueError
            If the shape is neither (n, 3) nor (n, 2).
        """
        array = np.asarray(points, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] not in (2, 3):
            raise ValueError(f"expected points of shape (n, 3) or (n, 2), got {array.shape}")
        return array @ self.rotation[:, : array.shape[1]].T + self.translation

    def apply_one(self, point: npt.ArrayLike) -> FloatArray:
        """Return one point of frame b in frame a.

        Parameters
        ----------
        point : (3,) array_like
            Point in frame b. Units: mm.

        Returns
        -------
        (3,) ndarray
            Point in frame a. Units: mm.

        Examples
        --------
        >>> Pose.along((0, 0, 1), 10.0).apply_one((1.0, 2.0, 3.0)).tolist()
        [1.0, 2.0, 13.0]
        """
        return self.rotation @ np.asarray(point, dtype=np.float64) + self.translation


def as_pose(value: Pose | npt.ArrayLike) -> Pose:
    """Return a pose unchanged, or the pose of a 4x4 homogeneous matrix (row-major, mm).

    Raises
    ------
    TypeError
        If it is neither.
    ValueError
        If the matrix is not a rigid motion.

    Examples
    --------
    >>> as_pose([[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]).translation
    array([5., 0., 0.])
    """
    if isinstance(value, Pose):
        return value
    try:
        matrix = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4):
        shape = f" of shape {matrix.shape}" if matrix.size else ""
        raise TypeError(
            f"expected a Pose or a 4x4 matrix in mm (as Pose.from_matrix takes it), got "
            f"{type(value).__name__}{shape}"
        )
    return Pose.from_matrix(matrix)


def as_poses(values: Iterable[Pose | npt.ArrayLike]) -> tuple[Pose, ...]:
    """Return poses, each given as a `Pose` or a 4x4 matrix; also an (n, 4, 4) array.

    Raises
    ------
    TypeError, ValueError
        If one is not a pose; the message names its index.
    """
    if isinstance(values, Pose):
        raise TypeError("expected a sequence of poses, got one Pose: put it into a list")
    poses = []
    for index, value in enumerate(values):
        try:
            poses.append(as_pose(value))
        except (TypeError, ValueError) as error:
            raise type(error)(f"pose {index}: {error}") from None
    return tuple(poses)
