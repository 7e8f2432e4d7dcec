"""Fisher information: what points with Gaussian errors say about the unknowns of a shape."""

import math

import numpy as np

from lsvision.errors import DegenerateGeometry, TooFewPoints
from lsvision.geometry import FloatArray

SINGULARITY_TOLERANCE = 1e-13
"""Smallest eigenvalue of the information, its diagonal scaled to 1, that still is one."""

UNIFORM_THETA = math.pi / math.sqrt(12)
"""Standard deviation of an angle about which nothing is known in [0, pi): 52 deg."""


def information(gradients: FloatArray, variances: FloatArray) -> FloatArray:
    """Sum over the points of g g' / v.

    Parameters
    ----------
    gradients : (n, k) ndarray
        Change of each point's signed distance from the surface by each unknown.
    variances : (n,) ndarray
        Variance of each point's error across the surface, n' Sigma n. Units: mm^2.

    Returns
    -------
    (k, k) ndarray
        The Fisher information of independent Gaussian errors. That the variance itself moves
        with the unknowns is left out: it adds a share of about (range_std / range)^2.

    Raises
    ------
    TooFewPoints
        If there are fewer points than two.
    ValueError
        If a variance is not positive and finite.
    """
    if len(gradients) < 2:
        hint = "look from nearer, with a finer pitch, or at more of the pipe"
        raise TooFewPoints("the planned view", len(gradients), 5, hint)
    if not (np.isfinite(variances).all() and (variances > 0).all()):
        raise ValueError("want positive finite variances across the surface in mm^2")
    weighted = gradients / np.sqrt(variances)[:, None]
    total: FloatArray = weighted.T @ weighted
    return total


def invert_information(matrix: FloatArray, known: tuple[int, float] | None = None) -> FloatArray:
    """The bound: smallest covariance that any unbiased estimate can reach.

    Parameters
    ----------
    matrix : (k, k) ndarray
        Fisher information.
    known : tuple of int and float, optional
        Index of an unknown that is known beforehand, and its one sigma; 0 means exactly.

    Returns
    -------
    (k, k) ndarray
        Zero in the row and column of an exactly known number.

    Raises
    ------
    DegenerateGeometry
        If the points leave a combination of the unknowns free.
    ValueError
        If the sigma of the known number is negative.
    """
    matrix = matrix.copy()
    free = np.ones(len(matrix), dtype=bool)
    if known is not None:
        index, std = known
        if not std >= 0:
            raise ValueError(f"want known_radius_std >= 0 mm, got {std}")
        free[index] = std > 0
        matrix[index, index] += 1 / std**2 if std > 0 else 0.0
    bound = np.zeros_like(matrix)
    bound[np.ix_(free, free)] = _invert(matrix[np.ix_(free, free)])
    return bound


def _invert(matrix: FloatArray) -> FloatArray:
    scale = np.sqrt(np.diag(matrix))
    if not (scale > 0).all():
        raise DegenerateGeometry(_FREE)
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    if values[0] < SINGULARITY_TOLERANCE:
        raise DegenerateGeometry(_FREE)
    inverse: FloatArray = (vectors / values) @ vectors.T / np.outer(scale, scale)
    return inverse


_FREE = (
    "the points leave radius and axis undetermined (too few, or too short an arc): "
    "see more of the pipe, add sections, or give the known radius"
)
