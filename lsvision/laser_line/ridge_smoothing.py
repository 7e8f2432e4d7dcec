"""Correction of the shift of Steger's ridge by its own smoothing along the line.

Smoothing by a Gaussian of sigma s moves a line of curvature k along its normal by k s^2 / 2,
inwards. That is v'' s^2 / 2 (1 + v'^2) down the column, of the row v(u). Light that changes along
the line does not shift a ridge, because the smoothing is isotropic.
"""

from dataclasses import replace

import numpy as np

from lsvision.geometry import FloatArray, IntArray, Points
from lsvision.laser_line.line_shape import compute_line_shape, find_continuous_runs
from lsvision.laser_line.noise import SLOPE_SPAN_PX
from lsvision.laser_line.stripe_windows import Stripes

SHIFT_STD_FRACTION = 0.3
"""Standard deviation of the correction over its size: the curvature changes along a flank, and at
an end the smoothing sees one side of the line only. On pipes, 0.05 to 0.15 of the shift is left at
slopes of 0.5 to 1.2, and less elsewhere."""


def correct_ridge_smoothing(columns: IntArray, stripes: Stripes, sigma: float) -> Stripes:
    """Correct n stripes located by Steger's method for their shift inwards.

    Parameters
    ----------
    columns : (n,) ndarray of int
        Columns of the pixels of which the stripes are the nearest ridge points. Units: px.
    stripes : Stripes
        Result of `locate_by_steger`, from left to right.
    sigma : float
        Standard deviation of its smoothing. Units: px.

    Returns
    -------
    Stripes
        With corrected `pixels`, and `std` increased by the uncertainty of the correction. Runs of
        fewer than 11 points are not corrected.
    """
    index = np.full(int(columns.max(initial=0)) + 1, -1)
    found = np.flatnonzero(stripes.found)
    index[columns[found]] = found
    rows = np.full(len(index), np.nan)
    rows[columns[found]] = interpolate_rows_at_columns(stripes.pixels[found], columns[found])
    pixels, std = stripes.pixels.copy(), stripes.std.copy()
    for run in find_continuous_runs(rows):
        at = index[run]
        widths = stripes.widths[at]
        shape = compute_line_shape(rows[run], stripes.heights[at] * widths, std[at] / widths)
        shift = shape.curvature * sigma**2 / (2 * (1 + shape.slope**2))
        pixels[at, 1] -= shift
        std[at] = np.hypot(std[at], SHIFT_STD_FRACTION * shift)
    return replace(stripes, pixels=pixels, std=std)


def interpolate_rows_at_columns(pixels: Points, columns: IntArray) -> FloatArray:
    """Return the rows (n,) of the line at whole columns, from ridge points up to 1 px beside."""
    index, last = np.arange(len(pixels)), len(pixels) - 1
    before, after = np.maximum(index - SLOPE_SPAN_PX, 0), np.minimum(index + SLOPE_SPAN_PX, last)
    du, dv = (pixels[after] - pixels[before]).T
    slopes = np.divide(dv, du, out=np.zeros_like(dv), where=np.abs(du) > 1)
    rows: FloatArray = pixels[:, 1] - slopes * (pixels[:, 0] - columns)
    return rows
