"""Correction of the shift of a laser line by blur along it."""

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from lsvision.geometry import FloatArray, IntArray
from lsvision.laser_line.line import LaserLine
from lsvision.laser_line.line_shape import (
    POLYNOMIAL_COLUMNS,
    LineShape,
    compute_line_shape,
    find_continuous_runs,
)
from lsvision.laser_line.line_spread import LineSpread, estimate_line_spread
from lsvision.statistics.robust import median

SECOND_ORDER_FACTOR = 2.0
"""Error of the first-order correction, as a multiple of (sum of its terms)^2 / width of the line:
the largest value on noise-free images of pipes whose line becomes vertical."""
SATURATED_SECOND_ORDER_FACTOR = 5.0
"""The same where pixels are clipped: in the flanks that are left, the terms by curvature and by
skewness do not cancel as in the middle, and the error of the curvature near an end counts twice."""
MAX_EDGE_VARIANCE_RATIO = 2.0
"""Largest ratio of the variance of a column at an edge to that by blur; beyond it, the rest of the
variance is taken for an error of the position."""
MAX_VARIANCE_RATIO = 4.0
"""Largest ratio of a column's variance to the median: a larger one has another cause than blur."""


def correct_line_blur(
    line: LaserLine,
    blur: float | None = None,
    sheet_direction: npt.ArrayLike | None = None,
    sheet_growth: float | None = None,
) -> LaserLine:
    """Correct the bias of a laser line by blur along the line.

    Blur mixes each column with its neighbours. Where the line is steep and its light changes, as
    on the flanks of a pipe, the line is shifted towards the brighter neighbour: by 0.01 px halfway
    down a flank and 0.1 px at its foot, to the same side in many columns. The radius of a pipe of
    25 mm becomes 16 um too large, eight times its standard deviation; 3 um are left, and 2 um if
    `sheet_growth` is given.

    Parameters
    ----------
    line : LaserLine
        Result of `extract_laser_line`.
    blur : float, optional
        Standard deviation of the point spread function of lens and pixel; 0 for no correction. By
        default it is estimated from the width of the line, which grows with its slope. Units: px.
    sheet_direction : (2,) array_like, optional
        Direction u, v in the image in which the normal of the laser plane is seen, of any length;
        zeros if it is seen end on. The thickness of the laser sheet blurs along it. By default
        down the columns (or along the rows).
    sheet_growth : float, optional
        Relative change of the thickness of the sheet's image along that direction, by perspective.
        Units: 1 / px.

    Returns
    -------
    LaserLine
        With corrected `pixels`, and `std` increased by the uncertainty of the correction, which
        is largest at the ends of the line and at other edges of its light. Runs of fewer than
        11 points are not corrected.

    Raises
    ------
    ValueError
        If the blur is negative or not finite.

    Notes
    -----
    A Gaussian blur of covariance C changes light M and row v of column u to

        v + C_uu v'' / 2 + (v' C_uu - C_uv) M' / M - 3 v'' (C_uv - v' C_uu)^2 / (2 (q^2 + s^2))

    to the first order. The second term is exact for a straight line, however abrupt the edge of
    the light, if M is the blurred light. The last term is the skewness of the cross-section of
    variance q^2, as the derivative-of-Gaussian filter of sigma s sees it. Where a Gaussian is
    fitted to a saturated line, it is 3 v'' (C_uv - v' C_uu)^2 times
    `LaserLine.skew_shift`: flanks are shifted to the other side than the middle.

    A ridge is located across the line: for it the same holds in coordinates along and across the
    line at each point, where the slope is 0 and blur that is equal in all directions has no C_uv.

    Derivation: blur displaces light by normal deviates d_u, d_v of covariance C. The light in
    column u comes from the column u - d_u and arrives in the row v(u - d_u) + d_v. Its mean row
    E[M(u - d_u) (v(u - d_u) + d_v)] / E[M(u - d_u)], with M and v expanded to the second order, has
    the first two terms. The row's deviation x + v'' d_u^2 / 2, with x = d_v - v' d_u, has the third
    cumulant k = 3 v'' cov(x, d_u)^2, and the maximum of a section of variance q^2 + s^2 lies
    -k / (2 (q^2 + s^2)) from its mean: the last term.

    Examples
    --------
    >>> from lsvision.laser_line.extraction import extract_laser_line
    >>> rows = np.arange(240)[:, None]
    >>> image = 10 + 180 * np.exp(-0.5 * ((rows - 100.25) / 1.5) ** 2) * np.ones(320)
    >>> line = extract_laser_line(image.round().astype(np.uint8))
    >>> bool(np.abs(correct_line_blur(line, 0.7).pixels - line.pixels).max() < 1e-3)
    True
    """
    if blur is not None and not 0 <= blur < math.inf:
        raise ValueError(f"expected blur >= 0 px, got {blur}")
    across = 1 if line.direction == "columns" else 0
    runs = find_continuous_runs(line.pixels[:, across])
    if blur == 0 or not runs:
        return line
    sheet = np.array([0.0, 1.0])  # along and across the line's columns
    if sheet_direction is not None:
        sheet = np.asarray(sheet_direction, dtype=np.float64)[[1 - across, across]]
        sheet = sheet / (math.hypot(*sheet) or 1.0)
    thickening = None
    if sheet_growth is not None:
        along_sheet = line.pixels[:, [1 - across, across]] @ sheet
        middle = median(along_sheet[~np.isnan(along_sheet)])
        thickening = 2 * sheet_growth * (along_sheet - middle)
    # A colour mosaic has a point in every second column: all lengths in steps between points.
    steps = np.diff(line.pixels[:, 1 - across])
    pitch = median(steps[np.isfinite(steps)])
    rows, std, widths = (
        values / pitch for values in (line.pixels[:, across], line.std, line.width)
    )
    blur = None if blur is None else blur / pitch
    pixels, corrected_std = line.pixels.copy(), line.std.copy()
    for run in runs:
        width = widths[run]
        shape = compute_line_shape(rows[run], line.intensity[run] * width, std[run] / width)
        unusable = line.saturated[run] & np.isnan(line.skew_shift[run])
        width_std = np.where(unusable, np.inf, std[run])
        thicker = None if thickening is None else thickening[run]
        spread = estimate_line_spread(width, width_std, shape, blur, sheet, thicker)
        second_order = np.where(
            line.saturated[run], SATURATED_SECOND_ORDER_FACTOR, SECOND_ORDER_FACTOR
        )
        shift, shift_std = (_compute_ridge_shift if line.is_ridge else _compute_shift)(
            shape, spread, width, _find_skew_shift(line, run) * pitch**2, second_order
        )
        pixels[run, across] -= pitch * shift
        corrected_std[run] = pitch * np.hypot(std[run], shift_std)
    return replace(line, pixels=pixels, std=corrected_std)


