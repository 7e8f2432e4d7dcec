"""Noise of the points of one arc, estimated from the residuals of its ellipse.

The noise model of a profile gives size and direction of the errors of single points. Where it was
estimated from neighbours, or the sensor smooths along the line, the residuals of an arc correct
it by a variance factor, an autocorrelation time, and variances that increase with incidence.
"""

import math
from typing import NamedTuple

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.statistics.correlation import (
    FIT_PARAMETERS,
    UNCORRELATED,
    Correlation,
    estimate_correlation,
    neighbour_correlation,
)
from lsvision.statistics.robust import SIGNIFICANT_SIGMAS, upper_mad_std

GRAZING_INCIDENCE_DEG = 45.0
"""Incidence at which the error of a sensor that smooths along the line has grown by sqrt(2), since
its spot covers a longer part of the surface. From arcs of real spheres, whose errors have the same
sign above about 55 deg. Units: deg."""
GRAZING_POWER = 8
"""Power of the incidence with which the variance increases, from the same arcs."""
MAX_INCIDENCE_STD_FACTOR = 4.0
"""Largest growth of the error, at 63 deg: above it the ground beside a pipe would be an inlier."""
MIN_SCORE_SIGMAS = 2.0
"""Score (Breusch and Pagan), in standard deviations, above which errors are taken to increase with
incidence: by chance in 2 % of the arcs."""
MAX_ROUNDING_FRACTION = 4 * float(np.finfo(float).eps)
"""Largest rms of residuals that consist of rounding errors only, relative to the coordinates: for
exact points it is a third of an eps, and the correlation of rounding errors is not the sensor's."""


class ArcNoise(NamedTuple):
    """Corrections of a noise model.

    Parameters
    ----------
    variance_factor : float
        Variance of the residuals over that of the model.
    autocorrelation_time : float
        Number of points per effective point.
    low_frequency_time : float
        Autocorrelation time of the lowest frequencies alone: the factor on the covariance of a fit.
    sensor_smooths : bool
        Whether neighbouring errors are correlated, since the sensor smooths along the line.
    """

    variance_factor: float
    autocorrelation_time: float
    low_frequency_time: float
    sensor_smooths: bool


def estimate_arc_noise(normalised: FloatArray, min_variance_factor: float) -> ArcNoise:
    """Estimate the noise of an arc from residuals (n,) over their standard deviations.

    The residuals are those of its middle part, in order along the line. With a
    `min_variance_factor` of 1, a given noise model, errors are taken to be uncorrelated.
    """
    scale = upper_mad_std(normalised)
    factor = max(scale * scale, min_variance_factor)
    if min_variance_factor >= 1:
        return ArcNoise(factor, 1.0, 1.0, sensor_smooths=False)
    limit = SIGNIFICANT_SIGMAS * scale
    clipped = np.minimum(np.maximum(normalised, -limit), limit)
    time, sensor_smooths = neighbour_correlation(clipped, FIT_PARAMETERS)
    if not sensor_smooths:
        return ArcNoise(factor, time, time, sensor_smooths=False)
    low_frequency_time = estimate_correlation(clipped).autocorrelation_time
    return ArcNoise(factor, time, low_frequency_time, sensor_smooths=True)


def apply_smoothing_sensor_noise(
    points: NoisyPoints, normals: ComplexArray, std: float | FloatArray
) -> NoisyPoints:
    """Return the points with the noise of a sensor that smooths along the line.

    Isotropic errors, with the standard deviation `std` (mm; a number, or (k, 1) for a stack of
    arcs) at normal incidence; the variance grows with the angle of the ellipse's unit normals
    (..., n) from +Y.
    """
    incidence_deg = np.degrees(np.arccos(np.minimum(np.maximum(normals.imag, -1.0), 1.0)))
    growth = 1 + (incidence_deg / GRAZING_INCIDENCE_DEG) ** GRAZING_POWER
    variances = std**2 * np.minimum(growth, MAX_INCIDENCE_STD_FACTOR**2)
    return NoisyPoints(points.z, variances, np.zeros(points.z.shape, dtype=complex))


def has_errors_growing_with_incidence(normalised: FloatArray, normals: ComplexArray) -> bool:
    """Return whether the variance of residuals over their stds increases with the incidence.

    Score test of Breusch and Pagan (Econometrica 47, 1979) for a variance that grows with the
    squared sine of the incidence; squared residuals are clipped at 9 times their mean (outliers).
    """
    largest = float(np.abs(normalised).max(initial=0.0))
    if largest == 0.0:
        return False
    inclination = normals.real * normals.real
    inclination -= inclination.sum() / len(inclination)
    squares = (normalised / largest) ** 2
    excess = np.minimum(squares * (len(squares) / squares.sum()), SIGNIFICANT_SIGMAS**2) - 1
    spread = math.sqrt(2 * float(inclination @ inclination))
    return float(inclination @ excess) > MIN_SCORE_SIGMAS * spread


def estimate_arc_correlation(
    residuals: FloatArray, normalised: FloatArray, parameters: FloatArray
) -> Correlation:
    """Return the correlation of the residuals of an ellipse, none if they consist of rounding.

    `residuals` (n,) are in mm, `normalised` (n,) those over their standard deviations;
    `parameters` (5,) are those of the ellipse, see `lsvision.ellipse.parameters`.
    """
    x, y, m = parameters[:3].tolist()
    rounding = MAX_ROUNDING_FRACTION * (math.hypot(x, y) + m)
    if float(residuals @ residuals) <= len(residuals) * rounding * rounding:
        return UNCORRELATED
    return estimate_correlation(normalised)
