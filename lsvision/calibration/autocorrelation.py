"""How much less a profile's points tell where neighbours err alike.

Written apart from `lsvision.statistics`: a calibration does not rest on what it is to calibrate.
"""

import numpy as np

from lsvision.geometry import FloatArray

MAX_ABSORBED_FRACTION = 0.7
"""Share of alike errors that a fit may have taken out of its residuals; beyond it nothing can be
said of their size but that it is larger."""


def autocorrelation_time(residuals: FloatArray, parameters: int) -> float:
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
    >>> autocorrelation_time(noise, 0) < 1.2, autocorrelation_time(np.repeat(noise, 5), 0) > 4
    (True, True)
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
