"""Effects in a simulated image: stray light, glints, speckle, and the noise of the image sensor."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.geometry import FloatArray, Points
from lsvision.geometry.arguments import as_numbers

STREAK_BLUR_PX = 1.0
"""Standard deviation of the lens blur of streaks. Units: px."""
GLINT_GAIN = 8.0
"""Additional brightness of a glint relative to the line; saturates any usual exposure."""
OVERSAMPLING = 2
"""Samples of the speckle along each side of a pixel, which are then averaged."""


@dataclass(frozen=True, kw_only=True)
class StrayLight:
    """Ambient light and bright objects, independent of the laser.

    Parameters
    ----------
    ambient : float
        Mean level. Units: DN.
    gradient : float
        Difference between the brightest corner and the mean. Units: DN.
    streaks : int
        Number of straight bright streaks, 1 to 3 px wide and 40 to 300 px long.
    blobs : int
        Number of Gaussian bright blobs with a standard deviation of 2 to 15 px.
    brightness : tuple of float
        Range of the peaks of streaks and blobs; the lens blur then lowers those of streaks.
        Units: DN.
    """

    ambient: float = 10.0
    gradient: float = 0.0
    streaks: int = 0
    blobs: int = 0
    brightness: tuple[float, float] = (100.0, 250.0)

    def __post_init__(self) -> None:
        if not math.inf > self.ambient >= abs(self.gradient):
            raise ValueError(
                f"expected ambient >= gradient, got {self.ambient:g} and {self.gradient:g} DN: "
                "light is never negative"
            )
        low, high = as_numbers(self.brightness, 2, "brightness (smallest, largest) in DN")
        if not 0 <= low <= high < math.inf:
            raise ValueError(
                f"expected brightness (smallest, largest) in DN, got {self.brightness}"
            )
        if self.streaks < 0 or self.blobs < 0:
            raise ValueError(
                f"expected counts >= 0, got {self.streaks} streaks, {self.blobs} blobs"
            )


def simulate_stray_light(
    shape: tuple[int, ...], stray: StrayLight, rng: np.random.Generator
) -> FloatArray:
    """Return the (height, width) mean brightness without the laser. Units: DN."""
    height, width = shape[:2]
    angle = rng.uniform(0, 2 * math.pi)
    u, v = np.linspace(-1, 1, width), np.linspace(-1, 1, height)
    slope = (u * math.cos(angle) + v[:, None] * math.sin(angle)) / (
        abs(math.cos(angle)) + abs(math.sin(angle))
    )
    light = stray.ambient + stray.gradient * slope
    light = light + _draw_streaks((height, width), stray, rng)
    for _ in range(stray.blobs):
        centre = rng.uniform((0, 0), (width, height))
        _add_blob(light, centre, rng.uniform(2, 15), rng.uniform(*stray.brightness))
    return light


def simulate_glint_gain(
    truth_pixels: Points, shape: tuple[int, ...], glints: int, rng: np.random.Generator
) -> FloatArray:
    """Return the (height, width) factor on the laser light of specular reflections.

    There are `glints` of them, at random points of the line. `truth_pixels` (width, 2) are u, v of
    the line in each column, NaN in a column without line. Units: px.
    """
    gain = np.ones(shape)
    line = truth_pixels[np.isfinite(truth_pixels[:, 1])]
    if len(line):
        for centre in line[rng.integers(len(line), size=glints)]:
            _add_blob(gain, centre, rng.uniform(2, 6), GLINT_GAIN)
    return gain


def _draw_streaks(
    shape: tuple[int, int], stray: StrayLight, rng: np.random.Generator
) -> FloatArray:
    """Return the (height, width) brightness of the streaks. Units: DN."""
    layer: FloatArray = np.zeros(shape)
    for _ in range(stray.streaks):
        start = rng.uniform((0, 0), shape[::-1])
        angle, length = rng.uniform(0, math.pi), rng.uniform(40, 300)
        brightness, width = float(rng.uniform(*stray.brightness)), int(rng.integers(1, 4))
        distances = _distances_from_segment(shape, start, angle, length)
        layer = np.maximum(layer, brightness * np.clip(width / 2 + 0.5 - distances, 0, 1))
    if stray.streaks:
        layer = cv2.GaussianBlur(layer, (0, 0), STREAK_BLUR_PX)
    return layer


def _distances_from_segment(
    shape: tuple[int, int], start: FloatArray, angle: float, length: float
) -> FloatArray:
    """Return the distance of each pixel from a line segment. Units: px.

    ``cv2.line`` is not used because its result differs between OpenCV 4 and 5.
    """
    u, v = np.arange(shape[1]) - start[0], np.arange(shape[0])[:, None] - start[1]
    position = np.clip(u * math.cos(angle) + v * math.sin(angle), 0, length)
    distances: FloatArray = np.hypot(u - position * math.cos(angle), v - position * math.sin(angle))
    return distances


def _add_blob(image: FloatArray, centre: FloatArray, sigma: float, height: float) -> None:
    """Add a Gaussian blob to the image in place, up to four standard deviations."""
    low = np.maximum(np.floor(centre - 4 * sigma), 0).astype(int)
    high = np.ceil(centre + 4 * sigma).astype(int) + 1
    window = image[low[1] : high[1], low[0] : high[0]]
    u = np.arange(low[0], low[0] + window.shape[1]) - centre[0]
    v = np.arange(low[1], low[1] + window.shape[0]) - centre[1]
    window += height * np.exp(-0.5 * (v[:, None] ** 2 + u**2) / sigma**2)


def simulate_speckle_field(
    shape: tuple[int, int], looks: int, fwhm: float, *, rng: np.random.Generator
) -> FloatArray:
    """Return the speckle factor (height, width) on the light in each pixel, with mean 1.

    `looks`, at least 1, is the number of independent patterns averaged (time, colour,
    polarisation): the contrast is 1 / sqrt(looks), slightly reduced by the averaging within each
    pixel. `fwhm` is the full width at half maximum of the autocorrelation of the intensity, in px.

    Fully developed speckle is the squared modulus of a circular complex Gaussian field. If the
    correlation of the field is mu, that of the intensity is mu^2 (Goodman, Speckle Phenomena in
    Optics, section 4.3). A Gaussian filter of sigma s gives mu = exp(-x^2 / 4 s^2), hence mu^2 =
    exp(-x^2 / 2 s^2), and s = fwhm / 2.355.
    """
    if looks < 1:
        raise ValueError(f"expected at least one look, got {looks}")
    fine = (shape[0] * OVERSAMPLING, shape[1] * OVERSAMPLING)
    sigma = fwhm / 2.3548 * OVERSAMPLING
    total = np.zeros(fine, dtype=np.float32)
    for _ in range(2 * looks):
        field = rng.standard_normal(fine, dtype=np.float32)
        total += cv2.GaussianBlur(field, (0, 0), sigma, borderType=cv2.BORDER_REFLECT) ** 2
    binned = total.reshape(shape[0], OVERSAMPLING, shape[1], OVERSAMPLING).mean(axis=(1, 3))
    factor: FloatArray = (binned / binned.mean()).astype(np.float64)
    return factor


@dataclass(frozen=True, kw_only=True)
class ImageSensor:
    """Noise, gain and bit depth of an image sensor.

    Parameters
    ----------
    bits : int
        Bit depth from 8 (uint8) to 16; above 8 the lower bits of uint16.
    full_well : float
        Number of electrons at full scale.
    read_noise : float
        Standard deviation of the read noise. Units: electrons.
    prnu : float
        Photo-response non-uniformity: relative standard deviation of the pixels' sensitivity.
    """

    bits: int = 8
    full_well: float = 10_000.0
    read_noise: float = 13.0
    prnu: float = 0.01

    def __post_init__(self) -> None:
        if not 8 <= self.bits <= 16:
            raise ValueError(f"expected 8 to 16 bits, got {self.bits}")
        if not (self.full_well > 0 and self.read_noise >= 0 and self.prnu >= 0):
            raise ValueError(
                f"expected full_well > 0, read_noise >= 0 and prnu >= 0, got {self.full_well:g}, "
                f"{self.read_noise:g} and {self.prnu:g}"
            )

    @property
    def full_scale(self) -> int:
        """Largest pixel value. Units: DN."""
        return (1 << self.bits) - 1

    def draw_sensitivity(self, shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
        """Draw the relative sensitivity of each pixel, which is fixed for one sensor."""
        sensitivity = 1 + self.prnu * rng.standard_normal(shape, dtype=np.float32)
        return np.maximum(sensitivity.astype(np.float64), 0.0)


def expose(
    light: FloatArray, sensitivity: FloatArray, sensor: ImageSensor, rng: np.random.Generator
) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint16]:
    """Return the pixel values of an exposure: with shot and read noise, clipped and rounded.

    `light` and `sensitivity` (height, width) are the mean light in DN and the relative sensitivity
    of each pixel. Shot noise is normal instead of Poisson: with a read noise of several electrons
    the difference is negligible, and it is ten times faster.
    """
    electrons_per_dn = sensor.full_well / sensor.full_scale
    electrons = light * sensitivity * electrons_per_dn
    std = np.sqrt(electrons + sensor.read_noise**2).astype(np.float32)
    noisy = electrons + std * rng.standard_normal(light.shape, dtype=np.float32)
    values = np.clip(np.rint(noisy / electrons_per_dn), 0, sensor.full_scale)
    if sensor.bits == 8:
        return values.astype(np.uint8)
    return values.astype(np.uint16)
