"""Colours with less resolution than the image: those of a JPEG file, or of an interpolated mosaic.

A line located in such colours deviates from the line located in the luminance by more than the
noise of the pixels. The luminance has twice the resolution of the colours and is used, except where
it shows a printed pattern, which the excess of the laser's colour does not contain.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import BoolArray, FloatArray
from lsvision.laser_line.detection import DetectedLine, add_rounding_errors, locate_line
from lsvision.laser_line.line_image import LineImage
from lsvision.laser_line.noise import has_correlated_errors, measure_roughness
from lsvision.laser_line.settings import LineSettings
from lsvision.statistics.robust import MAD_TO_STD

MAX_AGREEING_SIGMAS = 1.15
"""Distance of the lines in interpolated colours and in luminance, in standard deviations of their
noise, above which the colours shift the line: 1.2 to 9 in JPEG files and mosaics."""
MAX_DISTANCE_SIGMAS = 3.0
"""Distance of the two lines in a column, in standard deviations, beyond which the edge of a print
has shifted the line in the luminance there."""
SHARED_ERROR_FACTOR = 2.0
"""Factor on the standard deviation of errors that neighbouring columns share (those of a JPEG
file's block, or those between which a mosaic interpolates): a fit treats them as independent, and
four columns have one error. The mean squared error of single columns is then 0.7 of the predicted
one in mosaics and 0.1 in JPEG files."""
MAX_ROUGHNESS_SIGMAS = 1.5
"""Roughness of the line in a JPEG file's luminance, in standard deviations of its noise, from which
on a print is seen in it. Measured: 0.2 to 1.3 on grey surfaces (where a comparison with the
smoother colours would wrongly show a print), 2 to 16 on prints, 1 to 2 on thin text."""
MIN_LUMINANCE_FRACTION = 0.75
"""Smallest fraction of the line's columns in which the luminance has a stripe, too."""


def select_sharper_line(
    image: LineImage, detected: DetectedLine, settings: LineSettings
) -> tuple[LineImage, DetectedLine, FloatArray | float]:
    """Return the image and line of the luminance if they are better than those of the colour.

    The given image and line, from left to right, of the laser's colour are returned if the colours
    have the image's resolution, if the luminance has no stripe in too many columns, or if the line
    in the luminance is rougher, as on a printed pattern (in a JPEG file: rougher than its rounding
    explains); in a mosaic also if both lines agree or the one in the colour has the smaller
    standard deviation. Of the line of the luminance, columns in which an edge of a print shifts it
    are those of the colour.

    The third result is the standard deviation that the coarseness adds, for each column of the
    returned line (n,) or for all, in px. The error of the line in the luminance is assumed to be
    half of its distance from the line in the colour, which has half the resolution; the error of
    the line in the colour, in a single column of a JPEG file, to be the whole distance.
    """
    coarse = detected.select(detected.stripes.found)
    columns, rows = coarse.windows.columns, coarse.stripes.pixels[:, 1]
    if not has_correlated_errors(columns, rows):
        return image, detected, 0.0
    luminance_image = image.with_luminance_signal()
    luminance_line = locate_line(luminance_image, columns, rows, detected.sigma, settings)
    if luminance_line.stripes.found.mean() < MIN_LUMINANCE_FRACTION:
        return image, detected, 0.0
    luminance_line = add_rounding_errors(luminance_image, luminance_line)
    pair = _ComparedLines(coarse, luminance_line)
    compressed = luminance_line.blocks is not None
    if pair.agrees and not compressed:
        return image, detected, 0.0
    if pair.print_in_luminance and not (compressed and pair.noise_explains_luminance):
        std = min(SHARED_ERROR_FACTOR * pair.colour_error, pair.colour_roughness)
        return image, detected, std
    if pair.colour_is_better and not compressed:
        return image, detected, SHARED_ERROR_FACTOR * pair.colour_error
    of_colour: FloatArray | float = max(pair.scatter, pair.colour_roughness)
    if compressed:
        of_colour = np.fmax(of_colour, pair.distances)
    stds = np.where(pair.disturbed, of_colour, SHARED_ERROR_FACTOR * pair.scatter / 2)
    return luminance_image, luminance_line.replace_columns(coarse, pair.disturbed), stds


def estimate_coarse_colour_std(detected: DetectedLine) -> float:
    """Return the standard deviation that coarse colours add to the line located in them, in px.

    It is the line's roughness, over the largest distance at which columns share their errors; 0 if
    the colours have the image's resolution.
    """
    found = detected.stripes.found
    columns, rows = detected.windows.columns[found], detected.stripes.pixels[found, 1]
    return measure_roughness(columns, rows) if has_correlated_errors(columns, rows) else 0.0


@dataclass(frozen=True, eq=False)
class _ComparedLines:
    """The line in colour and in luminance, in the same n columns.

    Rows and standard deviations, (n,) in px, are NaN where the luminance does not show the line.
    """

    colour: DetectedLine
    luminance: DetectedLine

    @property
    def distances(self) -> FloatArray:
        """Distance of both lines in each column, (n,). Units: px."""
        rows, other_rows = (line.stripes.pixels[:, 1] for line in (self.luminance, self.colour))
        return np.abs(rows - other_rows)

    @property
    def noise(self) -> FloatArray:
        """Standard deviation of the distance predicted from the noise, (n,). Units: px."""
        return np.hypot(self.luminance.stripes.std, self.colour.stripes.std)

    @property
    def scatter(self) -> float:
        """Robust standard deviation of the distances. Units: px."""
        return MAD_TO_STD * float(np.nanmedian(self.distances))

    @property
    def agrees(self) -> bool:
        """Whether noise explains the distances of both lines."""
        ratio = MAD_TO_STD * float(np.nanmedian(self.distances / self.noise))
        return ratio < MAX_AGREEING_SIGMAS

    @property
    def colour_error(self) -> float:
        """Scatter of the distances beyond the noise, caused by the coarse colours. Units: px."""
        return math.sqrt(max(self.scatter**2 - float(np.nanmedian(self.noise)) ** 2, 0.0))

    @property
    def colour_roughness(self) -> float:
        """Roughness of the line in the colour. Units: px."""
        return _measure_roughness(self.colour, np.full(len(self.noise), True))

    @property
    def luminance_roughness(self) -> float:
        """Roughness of the line in the luminance. Units: px."""
        return _measure_roughness(self.luminance, np.isfinite(self.distances))

    @property
    def print_in_luminance(self) -> bool:
        """Whether the line in the luminance is rougher, in spite of the finer resolution."""
        of_colour = _measure_roughness(self.colour, np.isfinite(self.distances))
        return self.luminance_roughness > of_colour

    @property
    def noise_explains_luminance(self) -> bool:
        """Whether the luminance is no rougher than its noise with the rounding of a JPEG file."""
        std = float(np.nanmedian(self.luminance.stripes.std))
        return self.luminance_roughness < MAX_ROUGHNESS_SIGMAS * std

    @property
    def colour_is_better(self) -> bool:
        """Whether the colour has the smaller standard deviation, including its coarseness."""
        of_colour = np.nanmedian(np.hypot(self.colour.stripes.std, self.colour_error))
        return bool(
            of_colour < np.nanmedian(np.hypot(self.luminance.stripes.std, self.scatter / 2))
        )

    @property
    def disturbed(self) -> BoolArray:
        """Columns in which the luminance deviates far more than in most, or has no line, (n,)."""
        limit = MAX_DISTANCE_SIGMAS * np.hypot(self.scatter, self.luminance.stripes.std)
        near: BoolArray = self.distances <= limit
        return ~near


def _measure_roughness(line: DetectedLine, which: BoolArray) -> float:
    """Return the roughness of a line in the columns of a mask (n,). Units: px."""
    return measure_roughness(line.windows.columns[which], line.stripes.pixels[which, 1])
