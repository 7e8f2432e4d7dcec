"""Colours with less resolution than the image: those of a JPEG file, or of an interpolated mosaic.

A line in them deviates from that in the luminance by more than the noise of the pixels. The
luminance has twice their resolution and is used, except where it shows a printed pattern, which the
excess of the laser's colour does not contain.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.laser_line.detection import DetectedLine, locate_line, with_rounding_errors
from lsvision.laser_line.line_image import LineImage
from lsvision.laser_line.noise import errors_are_interpolated, roughness
from lsvision.laser_line.settings import LineSettings
from lsvision.statistics.robust import MAD_TO_STD

COARSE_COLOUR_SIGMAS = 1.15
"""Distance of the lines in interpolated colours and in luminance, in standard deviations of their
noise, above which the colours shift the line: 1.2 to 9 in JPEG files and mosaics."""
MAX_DISTANCE_SIGMAS = 3.0
"""Distance of the two in a column, in standard deviations, beyond which the edge of a print has
shifted the luminance there."""
BLOCK_FACTOR = 2.0
"""Factor on errors that are common to the columns of a JPEG file's block, which a fit takes to be
independent."""
MAX_ROUGHNESS_SIGMAS = 1.5
"""Roughness of a JPEG file's luminance, in standard deviations of its noise, from which on a print
is seen in it: 0.2 to 1.3 where the smoother colours would show a print on a grey surface, 2 to 16
on prints, 1 to 2 on thin text."""
MIN_BRIGHT_FRACTION = 0.75
"""Smallest fraction of the columns in which the luminance has a stripe, too."""


def sharper_line(
    image: LineImage, detected: DetectedLine, settings: LineSettings
) -> tuple[LineImage, DetectedLine, FloatArray | float]:
    """Return the image and line of the luminance where the colours are coarser.

    Parameters
    ----------
    image : LineImage
        With the line from left to right, of a coloured laser.
    detected : DetectedLine
        The line in the laser's colour.
    settings : LineSettings
        Settings of `extract_laser_line`.

    Returns
    -------
    image, line
        As given where the colours have the image's resolution, or the luminance is rougher (on a
        printed pattern), in a JPEG file rougher than its rounding makes it. Columns in which an
        edge of a print shifts the luminance keep the colour.
    std : (n,) ndarray or float
        Standard deviation that the coarseness adds. Units: px.

    Notes
    -----
    The error of the luminance is taken to be half of its distance from the colour, which has half
    its resolution; that of the colour in a single column of a JPEG file the whole distance.
    """
    coarse = detected.select(detected.stripes.found)
    columns, rows = coarse.windows.columns, coarse.stripes.pixels[:, 1]
    if not errors_are_interpolated(columns, rows):
        return image, detected, 0.0
    bright = locate_line(image.of_brightness, columns, rows, detected.sigma, settings)
    if bright.stripes.found.mean() < MIN_BRIGHT_FRACTION:
        return image, detected, 0.0
    bright = with_rounding_errors(image.of_brightness, bright)
    pair = _Pair.of(coarse, bright)
    compressed = bright.blocks is not None
    if pair.agrees and not compressed:
        return image, detected, 0.0
    if pair.print_in_luminance and not (compressed and pair.noise_explains_luminance):
        std = min(BLOCK_FACTOR * pair.colour_error, pair.colour_roughness)
        return image, detected, std
    if pair.colour_is_better and not compressed:
        return image, detected, BLOCK_FACTOR * pair.colour_error
    of_colour: FloatArray | float = max(pair.scatter, pair.colour_roughness)
    if compressed:
        of_colour = np.fmax(of_colour, pair.distances)
    stds = np.where(pair.disturbed, of_colour, BLOCK_FACTOR * pair.scatter / 2)
    return image.of_brightness, bright.replaced(coarse, pair.disturbed), stds


@dataclass(frozen=True, eq=False)
class _Pair:
    """One line in colour and in luminance: (n,) columns, rows, stds and distances."""

    columns: IntArray
    colour_rows: FloatArray
    bright_rows: FloatArray
    colour_std: FloatArray
    bright_std: FloatArray

    @classmethod
    def of(cls, colour: DetectedLine, bright: DetectedLine) -> "_Pair":
        return cls(
            colour.windows.columns,
            colour.stripes.pixels[:, 1],
            bright.stripes.pixels[:, 1],
            colour.stripes.std,
            bright.stripes.std,
        )

    @property
    def distances(self) -> FloatArray:
        return np.abs(self.bright_rows - self.colour_rows)

    @property
    def noise(self) -> FloatArray:
        return np.hypot(self.bright_std, self.colour_std)

    @property
    def scatter(self) -> float:
        return MAD_TO_STD * float(np.nanmedian(self.distances))

    @property
    def agrees(self) -> bool:
        ratio = MAD_TO_STD * float(np.nanmedian(self.distances / self.noise))
        return ratio < COARSE_COLOUR_SIGMAS

    @property
    def colour_error(self) -> float:
        return math.sqrt(max(self.scatter**2 - float(np.nanmedian(self.noise)) ** 2, 0.0))

    @property
    def colour_roughness(self) -> float:
        return roughness(self.columns, self.colour_rows)

    @property
    def print_in_luminance(self) -> bool:
        """Whether the luminance is the rougher one, which has the finer resolution."""
        found = np.isfinite(self.bright_rows)
        of_luminance = roughness(self.columns[found], self.bright_rows[found])
        return of_luminance > roughness(self.columns[found], self.colour_rows[found])

    @property
    def noise_explains_luminance(self) -> bool:
        """Whether the luminance is as rough as its noise, the rounding of a JPEG file included."""
        found = np.isfinite(self.bright_rows)
        of_luminance = roughness(self.columns[found], self.bright_rows[found])
        return of_luminance < MAX_ROUGHNESS_SIGMAS * float(np.median(self.bright_std[found]))

    @property
    def colour_is_better(self) -> bool:
        of_colour = np.nanmedian(np.hypot(self.colour_std, self.colour_error))
        return bool(of_colour < np.nanmedian(np.hypot(self.bright_std, self.scatter / 2)))

    @property
    def disturbed(self) -> BoolArray:
        """Columns in which the luminance is off by far more than in most, or lost."""
        limit = MAX_DISTANCE_SIGMAS * np.hypot(self.scatter, self.bright_std)
        near: BoolArray = self.distances <= limit
        return ~near
