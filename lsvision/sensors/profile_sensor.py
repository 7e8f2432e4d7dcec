"""Noise model of commercial laser profile sensors.

The error of a triangulating sensor lies along the ray from the sensor to the point and grows
with the square of the range, as the length that one pixel of the detector covers does.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, Points
from lsvision.geometry.arguments import as_numbers
from lsvision.profile import NoiseModel

MIN_RANGE_FRACTION = 1e-3
"""Smallest ratio of range to reference range at which the standard deviation is computed, so that
no covariance is zero."""
MAX_RANGE_MM = 1e12
"""Largest coordinate relative to the origin, against overflow at invalid points. Units: mm."""
RANGE_STDS_MM, REFERENCE_RANGES_MM = (1e-6, 1e3), (1e-3, 1e6)
"""Accepted noise and reference range, with room beyond those of all sensors. Units: mm."""
MAX_STD_MM, MIN_VARIANCE_MM2 = 1e8, 1e-17
"""Largest standard deviation along a ray (mm), and smallest variance perpendicular to it (mm^2),
far from those that occur: with them every fit takes the covariances."""
LATERAL_STD_RATIO = 0.05
"""Standard deviation perpendicular to the ray over that along it. The beam has a width, and without
a perpendicular error the weight of a point at a grazing flank would be infinite."""


@dataclass(frozen=True, kw_only=True)
class ProfileSensor:
    """Noise model and measuring range of a profile sensor; a ``NoiseModel``.

    Parameters
    ----------
    name : str
        Name of the sensor for messages.
    range_std : float
        Standard deviation along the ray at `reference_range`, from 1e-6 to 1000. Units: mm.
    reference_range : float
        Distance from the origin at which `range_std` is valid, from 0.001 to 1e6. Units: mm.
    origin : tuple of float
        Point of the section frame from which the rays diverge. Units: mm.
    quantum : float
        Resolution of the sensor's coordinates; adds quantum^2 / 12 to both coordinates. Units: mm.
    columns : int
        Number of points in a profile.
    min_range, max_range : float
        Measuring range. Units: mm.
    width_at_max_range : float
        Length of the measured line at `max_range`. Units: mm.

    Raises
    ------
    ValueError
        If a number is not finite or outside of its range, a length or `columns` not positive,
        `quantum` negative, or `max_range` not above `min_range`.

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
        for name in ("range_std", "reference_range", "min_range", "width_at_max_range"):
            value = getattr(self, name)
            if not (isinstance(value, int | float | np.number) and 0 < value < math.inf):
                raise ValueError(f"expected a positive {name} in mm, got {value!r}")
        limits = {"range_std": RANGE_STDS_MM, "reference_range": REFERENCE_RANGES_MM}
        for name, (low, high) in limits.items():
            if not low <= getattr(self, name) <= high:
                raise ValueError(
                    f"expected {name} from {low:g} to {high:g} mm, got {getattr(self, name):g}"
                )
        if not self.min_range < self.max_range < math.inf:
            raise ValueError(
                f"expected min_range < max_range, got {self.min_range} and {self.max_range} mm"
            )
        if not 0 <= self.quantum <= MAX_STD_MM:
            raise ValueError(
                f"expected quantum >= 0 mm, got {self.quantum} (at most {MAX_STD_MM:g} mm)"
            )
        if not (isinstance(self.columns, int | np.integer) and self.columns >= 1):
            raise ValueError(f"expected a whole number of columns >= 1, got {self.columns}")
        if not np.isfinite(as_numbers(self.origin, 2, "an origin (x, y) in mm")).all():
            raise ValueError(f"expected an origin (x, y) in mm, got {self.origin}")

    def covariances(self, points: Points) -> FloatArray:
        """Return the covariance of each point: along its ray, with a std that grows as range^2.

        Parameters
        ----------
        points : (n, 2) ndarray
            Points in the section frame; NaN rows are lost points. Units: mm.

        Returns
        -------
        (n, 2, 2) ndarray
            Covariance of each point. Units: mm^2.
        """
        rays = np.minimum(np.maximum(points - np.array(self.origin), -MAX_RANGE_MM), MAX_RANGE_MM)
        ranges = np.maximum(
            np.hypot(rays[:, 0], rays[:, 1]), MIN_RANGE_FRACTION * self.reference_range
        )
        std = np.minimum(self.range_std * (ranges / self.reference_range) ** 2, MAX_STD_MM)
        axial_std = rays * (std / ranges)[:, None]
        lateral_variance = (LATERAL_STD_RATIO * std) ** 2 + self.quantum**2 / 12
        lateral_variance = np.maximum(lateral_variance, MIN_VARIANCE_MM2)
        covariances: FloatArray = axial_std[:, :, None] * axial_std[:, None, :]
        covariances[:, 0, 0] += lateral_variance
        covariances[:, 1, 1] += lateral_variance
        return covariances


