"""Fit of a Gaussian to each stripe of a laser line.

The fit reaches the Cramer-Rao bound on a Gaussian stripe. Pixels at full scale are left out, so an
overexposed line is located by its flanks, as precisely as a well exposed one. On a line with a
sigma below 1 px the pixels average the flanks, which `SAMPLING_STD_PX` adds to `std`.
Where the residuals show that the flanks of a clipped line are not those of a Gaussian, as with a
halo of scattered light, it is not fitted.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from lsvision.geometry import BoolArray, FloatArray
from lsvision.laser_line.stripe_windows import Stripes, Windows
from lsvision.statistics.robust import median

GAUSS_NEWTON_ITERATIONS = 15
"""Largest number of damped Gauss-Newton steps: 3 to 5 are usual, 7 where pixels are clipped."""
USUAL_ITERATIONS = 7
"""Steps after which the finished fits of clipped stripes are judged: most have converged then."""
CONVERGED_STEP_PX = 1e-4
"""Step of position and width below which a fit has converged: the next one is far smaller. Units:
px."""
SQUARE_COEFFICIENT_RANGE, MAX_CONSTANT_COEFFICIENT = (-0.5, 0.2), 0.7
"""Coefficients of x^2 and of 1 that are added at most to the logarithm of a Gaussian in a step: its
width changes by a factor of 0.7 to 1.3. Larger steps lead away from a faint stripe."""
HANKEL = np.add.outer(np.arange(3), np.arange(3))
"""Order of the moment of S^2 in each element of the normal matrix."""
UNIT_POSITION = np.array([[0.0], [1.0], [0.0], [0.0]])
"""Right side whose solution is the column of the covariance that belongs to the position."""
GAUSS_NEWTON_DAMPING = 1e-9
"""Diagonal added to a normal matrix, relative to its trace: it may be singular."""
MAX_SHIFT_PX = 1.0
"""Largest distance of a fitted stripe from its start: beyond it the neighbouring pixel is nearer.
Units: px."""
MIN_PIXELS = 6
"""Smallest number of unsaturated pixels for the four parameters of a Gaussian."""
WIDTH_RATIO_RANGE = (0.4, 4.0)
"""Smallest and largest ratio of fitted to initial sigma; outside of this range the fit has
converged to something other than the stripe. Strongly saturated stripes start too wide: with 0.56
the fits of a line of 6 times full scale are lost."""
MIN_FITTED_WIDTH_PX = 0.4
"""Smallest width of a fitted stripe: a narrower one fits the noise of one or two pixels, and its
errors are two to ten times `std`. A pixel alone blurs by 0.29. Units: px."""
SAMPLING_STD_PX, SAMPLING_WIDTH_PX, SAMPLING_DECAY_PX = 0.01, 0.5, 0.1
"""Standard deviation of the position of a stripe of 0.5 px because pixels integrate its light, and
the increase in width by which it falls to 1 / e. The mean squared normalised error of lines of 0.58
and 0.66 px is 0.9 to 1.0, without it 1.1 to 1.4, and at full scale, too. Units: px."""
MIN_FLANK_LIGHT_FRACTION, MIN_FLANK_LIGHT_SIGMAS = 0.02, 3.0
"""Smallest light of the pixel beside a plateau of saturated ones, over the height of the line, and
in its standard deviations."""
MODEL_ERROR_FRACTION = 0.01
"""Error of the model of a clipped stripe over its height, which limits the weights of its tails: a
section that is no Gaussian differs most from it there. With 0.7 and 1.4 times this error the mean
squared normalised error of saturated lines is 0.96 and 0.90 instead of 0.93."""
MAX_NORMALISED_RMS, TOLERATED_RESIDUAL_FRACTION = 1.15, 0.003
"""Largest residual of clipped stripes (median of rms) with which their sections are taken for
Gaussians, over their noise and a residual, over the height, that sections of pipes have. Measured:
0.8 to 1.1, and 1.0 to 2.4 with a halo of 15 % of the light."""
MAX_LAST_STEP_SIGMAS = 0.1
"""Largest last step of a fit that has converged, in standard deviations of the position."""
MAX_CLIPPED_LAST_STEP_SIGMAS = 3.0
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
        fitted one is narrower than `MIN_FITTED_WIDTH_PX`, a saturated one has no light beside its
        plateau, the fit has not converged, or the residuals of most saturated ones exceed
        `MAX_NORMALISED_RMS`: its `skew_shifts` is NaN.
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
    noise = variances[usable] / heights[:, None] ** 2
    clipped = fitted.saturated.any(axis=1)
    variances = noise + np.where(clipped, MODEL_ERROR_FRACTION**2, 0.0)[:, None]
    initial = start.pixels[usable, 1] - fitted.centre_rows
    initial_widths = start.widths[usable]
    guess = np.stack([np.ones_like(heights), initial, initial_widths, fitted.backgrounds])
    unknown = np.full(len(heights), np.inf)
    fits = _Fits(guess, unknown, unknown, np.full(len(heights), True))
    fits = _fit_gaussians(fitted, fits, variances, USUAL_ITERATIONS)
    if clipped.all() and _cannot_be_gaussians(fitted, fits, guess, noise):
        return stripes.replace_at(np.flatnonzero(usable), start.select(usable))
    remaining = GAUSS_NEWTON_ITERATIONS - USUAL_ITERATIONS
    fits = _fit_gaussians(fitted, fits, variances, remaining)
    good, valid = _are_near_start(fits, guess), _are_valid(fitted, fits, noise)
    if not _are_gaussians(_compute_reduced_chi2(fitted, fits, noise, clipped & good & valid)):
        valid &= ~clipped
    found = _build_stripes(fitted, fits, noise, variances)
    found = replace(found, heights=heights * found.heights).select(good & valid)
    stripes = stripes.replace_at(np.flatnonzero(usable)[good & valid], found)
    kept = usable.copy()
    kept[usable] = ~valid
    return stripes.replace_at(np.flatnonzero(kept), start.select(kept))


@dataclass(frozen=True, eq=False)
class _Fits:
    """Fits of n Gaussians, in units of the heights of the stripes that they start from.

    Parameters
    ----------
    parameters : (4, n) ndarray
        A, m (in px from the central pixel), q (in px) and B.
    last_step, std : (n,) ndarray
        Last change of m, and its standard deviation. Units: px.
    moving : (n,) ndarray of bool
        Whether a fit has not converged.
    """

    parameters: FloatArray
    last_step: FloatArray
    std: FloatArray
    moving: BoolArray


def _build_stripes(
    windows: Windows, fits: _Fits, noise: FloatArray, variances: FloatArray
) -> Stripes:
    """Return the fits as n stripes, with heights relative to those that they start from.

    `variances` (n, w) are those by which the fits were weighted, `noise` those of the pixels.
    """
    height, position, width, _ = fits.parameters
    weights = _compute_position_weights(windows, position, width, variances)
    std = fits.std * np.sqrt(_compute_weighted_mean(noise / variances, weights))
    clipped = windows.saturated.any(axis=1)
    sampling = SAMPLING_STD_PX * np.exp((SAMPLING_WIDTH_PX - width) / SAMPLING_DECAY_PX)
    std = np.hypot(std, sampling)
    skew = ((windows.offsets - position[:, None]) / width[:, None]) ** 2 - 3
    shifts = np.where(clipped, _compute_weighted_mean(skew, weights) / (6 * width**2), np.nan)
    pixels = np.column_stack([windows.columns, windows.centre_rows + position])
    return Stripes(pixels, std, height, width, shifts)


def _are_near_start(fits: _Fits, initial: FloatArray) -> BoolArray:
    """Return whether each fit (n,) has stayed near its start, the parameters `initial` (4, n)."""
    height, position, width, _ = fits.parameters
    ratio = width / initial[2]
    near = (height > 0) & (np.abs(position - initial[1]) < MAX_SHIFT_PX)
    near &= (ratio > WIDTH_RATIO_RANGE[0]) & (ratio < WIDTH_RATIO_RANGE[1])
    return np.asarray(near)


def _are_valid(windows: Windows, fits: _Fits, noise: FloatArray) -> BoolArray:
    """Return whether each fit (n,) has converged to a stripe with flanks, not too narrow a one."""
    clipped = windows.saturated.any(axis=1)
    max_step = np.where(clipped, MAX_CLIPPED_LAST_STEP_SIGMAS, MAX_LAST_STEP_SIGMAS) * fits.std
    converged = np.abs(fits.last_step) <= np.maximum(max_step, CONVERGED_STEP_PX)
    wide = fits.parameters[2] >= MIN_FITTED_WIDTH_PX
    valid: BoolArray = converged & wide & _have_light_beside_plateau(windows, noise)
    return valid


def _compute_reduced_chi2(
    windows: Windows, fits: _Fits, noise: FloatArray, which: BoolArray
) -> FloatArray:
    """Return the mean squares (k,) of the residuals over their noise, of the fits of a mask (n,).

    `values` of the windows are relative to the heights, and so are the variances `noise`.
    """
    windows, noise = windows.select(which), noise[which]
    height, position, width, background = fits.parameters[:, which, None]
    x = (windows.offsets - position) / width
    residuals = windows.values - height * np.exp(-0.5 * x**2) - background
    free = np.maximum((~windows.saturated).sum(axis=1) - len(fits.parameters), 1)
    relative = np.where(
        windows.saturated, 0.0, residuals**2 / (noise + TOLERATED_RESIDUAL_FRACTION**2)
    )
    reduced_chi2: FloatArray = relative.sum(axis=1) / free
    return reduced_chi2


def _are_gaussians(reduced_chi2: FloatArray) -> bool:
    """Return whether noise explains the reduced chi^2 (k,) of most fits; True for no fits."""
    return not len(reduced_chi2) or math.sqrt(median(reduced_chi2)) < MAX_NORMALISED_RMS


def _cannot_be_gaussians(
    windows: Windows, fits: _Fits, initial: FloatArray, noise: FloatArray
) -> bool:
    """Return whether clipped stripes are no Gaussians, whatever the unfinished fits will yield.

    False if all fits have finished.
    """
    unfinished = np.count_nonzero(fits.moving)
    if not unfinished:
        return False
    which = ~fits.moving & _are_near_start(fits, initial) & _are_valid(windows, fits, noise)
    reduced_chi2 = _compute_reduced_chi2(windows, fits, noise, which)
    return not _are_gaussians(np.append(reduced_chi2, np.zeros(unfinished)))


def _have_light_beside_plateau(windows: Windows, variances: FloatArray) -> BoolArray:
    """Return whether the pixels beside the plateau of saturated ones have light on both sides (n,).

    `values` of the windows are relative to the heights, and so are the `variances`. True without
    saturated pixels. Without that light the section is a bar, to which no Gaussian fits.
    """
    last = len(windows.offsets) - 1
    before = np.maximum(windows.saturated.argmax(axis=1) - 1, 0)
    after = last - np.maximum(windows.saturated[:, ::-1].argmax(axis=1) - 1, 0)
    ends = np.stack([before, after], axis=1)
    light = np.take_along_axis(windows.values, ends, axis=1) - windows.backgrounds[:, None]
    noise = np.sqrt(np.take_along_axis(variances, ends, axis=1))
    smallest = np.maximum(MIN_FLANK_LIGHT_FRACTION, MIN_FLANK_LIGHT_SIGMAS * noise)
    lit: BoolArray = (light - smallest).min(axis=1) > 0
    return lit | ~windows.saturated.any(axis=1)


def _compute_position_weights(
    windows: Windows, position: FloatArray, width: FloatArray, variances: FloatArray
) -> FloatArray:
    """Return the weights (n, w) of the pixels in the position of a fit.

    A section of variance q^2 and third cumulant k is exp(-t^2 / 2) (1 + k (t^3 - 3 t) / 6 q^3) with
    t = (v - m) / q: its flanks move by k (t^2 - 3) / 6 q^2, to the other side than its middle. The
    fit takes the mean of it over the unsaturated pixels, weighted by the square of the model's
    derivative by the position, over the variance. For equal variances and no saturated pixels this
    is -k / 4 q^2, as with a derivative of Gaussian of the same sigma.
    """
    squared = ((windows.offsets - position[:, None]) / width[:, None]) ** 2
    return np.where(windows.saturated, 0.0, squared * np.exp(-squared) / variances)


def _compute_weighted_mean(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the weighted mean (n,) of values (n, w); NaN where no weight is positive."""
    with np.errstate(invalid="ignore"):
        mean: FloatArray = (weights * values).sum(axis=1) / weights.sum(axis=1)
    return mean


