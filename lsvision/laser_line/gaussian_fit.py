"""Fit of a Gaussian to each stripe of a laser line.

The fit reaches the Cramer-Rao bound on a Gaussian stripe. Pixels at full scale are left out, so an
overexposed line is located by its flanks, as precisely as a well exposed one. On a line with a
sigma below 1 px, of which the pixels average the flanks, the errors are then 1.5 to 5 times `std`.
A halo of scattered light (15 % of the light, three times as wide) is not in the model: it makes the
flanks of a clipped line wider, and radii are off by 1.7 of their standard deviations (rms).
"""

from dataclasses import replace

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.laser_line.stripe_windows import Stripes, Windows

GAUSS_NEWTON_ITERATIONS = 15
"""Damped Gauss-Newton steps: from the zero crossings 6 suffice, and 15 where pixels are clipped."""
GAUSS_NEWTON_DAMPING = 1e-9
"""Diagonal added to a normal matrix, relative to its trace: it may be singular."""
MAX_SHIFT_PX = 1.0
"""Largest distance of a fitted stripe from its start: beyond it the neighbouring pixel is nearer.
Units: px."""
MIN_PIXELS = 6
"""Smallest number of unsaturated pixels for the four parameters of a Gaussian."""
SIGMA_RATIO_RANGE = (0.4, 4.0)
"""Smallest and largest ratio of fitted to initial sigma; outside of this range the fit has
converged to something other than the stripe."""
MIN_FITTED_WIDTH_PX = 0.4
"""Smallest width of a fitted stripe: a narrower one fits the noise of one or two pixels, and its
errors are two to ten times `std`. A pixel alone blurs by 0.29. Units: px."""
MAX_LAST_STEP_STDS = 0.1
"""Largest last step of a fit that has converged, in standard deviations of the position."""
MAX_CLIPPED_LAST_STEP_STDS = 3.0
"""The same where pixels are clipped: such fits converge slowly, and the stripes at their start are
worse; errors above 5 standard deviations occurred from steps of 12 on."""


def locate_by_gaussian_fit(windows: Windows, start: Stripes, variances: FloatArray) -> Stripes:
    """Locate stripes by weighted least-squares fits of A exp(-(k - m)^2 / 2 q^2) + B.

    Parameters
    ----------
    windows : Windows
        n windows around the line.
    start : Stripes
        Result of `locate_by_derivative` for the same windows.
    variances : (n, w) ndarray
        Read and shot noise of the windows' pixels. Units: DN^2.

    Returns
    -------
    Stripes
        One for each window; NaN where the fit leaves its start or fewer than `MIN_PIXELS` pixels
        are unsaturated. `std` comes from the covariance of the fit. The stripe of `start` where the
        fitted one is narrower than `MIN_FITTED_WIDTH_PX`, or the fit has not converged: its
        `skew_shifts` is NaN.
    """
    usable = start.found & ((~windows.saturated).sum(axis=1) >= MIN_PIXELS)
    stripes = Stripes(
        np.full((len(usable), 2), np.nan), *(np.full(len(usable), np.nan) for _ in range(4))
    )
    if not usable.any():
        return stripes
    # In units of the heights: the damping is relative to a trace of values in DN and pixels, and
    # with 16 bit it would stop the fit of clipped stripes.
    heights, fitted = start.heights[usable], windows.select(usable)
    fitted = replace(fitted, values=fitted.values / heights[:, None])
    variances = variances[usable] / heights[:, None] ** 2
    initial = start.pixels[usable, 1] - fitted.centre_rows
    initial_widths = start.sigmas[usable]
    guess = np.column_stack([np.ones_like(heights), initial, initial_widths, fitted.backgrounds])
    parameters, step, normal_matrices = _fit_gaussians(fitted, guess, variances)
    std = np.sqrt(np.linalg.pinv(normal_matrices, hermitian=True)[:, 1, 1])
    height, position, width, _ = parameters.T
    width_ratio = width / initial_widths
    good = (height > 0) & (np.abs(position - initial) < MAX_SHIFT_PX)
    good &= (width_ratio > SIGMA_RATIO_RANGE[0]) & (width_ratio < SIGMA_RATIO_RANGE[1])
    clipped = fitted.saturated.any(axis=1)
    max_step = np.where(clipped, MAX_CLIPPED_LAST_STEP_STDS, MAX_LAST_STEP_STDS) * std
    unfitted = (np.abs(step[:, 1]) > max_step) | (width < MIN_FITTED_WIDTH_PX)
    good &= ~unfitted
    at = np.flatnonzero(usable)[good]
    stripes.pixels[at, 0] = fitted.columns[good]
    stripes.pixels[at, 1] = (fitted.centre_rows + position)[good]
    stripes.std[at] = std[good]
    stripes.heights[at], stripes.sigmas[at] = (heights * height)[good], width[good]
    shifts = np.where(clipped, _skew_shifts(fitted, position, width, variances), np.nan)
    stripes.skew_shifts[at] = shifts[good]
    at = np.flatnonzero(usable)[unfitted]
    return stripes.replace_at(at, start.select(at))


