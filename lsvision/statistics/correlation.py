"""How much less correlated errors tell than independent ones: the effective number of points.

Real profile sensors smooth along the line and have errors of form that many neighbours share.
A fit of five parameters hides the slowest of them from its own residuals, so their size is
read off the slow waves just above, and off how fast the spectrum rises towards them.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.shapes import FloatArray

TINY = 1e-300
LOW_FREQUENCY_BAND = slice(4, 12)
"""Half waves along the arc that five parameters do not absorb, and still are slow."""
REFERENCE_BAND = slice(12, 34)
MAX_LOW_FREQUENCY_POWER = 2.75
"""Power of the slow waves, over independent errors', that chance reaches once in 200 arcs."""
LOW_FREQUENCY_DOF = 4.0
"""Degrees of freedom of a variance that is extrapolated from so few waves."""
GRAZING_INCIDENCE_DEG = 45.0
"""Incidence at which a smoothing sensor's error has grown by sqrt(2), the spot lying across an
ever longer stretch of the surface. Units: deg. From the real arcs of spheres: their errors have
the same sign from about 55 deg on."""


LAG1_SIGMAS = 3.5
"""Standard errors by which the correlation of neighbours must exceed zero to tell a sensor that
smooths along the line."""


@dataclass(frozen=True, slots=True)
class Correlation:
    """What correlation does to a covariance.

    Parameters
    ----------
    autocorrelation_time : float
        Points over effective points; 1 for independent errors.
    coloured : bool
        Whether the errors are those of a sensor that smooths along the line: neighbours are
        significantly alike, or slow waves stand out.
    """

    autocorrelation_time: float
    coloured: bool


def estimate_correlation(normalised: FloatArray) -> Correlation:
    """Correlation of the residuals of a fit, in order along the line.

    Parameters
    ----------
    normalised : (n,) ndarray
        Residuals over their standard deviations.

    Returns
    -------
    Correlation
        The factor is what neighbours share, or the power of the slow waves extrapolated to
        those that the fit absorbs, whichever is more; below 40 points the former.
    """
    n = len(normalised)
    centred = _centred(normalised)
    factor = _autocorrelation_time(centred)
    alike = n >= 8 and _autocorrelation(centred, 1) > LAG1_SIGMAS / math.sqrt(n)
    if n < REFERENCE_BAND.stop + 6:
        return Correlation(factor, alike)
    from scipy.fft import dct

    waves = dct(normalised, norm="ortho")
    typical = max(float(normalised @ normalised) / n, TINY)
    slow, following = (
        float(waves[part] @ waves[part]) / (part.stop - part.start) / typical
        for part in (LOW_FREQUENCY_BAND, REFERENCE_BAND)
    )
    if not alike and slow < MAX_LOW_FREQUENCY_POWER:
        return Correlation(factor, coloured=False)
    extrapolated = slow * max(1.0, slow / max(following, TINY))
    return Correlation(max(factor, following, extrapolated), coloured=True)


def autocorrelation_time(normalised: FloatArray) -> float:
    """How many neighbours say the same: points over effective points.

    Definition: 1 + 2 sum_k (1 - k / n) rho_k over the first lags whose autocorrelation rho_k is
    significant (above 2 / sqrt(n)); 1 for independent errors.
    """
    return _autocorrelation_time(_centred(normalised))


def _autocorrelation_time(centred: FloatArray) -> float:
    n = len(centred)
    factor, limit = 1.0, 2 / math.sqrt(max(n, 1))
    for lag in range(1, n // 3 if n >= 8 else 0):
        rho = _autocorrelation(centred, lag)
        if rho < limit:
            break
        factor += 2 * (1 - lag / n) * rho
    return factor


def _centred(values: FloatArray) -> FloatArray:
    centred: FloatArray = values - values.sum() / max(len(values), 1)
    return centred


def _autocorrelation(centred: FloatArray, lag: int) -> float:
    return float(centred[lag:] @ centred[:-lag]) / max(float(centred @ centred), TINY)


def incidence_std_factor(towards: FloatArray) -> FloatArray:
    """Relative error of a smoothing sensor by incidence; 1 where square on. (n,).

    `towards` is the component of the unit normals towards the sensor, +Y.
    """
    incidence = np.degrees(np.arccos(np.clip(towards, -1, 1)))
    stds: FloatArray = np.sqrt(1 + (incidence / GRAZING_INCIDENCE_DEG) ** 8)
    return stds
