"""Rigid transformation, named ``a_from_b`` so that adjacent frames cancel in products."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
import numpy.typing as npt

from lsvision.geometry.arrays import FloatArray, Points, as_readonly_array

ORTHONORMALITY_TOLERANCE = 1e-6
"""Largest entry of R'R - I of a rotation (files contain poses with 6 digits)."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Rigid transformation ``a_from_b`` of coordinates in frame b to coordinates in frame a.

    Parameters
    ----------
    rotation : (3, 3) array_like
        Proper rotation; its columns are the axes of b in a.
    translation : (3,) array_like
        Origin of b in a. Units: mm.

    Raises
    ------
    ValueError
        If `rotation` is not orthonormal to 1e-6 or has a negative determinant.

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
        with np.errstate(over="ignore", invalid="ignore"):  # not finite, and refused
            defect = np.abs(rotation.T @ rotation - np.eye(3)).max()
        if not defect <= ORTHONORMALITY_TOLERANCE:
            raise ValueError(f"expected an orthonormal rotation, got R'R off by {defect:.3g}")
        if np.linalg.det(rotation) < 0:
            raise ValueError("expected a proper rotation, got determinant -1: it mirrors")
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(
            self, "translation", as_readonly_array(self.translation, (3,), "translation")
        )
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
        """
        axis = as_readonly_array(direction, (3,), "direction")
        with np.errstate(over="ignore"):  # infinite, and refused
            length = float(np.linalg.norm(axis))
        if not (np.isfinite(length) and length > 0):
            raise ValueError(f"expected a finite, non-zero feed direction, got {axis.tolist()}")
        with np.errstate(over="ignore", invalid="ignore"):  # not finite, and refused
            translation = axis / length * distance
        return cls(translation=translation)

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike) -> Self:
        """Return the pose of a 4x4 homogeneous matrix (mm).

        Raises
        ------
        ValueError
            If the last row is not ``0 0 0 1`` or the rotation is invalid.
        """
        homogeneous = as_readonly_array(matrix, (4, 4), "matrix")
        if not np.allclose(homogeneous[3], (0, 0, 0, 1), rtol=0, atol=ORTHONORMALITY_TOLERANCE):
            raise ValueError(f"expected last row 0 0 0 1, got {homogeneous[3]}")
        return cls(homogeneous[:3, :3], homogeneous[:3, 3])

    @property
    def matrix(self) -> FloatArray:
        """4x4 homogeneous matrix. Units: mm."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.translation
        return matrix

    def __matmul__(self, other: "Pose") -> "Pose":
        """Compose: ``a_from_c = a_from_b @ b_from_c``."""
        if not isinstance(other, Pose):
            return NotImplemented
        rotation = self.rotation @ other.rotation
        return Pose(_nearest_rotation(rotation), self.apply_one(other.translation))

    def inverse(self) -> "Pose":
        """Return ``b_from_a``."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: npt.ArrayLike) -> Points:
        """Transform points from frame b to frame a.

        Parameters
        ----------
        points : (n, 3) or (n, 2) array_like
            Frame b; two columns are points of the section plane z = 0. Units: mm.

        Returns
        -------
        (n, 3) ndarray
            Frame a. Units: mm.
        """
        array = np.asarray(points, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] not in (2, 3):
            raise ValueError(f"expected points of shape (n, 3) or (n, 2), got {array.shape}")
        return array @ self.rotation[:, : array.shape[1]].T + self.translation

    def apply_one(self, point: npt.ArrayLike) -> FloatArray:
        """Transform one point (3,) from frame b to frame a."""
        return self.rotation @ np.asarray(point, dtype=np.float64) + self.translation


def _nearest_rotation(matrix: FloatArray) -> FloatArray:
    """Return the rotation nearest to a product of rotations: long products stay orthonormal."""
    left, _, right = np.linalg.svd(matrix)
    nearest: FloatArray = left @ right
    return nearest
