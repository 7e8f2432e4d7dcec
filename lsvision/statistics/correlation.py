"""Autocorrelation of residuals along a line: the effective number of points.

Profile sensors smooth along the line and have form errors that many neighbours share. A fit absorbs
the lowest frequencies of such errors, so that the residuals are less correlated than the errors.
`estimate_correlation` estimates the correlation of the errors after a five-parameter fit from the
lowest frequencies that such a fit does not absorb; `debiased_autocorrelation_time` corrects for any
number of parameters.

Frequencies are the indices k of the cosine transform: the number of half waves along the arc.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.geometry.arrays import TINY

LOW_FREQUENCY_BAND = slice(4, 8)
"""Frequencies 4 to 7 (half waves along the arc): the lowest that five parameters do not absorb."""
FORM_BAND = slice(4, 6)
"""Frequencies 4 and 5, which are large for a shape that is not an ellipse, such as an arc of two
radii."""
LOW_FREQUENCY_DOF = float(LOW_FREQUENCY_BAND.stop - LOW_FREQUENCY_BAND.start)
"""Degrees of freedom of a variance estimated from the low-frequency band."""
MAX_LOW_FREQUENCY_POWER = 2.786
"""Largest mean power of the low-frequency band, over that of uncorrelated errors: the 97.5 %
quantile of chi^2 with 4 degrees of freedom over 4 (exceeded by chance in one of 40 arcs)."""
REFERENCE_BAND = slice(12, 34)
"""Frequencies whose power is the reference for that of the low frequencies."""
_LOW_ROWS = slice(0, LOW_FREQUENCY_BAND.stop - LOW_FREQUENCY_BAND.start)
_FORM_ROWS = slice(0, FORM_BAND.stop - FORM_BAND.start)
_REFERENCE_ROWS = slice(_LOW_ROWS.stop, None)
"""Rows of the bands in a transform to the frequencies of the low and the reference band."""
MIN_SPECTRUM_POINTS = REFERENCE_BAND.stop
"""Smallest number of points whose spectrum contains the reference band."""
MAX_SMOOTHED_RISE = 1.5
"""Largest ratio of low-frequency power to reference power that is used for a sensor that smooths,
since smoothing attenuates the reference band, too. With 2, 2 % of smoothed arcs do not determine
their radius, with 1.5 1 %; with 1, errors correlated over 6 points have 95 % intervals that contain
the radius in 79 to 89 % of the arcs, with 1.5 in 90 to 94 %. Of 125 real spheres, whose sections
are circles, the interval of phi contains 0 in 96 %, with 1 in 94 %."""
MIN_POINTS = 8
"""Number of points below which no correlation is estimated."""
FIT_PARAMETERS = 5
"""Number of parameters of the fit of an ellipse."""
LAG1_SIGMAS = 3.0
"""Standard errors by which the correlation of neighbours must exceed that of uncorrelated errors to
show a sensor that smooths along the line: exceeded by chance in one of 1000 arcs."""
LAG_SIGMAS = 2.0
"""Standard errors above which the correlation at a lag counts in the autocorrelation time."""

MAX_ABSORBED_FRACTION = 0.7
"""Largest fraction of correlated errors that a fit is assumed to have absorbed; beyond it the
residuals only give a lower limit."""


@dataclass(frozen=True)
class Correlation:
    """Effect of correlation on a covariance.

    Parameters
    ----------
    autocorrelation_time : float
        Number of points per effective point; 1 for uncorrelated errors.
    degrees_of_freedom : float
        Degrees of freedom of `autocorrelation_time`: those of the low-frequency band (4) if
        neighbours are correlated or the power of that band is significantly above that of
        uncorrelated errors; infinite otherwise.
    neighbours_correlated : bool
        Whether neighbours are significantly correlated: a sensor that smooths along the line.
    """

    autocorrelation_time: float
    degrees_of_freedom: float
    neighbours_correlated: bool


UNCORRELATED = Correlation(1.0, math.inf, neighbours_correlated=False)
"""Independent errors: each point is an effective one."""


def estimate_correlation(normalised: FloatArray) -> Correlation:
    """Estimate the correlation of the residuals of a fit, in order along the line.

    `normalised` are residuals (n,) over their standard deviations. Below 34 points
    (`MIN_SPECTRUM_POINTS`) the result is that of `neighbour_correlation` alone, with the same
    degrees of freedom if neighbours are correlated.
    """
    time, neighbours = neighbour_correlation(normalised, FIT_PARAMETERS)
    if len(normalised) < MIN_SPECTRUM_POINTS:
        dof = LOW_FREQUENCY_DOF if neighbours else math.inf
        return Correlation(time, dof, neighbours)
    low, form, reference = _compute_band_powers(normalised)
    if not neighbours:
        if low < MAX_LOW_FREQUENCY_POWER:
            return Correlation(time, math.inf, neighbours_correlated=False)
        low = max(low, form)  # a form error may be in the lowest two frequencies alone
    # The power of a band, over that of uncorrelated errors, estimates the autocorrelation time. It
    # may increase further below the lowest band: it is extrapolated by the same ratio.
    rise = max(low / max(reference, TINY), 1.0)
    if neighbours:
        rise = min(rise, MAX_SMOOTHED_RISE)
    return Correlation(max(time, reference, low * rise), LOW_FREQUENCY_DOF, neighbours)


def _compute_band_powers(normalised: FloatArray) -> tuple[float, float, float]:
    """Return the mean powers of the low-frequency, form and reference band.

    They are relative to those of uncorrelated errors with the same sum of squares.
    """
    transform = _compute_cosines(len(normalised)) @ normalised
    scale = 2 / max(float(normalised @ normalised), TINY)
    parts = transform[_LOW_ROWS], transform[_FORM_ROWS], transform[_REFERENCE_ROWS]
    low, form, reference = (scale * float(part @ part) / len(part) for part in parts)
    return low, form, reference


@lru_cache(maxsize=256)
def _compute_cosines(count: int) -> FloatArray:
    """Return the cosine transform to the frequencies of the bands, (26, n).

    For the few frequencies of the bands it is faster than a Fourier transform.
    """
    bands = LOW_FREQUENCY_BAND, REFERENCE_BAND
    frequencies = np.concatenate([np.arange(band.start, band.stop) for band in bands])
    return np.cos(np.outer(frequencies, np.arange(0.5, count)) * (math.pi / count))


def neighbour_correlation(normalised: FloatArray, parameters: int) -> tuple[float, bool]:
    """Return the autocorrelation time, and whether neighbours are significantly correlated.

    `normalised` are residuals (n,) over their standard deviations, in order along the line,
    `parameters` the number of parameters of their fit. The time is the number of points per
    effective point, 1 + 2 sum_k (1 - k / n) rho_k over the first lags whose autocorrelation rho_k
    exceeds 2 / sqrt(n); 1 for uncorrelated errors. Neighbours are correlated if rho_1 exceeds
    -parameters / n, its mean for uncorrelated errors, by 3 / sqrt(n): the sensor smooths along the
    line. Never below 8 points.
    """
    n = len(normalised)
    if n < MIN_POINTS:
        return 1.0, False
    centred = normalised - normalised.sum() / n
    scale = math.sqrt(n) / max(float(centred @ centred), TINY)
    smallest, time = LAG1_SIGMAS - parameters / math.sqrt(n), 1.0
    for lag in range(1, n // 2):
        sigmas = scale * float(centred[lag:] @ centred[:-lag])
        if sigmas < smallest:
            break
        time += 2 * (1 - lag / n) * sigmas / math.sqrt(n)
        smallest = LAG_SIGMAS
    return time, time > 1


def autocorrelation_time(normalised: FloatArray) -> float:
    """Return the autocorrelation time of `neighbour_correlation`.

    Not corrected for the parameters of a fit: too small for strongly correlated residuals of a fit
    (7.7 instead of 10.0 for 400 points and 3 parameters), where `debiased_autocorrelation_time`
    gives 9.8. The latter is less precise: there its standard deviation is twice as large.
    """
    return neighbour_correlation(normalised, 0)[0]


def debiased_autocorrelation_time(residuals: FloatArray, parameters: int) -> float:
    """Return the autocorrelation time of residuals, at least 1, corrected for their fit.

    Definition: 1 + 2 sum rho_k over the lags k < n / 2 up to the first pair of lags whose sum is
    not significant (Geyer 1992, initial positive sequence), divided by the fraction that the fit
    has not absorbed: a fit decreases each rho_k of its residuals by about parameters / n times the
    result. The mean is not subtracted: a fit has absorbed it. The residuals (n,) are in order along
    the line and divided by their standard deviations.

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
    # Autocorrelation at all lags by FFT, zero-padded against wrap-around.
    spectrum = np.abs(np.fft.rfft(residuals, 2 * n)) ** 2
    rho = np.fft.irfft(spectrum)[: n // 2] / power
    pairs = rho[1:-1:2] + rho[2::2]
    insignificant = np.flatnonzero(pairs <= 2 * np.sqrt(2 / n))
    count = int(insignificant[0]) if len(insignificant) else len(pairs)
    time = 1 + 2 * float(pairs[:count].sum())
    absorbed = 4 * parameters * count / n  # 2 sum over 2 count lags, parameters / n each
    return max(1.0, time / (1 - min(absorbed, MAX_ABSORBED_FRACTION)))
