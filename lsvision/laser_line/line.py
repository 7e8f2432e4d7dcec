"""Result of the extraction: a laser line with one sub-pixel point in each column or row."""

from dataclasses import dataclass, field
from typing import get_args

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, Points
from lsvision.geometry.arrays import freeze_arrays
from lsvision.geometry.equality import ComparedByValue
from lsvision.laser_line.line_image import Direction


@dataclass(frozen=True, eq=False, repr=False)
class LaserLine(ComparedByValue):
    """A laser line: one point for each of the n columns (or rows) of the image, in order.

    Of the mosaic of a colour sensor, a red or blue laser has a point in every second one only.

    Parameters
    ----------
    pixels : (n, 2) ndarray
        u, v; NaN rows where the line is lost. Pixel (0, 0) is the centre of the top-left
        pixel. Units: px.
    std : (n,) ndarray
        Standard deviation along v (columns) or u (rows). Units: px.
    intensity : (n,) ndarray
        Height above the background; where the line is saturated and a Gaussian fits its flanks,
        the height of that, above full scale. Units: DN.
    width : (n,) ndarray
        Standard deviation of the Gaussian section down the column (along the row): on a steep part
        of the line larger than across it. Units: px.
    saturated : (n,) ndarray of bool
        Whether the line is at full scale there.
    direction : {"columns", "rows"}
        Whether there is one point for each column or one for each row.
    second_line_fraction : float
        Fraction of the columns in which a second line, at least half as strong and apart from this
        one, can be followed: above about 0.2, check that this is the right one.
    filter_sigma : float
        Standard deviation of the filter that located it. Units: px.
    skew_shift : (n,) ndarray, optional
        Shift of v (or u) by a skewness of the section, over its third cumulant; NaN, by default
        everywhere, for that of the derivative of Gaussian on an unsaturated section, and where no
        Gaussian fits a saturated one: its `width` is too large then. Units: 1 / px^2.
    is_ridge : bool
        Whether the points are those of a ridge, located across the line by Steger's method, and not
        along v or u: blur that is equal in all directions shifts them by curvature only.

    Examples
    --------
    >>> rows = np.arange(64)[:, None]
    >>> image = (10 + 90 * np.exp(-0.5 * ((rows - 30.2) / 1.5) ** 2) * np.ones(99)).astype("uint8")
    >>> from lsvision.laser_line.extraction import extract_laser_line
    >>> extract_laser_line(image)
    <LaserLine: 99 columns, 0 lost>
    """

    pixels: Points
    std: FloatArray
    intensity: FloatArray
    width: FloatArray
    saturated: BoolArray
    direction: Direction
    second_line_fraction: float
    filter_sigma: float
    skew_shift: FloatArray = field(default_factory=lambda: np.array(np.nan))
    is_ridge: bool = False

    def __post_init__(self) -> None:
        freeze_arrays(self, pixels=("n", 2))
        count = (len(self.pixels),)
        freeze_arrays(self, std=count, intensity=count, width=count)
        saturated = np.array(self.saturated, dtype=bool)
        if saturated.shape != count:
            raise ValueError(f"expected saturated of shape {count}, got {saturated.shape}")
        saturated.setflags(write=False)
        object.__setattr__(self, "saturated", saturated)
        if not np.ndim(self.skew_shift):
            object.__setattr__(self, "skew_shift", np.full(count, self.skew_shift))
        freeze_arrays(self, skew_shift=count)
        if self.direction not in get_args(Direction):
            raise ValueError(f"expected direction 'columns' or 'rows', got {self.direction!r}")

    def __len__(self) -> int:
        return len(self.pixels)

    def __repr__(self) -> str:
        return f"<LaserLine: {len(self)} {self.direction}, {self.lost} lost>"

    @property
    def lost(self) -> int:
        """Number of columns without a line."""
        return int(np.isnan(self.std).sum())
