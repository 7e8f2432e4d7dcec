"""Inverse of the normal matrix of a least-squares problem."""

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.geometry.arrays import TINY


def invert_normal_matrix(matrix: FloatArray) -> FloatArray:
    """Return the inverse of J'J (k, k), computed with its diagonal scaled to 1.

    It is the covariance of the parameters for residuals of unit variance. Without the scaling,
    parameters in px and in rad differ by so many orders of magnitude that the inverse loses its
    digits.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is singular.

    Examples
    --------
    >>> invert_normal_matrix(np.diag([4.0, 1e-20])).diagonal()
    array([2.5e-01, 1.0e+20])
    """
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), TINY))
    return np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)
