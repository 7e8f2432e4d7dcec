"""The pixels around a laser line, column by column, and what is found in them."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.laser_line.line_image import Image, LineImage

HALF_WIDTH_SIGMAS = 3.5
"""Half width of a window, in sigmas of the filter."""
CLIPPING_STD_PX = 0.008
"""px by which each clipped pixel moves a stripe (measured at 1.2 to 4 times full scale)."""
MAX_CLIPPED_PIXELS = 5
"""Clipped pixels from which more of them make no difference: the flanks are as steep as edges."""
END_PIXELS = 2
"""Pixels at each end of a window that tell the level of the surroundings."""


@dataclass(frozen=True, eq=False)
class Windows:
    """Pixels around the line, a row for each of its columns.

    Parameters
    ----------
    columns, centre_rows : (n,) ndarray of int
        Pixels of the line. Units: px.
    offsets : (w,) ndarray of int
        Rows of a window's pixels from its middle. Units: px.
    values : (n, w) ndarray
        Signal; beyond the border that of the border. Units: DN.
    saturated : (n, w) ndarray of bool
        Pixels at full scale.
    """

    columns: IntArray
    centre_rows: IntArray
    offsets: IntArray
    values: FloatArray
    saturated: BoolArray

    @property
    def background_subtracted(self) -> FloatArray:
        """Values above the surroundings, which the outermost pixels tell. Units: DN."""
        ends = np.hstack([self.values[:, :END_PIXELS], self.values[:, -END_PIXELS:]])
        above: FloatArray = self.values - ends.mean(axis=1, keepdims=True)
        return above

    @property
    def clipping_std(self) -> FloatArray:
        """Error of each place by the clipped top of a saturated stripe, one sigma. Units: px.

        The two ends of the plateau fall anywhere within their pixels; the more pixels it has,
        the steeper is what is left of the flanks, and the more that weighs.
        """
        clipped = np.minimum(self.saturated.sum(axis=1), MAX_CLIPPED_PIXELS)
        std: FloatArray = CLIPPING_STD_PX * clipped
        return std

    def select(self, which: BoolArray) -> "Windows":
        """Those columns that a mask names."""
        return Windows(
            self.columns[which],
            self.centre_rows[which],
            self.offsets,
            self.values[which],
            self.saturated[which],
        )


@dataclass(frozen=True, eq=False)
class Stripes:
    """What one method finds in each window; NaN where it finds nothing.

    Parameters
    ----------
    pixels : (n, 2) ndarray
        u, v. Units: px.
    std : (n,) ndarray
        Across the line, predicted from read and shot noise alone. Units: px.
    heights : (n,) ndarray
        Above the surroundings. Units: DN.
    sigmas : (n,) ndarray
        Of the stripe's Gaussian section. Units: px.
    """

    pixels: FloatArray
    std: FloatArray
    heights: FloatArray
    sigmas: FloatArray

    @property
    def found(self) -> BoolArray:
        """Where there is a stripe."""
        found: BoolArray = np.isfinite(self.pixels).all(axis=1) & np.isfinite(self.std)
        return found


def cut_windows(
    image: LineImage, signal: Image, columns: IntArray, rows: FloatArray, sigma: float
) -> Windows:
    """Windows around the points of a line.

    Parameters
    ----------
    image : LineImage
        With the line from left to right; tells what is saturated.
    signal : (height, width) ndarray
        One of the image's, to cut the values from. Units: DN.
    columns, rows : (n,) ndarray
        Coarse places. Units: px.
    sigma : float
        Of the filter that will look at them. Units: px.
    """
    reach = math.ceil(HALF_WIDTH_SIGMAS * sigma)
    offsets = np.arange(-reach, reach + 1)
    middles = np.rint(rows).astype(np.int64)
    down = np.clip(middles[:, None] + offsets, 0, signal.shape[0] - 1)
    at = down, columns[:, None]
    values = signal[at].astype(np.float64)
    return Windows(columns, middles, offsets, values, image.raw_channel[at] >= image.full_scale)
