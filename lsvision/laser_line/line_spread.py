"""Covariance of the blur of a laser line, from its width in the image.

Two effects blur a line: the point spread of lens and pixel, which is isotropic, and the thickness
of the laser sheet, which blurs each point along the image direction of the laser plane's normal (on
a pipe along its axis). Let C be the covariance of both effects together. The intensity along a
column of a line of slope m then has the variance C_vv - 2 m C_uv + m^2 C_uu: a line with parts of
different slope determines C. A line of one slope hardly determines C, but then C hardly affects the
correction.

The image of the sheet is thicker where the camera is nearer, as at the top of a pipe. Without a
parameter of its own this would be taken for a C_uu below zero, and pipes would become too large.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.laser_line.line_shape import LineShape
from lsvision.statistics.robust import mad_std, median

MIN_EDGE_DISTANCE_PX = 3
"""Distance in columns from an edge or end beyond which the width of a line is not disturbed. Units:
px."""
NARROW_QUANTILE = 0.2
"""Quantile of the variances perpendicular to the line that is taken for its narrow parts."""
STATED_VARIANCE_STD_FRACTION = 0.1
"""Relative standard deviation of the variance of a stated blur, whose sigma is known to 5 %."""
UNSTATED_BLUR_FRACTION = 0.4
"""Fraction of a narrow line's variance that is assumed for lens and pixel if no blur is stated."""
C_VV_STD_FRACTION, C_UV_STD_FRACTION, C_UU_STD_FRACTION = 1.0, 0.4, 0.3
"""Prior standard deviations of C_vv, C_uv and C_uu, relative to the line's variance: a pipe's axis
is tilted from the laser plane's normal by an unknown angle."""
SHEET_STD_FRACTION = 0.02
"""Standard deviation, over C_vv, of the sheet's part of C_uu as it follows from C_uv and C_vv."""
CONSTRAINT_ITERATIONS = 3
"""Number of times that the constraint by a stated blur is linearised."""
MIN_SQUARED_SINE = 0.05
"""Lower limit of the squared sine between the line and the direction of the sheet's blur, by which
the estimate of that blur is divided."""
UNDETERMINED_FRACTION = 0.5
"""Ratio of a standard deviation to that of the prior above which the prior value is kept, since the
widths hardly determine it."""
REWEIGHTING_ITERATIONS = 4
"""Number of iterations of the robust fit to the widths."""
TUKEY_SIGMAS = 4.7
"""Residual, in standard deviations, from which on a width has no weight."""
MIN_NOISE_FACTOR = 0.1
"""Smallest ratio of the widths' estimated noise to `width_std`."""
MIN_WIDTH_STD_RATIO = 1e-4
"""Smallest `width_std` over width: with a smaller one, the equations of a straight line without
noise are singular."""
THICKENING_STD = 0.7
"""Prior standard deviation of the thickening of the sheet's image over that of a surface along the
plane's normal: 0.5 to 1.4 on pipes tilted by up to 40 deg, and the sheet's blur itself is estimated
to 30 % only."""
MODEL_ERROR_FRACTION, UNKNOWN_THICKENING_ERROR_FRACTION = 0.03, 0.1
"""Error of each value relative to C_vv, with and without a stated thickening of the sheet's image;
from noise-free images."""


@dataclass(frozen=True, eq=False)
class LineSpread:
    """Covariance of the blur of a line, in the order C_vv, C_uv, C_uu; u runs along the line.

    Parameters
    ----------
    values : (3,) ndarray
        Estimated variances. Units: px^2.
    covariance : (3, 3) ndarray
        Covariance of `values`. Units: px^4.
    """

    values: FloatArray
    covariance: FloatArray