def _turn_to_line(shape: LineShape, spread: LineSpread) -> tuple[LineShape, LineSpread]:
    """Return shape and blur of a run (n,) in coordinates along and across it at each point.

    The slope is 0 there; `values` (3, n) and `covariance` (n, 3, 3) of the blur are those of each
    point. Light per length of the line is that per column over sqrt(1 + slope^2).
    """
    m = shape.slope
    squared = 1 + m**2
    turn = np.stack(
        [[np.ones_like(m), -2 * m, m**2], [m, 1 - m**2, -m], [m**2, 2 * m, np.ones_like(m)]]
    )
    turn = np.moveaxis(turn / squared, 2, 0)
    turned = LineShape(
        np.zeros_like(m),
        shape.curvature / squared**1.5,
        (shape.fade - m * shape.curvature / squared) / np.sqrt(squared),
        shape.fade_std / np.sqrt(squared),
        shape.edge,
    )
    covariance = turn @ spread.covariance @ turn.transpose(0, 2, 1)
    return turned, LineSpread((turn @ spread.values).T, covariance)


def _find_skew_shift(line: LaserLine, run: IntArray) -> FloatArray:
    """Return the shift (k,) of a run by a skewness, over its third cumulant. Units: 1 / px^2."""
    squared = line.width[run] ** 2
    variance = np.minimum(squared, MAX_VARIANCE_RATIO * median(squared))
    stated = line.skew_shift[run]
    return np.where(np.isnan(stated), -0.5 / (variance + line.filter_sigma**2), stated)


def _compute_ridge_shift(
    shape: LineShape,
    spread: LineSpread,
    width: FloatArray,
    skew_shift: FloatArray,
    second_order: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the result of `_compute_shift` (n,) for a ridge, which is located across the line."""
    turned, turned_spread = _turn_to_line(shape, spread)
    turn = np.sqrt(1 + shape.slope**2)
    shift, std = _compute_shift(turned, turned_spread, width / turn, skew_shift, second_order)
    return turn * shift, turn * std


def _compute_shift(
    shape: LineShape,
    spread: LineSpread,
    width: FloatArray,
    skew_shift: FloatArray,
    second_order: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the shift (n,) of a run by its blur, and its standard deviation. Units: px.

    The blur is that of the run, or of each point (`_turn_to_line`).
    """
    c_vv, c_uv, c_uu = spread.values
    # Minus cov(x, d_u) in the notes of `correct_line_blur`.
    displacement_covariance = shape.slope * c_uu - c_uv
    bend = shape.curvature * c_uu / 2
    fade = displacement_covariance * shape.fade
    by_skewness = 3 * shape.curvature * skew_shift
    skew = by_skewness * displacement_covariance**2
    by_covariance = shape.fade + 2 * by_skewness * displacement_covariance
    gradient = np.stack([-by_covariance, shape.curvature / 2 + shape.slope * by_covariance], axis=1)
    shift = bend + fade + skew
    size = np.abs(bend) + np.abs(fade) + np.abs(skew)
    shift_variance = (
        ((gradient[:, None] @ spread.covariance[..., 1:, 1:])[:, 0] * gradient).sum(axis=1)
        + (displacement_covariance * shape.fade_std) ** 2
        + (second_order * size**2 / width) ** 2
    )
    # These errors are common to the columns of a window, the first one to all of them.
    shift_variance *= POLYNOMIAL_COLUMNS / 2
    # At an edge of a steep line, a column can hold light that is smeared over many rows.
    expected = c_vv - 2 * shape.slope * c_uv + shape.slope**2 * c_uu
    smeared = shape.edge & (width**2 > MAX_EDGE_VARIANCE_RATIO * expected)
    shift_variance += np.where(smeared, width**2 - expected, 0.0)
    return shift, np.sqrt(shift_variance)
