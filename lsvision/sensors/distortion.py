"""Lens distortion: OpenCV's model of up to 14 coefficients, and its inverse.

OpenCV's own functions are not used, for two reasons: ``cv2.undistortPoints`` stops after five
iterations with errors of up to 0.27 px, which OpenCV 4 and 5 prevent by different arguments; and
the Jacobian is needed to propagate the covariance of a laser line's pixels into the section.
"""

import math

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, Points

COEFFICIENTS = 14
"""Number of distortion coefficients: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y in OpenCV's
order."""
MAX_NEWTON_ITERATIONS = 25
"""Newton's method doubles the correct digits in each step, but starts slowly near a fold."""
NEWTON_TOLERANCE = 1e-13
"""Largest residual of an inverted point in units of the focal length: 1e-9 px at f = 10000 px."""
MAX_NEWTON_STEP = 0.5
"""Largest change of a coordinate in one step, against divergence. Units: focal lengths."""
FAR_RADIUS = 1.0
"""Distance from the optical axis from which each point is checked for folds between it and the
axis. Of nearer points the farthest is checked; if a checked point is beyond a fold, all are.
Units: focal lengths."""
FOLD_SAMPLES = 16
"""Intervals between the optical axis and a point; the model is checked for folds at their ends."""
MIN_DETERMINANT = 1e-12
"""Smallest modulus of the determinant of a regular Jacobian."""


def distort(normalised: Points, coefficients: FloatArray) -> tuple[Points, FloatArray]:
    """Return distorted image coordinates, with the Jacobian.

    Parameters
    ----------
    normalised : (n, 2) ndarray
        x / z, y / z in the camera frame. Units: focal lengths.
    coefficients : (14,) ndarray
        Coefficients in OpenCV's order, see `COEFFICIENTS`; tau in rad.

    Returns
    -------
    distorted : (n, 2) ndarray
        Distorted points. Units: focal lengths.
    jacobian : (n, 2, 2) ndarray
        d distorted / d normalised.

    References
    ----------
    OpenCV documentation, "Camera Calibration and 3D Reconstruction", the equations before
    ``cv::projectPoints``.
    """
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y = coefficients
    x, y = normalised[:, 0], normalised[:, 1]
    r2 = x * x + y * y
    denominator = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / denominator
    # d radial / d r2, by the quotient rule.
    slope = (
        k1 + r2 * (2 * k2 + 3 * k3 * r2) - radial * (k4 + r2 * (2 * k5 + 3 * k6 * r2))
    ) / denominator
    distorted = np.empty_like(normalised)
    distorted[:, 0] = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + s2 * r2)
    distorted[:, 1] = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + s4 * r2)
    jacobian = np.empty((len(normalised), 2, 2))
    prism_x, prism_y = s1 + 2 * s2 * r2, s3 + 2 * s4 * r2
    cross = 2 * x * y * slope
    jacobian[:, 0, 0] = radial + 2 * x * (x * slope + prism_x) + 2 * p1 * y + 6 * p2 * x
    jacobian[:, 0, 1] = cross + 2 * p1 * x + 2 * p2 * y + 2 * y * prism_x
    jacobian[:, 1, 0] = cross + 2 * p1 * x + 2 * p2 * y + 2 * x * prism_y
    jacobian[:, 1, 1] = radial + 2 * y * (y * slope + prism_y) + 6 * p1 * y + 2 * p2 * x
    if tau_x or tau_y:
        return _apply_tilt(distorted, jacobian, _build_tilt_homography(tau_x, tau_y))
    return distorted, jacobian


