"""Noise of bought profile sensors.

The error of a triangulating sensor lies along the ray from the sensor to the point and grows
with the square of the range (one pixel of the detector spans more and more millimetres).
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, Points

MIN_RANGE_FRACTION, MAX_RANGE_MM = 1e-3, 1e12
"""Rubbish points are given a covariance, not an overflow: at this share of the reference range,
and at so many mm."""
LATERAL_FRACTION = 0.05
"""Smallest share of the range error that is taken to lie across the ray: no real beam is a
line without width, and a point at a grazing flank must not get an endless weight."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ProfileSensor:
    """A profile sensor as the fit needs to know it; a ``NoiseModel``.

    Parameters
    ----------
    name : str
        As a person calls it.
    range_std : float
        One sigma along the ray at `reference_range`. Units: mm.
    reference_range : float
        Units: mm.
    origin : tuple of float
        Point of the section frame from which the rays fan out. Units: mm.
    quantum : float
        Step of the sensor's numbers; adds quantum^2 / 12 to both coordinates. Units: mm.
    columns : int
        Points in a profile.
    min_range, max_range : float
        Units: mm.
    width_at_max_range : float
        Length of the measured line at `max_range`. Units: mm.

    Raises
    ------
    ValueError
        If a length is not positive.

    Examples
    --------
    >>> sensor = ProfileSensor(range_std=0.05, reference_range=400.0)
    >>> covariance = sensor.covariances(np.array([[0.0, -800.0]]))[0]
    >>> f"{covariance[1, 1] ** 0.5:.2f} mm along the ray at twice the reference range"
    '0.20 mm along the ray at twice the reference range'
    """

    name: str = "profile sensor"
    range_std: float = 0.05
    reference_range: float = 400.0
    origin: tuple[float, float] = (0.0, 0.0)
    quantum: float = 0.0
    columns: int = 376
    min_range: float = 200.0
    max_range: float = 800.0
    width_at_max_range: float = 600.0

    def __post_init__(self) -> None:
        for what in ("range_std", "reference_range", "min_range", "width_at_max_range"):
            value = getattr(self, what)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"want a positive {what} in mm, got {value}")
        if not self.max_range > self.min_range:
            raise ValueError(f"want max_range > min_range, got {self.max_range} mm")
        if not self.quantum >= 0:
            raise ValueError(f"want quantum >= 0 mm, got {self.quantum}")

    def covariances(self, points: Points) -> FloatArray:
        """Covariance of each point's error: along its ray, growing with range squared.

        Parameters
        ----------
        points : (n, 2) ndarray
            Section frame; NaN rows are lost points. Units: mm.

        Returns
        -------
        (n, 2, 2) ndarray
            Units: mm^2.
        """
        rays = np.minimum(np.maximum(points - np.array(self.origin), -MAX_RANGE_MM), MAX_RANGE_MM)
        ranges = np.maximum(
            np.hypot(rays[:, 0], rays[:, 1]), MIN_RANGE_FRACTION * self.reference_range
        )
        std = self.range_std * (ranges / self.reference_range) ** 2
        along = rays * (std / ranges)[:, None]
        across = (LATERAL_FRACTION * std) ** 2 + self.quantum**2 / 12
        covariances: FloatArray = along[:, :, None] * along[:, None, :]
        covariances[:, 0, 0] += across
        covariances[:, 1, 1] += across
        return covariances


LPS36HI = ProfileSensor(
    name="LPS 36 HI",
    # Resolution 0.1 mm at 200 mm to 0.9 mm at 600 mm (Leuze; the paper's section 4 has 0.9 mm):
    # grows exactly with range squared, 0.4 mm at 400 mm. DERIVED: a resolution cell is taken
    # as uniform, one sigma = 0.4 / sqrt(12).
    range_std=0.115,
    reference_range=400.0,
    quantum=0.01,  # words of the HI connection are 1/100 mm
    columns=240,  # HI connection
    min_range=200.0,
    max_range=600.0,
    width_at_max_range=140.0,  # from the limits of X; pitch 0.58 mm, the paper's 0.6 mm
)
"""Leuze LPS 36 HI, the paper's sensor."""

LPS36 = ProfileSensor(
    name="LPS 36",
    # Resolution 3 mm at 800 mm (Leuze). DERIVED as above: 0.75 mm at 400 mm, / sqrt(12).
    range_std=0.217,
    reference_range=400.0,
    quantum=0.1,  # words of the standard connection are 1/10 mm
    columns=376,
    min_range=200.0,
    max_range=800.0,
    width_at_max_range=600.0,
)
"""Leuze LPS 36."""
