"""How much less correlated errors tell than independent ones: the effective number of points.

Real profile sensors smooth along the line and have form errors that many neighbours share. A fit
of five parameters absorbs the lowest frequencies of such errors, so their size is estimated from
the lowest frequencies that it leaves, and from how fast the spectrum rises towards them.
"""

import math
from dataclasses import dataclass

import numpy as np

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
MIN_POINTS = 8
"""Below which no correlation is estimated."""
LAG1_SIGMAS = 3.5
"""Standard errors by which the correlation of neighbours must exceed zero to show a sensor that
smooths along the line: one arc in 4000 by chance."""
LAG_SIGMAS = 2.0
"""Standard errors above which the correlation at a lag counts in the autocorrelation time."""

MAX_ABSORBED_FRACTION = 0.7
"""Share of alike errors that a fit may have taken out of its residuals; beyond it nothing can be
said of their size but that it is larger."""


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
    time, neighbours = neighbour_correlation(normalised)
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
    n = len(normalised)
    # Half waves by the Fourier transform of the residuals and their mirror image.
    waves = np.fft.rfft(np.concatenate([normalised, normalised[::-1]]))[: REFERENCE_BAND.stop]
    powers = (waves.real**2 + waves.imag**2) / (2 * n)
    typical = max(float(normalised @ normalised) / n, TINY)
    low, reference = (float(powers[band].mean()) for band in (LOW_FREQUENCY_BAND, REFERENCE_BAND))
    return low / typical, reference / typical


def neighbour_correlation(normalised: FloatArray) -> tuple[float, bool]:
    """How many neighbours say the same, and whether that is significant.

    Parameters
    ----------
    normalised : (n,) ndarray
        Residuals over their standard deviations, in order along the line.

    Returns
    -------
    time : float
        Autocorrelation time: points over effective points, 1 + 2 sum_k (1 - k / n) rho_k over the
        first lags whose autocorrelation rho_k exceeds 2 / sqrt(n); 1 for independent errors.
    correlated : bool
        rho_1 exceeds 3.5 / sqrt(n): the sensor smooths along the line. Never below 8 points.
    """
    n = len(normalised)
    if n < MIN_POINTS:
        return 1.0, False
    centred = normalised - normalised.sum() / n
    scale = math.sqrt(n) / max(float(centred @ centred), TINY)
    time, correlated = 1.0, False
    for lag in range(1, n // 3):
        sigmas = scale * float(centred[lag:] @ centred[:-lag])
        if lag == 1:
            correlated = sigmas > LAG1_SIGMAS
        if sigmas < LAG_SIGMAS:
            break
        time += 2 * (1 - lag / n) * sigmas / math.sqrt(n)
    return time, correlated


def autocorrelation_time(normalised: FloatArray) -> float:
    """The first of `neighbour_correlation`."""
    return neighbour_correlation(normalised)[0]


def debiased_autocorrelation_time(residuals: FloatArray, parameters: int) -> float:
    """How many points say as much as one whose error is its own.

    Definition: 1 + 2 sum rho_k over the lags k up to the first pair of lags whose sum is not
    above chance (Geyer 1992, initial positive sequence), and then what the fit hides: it lowers
    each rho_k of its residuals by about parameters / n times the result.

    Parameters
    ----------
    residuals : (n,) ndarray
        In order along the line, over their standard deviations.
    parameters : int
        Of the fit.

    Returns
    -------
    float
        At least 1.

    Examples
    --------
    >>> noise = np.random.default_rng(0).normal(size=400)
    >>> debiased_autocorrelation_time(noise, 0) < 1.2
    True
    >>> debiased_autocorrelation_time(np.repeat(noise, 5), 0) > 4
    True
    """
    n = len(residuals)
    power = float(residuals @ residuals)
    if power <= 0:
        return 1.0
    # The autocorrelation of all lags at once; padded so that the ends do not meet.
    spectrum = np.abs(np.fft.rfft(residuals, 2 * n)) ** 2
    rho = np.fft.irfft(spectrum)[: n // 2] / power
    pairs = rho[1:-1:2] + rho[2::2]
    below = np.flatnonzero(pairs <= 2 * np.sqrt(2 / n))
    count = int(below[0]) if len(below) else len(pairs)
    seen = 1 + 2 * float(pairs[:count].sum())
    hidden = 4 * parameters * count / n
    return max(1.0, seen / (1 - min(hidden, MAX_ABSORBED_FRACTION)))
