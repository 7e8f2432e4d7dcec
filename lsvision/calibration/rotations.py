"""Stacks of rotations with any leading shape; scipy's `Rotation` takes one leading axis."""

import itertools

import numpy as np

from lsvision.geometry import FloatArray


def cross_matrices(vectors: FloatArray) -> FloatArray:
    """Return matrices [v]x with ``[v]x w = v x w``; (..., 3) -> (..., 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [(zero, -z, y), (z, zero, -x), (-y, x, zero)]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotations_from_vectors(vectors: FloatArray) -> FloatArray:
    """Return rotation matrices of rotation vectors; (..., 3) rad -> (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    rotations: FloatArray = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
    return rotations.reshape(*vectors.shape, 3)


def vectors_from_rotations(rotations: FloatArray) -> FloatArray:
    """Return rotation vectors of rotations, angles in [0, pi]; (..., 3, 3) -> (..., 3) rad."""
    from scipy.spatial.transform import Rotation

    vectors: FloatArray = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_rotvec()
    return vectors.reshape(rotations.shape[:-1])


def nearest_rotations(matrices: FloatArray) -> FloatArray:
    """Return the proper rotations nearest to matrices in the Frobenius norm; (..., 3, 3)."""
    u, _, vh = np.linalg.svd(matrices)
    u[..., :, 2] *= np.linalg.det(u @ vh)[..., None]
    nearest: FloatArray = u @ vh
    return nearest


def cube_rotations() -> FloatArray:
    """Return the 24 rotations of a cube (24, 3, 3), at most 63 deg from any rotation."""
    rotations = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                rotations.append(matrix)
    return np.array(rotations)
