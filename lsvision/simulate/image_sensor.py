"""How an image sensor turns light to numbers."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lsvision.geometry import FloatArray


@dataclass(frozen=True, kw_only=True)
class ImageSensor:
    """Noise, gain and depth of an image sensor.

    Parameters
    ----------
    bits : int
        8 (uint8) to 16 (uint16; 10 and 12 fill its lower bits).
    full_well : float
        Electrons at full scale.
    read_noise : float
        One sigma. Units: electrons.
    prnu : float
        Pixel-to-pixel differences in sensitivity, one sigma as a share.
    """

    bits: int = 8
    full_well: float = 10_000.0
    read_noise: float = 13.0
    prnu: float = 0.01

    def __post_init__(self) -> None:
        if not 8 <= self.bits <= 16:
            raise ValueError(f"want 8 to 16 bits, got {self.bits}")
        if not (self.full_well > 0 and self.read_noise >= 0 and self.prnu >= 0):
            raise ValueError(
                f"want full_well > 0, read_noise >= 0 and prnu >= 0, got {self.full_well:g}, "
                f"{self.read_noise:g} and {self.prnu:g}"
            )

    @property
    def full_scale(self) -> int:
        """Largest number of the image. Units: DN."""
        return (1 << self.bits) - 1

    def pattern(self, shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
        """Sensitivity of each pixel, mean 1: the same in every frame of one sensor."""
        pattern = 1 + self.prnu * rng.standard_normal(shape, dtype=np.float32)
        return pattern.astype(np.float64)


def expose(
    light: FloatArray, pattern: FloatArray, sensor: ImageSensor, rng: np.random.Generator
) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint16]:
    """Numbers that a sensor reads from the mean light in each pixel.

    Parameters
    ----------
    light, pattern : (height, width) ndarray
        Mean light in DN, and the pixels' sensitivities.
    sensor : ImageSensor
        The sensor.
    rng : numpy.random.Generator
        Source of shot and read noise.

    Notes
    -----
    Counts are taken as normal with the variance of their mean: beside a read noise of some
    electrons nothing tells that from a Poisson count, and it is ten times faster.
    """
    per_number = sensor.full_well / sensor.full_scale
    electrons = light * pattern * per_number
    std = np.sqrt(electrons + sensor.read_noise**2).astype(np.float32)
    noisy = electrons + std * rng.standard_normal(light.shape, dtype=np.float32)
    numbers = np.clip(np.rint(noisy / per_number), 0, sensor.full_scale)
    if sensor.bits == 8:
        return numbers.astype(np.uint8)
    return numbers.astype(np.uint16)
