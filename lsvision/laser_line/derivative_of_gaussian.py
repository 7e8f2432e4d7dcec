"""Sub-pixel place of a stripe: where the derivative-of-Gaussian filter crosses zero.

The default. Within 1.2 of the Cramer-Rao bound as long as the filter's sigma s is about 1 to
1.5 times the stripe's, without bias on a level or evenly curved line.
"""

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.laser_line.stripe_windows import Stripes, Windows

NEWTON_ITERATIONS = 4
"""Newton steps; the fourth moves less than 1e-6 px on any stripe within a px of its start."""
MAX_SHIFT_SIGMAS = 1.2
"""Sigmas that the zero crossing may lie from the maximum it belongs to."""


def locate_by_derivative(
    windows: Windows, start: FloatArray, variances: FloatArray, sigma: float
) -> Stripes:
    """Zero crossings of the filtered windows.

    Parameters
    ----------
    windows : Windows
        About the line.
    start : (n,) ndarray
        Coarse rows. Units: px.
    variances : (n, w) ndarray
        Read and shot noise of the windows' pixels. Units: DN^2.
    sigma : float
        Of the filter. Units: px.

    Returns
    -------
    Stripes
        One for each window.

    Notes
    -----
    F(m) = sum I_k x_k g(x_k), x_k = k - m, g(x) = exp(-x^2 / 2 s^2), is solved for F = 0 by
    Newton's method on the continuous filter, so that no interpolation locks onto pixels. Its
    variance is sum (x_k g(x_k))^2 var_k / F'^2. For a Gaussian stripe of sigma q the share
    -F' / sum I_k g is s^2 / (s^2 + q^2), which gives its width.
    """
    above = windows.background_subtracted
    first = start - windows.centre_rows
    place = first
    for _ in range(NEWTON_ITERATIONS):
        x, weight, slope = _filter(windows, above, place, sigma)
        moment = np.einsum("ij,ij,ij->i", above, x, weight)
        move = moment / np.where(slope < 0, slope, -np.inf)
        place = place - np.clip(move, -sigma, sigma)
    x, weight, slope = _filter(windows, above, place, sigma)
    mass = np.einsum("ij,ij->i", above, weight)
    near = np.abs(place - first) < max(MAX_SHIFT_SIGMAS * sigma, 1.0)
    found = (slope < 0) & (mass > 0) & near
    steep, mass = np.where(found, -slope, np.nan), np.where(found, mass, np.nan)
    noise = np.einsum("ij,ij,ij->i", x**2, weight**2, variances) / steep**2
    share = np.clip(steep / mass, 1e-3, 1 - 1e-3)
    sigmas = sigma * np.sqrt(1 / share - 1)
    heights = mass * np.hypot(sigma, sigmas) / (np.sqrt(2 * np.pi) * sigma * sigmas)
    rows = np.where(found, windows.centre_rows + place, np.nan)
    std = np.hypot(np.sqrt(noise), windows.clipping_std)
    pixels = np.column_stack([windows.columns.astype(np.float64), rows])
    return Stripes(pixels, std, heights, sigmas)


def _filter(
    windows: Windows, above: FloatArray, place: FloatArray, sigma: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Offsets x and weights g of each pixel (n, w), and F' (n,)."""
    x = windows.offsets - place[:, None]
    squared = (x / sigma) ** 2
    weight = np.exp(-0.5 * squared)
    slope = np.einsum("ij,ij,ij->i", above, squared - 1, weight)
    return x, weight, slope