def _fit_gaussians(windows: Windows, fits: _Fits, variances: FloatArray, iterations: int) -> _Fits:
    """Continue the moving ones of fits, each until it has converged, by at most `iterations`."""
    moving = np.flatnonzero(fits.moving)
    if not len(moving):
        return fits
    weights = np.where(windows.saturated.T, 0.0, 1 / variances.T).take(moving, axis=1)
    values = windows.values.T.take(moving, axis=1)
    sums = np.stack([weights.sum(axis=0), np.einsum("wn,wn->n", weights, values)])
    powers = windows.offsets.astype(np.float64) ** np.arange(5)[:, None]
    parameters, last_step, std = fits.parameters.copy(), fits.last_step.copy(), fits.std.copy()
    for _ in range(iterations):
        if not len(moving):
            break
        current = parameters.take(moving, axis=1)
        step, std[moving] = _compute_gauss_newton_step(powers, values, weights, sums, current)
        parameters[:, moving] = changed = _change_logarithm(current, step)
        moved = np.abs(changed - current)[1:3]
        last_step[moving] = moved[0]
        unfinished = np.flatnonzero(~(moved < CONVERGED_STEP_PX).all(axis=0))
        if len(unfinished) < len(moving):
            moving = moving[unfinished]
            values, weights, sums = (
                array.take(unfinished, axis=1) for array in (values, weights, sums)
            )
    still_moving = np.zeros(len(std), dtype=bool)
    still_moving[moving] = True
    return _Fits(parameters, last_step, std, still_moving)


