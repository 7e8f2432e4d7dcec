"""Two filters that locate a laser line to a fraction of a pixel; each returns `Stripes`.

Zero crossing of the derivative of Gaussian (the default)
    Standard deviation at most 1.2 times the Cramer-Rao bound where the filter's sigma s is 1 to 1.5
    times the stripe's; no bias on a level or evenly curved line.
Steger's ridge
    For lines that columns and rows both cut at grazing angles. Smooths along the line as well,
    which shifts a curve inwards (`ridge_smoothing` corrects it) and correlates the errors of
    neighbours: their residuals are half as large although a fit to them is no better.
"""

import itertools
import math
from functools import lru_cache

import numpy as np

from lsvision.geometry import FloatArray, IntArray
from lsvision.laser_line.image_array import Image
from lsvision.laser_line.stripe_windows import END_PIXELS, Stripes, Windows

NEWTON_ITERATIONS = 4
"""Newton steps; the fourth moves less than 1e-6 px on any stripe within 1 px of its start."""
MAX_SHIFT_SIGMAS = 1.2
"""Largest distance of a zero crossing from its coarse row, in sigmas of the filter. In 10 cluttered
images 121 columns are lost and 101 false; with 0.84 142 and 80, with 1.68 67 and 155, and edges of
boxes are taken for a line."""
MIN_SHIFT_LIMIT_PX = 1.0
"""Smallest value of that limit, for narrow filters: coarse rows are accurate to about half a pixel.
Units: px."""
MIN_SIGMA_PX = 0.1
"""Smallest sigma with which the derivative filter is computed: it has a single pixel already, and
the exponentials of a narrower filter overflow. Units: px."""
WIDTH_RATIO_MARGIN = 1e-3
"""Margin from 0 and 1 of the ratio that gives a stripe's width, which would be infinite or 0."""
TABULATED_WIDTH_RATIOS = (0.3, 2.6, 50)
"""Smallest and largest width of a stripe over sigma of the filter for which the part of its tails
in the background is tabulated, and number of values."""
MEDIAN_COLUMNS = 7
"""Number of neighbouring columns whose median width gives the correction for the tails; 15 columns
would smooth the widths at steep ends of a line."""
MAX_SHIFT_PX = 1.0
"""Largest distance of a ridge point from its pixel: beyond it the neighbouring pixel is nearer.
Units: px."""
PADDED_RIDGE_SIGMAS = 2.5
"""Distance from the left and right border, in sigmas of the smoothing, below which the values
substituted for the missing pixels shift a ridge."""
MARGIN_SIGMAS = 5.0
"""Rows around the line that are smoothed, in sigmas of the smoothing."""


def locate_by_derivative(
    windows: Windows, start: FloatArray, variances: FloatArray, sigma: float
) -> Stripes:
    """Locate stripes at the zero crossings of the derivative of Gaussian.

    Parameters
    ----------
    windows : Windows
        n windows around the line.
    start : (n,) ndarray
        Coarse rows. Units: px.
    variances : (n, w) ndarray
        Read and shot noise of the windows' pixels. Units: DN^2.
    sigma : float
        Sigma of the filter. Units: px.

    Returns
    -------
    Stripes
        One for each window; NaN where the zero crossing is not that of a bright stripe, or lies too
        far from the start. `std` is along v.

    Notes
    -----
    F(m) = sum I_k x_k g(x_k), x_k = k - m, g(x) = exp(-x^2 / 2 s^2), is solved for F = 0 by
    Newton's method on the continuous filter, so the result is not biased towards pixel centres, as
    by interpolation. Its variance is sum (x_k g(x_k))^2 var_k / F'^2. For a Gaussian stripe of
    sigma q the ratio -F' / sum I_k g is s^2 / (s^2 + q^2), which gives its width; of a wide one
    the tails are part of the background, for which `_compute_tail_factors` corrects.
    """
    offsets, sigma = windows.offsets, max(sigma, MIN_SIGMA_PX)
    gaussian = np.exp(-0.5 * (offsets[:, None] / sigma) ** 2)
    weighted = (windows.values.T - windows.backgrounds) * gaussian
    initial = start - windows.centre_rows
    position = _find_zero_crossings(weighted, offsets, initial, sigma)
    shift_factors = _compute_shift_factors(offsets, position, sigma)
    # The factor that `_compute_shift_factors` leaves out.
    scale = np.exp((offsets[0] - position / 2) * position / sigma**2)
    filtered_light, _, second_moment = _compute_moments(
        weighted * shift_factors * scale, offsets, position
    )
    slope = second_moment / sigma**2 - filtered_light
    near = np.abs(position - initial) < max(MAX_SHIFT_SIGMAS * sigma, MIN_SHIFT_LIMIT_PX)
    located = (slope < 0) & (filtered_light > 0) & near
    steepness, filtered_light = (
        np.where(located, -slope, np.nan),
        np.where(located, filtered_light, np.nan),
    )
    _, _, second_moment = _compute_moments(
        (gaussian * shift_factors) ** 2 * variances.T, offsets, position
    )
    variance = second_moment * (scale / steepness) ** 2
    width_ratio = np.clip(steepness / filtered_light, WIDTH_RATIO_MARGIN, 1 - WIDTH_RATIO_MARGIN)
    width_factor, light_factor = _compute_tail_factors(width_ratio, offsets, sigma)
    widths = sigma * np.sqrt(1 / width_ratio - 1) * width_factor
    heights = (
        light_factor
        * filtered_light
        * np.hypot(sigma, widths)
        / (np.sqrt(2 * np.pi) * sigma * widths)
    )
    rows = np.where(located, windows.centre_rows + position, np.nan)
    std = np.hypot(np.sqrt(variance), windows.compute_clipping_std(sigma, steepness))
    pixels = np.column_stack([windows.columns.astype(np.float64), rows])
    return Stripes(pixels, std, heights, widths, np.full(len(std), np.nan))