def _skew_shifts(
    windows: Windows, position: FloatArray, width: FloatArray, variances: FloatArray
) -> FloatArray:
    """Return the shift (n,) of fits by the skewness of their sections, over its third cumulant.

    A section of variance q^2 and third cumulant k is exp(-t^2 / 2) (1 + k (t^3 - 3 t) / 6 q^3) with
    t = (v - m) / q: its flanks move by k (t^2 - 3) / 6 q^2, to the other side than its middle. The
    fit takes the mean of it over the unsaturated pixels, weighted by the square of the model's
    derivative by the position, over the variance. For equal variances and no saturated pixels this
    is -k / 4 q^2, as with a derivative of Gaussian of the same sigma.
    """
    squared = ((windows.offsets - position[:, None]) / width[:, None]) ** 2
    weights = np.where(windows.saturated, 0.0, squared * np.exp(-squared) / variances)
    with np.errstate(invalid="ignore"):
        mean = (weights * (squared - 3)).sum(axis=1) / weights.sum(axis=1)
    shifts: FloatArray = mean / (6 * width**2)
    return shifts


def _fit_gaussians(
    windows: Windows, initial: FloatArray, variances: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the parameters A, m, q, B (n, 4) of the fits, their last step, and normal matrices."""
    weights = np.where(windows.saturated, 0.0, 1 / variances)
    parameters = initial
    for _ in range(GAUSS_NEWTON_ITERATIONS):
        residuals, jacobians = _gaussian_residuals(windows, parameters)
        weighted = jacobians * weights[:, :, None]
        normal_matrices = jacobians.transpose(0, 2, 1) @ weighted
        gradient = np.einsum("nwk,nw->nk", weighted, residuals)
        trace = normal_matrices.trace(axis1=1, axis2=2)[:, None, None]
        normal_matrices += GAUSS_NEWTON_DAMPING * trace * np.eye(4)
        step = np.linalg.solve(normal_matrices, gradient[:, :, None])[:, :, 0]
        # Position and width change by half the width at most, so that the fit stays at its stripe.
        limit = 0.5 * parameters[:, 2]
        step[:, 1:3] = np.clip(step[:, 1:3], -limit[:, None], limit[:, None])
        parameters = parameters + step
    return parameters, step, normal_matrices


def _gaussian_residuals(windows: Windows, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the residuals (n, w), and derivatives (n, w, 4) of the model by A, m, q, B."""
    height, position, width, background = (column[:, None] for column in parameters.T)
    x = (windows.offsets - position) / width
    shape = np.exp(-0.5 * x**2)
    by_position = height * shape * x / width
    jacobians = np.stack([shape, by_position, by_position * x, np.ones_like(shape)], axis=2)
    return windows.values - height * shape - background, jacobians
