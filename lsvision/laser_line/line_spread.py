"""Blur of a laser line along it and across, from its own width.

Two effects blur a line: the point spread of lens and pixel, the same in all directions, and the
thickness of the laser sheet, which spreads each point of the line in the direction in which the
normal of the laser plane (of a pipe: its axis) is seen. Down a column, a line of slope m has the
variance C_vv - 2 m C_uv + m^2 C_uu, with the covariance C of both: a line that is level in one
place and steep in another determines C. Where it has one slope only, C is hardly determined, but
then it hardly affects the correction.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.laser_line.line_shape import LineShape
from lsvision.statistics.robust import mad_std, median

CLEARANCE = 3
"""Distance from an edge or end in columns beyond which the width of a line is undisturbed. Units:
px."""
LEVEL_QUANTILE = 0.2
"""Quantile of the variances perpendicular to the line that is that of its narrow parts."""
STATED_STD = 0.1
"""Relative standard deviation of the variance of a stated blur (5 % of its sigma)."""
UNSTATED_FRACTION = 0.4
"""Fraction of lens and pixel in the variance of a narrow line where no blur is stated."""
SPREAD_STD, TILT_STD, ALONG_STD = 1.0, 0.4, 0.3
"""Standard deviations of C_vv, C_uv and C_uu before the widths are used, over the line's variance:
a pipe's axis is tilted from the laser plane's normal by an unknown angle."""
SHEET_STD = 0.02
"""Standard deviation of the sheet's part of C_uu that follows from C_uv, over C_vv."""
CONSTRAINT_STEPS = 3
"""Number of linearisations of the constraint that a stated blur is."""
MIN_ACROSS = 0.05
"""Smallest squared sine between line and sheet's direction from which the sheet is estimated."""
UNDETERMINED_FRACTION = 0.5
"""Standard deviation over that of the prior, above which the widths determine too little: the prior
is kept, and its uncertainty."""
REWEIGHTINGS = 4
TUKEY_SIGMAS = 4.7
"""Residual beyond which a width has no weight."""
MIN_NOISE_FACTOR = 0.1
"""Smallest noise of the widths over the one that is stated for them."""
MODEL_ERROR = 0.1
"""Error of each value over C_vv because the sheet is seen nearer, thus thicker, on top of a pipe
than on its flanks; from noise-free images."""


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
) -> LineSpread:
    """Estimate the blur of a run of a line from its width in each column.

    Parameters
    ----------
    width : (n,) ndarray
        Standard deviation of the line's cross-section. Units: px.
    width_std : (n,) ndarray
        Standard deviation of `width` up to a common factor; infinite where it is not to be used.
        Units: px.
    shape : LineShape
        Local shape of the line at the same points.
    blur : float, optional
        Standard deviation of the point spread of lens and pixel, if measured. Units: px.
    sheet : (2,) ndarray
        Direction u, v in which the normal of the laser plane is seen: a unit vector, or zeros.
    """
    usable = np.isfinite(width_std) & shape.far_from_edges(CLEARANCE)
    variances, slope = width[usable] ** 2, shape.slope[usable]
    if not len(variances):
        return LineSpread(np.zeros(3), np.zeros((3, 3)))
    prior, prior_std = _prior(variances, slope, blur, sheet)
    design = np.stack([np.ones_like(slope), -2 * slope, slope**2], axis=1)
    scale = 2 * width[usable] * width_std[usable]
    design, target = design / scale[:, None], variances / scale
    values: FloatArray = prior
    prior_information = np.diag(1 / prior_std**2)
    for _ in range(REWEIGHTINGS):
        residuals = target - design @ values
        std = max(mad_std(residuals), MIN_NOISE_FACTOR)
        weights = np.maximum(1 - (residuals / (TUKEY_SIGMAS * std)) ** 2, 0.0) ** 2 / std**2
        weighted = design.T * weights
        covariance = np.asarray(np.linalg.inv(weighted @ design + prior_information))
        values = covariance @ (weighted @ target + prior_information @ prior)
    undetermined = np.sqrt(covariance.diagonal()) > UNDETERMINED_FRACTION * prior_std
    values = np.where(undetermined, prior, values)
    spread = LineSpread(values, covariance + np.diag([(MODEL_ERROR * values[0]) ** 2] * 3))
    return spread if blur is None else _with_stated_blur(spread, blur)


def _with_stated_blur(spread: LineSpread, blur: float) -> LineSpread:
    """Return the weighted mean of an estimate and the stated blur (a Kalman filter step).

    The sheet spreads light along one direction: without the blur B of lens and pixel, C is of rank
    one, C_uu - B = C_uv^2 / (C_vv - B). C_uv and C_vv are as uncertain as C_uu: they change, too.
    """
    values, P = spread.values, spread.covariance
    for _ in range(CONSTRAINT_STEPS):
        c_vv, c_uv, c_uu = values
        sheet = max(c_vv - blur**2, UNSTATED_FRACTION * c_vv)
        row = np.array([(c_uv / sheet) ** 2, -2 * c_uv / sheet, 1.0])
        variance = (STATED_STD * blur**2) ** 2 + (SHEET_STD * c_vv) ** 2
        gain = P @ row / (row @ P @ row + variance)
        missing = blur**2 - (c_uu - c_uv**2 / sheet)
        values = spread.values + gain * (missing - row @ (spread.values - values))
    covariance: FloatArray = P - np.outer(gain, row @ P)
    return LineSpread(values, covariance)


def _prior(
    variances: FloatArray, slope: FloatArray, blur: float | None, sheet: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the spread (3,) that is assumed before the widths are used, and its stds."""
    ordered = np.sort(variances / (1 + slope**2))
    place = LEVEL_QUANTILE * (len(ordered) - 1)
    narrow = float(np.interp(place, np.arange(len(ordered)), ordered))
    lens = UNSTATED_FRACTION * narrow if blur is None else min(blur**2, narrow)
    u, v = sheet
    across = np.maximum((v - slope * u) ** 2, MIN_ACROSS)
    thickness = max(median((variances - lens * (1 + slope**2)) / across), 0.0)
    values = lens * np.array([1.0, 0.0, 1.0]) + thickness * np.array([v * v, u * v, u * u])
    scale = max(narrow, thickness)
    return values, scale * np.array([SPREAD_STD, TILT_STD, ALONG_STD])
