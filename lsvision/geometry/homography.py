"""Homographies: projective maps from plane to plane, as by a pinhole camera."""

from lsvision.geometry.arrays import FloatArray, Points


def apply_homography(homography: FloatArray, points: Points) -> Points:
    """Return the images (n, 2) of points (n, 2) under a homography (3, 3).

    Points that are mapped to infinity get inf or NaN, with a warning of numpy.

    Examples
    --------
    >>> import numpy as np
    >>> apply_homography(np.diag([1.0, 1.0, 2.0]), np.array([[4.0, 6.0]]))
    array([[2., 3.]])
    """
    mapped = points @ homography[:, :2].T + homography[:, 2]
    return mapped[:, :2] / mapped[:, 2:]
