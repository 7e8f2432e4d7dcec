"""Sub-pixel place of a stripe: fit of a Gaussian to each column.

Reaches the Cramer-Rao bound on a Gaussian stripe. Pixels at full scale are left out, so that
an overexposed line is measured by its flanks, as precisely as a well exposed one.
"""

import numpy as np

from lsvision.geometry import BoolArray, FloatArray
from lsvision.laser_line.stripe_windows import Stripes, Windows

GAUSS_NEWTON_ITERATIONS = 10
"""Damped Gauss-Newton steps; from the filter's places six suffice."""
MAX_SHIFT_PX = 1.0
"""px that the fit may move from its start."""
MIN_PIXELS = 6
"""Unsaturated pixels that four unknowns need."""
SIGMA_RATIO_RANGE = (0.4, 4.0)
"""Range of the stripe's sigma, in multiples of its start, that still is the same stripe."""


def locate_by_gaussian_fit(windows: Windows, start: Stripes, variances: FloatArray) -> Stripes:
    """Gaussians A exp(-(k - m)^2 / 2 q^2) + B, fitted by weighted least squares.

    Parameters
    ----------
    windows : Windows
        About the line.
    start : Stripes
        Of `locate_by_derivative`, for the same windows.
    variances : (n, w) ndarray
        Read and shot noise of the windows' pixels. Units: DN^2.

    Returns
    -------
    Stripes
        One for each window; none where the fit leaves its start or too few pixels are
        unsaturated. `std` is that of the fit's covariance.
    """
    usable = start.found & ((~windows.saturated).sum(axis=1) >= MIN_PIXELS)
    stripes = Stripes(
        np.full((len(usable), 2), np.nan), *(np.full(len(usable), np.nan) for _ in range(3))
    )
    if not usable.any():
        return stripes
    chosen = windows.select(usable)
    first = start.pixels[usable, 1] - chosen.centre_rows
    values, bends = _fit(chosen, first, start, usable, variances)
    covariances = np.linalg.pinv(bends, hermitian=True)
    height, place, width, _ = values.T
    width_start = start.sigmas[usable]
    good = (height > 0) & (np.abs(place - first) < MAX_SHIFT_PX)
    good &= (width > SIGMA_RATIO_RANGE[0] * width_start) & (
        width < SIGMA_RATIO_RANGE[1] * width_start
    )
    at = np.flatnonzero(usable)[good]
    stripes.pixels[at, 0] = chosen.columns[good]
    stripes.pixels[at, 1] = (chosen.centre_rows + place)[good]
    stripes.std[at] = np.sqrt(covariances[good, 1, 1])
    stripes.heights[at], stripes.sigmas[at] = height[good], width[good]
    return stripes


def _fit(
    windows: Windows,
    first: FloatArray,
    start: Stripes,
    usable: BoolArray,
    variances: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Parameters (n, 4) A, m, q, B and the normal matrices (n, 4, 4) at them."""
    weights = np.where(windows.saturated, 0.0, 1 / variances[usable])
    surroundings = windows.values - windows.background_subtracted
    values = np.column_stack(
        [start.heights[usable], first, start.sigmas[usable], surroundings[:, 0]]
    )
    for _ in range(GAUSS_NEWTON_ITERATIONS):
        residuals, jacobians = _residuals(windows, values)
        weighted = jacobians * weights[:, :, None]
        bends = jacobians.transpose(0, 2, 1) @ weighted
        pull = np.einsum("nwk,nw->nk", weighted, residuals)
        bends += 1e-9 * bends.trace(axis1=1, axis2=2)[:, None, None] * np.eye(4)
        step = np.linalg.solve(bends, pull[:, :, None])[:, :, 0]
        limit = 0.5 * values[:, 2]
        step[:, 1:3] = np.clip(step[:, 1:3], -limit[:, None], limit[:, None])
        values = values + step
    return values, bends


def _residuals(windows: Windows, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residuals (n, w), and derivatives (n, w, 4) of the model by A, m, q, B."""
    height, place, width, level = (column[:, None] for column in values.T)
    x = (windows.offsets - place) / width
    shape = np.exp(-0.5 * x**2)
    by_place = height * shape * x / width
    jacobians = np.stack([shape, by_place, by_place * x, np.ones_like(shape)], axis=2)
    return windows.values - height * shape - level, jacobians
