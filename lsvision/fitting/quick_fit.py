"""Ellipses good enough to look around with: stable on short arcs, biased a little, fast.

An arc of 40 deg leaves the tilt of a free ellipse almost undetermined, and a fit that runs off
to a needle recognises nothing. Here a weak prior (few pipes are tilted by more than 60 deg)
holds the difference of the semi-axes; on a long arc the data overrule it.
"""

import math

import numpy as np

from lsvision.fitting.ellipse_parameters import as_vectors, axes_of, in_own_frame, parameter_rows
from lsvision.fitting.scatter import MAD_TO_STD, median
from lsvision.shapes import FloatArray, Points

TILT_STD = 0.15
"""One sigma of (a - b) / (a + b) before the data speak: 0.13 is a tilt of 40 deg."""
TINY = 1e-300
LARGEST_STEP = 0.1
"""Damping: a step of this share of the size is as dear as a misfit of one sigma."""
CAUCHY_SIGMAS = 3.0
"""A point so far off has half its weight."""
NORMAL_SLACK = 0.05
"""Share of the total variance that counts along any normal: one 13 deg off."""


def normal_residuals(
    points: Points, parameters: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """First-order orthogonal distance, unit normals, and w where the ray meets the ellipse.

    Returns
    -------
    signed : (n,) ndarray
        Positive outside; exact at the ellipse, right to second order near it. Units: mm.
    normals, w : (n, 2) ndarray
        Outward unit normal and unit vector of c + E w.
    """
    a, b, turn = axes_of(parameters)
    own = in_own_frame(points, parameters, turn)
    w = own.real / a + 1j * (own.imag / b)
    size = np.maximum(np.abs(w), TINY)
    w /= size
    n = w.real / a + 1j * (w.imag / b)
    steepness = np.abs(n)
    n /= steepness
    # Along the ray from the centre the ellipse is at 1 / size; times the ray's cosine with n.
    return (size - 1) / steepness, as_vectors(n * turn), as_vectors(w * turn)


def normal_variances(normals: FloatArray, covariances: FloatArray) -> FloatArray:
    """Variance n' Sigma n of each point's error along the normal. Units: mm^2."""
    nx, ny = normals[:, 0], normals[:, 1]
    variances: FloatArray = (
        nx * nx * covariances[:, 0, 0]
        + 2 * nx * ny * covariances[:, 0, 1]
        + ny * ny * covariances[:, 1, 1]
    )
    return variances


def tolerant_variances(normals: FloatArray, covariances: FloatArray) -> FloatArray:
    """Variance along a normal that is itself not yet known well. Units: mm^2.

    At a grazing flank n' Sigma n almost vanishes, and a normal a few degrees off would give
    that point all the weight; `NORMAL_SLACK` of the total variance is added.
    """
    total = covariances[:, 0, 0] + covariances[:, 1, 1]
    return normal_variances(normals, covariances) + NORMAL_SLACK * total


def robust_variances(signed: FloatArray, variances: FloatArray) -> FloatArray:
    """Variances that grow with the square of the residual: Cauchy's weights. Units: mm^2.

    The foot of a weld bead at a flank, where n' Sigma n is small, would else pull the whole
    ellipse to itself, and the next step far beyond. The median tells the scatter of the rest.
    """
    squares = signed * signed
    scatter = max(median(squares / variances) * MAD_TO_STD**2, 1.0)
    return variances + squares / (CAUCHY_SIGMAS**2 * scatter)


def refine_quickly(
    points: Points, covariances: FloatArray, parameters: FloatArray, steps: int
) -> tuple[FloatArray, FloatArray]:
    """A few Gauss-Newton steps of the robust weighted fit, the tilt held by its prior.

    Parameters
    ----------
    points : (n, 2) ndarray
        Units: mm.
    covariances : (n, 2, 2) ndarray
        Units: mm^2.
    parameters : (5,) ndarray
        Start; see `lsvision.fitting.ellipse_parameters`. Units: mm.
    steps : int
        Gauss-Newton steps.

    Returns
    -------
    parameters : (5,) ndarray
        NaN where the iteration breaks down.
    covariance : (5, 5) ndarray
        Of the parameters, before the last step. Units: mm^2.
    """
    covariance = np.full((5, 5), np.nan)
    for step in range(steps):
        signed, n, w = normal_residuals(points, parameters)
        J = parameter_rows(n, w)
        weighted = J / robust_variances(signed, tolerant_variances(n, covariances))
        information, right = weighted @ J.T, weighted @ signed
        held = 1 / (TILT_STD * 2 * parameters[2]) ** 2
        information[3, 3] += held
        information[4, 4] += held
        right[3:] -= held * parameters[3:]
        if not math.isfinite(float(information.sum())):
            return np.full(5, np.nan), covariance
        try:
            if step == steps - 1:
                covariance = np.linalg.inv(information)
            information.flat[::6] += 1 / (LARGEST_STEP * parameters[2]) ** 2
            parameters = parameters + np.linalg.solve(information, right)
        except np.linalg.LinAlgError:
            return np.full(5, np.nan), covariance
    return parameters, covariance