def _compute_gauss_newton_step(
    powers: FloatArray,
    values: FloatArray,
    weights: FloatArray,
    sums: FloatArray,
    parameters: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the step (4, n) of n fits, and the std of their positions (n,).

    A step is a change of the logarithm of the Gaussian by c0 + c1 x + c2 x^2, with x = (k - m) / q,
    and of B. The derivatives of the model by A c0, A c1, A c2 and B are S, S x, S x^2 and 1, with
    S = exp(-x^2 / 2): the normal equations consist of moments of S and S^2 over the pixels.
    `powers` (5, w) are those of the pixels' offsets, `values` and `weights` are (w, n), and `sums`
    (2, n) are those of the weights and of the weighted values.
    """
    height, position, width, background = parameters
    # In place: new arrays of this size take more time than what is computed in them.
    products = np.empty((3, *values.shape))
    second, first, light = products
    np.subtract(powers[1][:, None], position, out=second)
    second /= width
    np.exp(np.multiply(np.square(second, out=second), -0.5, out=second), out=second)
    np.multiply(weights, second, out=first)
    second *= first
    np.multiply(first, values, out=light)
    second, first, light = _compute_moments(products, powers, position, width)
    first, light = first[:3], light[:3]
    system = np.empty((4, 6, len(position)))
    system[:3, :3] = second[HANKEL]
    system[:3, 3] = system[3, :3] = first
    system[3, 3] = sums[0]
    system[:3, 4] = light - height * second[:3] - background * first
    system[3, 4] = sums[1] - height * first[0] - background * sums[0]
    system[:, 5] = UNIT_POSITION
    diagonal = system.reshape(-1, len(position))[::7]  # every seventh of 4 x 6 elements
    diagonal += GAUSS_NEWTON_DAMPING * diagonal.sum(axis=0)
    step, covariance = np.moveaxis(_solve(system), 1, 0)
    step[:3] /= height
    return step, np.sqrt(covariance[1]) * np.abs(width / height)


def _change_logarithm(parameters: FloatArray, step: FloatArray) -> FloatArray:
    """Return the parameters (4, n) after a step.

    A parabola is added to the logarithm of each Gaussian. That of a flank is nearly linear in the
    parabola's coefficients, but not in m and q: half the number of steps suffices.
    """
    height, position, width, background = parameters
    constant, linear, square = step[:3]
    narrowing = 1 - 2 * _clip(square, *SQUARE_COEFFICIENT_RANGE)
    # The position moves by half the width at most, so that the fit stays at its stripe.
    shift = _clip(linear / narrowing, -0.5, 0.5)
    growth = (
        _clip(constant, -MAX_CONSTANT_COEFFICIENT, MAX_CONSTANT_COEFFICIENT)
        + 0.5 * narrowing * shift**2
    )
    return np.stack(
        [
            height * np.exp(growth),
            position + width * shift,
            width / np.sqrt(narrowing),
            background + step[3],
        ]
    )


def _clip(values: FloatArray, low: float, high: float) -> FloatArray:
    """Return values (n,) limited to a range: `np.clip` takes three times as long for few values."""
    limited: FloatArray = np.minimum(np.maximum(values, low), high)
    return limited


def _compute_moments(
    weights: FloatArray, powers: FloatArray, position: FloatArray, width: FloatArray
) -> FloatArray:
    """Return the sums (k, 5, n) over the pixels of k weights (k, w, n) times powers of x."""
    moments: FloatArray = powers @ weights
    last = len(powers) - 1
    for done in range(last):
        moments[:, done + 1 :] -= position * moments[:, done:last]
    squared = width * width
    moments /= np.stack([np.ones_like(width), width, squared, squared * width, squared * squared])
    return moments


def _solve(system: FloatArray) -> FloatArray:
    """Return the solutions (k, j, n) of n positive definite systems, matrix beside right sides."""
    size = len(system)
    for k in range(size):
        # Columns up to k are those of the unit matrix now and are not read again.
        row = system[k, k + 1 :] / system[k, k]
        system[:, k + 1 :] -= system[:, k, None] * row
        system[k, k + 1 :] = row
    return system[:, size:]
