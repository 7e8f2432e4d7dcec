"""Stacks of rotations: exponential, logarithm, nearest rotation; any leading shape."""

import itertools

import numpy as np

from lsvision.geometry import FloatArray

SMALL = 1e-8
"""Angle below which the series' first term is exact in float64. Units: rad."""


def cross_matrices(vectors: FloatArray) -> FloatArray:
    """Matrices [v]x with ``[v]x w = v x w``; (..., 3) -> (..., 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [(zero, -z, y), (z, zero, -x), (-y, x, zero)]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotations_of(vectors: FloatArray) -> FloatArray:
    """Rotations exp([v]x) of rotation vectors (Rodrigues); (..., 3) rad -> (..., 3, 3)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    safe = np.where(angle > SMALL, angle, 1.0)
    sine = np.where(angle > SMALL, np.sin(safe) / safe, 1.0)
    versine = np.where(angle > SMALL, (1 - np.cos(safe)) / safe**2, 0.5)
    cross = cross_matrices(vectors)
    rotations: FloatArray = np.eye(3) + sine * cross + versine * (cross @ cross)
    return rotations


def rotation_vectors(rotations: FloatArray) -> FloatArray:
    """Rotation vectors of rotations, the inverse of `rotations_of`; angles in [0, pi].

    By way of the quaternion of largest component (Shepperd 1978), which stays exact near
    0 and near pi; (..., 3, 3) -> (..., 3) rad.
    """
    m = rotations
    trace = np.trace(m, axis1=-2, axis2=-1)
    squares = np.stack([trace, m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]], axis=-1)
    sums = [m[..., i, j] + m[..., j, i] for i, j in ((0, 1), (0, 2), (1, 2))]
    gaps = [m[..., j, i] - m[..., i, j] for i, j in ((1, 2), (2, 0), (0, 1))]
    one = 1 + 2 * squares[..., 1:] - trace[..., None]
    rows = [
        np.stack([1 + trace, *gaps], axis=-1),
        np.stack([gaps[0], one[..., 0], sums[0], sums[1]], axis=-1),
        np.stack([gaps[1], sums[0], one[..., 1], sums[2]], axis=-1),
        np.stack([gaps[2], sums[1], sums[2], one[..., 2]], axis=-1),
    ]
    largest = np.argmax(squares, axis=-1)[..., None, None]
    q = np.take_along_axis(np.stack(rows, axis=-2), largest, axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    q = np.where(q[..., :1] < 0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, q[..., :1])
    vectors: FloatArray = q[..., 1:] * np.where(sine > SMALL, angle / np.maximum(sine, SMALL), 2.0)
    return vectors


def nearest_rotations(matrices: FloatArray) -> FloatArray:
    """Proper rotations nearest to matrices in the Frobenius norm; (..., 3, 3)."""
    left, _, right = np.linalg.svd(matrices)
    sign = np.linalg.det(left @ right)
    left = left.copy()
    left[..., :, 2] *= sign[..., None]
    nearest: FloatArray = left @ right
    return nearest


def cube_rotations() -> FloatArray:
    """The 24 rotations of a cube: starts no further than 63 deg from any rotation; (24, 3, 3)."""
    rotations = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                rotations.append(matrix)
    return np.array(rotations)
