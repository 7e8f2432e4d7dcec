"""How much less correlated errors tell than independent ones: the effective number of points.

Real profile sensors smooth along the line and have form errors that many neighbours share. A fit
of five parameters absorbs the lowest frequencies of such errors, so their size is estimated from
the lowest frequencies that it leaves, and from how fast the spectrum rises towards them.
"""

import math
from dataclasses import dataclass

from lsvision.geometry import FloatArray

TINY = 1e-300
LOW_FREQUENCY_BAND = slice(4, 8)
"""Half waves along the arc that five parameters do not absorb, the lowest four."""
REFERENCE_BAND = slice(12, 34)
"""Half waves with which the lowest are compared."""
MIN_WAVES = REFERENCE_BAND.stop + 6
"""Points below which there is no reference band."""
LOW_FREQUENCY_DOF = float(LOW_FREQUENCY_BAND.stop - LOW_FREQUENCY_BAND.start)
"""Degrees of freedom of a variance that is estimated from the low-frequency band."""
MAX_LOW_FREQUENCY_POWER = 2.786
"""Mean power of the low-frequency band, over that of independent errors, that chance exceeds once
in 40 arcs: the 97.5 % quantile of chi^2 with 4 degrees of freedom over 4."""
MAX_SMOOTHED_RISE = 2.0
"""A sensor that smooths attenuates the reference band too: the rise towards low frequencies then
counts no more than this. Without the limit the interval of smoothed data is far too wide, without
the rise one real sphere in ten has an interval of phi that does not reach 0."""
LAG1_SIGMAS = 3.5
"""Standard errors by which the correlation of neighbours must exceed zero to show a sensor that
smooths along the line: one arc in 4000 by chance."""
LAG_SIGMAS = 2.0
"""Standard errors above which the correlation at a lag counts in the autocorrelation time."""


@dataclass(frozen=True, slots=True)
class Correlation:
    """What correlation does to a covariance.

    Parameters
    ----------
    autocorrelation_time : float
        Points over effective points; 1 for independent errors.
    coloured : bool
        Whether `autocorrelation_time` rests on the low-frequency band, and so on its few degrees
        of freedom: neighbours are correlated, or the lowest frequencies stand out.
    neighbours_correlated : bool
        Whether neighbours are significantly correlated: a sensor that smooths along the line.
    """

    autocorrelation_time: float
    coloured: bool
    neighbours_correlated: bool


def estimate_correlation(normalised: FloatArray) -> Correlation:
    """Correlation of the residuals of a fit, in order along the line.

    Parameters
    ----------
    normalised : (n,) ndarray
        Residuals over their standard deviations.

    Returns
    -------
    Correlation
        Below 40 points neighbours alone are compared.
    """
    n = len(normalised)
    centred = _centred(normalised)
    time = _autocorrelation_time(centred)
    neighbours = neighbours_correlated(normalised)
    if n < MIN_WAVES:
        return Correlation(time, neighbours, neighbours)
    low, reference = _band_powers(normalised)
    if not neighbours and low < MAX_LOW_FREQUENCY_POWER:
        return Correlation(time, coloured=False, neighbours_correlated=False)
    rise = max(low / max(reference, TINY), 1.0)
    if neighbours:
        rise = min(rise, MAX_SMOOTHED_RISE)
    return Correlation(max(time, reference, low * rise), True, neighbours)


def _band_powers(normalised: FloatArray) -> tuple[float, float]:
    """Mean power of the low-frequency and reference bands, over that of independent errors."""
    from scipy.fft import dct

    waves = dct(normalised, norm="ortho")
    typical = max(float(normalised @ normalised) / len(normalised), TINY)
    bands = (waves[LOW_FREQUENCY_BAND], waves[REFERENCE_BAND])
    low, reference = (float(band @ band) / len(band) / typical for band in bands)
    return low, reference


def neighbours_correlated(normalised: FloatArray) -> bool:
    """Whether neighbours are significantly correlated: a sensor that smooths along the line.

    Parameters
    ----------
    normalised : (n,) ndarray
        Residuals over their standard deviations, in order along the line; never below 8.
    """
    n = len(normalised)
    return n >= 8 and _autocorrelation(_centred(normalised), 1) > LAG1_SIGMAS / math.sqrt(n)


def autocorrelation_time(normalised: FloatArray) -> float:
    """How many neighbours say the same: points over effective points.

    Definition: 1 + 2 sum_k (1 - k / n) rho_k over the first lags whose autocorrelation rho_k is
    significant (above 2 / sqrt(n)); 1 for independent errors.
    """
    return _autocorrelation_time(_centred(normalised))


def _autocorrelation_time(centred: FloatArray) -> float:
    n = len(centred)
    time, limit = 1.0, LAG_SIGMAS / math.sqrt(max(n, 1))
    for lag in range(1, n // 3 if n >= 8 else 0):
        rho = _autocorrelation(centred, lag)
        if rho < limit:
            break
        time += 2 * (1 - lag / n) * rho
    return time


def _centred(values: FloatArray) -> FloatArray:
    centred: FloatArray = values - values.sum() / max(len(values), 1)
    return centred


def _autocorrelation(centred: FloatArray, lag: int) -> float:
    return float(centred[lag:] @ centred[:-lag]) / max(float(centred @ centred), TINY)
