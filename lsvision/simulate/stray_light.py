"""Light in the image that is not the laser line: daylight, lamps, reflections."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from lsvision.geometry import FloatArray, Points

EDGE_BLUR = 1.0
"""px; streaks are drawn hard and seen through a lens."""
GLINT_GAIN = 8.0
"""How many times brighter than the line a glint is: it saturates any exposure."""


@dataclass(frozen=True, kw_only=True)
class StrayLight:
    """Ambient light and bright clutter; there with the laser off, too.

    Parameters
    ----------
    ambient : float
        Mean level. Units: DN.
    gradient : float
        Rise from the mean to the brighter end and fall to the darker. Units: DN.
    streaks : int
        Straight bright streaks, 1 to 3 px wide and 40 to 300 px long.
    blobs : int
        Round bright blobs, 2 to 15 px (one sigma).
    brightness : tuple of float
        Range of the streaks' and blobs' peaks. Units: DN.
    """

    ambient: float = 10.0
    gradient: float = 0.0
    streaks: int = 0
    blobs: int = 0
    brightness: tuple[float, float] = (100.0, 250.0)

    def __post_init__(self) -> None:
        if not self.ambient >= abs(self.gradient):
            raise ValueError(
                f"want ambient >= gradient, got {self.ambient:g} and {self.gradient:g} DN: "
                "light is never negative"
            )
        if self.streaks < 0 or self.blobs < 0:
            raise ValueError(f"want counts >= 0, got {self.streaks} streaks, {self.blobs} blobs")


def stray_light(shape: tuple[int, ...], stray: StrayLight, rng: np.random.Generator) -> FloatArray:
    """Mean light of everything but the laser, (height, width). Units: DN."""
    height, width = shape[:2]
    turn = rng.uniform(0, 2 * math.pi)
    u, v = np.linspace(-1, 1, width), np.linspace(-1, 1, height)
    slope = (u * math.cos(turn) + v[:, None] * math.sin(turn)) / (
        abs(math.cos(turn)) + abs(math.sin(turn))
    )
    light = stray.ambient + stray.gradient * slope
    light = light + _streaks((height, width), stray, rng)
    for _ in range(stray.blobs):
        centre = rng.uniform((0, 0), (width, height))
        _add_blob(light, centre, rng.uniform(2, 15), rng.uniform(*stray.brightness))
    return light


def glint_gain(
    truth_pixels: Points, shape: tuple[int, ...], glints: int, rng: np.random.Generator
) -> FloatArray:
    """Factor (height, width) by which mirroring places brighten the laser's light."""
    gain = np.ones(shape)
    seen = truth_pixels[np.isfinite(truth_pixels[:, 1])]
    if len(seen):
        for centre in seen[rng.integers(len(seen), size=glints)]:
            _add_blob(gain, centre, rng.uniform(2, 6), GLINT_GAIN)
    return gain


def _streaks(shape: tuple[int, int], stray: StrayLight, rng: np.random.Generator) -> FloatArray:
    layer: FloatArray = np.zeros(shape)
    for _ in range(stray.streaks):
        start = rng.uniform((0, 0), shape[::-1])
        turn, length = rng.uniform(0, math.pi), rng.uniform(40, 300)
        brightness, width = float(rng.uniform(*stray.brightness)), int(rng.integers(1, 4))
        beside = _distances_from_segment(shape, start, turn, length)
        layer = np.maximum(layer, brightness * np.clip(width / 2 + 0.5 - beside, 0, 1))
    if stray.streaks:
        layer = cv2.GaussianBlur(layer, (0, 0), EDGE_BLUR)
    return layer


def _distances_from_segment(
    shape: tuple[int, int], start: FloatArray, turn: float, length: float
) -> FloatArray:
    """Of each pixel. Drawn by hand: ``cv2.line`` differs between OpenCV 4 and 5. Units: px."""
    u, v = np.arange(shape[1]) - start[0], np.arange(shape[0])[:, None] - start[1]
    along = np.clip(u * math.cos(turn) + v * math.sin(turn), 0, length)
    distances: FloatArray = np.hypot(u - along * math.cos(turn), v - along * math.sin(turn))
    return distances


def _add_blob(image: FloatArray, centre: FloatArray, sigma: float, height: float) -> None:
    """Add a Gaussian blob in place, out to four sigma."""
    low = np.maximum(np.floor(centre - 4 * sigma), 0).astype(int)
    high = np.ceil(centre + 4 * sigma).astype(int) + 1
    window = image[low[1] : high[1], low[0] : high[0]]
    u = np.arange(low[0], low[0] + window.shape[1]) - centre[0]
    v = np.arange(low[1], low[1] + window.shape[0]) - centre[1]
    window += height * np.exp(-0.5 * (v[:, None] ** 2 + u**2) / sigma**2)