LPS36HI = ProfileSensor(
    name="LPS 36 HI",
    # Resolution 0.1 mm at 200 mm to 0.9 mm at 600 mm (Leuze; the paper's section 4 has 0.9 mm):
    # grows exactly with range squared, 0.4 mm at 400 mm. Derived: a resolution cell is taken
    # as uniform, one sigma = 0.4 / sqrt(12).
    range_std=0.115,
    reference_range=400.0,
    quantum=0.01,  # numbers of the HI connection are in 1/100 mm
    columns=240,  # HI connection
    min_range=200.0,
    max_range=600.0,
    width_at_max_range=140.0,  # from the limits of X; pitch 0.58 mm, the paper's 0.6 mm
)
"""Leuze LPS 36 HI, the paper's sensor."""

LPS36 = ProfileSensor(
    name="LPS 36",
    # Resolution 3 mm at 800 mm (Leuze). Derived as above: 0.75 mm at 400 mm, / sqrt(12).
    range_std=0.217,
    reference_range=400.0,
    quantum=0.1,  # numbers of the standard connection are in 1/10 mm
    columns=376,
    min_range=200.0,
    max_range=800.0,
    width_at_max_range=600.0,
)
"""Leuze LPS 36."""

KNOWN_SENSORS = {"lps36hi": LPS36HI, "lps36": LPS36}
"""Sensors that `find_sensor` returns by name."""


def find_sensor(name: str) -> ProfileSensor:
    """Return the sensor with a given name, a key of `KNOWN_SENSORS`.

    Case, blanks, hyphens and underscores are ignored.

    Raises
    ------
    ValueError
        If the name is unknown; the message lists those that are known.

    Examples
    --------
    >>> find_sensor("LPS 36 HI").columns
    240
    """
    key = "".join(letter for letter in name.lower() if letter.isalnum())
    if key not in KNOWN_SENSORS:
        raise ValueError(f"expected a sensor among {', '.join(KNOWN_SENSORS)}, got {name!r}")
    return KNOWN_SENSORS[key]


def as_noise_model(sensor: NoiseModel | str | None) -> NoiseModel | None:
    """Return a noise model that is given as such or by the name of its sensor; None for None.

    Raises
    ------
    ValueError
        If the name is unknown.
    TypeError
        If `sensor` is not a noise model.

    Examples
    --------
    >>> as_noise_model("lps36").name
    'LPS 36'
    >>> as_noise_model(0.05)
    Traceback (most recent call last):
    ...
    TypeError: expected sensor as a ProfileSensor, another NoiseModel or a name among lps36hi, \
lps36, got float 0.05: ProfileSensor(range_std=0.05) is a sensor with this noise
    """
    if isinstance(sensor, str):
        return find_sensor(sensor)
    if sensor is None or (isinstance(sensor, NoiseModel) and not isinstance(sensor, type)):
        return sensor
    is_number = isinstance(sensor, int | float)
    hint = f": ProfileSensor(range_std={sensor}) is a sensor with this noise" if is_number else ""
    raise TypeError(
        "expected sensor as a ProfileSensor, another NoiseModel or a name among "
        f"{', '.join(KNOWN_SENSORS)}, got {type(sensor).__name__} {sensor!r}{hint}"
    )