def estimate_line_spread(
    width: FloatArray,
    width_std: FloatArray,
    shape: LineShape,
    blur: float | None,
    sheet: FloatArray,
    thickening: FloatArray | None,
) -> LineSpread:
    """Estimate the blur of a run of a line from its width in each column, all (n,) in px.

    `width_std` is the standard deviation of `width` up to a common factor, infinite where it is not
    to be used; `blur` that of the point spread of lens and pixel, if measured. `sheet` (2,) is the
    direction u, v in which the normal of the laser plane is seen, a unit vector or zeros, and
    `thickening` the relative change of the variance of the sheet's blur from that in the middle of
    the line.

    If no width is usable, as of a saturated line to which no Gaussian is fitted, the result is the
    prior with its wide uncertainty. If edges disturb all columns it is zero, which means no
    correction.
    """
    undisturbed = shape.is_far_from_edges(MIN_EDGE_DISTANCE_PX)
    if not undisturbed.any():
        return LineSpread(np.zeros(3), np.zeros((3, 3)))
    usable = np.isfinite(width_std) & undisturbed
    if not usable.any():
        prior, prior_std, _ = _build_prior(
            width[undisturbed] ** 2, shape.slope[undisturbed], blur, sheet
        )
        spread = LineSpread(prior[:3], np.diag(prior_std[:3] ** 2))
        return spread if blur is None else _apply_stated_blur(spread, blur)
    variances, slope = width[usable] ** 2, shape.slope[usable]
    prior, prior_std, thickness = _build_prior(variances, slope, blur, sheet)
    u, v = sheet
    thicker = np.zeros(len(slope)) if thickening is None else thickening[usable]
    sheet_change = thickness * thicker * (v - slope * u) ** 2
    design = np.stack([np.ones_like(slope), -2 * slope, slope**2, sheet_change], axis=1)
    scale = 2 * np.maximum(width_std[usable], MIN_WIDTH_STD_RATIO * width[usable]) * width[usable]
    design, target = design / scale[:, None], variances / scale
    values: FloatArray = prior
    prior_information = np.diag(1 / prior_std**2)
    for _ in range(REWEIGHTING_ITERATIONS):
        residuals = target - design @ values
        std = max(mad_std(residuals), MIN_NOISE_FACTOR)
        weights = np.maximum(1 - (residuals / (TUKEY_SIGMAS * std)) ** 2, 0.0) ** 2 / std**2
        weighted = design.T * weights
        covariance = np.asarray(np.linalg.inv(weighted @ design + prior_information))
        values = covariance @ (weighted @ target + prior_information @ prior)
    undetermined = np.sqrt(covariance.diagonal()) > UNDETERMINED_FRACTION * prior_std
    values, covariance = np.where(undetermined, prior, values)[:3], covariance[:3, :3]
    values[2] = max(values[2], 0.0)  # no variance is negative
    error = UNKNOWN_THICKENING_ERROR_FRACTION if thickening is None else MODEL_ERROR_FRACTION
    spread = LineSpread(values, covariance + np.diag([(error * values[0]) ** 2] * 3))
    return spread if blur is None else _apply_stated_blur(spread, blur)


def _apply_stated_blur(spread: LineSpread, blur: float) -> LineSpread:
    """Return the weighted mean of an estimate and the stated blur (a Kalman filter step).

    The sheet spreads light along one direction: without the blur B of lens and pixel, C is of rank
    one, C_uu - B = C_uv^2 / (C_vv - B). C_uv and C_vv are as uncertain as C_uu: they change, too.
    """
    values, P = spread.values, spread.covariance
    for _ in range(CONSTRAINT_ITERATIONS):
        c_vv, c_uv, c_uu = values
        sheet = max(c_vv - blur**2, UNSTATED_BLUR_FRACTION * c_vv)
        row = np.array([(c_uv / sheet) ** 2, -2 * c_uv / sheet, 1.0])
        variance = (STATED_VARIANCE_STD_FRACTION * blur**2) ** 2 + (SHEET_STD_FRACTION * c_vv) ** 2
        gain = P @ row / (row @ P @ row + variance)
        innovation = blur**2 - (c_uu - c_uv**2 / sheet)
        values = spread.values + gain * (innovation - row @ (spread.values - values))
    covariance: FloatArray = P - np.outer(gain, row @ P)
    return LineSpread(values, covariance)


def _build_prior(
    variances: FloatArray, slope: FloatArray, blur: float | None, sheet: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Return prior values (4,), their stds (4,), and the variance of the sheet's blur.

    The values are C_vv, C_uv, C_uu, and the factor on the thickening of the sheet's image. The
    narrow parts of the line give the blur of lens and pixel, its median width that of the sheet.
    """
    ordered = np.sort(variances / (1 + slope**2))
    position = NARROW_QUANTILE * (len(ordered) - 1)
    narrow = float(np.interp(position, np.arange(len(ordered)), ordered))
    lens = UNSTATED_BLUR_FRACTION * narrow if blur is None else min(blur**2, narrow)
    u, v = sheet
    squared_sine = np.maximum((v - slope * u) ** 2, MIN_SQUARED_SINE)
    thickness = max(median((variances - lens * (1 + slope**2)) / squared_sine), 0.0)
    values = lens * np.array([1.0, 0.0, 1.0]) + thickness * np.array([v * v, u * v, u * u])
    stds = max(narrow, thickness) * np.array(
        [C_VV_STD_FRACTION, C_UV_STD_FRACTION, C_UU_STD_FRACTION]
    )
    return np.append(values, 1.0), np.append(stds, THICKENING_STD), thickness
