"""Windows of pixels around a laser line, one for each column, and the stripes located in them."""

import math
from dataclasses import dataclass, fields

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.laser_line.image_array import Image
from lsvision.laser_line.line_image import LineImage

HALF_WIDTH_SIGMAS = 3.5
"""Half width of a window in standard deviations of the filter."""
CLIPPING_ALIAS = 0.12
"""Standard deviation of the filtered light by the sampling of a clipped stripe, over the filter's
weight at the ends of its plateau times the largest step between two pixels. Each end is a corner,
whose first alias in the sum over pixels has the amplitude slope / (2 pi^2): the rms of both is 0.07
times the slope. The slope is 1 to 3 times that step, of which a clipped pixel hides a part: 1.7 is
used. On stripes of 1.2 to 12 times full scale, errors are 0.3 to 2.1 times the result."""
STEEP_STEP_FRACTIONS, STEEP_ALIAS = (0.6, 0.85), 0.27
"""Largest step between two pixels over the height of the stripe from which a plateau of one pixel
has a larger factor, and from which it has the one stated: the whole flank of such a thin line lies
within a pixel. Measured: 0.09 at 0.55, 0.13 at 0.65, 0.19 at 0.75, 0.27 from 0.85 on; 0.16 at most
for wider plateaus."""
HARD_EDGE_ALIAS = 0.41
"""The same where the light falls from full scale to the background from one pixel to the next, as
in an image of two values: each end lies anywhere within a pixel, with an rms of 0.29."""
HARD_EDGE_STEP_FRACTION = 0.95
"""Largest step between two pixels over the height of the stripe above which its ends are so."""
END_PIXELS = 2
"""Pixels at each end of a window whose mean is its background."""


@dataclass(frozen=True, eq=False)
class Windows:
    """Pixels around a laser line: w pixels down each of its n columns.

    Parameters
    ----------
    columns, centre_rows : (n,) ndarray of int
        Central pixel of each window. Units: px.
    offsets : (w,) ndarray of int
        Rows of a window's pixels relative to its central pixel. Units: px.
    values : (n, w) ndarray
        Signal; beyond the border of the image that of the nearest pixel. Units: DN.
    saturated : (n, w) ndarray of bool
        Whether a pixel is at full scale.
    """

    columns: IntArray
    centre_rows: IntArray
    offsets: IntArray
    values: FloatArray
    saturated: BoolArray

    @property
    def backgrounds(self) -> FloatArray:
        """Mean of the outermost pixels of each window (n,). Units: DN."""
        ends = np.hstack([self.values[:, :END_PIXELS], self.values[:, -END_PIXELS:]])
        backgrounds: FloatArray = ends.mean(axis=1)
        return backgrounds

    def compute_clipping_std(self, sigma: float, steepness: FloatArray) -> FloatArray:
        """Return the standard deviation of each position due to clipping at full scale (n,), in px.

        The two ends of the plateau lie anywhere within their pixels. `sigma` is that of the
        derivative of Gaussian, x exp(-x^2 / 2 sigma^2); `steepness` (n,) is minus the derivative,
        by the position, of the sum of values times that filter, in DN px.
        """
        clipped = self.saturated.sum(axis=1)
        std = np.zeros(len(clipped))
        at = np.flatnonzero(clipped)
        if len(at):
            values = self.values.T.take(at, axis=1)  # as stored: whole rows are compared
            step = np.abs(np.diff(values, axis=0)).max(axis=0)
            height = values.max(axis=0) - self.backgrounds[at]
            fraction, end = step / height, clipped[at] / 2
            steep = np.interp(fraction, STEEP_STEP_FRACTIONS, (CLIPPING_ALIAS, STEEP_ALIAS))
            alias = np.where(clipped[at] == 1, steep, CLIPPING_ALIAS)
            alias[fraction > HARD_EDGE_STEP_FRACTION] = HARD_EDGE_ALIAS
            weight = end * np.exp(-0.5 * (end / sigma) ** 2)
            std[at] = alias * step * weight / steepness[at]
        return std

    def select(self, which: BoolArray) -> "Windows":
        """Return the windows of a mask (n,)."""
        return Windows(
            self.columns[which],
            self.centre_rows[which],
            self.offsets,
            self.values[which],
            self.saturated[which],
        )

    def replace_columns(self, other: "Windows", which: BoolArray) -> "Windows":
        """Return the windows with those of a mask (n,) taken from `other`, of the same columns."""
        return Windows(
            self.columns,
            np.where(which, other.centre_rows, self.centre_rows),
            self.offsets,
            np.where(which[:, None], other.values, self.values),
            np.where(which[:, None], other.saturated, self.saturated),
        )


@dataclass(frozen=True, eq=False)
class Stripes:
    """Position, height and width of the stripe in each window; NaN where there is none.

    Parameters
    ----------
    pixels : (n, 2) ndarray
        Positions u, v. Units: px.
    std : (n,) ndarray
        Standard deviation of v, predicted from read and shot noise and from clipping. Units: px.
    heights : (n,) ndarray
        Height above the background. Units: DN.
    widths : (n,) ndarray
        Standard deviation of the Gaussian section down the column. Units: px.
    skew_shifts : (n,) ndarray
        Shift of v by a skewness of the section, over its third cumulant; NaN where it is that of
        the derivative of Gaussian on an unsaturated section. Units: 1 / px^2.
    """

    pixels: FloatArray
    std: FloatArray
    heights: FloatArray
    widths: FloatArray
    skew_shifts: FloatArray

    @property
    def found(self) -> BoolArray:
        """Whether a window has a stripe with a finite standard deviation (n,)."""
        return np.isfinite(self.pixels).all(axis=1) & np.isfinite(self.std)

    def select(self, which: BoolArray) -> "Stripes":
        """Return the stripes of a mask (n,)."""
        return Stripes(*(getattr(self, field.name)[which] for field in fields(self)))

    def replace_at(self, indices: IntArray, others: "Stripes") -> "Stripes":
        """Return the stripes with those at indices (k,) replaced by k others."""
        merged = Stripes(*(getattr(self, field.name).copy() for field in fields(self)))
        for field in fields(self):
            getattr(merged, field.name)[indices] = getattr(others, field.name)
        return merged


def cut_windows(
    image: LineImage, signal: Image, columns: IntArray, rows: FloatArray, sigma: float
) -> Windows:
    """Cut windows around the points of a line from left to right.

    The values are those of `signal`, a channel of the image; its raw channel decides what is
    saturated. `columns` and coarse `rows` (n,), in px, are those at which the windows are centred,
    `sigma` is that of the filter, which sets their width.
    """
    half_width = math.ceil(HALF_WIDTH_SIGMAS * sigma)
    offsets = np.arange(-half_width, half_width + 1)
    centre_rows = np.rint(rows).astype(np.int64)
    window_rows = np.clip(centre_rows + offsets[:, None], 0, signal.shape[0] - 1)
    if signal is image.signal:
        values = image.read_signal(window_rows, columns)
    else:
        values = signal[window_rows, columns].astype(np.float64)
    raw = values if image.raw_channel is signal else image.raw_channel[window_rows, columns]
    # Transposed views: a sum over the pixels of each window adds whole rows of memory.
    saturated = (raw >= image.full_scale).T
    return Windows(columns, centre_rows, offsets, values.T, saturated)