def undistort(distorted: Points, coefficients: FloatArray) -> tuple[Points, FloatArray]:
    """Return undistorted image coordinates: the inverse of `distort` by Newton's method.

    Points (n, 2) are in focal lengths, the coefficients (14,) as for `distort`. The second result
    (n, 2, 2) is d distorted / d undistorted at the undistorted points. Both are NaN where the
    distorted point is, or no point within the first fold of the model is mapped to it.
    """
    normalised = np.array(distorted)
    for _ in range(MAX_NEWTON_ITERATIONS):
        image, jacobian = distort(normalised, coefficients)
        residual = image - distorted
        largest = np.abs(residual).max(axis=1)
        if not np.any(largest > NEWTON_TOLERANCE):
            break
        step = np.einsum("nij,nj->ni", invert_2x2(jacobian), residual)
        normalised = normalised - np.clip(step, -MAX_NEWTON_STEP, MAX_NEWTON_STEP)
    # Beyond a fold the model mirrors the image: its determinant is negative. Beyond two it is not.
    valid = (largest <= NEWTON_TOLERANCE) & (_compute_determinants(jacobian) > 0)
    radii = np.where(valid, np.hypot(*normalised.T), -1.0)
    far = radii >= min(FAR_RADIUS, radii.max(initial=0.0))
    if far.any() and _is_beyond_folds(normalised[far], coefficients).any():
        valid[valid] = ~_is_beyond_folds(normalised[valid], coefficients)
    normalised[~valid], jacobian[~valid] = np.nan, np.nan
    return normalised, jacobian


def _is_beyond_folds(normalised: Points, coefficients: FloatArray) -> BoolArray:
    """Return whether a fold lies between the optical axis and each of n points (n,)."""
    fractions = np.arange(1, FOLD_SAMPLES)[:, None, None] / FOLD_SAMPLES
    between = (fractions * normalised).reshape(-1, 2)
    determinants = _compute_determinants(distort(between, coefficients)[1])
    beyond: BoolArray = determinants.reshape(-1, len(normalised)).min(axis=0) <= 0
    return beyond


def invert_2x2(matrices: FloatArray) -> FloatArray:
    """Return inverse matrices (n, 2, 2); zero for singular ones, NaN for NaN."""
    determinants = _compute_determinants(matrices)
    divisors = np.where(np.abs(determinants) < MIN_DETERMINANT, np.inf, determinants)
    adjugates = np.empty_like(matrices)
    adjugates[:, 0, 0], adjugates[:, 1, 1] = matrices[:, 1, 1], matrices[:, 0, 0]
    adjugates[:, 0, 1], adjugates[:, 1, 0] = -matrices[:, 0, 1], -matrices[:, 1, 0]
    return adjugates / divisors[:, None, None]


def _compute_determinants(matrices: FloatArray) -> FloatArray:
    """Return the determinants (n,) of matrices (n, 2, 2)."""
    return matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]


def _build_tilt_homography(tau_x: float, tau_y: float) -> FloatArray:
    """Return OpenCV's (3, 3) homography of a sensor tilted by `tau_x`, `tau_y` (Scheimpflug)."""
    about_x = [
        [1.0, 0.0, 0.0],
        [0.0, math.cos(tau_x), math.sin(tau_x)],
        [0.0, -math.sin(tau_x), math.cos(tau_x)],
    ]
    about_y = [
        [math.cos(tau_y), 0.0, -math.sin(tau_y)],
        [0.0, 1.0, 0.0],
        [math.sin(tau_y), 0.0, math.cos(tau_y)],
    ]
    R = np.array(about_y) @ about_x
    projection = [[R[2, 2], 0.0, -R[0, 2]], [0.0, R[2, 2], -R[1, 2]], [0.0, 0.0, 1.0]]
    return np.array(projection) @ R


def _apply_tilt(
    points: Points, jacobian: FloatArray, homography: FloatArray
) -> tuple[Points, FloatArray]:
    """Return points (n, 2) and Jacobians (n, 2, 2) after the homography of a tilted sensor."""
    mapped = points @ homography[:, :2].T + homography[:, 2]
    tilted = mapped[:, :2] / mapped[:, 2:]
    projective_jacobian = homography[None, :2, :2] - tilted[:, :, None] * homography[None, 2:, :2]
    return tilted, (projective_jacobian / mapped[:, 2, None, None]) @ jacobian