def _find_zero_crossings(
    weighted: FloatArray, offsets: IntArray, initial: FloatArray, sigma: float
) -> FloatArray:
    """Return the zero crossings m (n,) of F by Newton's method; `weighted` is I_k g(k), (w, n)."""
    position = initial
    for _ in range(NEWTON_ITERATIONS):
        weights = weighted * _compute_shift_factors(offsets, position, sigma)
        filtered_light, first_moment, second_moment = _compute_moments(weights, offsets, position)
        slope = second_moment / sigma**2 - filtered_light
        step = first_moment / np.where(slope < 0, slope, -np.inf)
        position = position - np.clip(step, -sigma, sigma)
    return position


def _compute_tail_factors(
    width_ratio: FloatArray, offsets: IntArray, sigma: float
) -> tuple[FloatArray, FloatArray]:
    """Return factors (n,) on width and filtered light that correct for tails in the background.

    The background is the mean of a window's ends. Where it contains t times the stripe's height, it
    lowers the sum of I_k g by t sqrt(s^2 + q^2) / q and does not change F': for a stripe 1.5 times
    as wide as the filter t is 6 to 10 %, and the sum 7 to 12 % too small. Without the correction, a
    steep part of a line would seem to have less light than its neighbours. The factors follow from
    the median width of neighbouring columns: they do not amplify the noise of single widths.
    """
    from scipy.ndimage import median_filter

    if len(offsets) <= 2 * END_PIXELS:  # the whole window is background
        return np.ones_like(width_ratio), np.ones_like(width_ratio)
    ratios, width_factors, light_factors = _tabulate_tail_factors(len(offsets) // 2, sigma)
    found = np.isfinite(width_ratio)
    smooth = np.ones_like(width_ratio)
    if found.any():
        smooth[found] = median_filter(width_ratio[found], MEDIAN_COLUMNS, mode="nearest")
    width_factor = np.interp(smooth, ratios, width_factors)
    return width_factor, np.interp(smooth, ratios, light_factors)


@lru_cache
def _tabulate_tail_factors(half_width: int, sigma: float) -> tuple[FloatArray, ...]:
    """Return ascending ratios of widths (k,) with the factors of `_compute_tail_factors`."""
    widths = sigma * np.linspace(*TABULATED_WIDTH_RATIOS)
    ends = np.arange(half_width - END_PIXELS + 1, half_width + 1)
    tails = np.exp(-0.5 * (ends[:, None] / widths) ** 2).mean(axis=0)
    kept = 1 - tails * np.hypot(sigma, widths) / widths
    ratios = sigma**2 / (sigma**2 + widths**2) / kept
    apparent_widths = sigma * np.sqrt(1 / ratios - 1)
    return ratios[::-1], (widths / apparent_widths)[::-1], 1 / kept[::-1]


def _compute_shift_factors(offsets: IntArray, position: FloatArray, sigma: float) -> FloatArray:
    """Return factors (w, n) that convert g(k) into g(k - m), up to one factor for each window.

    g(k - m) = g(k) exp(k m / s^2) exp(-m^2 / 2 s^2): powers of exp(m / s^2), here from the first
    pixel on, take a quarter of the time of exponentials.
    """
    factor = np.exp(position / sigma**2)
    shift_factors = np.ones((len(offsets), len(position)))
    for before, after in itertools.pairwise(shift_factors):
        np.multiply(before, factor, out=after)
    return shift_factors


def _compute_moments(
    weights: FloatArray, offsets: IntArray, position: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the sums (n,) over pixels of weights (w, n), of weights times x, and times x^2."""
    zeroth, first, second = np.array([np.ones(len(offsets)), offsets, offsets**2]) @ weights
    by_x = first - position * zeroth
    return zeroth, by_x, second - position * (first + by_x)


def locate_by_steger(
    image: Image, windows: Windows, start: Stripes, variances: FloatArray, sigma: float
) -> Stripes:
    """Locate the ridge points of the smoothed image next to stripes.

    Parameters
    ----------
    image : (height, width) ndarray
        Signal of the laser. Units: DN.
    start : Stripes
        Result of `locate_by_derivative`.
    windows, variances, sigma
        As for `locate_by_derivative`.

    Returns
    -------
    Stripes
        One for each window; NaN near the left and right border, and where the ridge lies more than
        `MAX_SHIFT_PX` from the pixel. Neither u nor v of a ridge point is a whole number. `std` is
        along v at constant u, as for the other methods.

    Notes
    -----
    Taylor expansion about a pixel, along the line's normal: the eigenvector n of the Hessian's
    most negative eigenvalue, the ridge lies at t = -(g . n) / (n' H n). Each component of the
    gradient of white noise, smoothed by a 2-D Gaussian, has the variance var / (8 pi s^4).

    References
    ----------
    Steger, "An unbiased detector of curvilinear structures", IEEE PAMI 20 (1998).
    """
    coarse = np.where(start.found, start.pixels[:, 1], windows.centre_rows)
    rows = np.clip(np.rint(coarse), 0, len(image) - 1).astype(np.int64)
    gradient, hessian = _compute_derivatives(image, windows.columns, rows, sigma)
    curvatures, eigenvectors = np.linalg.eigh(hessian)
    normals, curvature = eigenvectors[:, :, 0], curvatures[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = -np.einsum("ij,ij->i", gradient, normals) / curvature
        # The median is that of the background; of the stripe's shot noise a half is assumed.
        variance = np.median(variances, axis=1) + 0.5 * variances.max(axis=1)
        std = np.sqrt(variance / (8 * math.pi * sigma**4)) / np.abs(curvature * normals[:, 1])
        # The expansion's own error on a Gaussian section: g / H = x / (1 - x^2 / (s^2 + q^2)).
        offset *= 1 - offset**2 / (sigma**2 + start.widths**2)
    steepness = np.sqrt(2 * np.pi) * sigma**3 * np.abs(curvature)
    std = np.hypot(std, windows.compute_clipping_std(sigma, steepness))
    shift = offset[:, None] * normals
    border_distance = np.minimum(windows.columns, image.shape[1] - 1 - windows.columns)
    good = (
        start.found
        & (border_distance >= PADDED_RIDGE_SIGMAS * sigma)
        & (curvature < 0)
        & (np.abs(shift) < MAX_SHIFT_PX).all(axis=1)
    )
    pixels = np.column_stack([windows.columns, rows]) + shift
    return Stripes(
        np.where(good[:, None], pixels, np.nan),
        np.where(good, std, np.nan),
        start.heights,
        start.widths,
        start.skew_shifts,
    )


def _compute_derivatives(
    image: Image, columns: IntArray, rows: IntArray, sigma: float
) -> tuple[FloatArray, FloatArray]:
    """Return the gradient (n, 2) and Hessian (n, 2, 2) of the smoothed image by u and v."""
    from scipy.ndimage import gaussian_filter
    from skimage.feature import hessian_matrix

    margin = math.ceil(MARGIN_SIGMAS * sigma)
    low = max(int(rows.min()) - margin, 0)
    band = image[low : int(rows.max()) + margin + 1].astype(np.float64)
    at = rows - low, columns
    # Derivatives by row and column of the array, that is by v and u.
    by_vv, by_uv, by_uu = hessian_matrix(
        band, sigma=sigma, mode="nearest", order="rc", use_gaussian_derivatives=True
    )
    by_u = gaussian_filter(band, sigma, order=(0, 1), mode="nearest")[at]
    by_v = gaussian_filter(band, sigma, order=(1, 0), mode="nearest")[at]
    hessian = np.stack([by_uu[at], by_uv[at], by_uv[at], by_vv[at]], axis=1).reshape(-1, 2, 2)
    return np.column_stack([by_u, by_v]), hessian
