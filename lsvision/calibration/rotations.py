"""Conversions of stacks of rotations, arrays with any leading axes ``...``.

Scipy's `Rotation`, with which the conversions are made, takes a single leading axis.

Small changes of a rotation R from frame b to frame a, and their covariances, are left perturbations
in this package: vectors w (rad) along the axes of frame a, R -> exp([w]x) R.
"""

from itertools import product

import numpy as np

from lsvision.geometry import FloatArray


def build_cross_matrices(vectors: FloatArray) -> FloatArray:
    """Return the matrices [v] of vectors v with which ``[v] @ w`` is the cross product ``v x w``.

    Shapes: (..., 3) to (..., 3, 3); units are those of the vectors.
    """
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [(zero, -z, y), (z, zero, -x), (-y, x, zero)]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotations_from_vectors(vectors: FloatArray) -> FloatArray:
    """Return the rotation matrices (..., 3, 3) of rotation vectors (..., 3). Units: rad."""
    from scipy.spatial.transform import Rotation

    rotations: FloatArray = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
    return rotations.reshape(*vectors.shape, 3)


def vectors_from_rotations(rotations: FloatArray) -> FloatArray:
    """Return the rotation vectors (..., 3) of rotation matrices (..., 3, 3).

    Their lengths are angles in [0, pi]. Units: rad.
    """
    from scipy.spatial.transform import Rotation

    rotation_vectors: FloatArray = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_rotvec()
    return rotation_vectors.reshape(rotations.shape[:-1])


def rotation_vector_jacobian(vector: FloatArray) -> FloatArray:
    """Return the derivative (3, 3) of a rotation vector (3,) by a left perturbation.

    This is the inverse of the left Jacobian of SO(3); the angle must be below 2 pi. Units: rad.
    """
    angle = float(np.linalg.norm(vector))
    cross = build_cross_matrices(vector)
    if angle < 1e-6:
        return np.eye(3) - 0.5 * cross
    factor = 1 / angle**2 - 1 / (2 * angle * np.tan(angle / 2))
    jacobian: FloatArray = np.eye(3) - 0.5 * cross + factor * cross @ cross
    return jacobian


def find_nearest_rotations(matrices: FloatArray) -> FloatArray:
    """Return the rotation matrices nearest to matrices (..., 3, 3) in the Frobenius norm."""
    u, _, vh = np.linalg.svd(matrices)
    # If the nearest orthogonal matrix is a reflection, the axis of the least singular value flips.
    u[..., :, 2] *= np.linalg.det(u @ vh)[..., None]
    nearest: FloatArray = u @ vh
    return nearest


def rotations_from_columns(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the rotations (n, 3, 3) nearest to first and second columns (n, 3).

    Both columns may have the same unknown scale.
    """
    matrices = np.stack([first, second, np.cross(first, second)], axis=-1)
    norms = np.linalg.norm(matrices, axis=(1, 2))[:, None, None]
    return find_nearest_rotations(matrices / np.maximum(norms, 1e-12))


def list_cube_rotations() -> FloatArray:
    """Return the rotation matrices (24, 3, 3) that map a cube onto itself.

    They are initial guesses for an unknown rotation: one of them is at most 63 deg from it.
    """
    from scipy.spatial.transform import Rotation

    rotations: FloatArray = Rotation.create_group("O").as_matrix().round()
    return rotations


def list_dense_rotations() -> FloatArray:
    """Return 192 rotation matrices (192, 3, 3): one of them is at most 32 deg from any rotation.

    They are those of a cube, alone and followed by rotations of 45 deg about its three edges and of
    60 deg about its four diagonals.
    """
    from scipy.spatial.transform import Rotation

    edges, diagonals = np.radians(45.0) * np.eye(3), np.array(list(product((1, -1), (1, -1), [1])))
    vectors = [np.zeros(3), *edges, *(np.radians(60.0) / np.sqrt(3.0) * diagonals)]
    turns = Rotation.from_rotvec(vectors).as_matrix()
    rotations: FloatArray = (turns[:, None] @ list_cube_rotations()).reshape(-1, 3, 3)
    return rotations
