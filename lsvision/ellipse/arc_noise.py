"""Noise of the points of one arc, as the residuals of its own fit show it.

The noise model of a profile says how the errors of single points are directed and how large they
are; where it was estimated from neighbours, or the sensor smooths along the line, the residuals
of an arc correct it: a variance factor, an autocorrelation time, and errors that grow with the
angle of incidence.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.robust_gauss_newton import EllipseResiduals
from lsvision.geometry import FloatArray
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.statistics.correlation import (
    autocorrelation_time,
    estimate_correlation,
    neighbours_correlated,
)
from lsvision.statistics.robust import mad_std

CLIPPED_SIGMAS = 3.0
"""Residuals are clipped at so many standard deviations before their correlation is estimated."""
GRAZING_INCIDENCE_DEG = 45.0
"""Incidence at which the error of a sensor that smooths along the line has grown by sqrt(2): the
spot lies across an ever longer stretch of the surface. From the arcs of real spheres, whose
errors have the same sign from about 55 deg on. Units: deg."""
GRAZING_POWER = 8
"""Power with which the variance grows with the incidence, from the same arcs."""
MAX_INCIDENCE_STD_FACTOR = 4.0
"""Reached at 64 deg: beyond, a larger one would let the ground beside a pipe pass for noise."""
MIN_SCORE_SIGMAS = 2.0
"""Standard deviations of the score test (Breusch and Pagan) above which the errors are taken to
grow with incidence: 2 % of the arcs whose errors do not."""


@dataclass(frozen=True, slots=True)
class ArcNoise:
    """Corrections of a noise model.

    Parameters
    ----------
    variance_factor : float
        Variance of the residuals over that of the noise model.
    autocorrelation_time : float
        Points for each independent one; 1 for independent errors.
    low_frequency_time : float
        The same for the lowest frequencies, to which the covariance of a fit is proportional.
    smoothed : bool
        Whether neighbouring errors are correlated: the sensor smooths along the line.
    """

    variance_factor: float
    autocorrelation_time: float
    low_frequency_time: float
    smoothed: bool


def estimate_arc_noise(compared: EllipseResiduals, min_variance_factor: float) -> ArcNoise:
    """Noise of the middle part of an arc from its residuals.

    Parameters
    ----------
    compared : EllipseResiduals
        In order along the line, of the ellipse fitted to them.
    min_variance_factor : float
        Smallest variance factor: 1 for a given noise model, which is also taken at its word
        about independence.

    Returns
    -------
    ArcNoise
    """
    normalised = compared.residuals / np.sqrt(compared.variances)
    scale = mad_std(normalised)
    factor = max(scale * scale, min_variance_factor)
    if min_variance_factor >= 1:
        return ArcNoise(factor, 1.0, 1.0, smoothed=False)
    limit = CLIPPED_SIGMAS * scale
    clipped = np.minimum(np.maximum(normalised, -limit), limit)
    time = autocorrelation_time(clipped)
    if not neighbours_correlated(clipped):
        return ArcNoise(factor, time, time, smoothed=False)
    low_frequency_time = estimate_correlation(clipped).autocorrelation_time
    return ArcNoise(factor, time, low_frequency_time, smoothed=True)


def smoothed_noise(points: NoisyPoints, normals: ComplexArray, std: float) -> NoisyPoints:
    """The points with the noise of a sensor that smooths along the line.

    Parameters
    ----------
    points : NoisyPoints
        n points.
    normals : (n,) complex ndarray
        Unit normals of the ellipse.
    std : float
        Standard deviation where the surface lies square on. Units: mm.

    Returns
    -------
    NoisyPoints
        Isotropic errors whose variance grows with the incidence, measured from +Y.
    """
    incidence_deg = np.degrees(np.arccos(np.minimum(np.maximum(normals.imag, -1.0), 1.0)))
    growth = 1 + (incidence_deg / GRAZING_INCIDENCE_DEG) ** GRAZING_POWER
    variances = std**2 * np.minimum(growth, MAX_INCIDENCE_STD_FACTOR**2)
    return NoisyPoints(points.z, variances, np.zeros(len(points), dtype=complex))


def errors_grow_with_incidence(normalised: FloatArray, normals: ComplexArray) -> bool:
    """Whether residuals scatter more where the surface is inclined than the noise model says.

    Parameters
    ----------
    normalised : (n,) ndarray
        Residuals over their standard deviations.
    normals : (n,) complex ndarray
        Unit normals there.

    Notes
    -----
    Score test of Breusch and Pagan (Econometrica 47, 1979) for a variance that grows with the
    squared sine of the incidence; squares are limited to 9 times their mean, for outliers.
    """
    inclination = normals.real * normals.real
    inclination -= inclination.sum() / len(inclination)
    squares = normalised * normalised
    excess = np.minimum(squares * (len(squares) / squares.sum()), CLIPPED_SIGMAS**2) - 1
    spread = math.sqrt(2 * float(inclination @ inclination))
    return float(inclination @ excess) > MIN_SCORE_SIGMAS * spread
