"""Laser lines as text."""

import numpy as np

from lsvision.laser_line.line import LaserLine

HEADER = "u [px],v [px],std [px],width [px],intensity [DN],saturated"
"""Columns: pixel, standard uncertainty of its position across the line, width, and peak value."""


def format_line_csv(line: LaserLine) -> str:
    """Return a laser line as CSV text, one point per row; ``nan`` where it is lost.

    Parameters
    ----------
    line : LaserLine
        The line; its order is kept, a row for each column (or row) of the image.

    Examples
    --------
    >>> rows = np.arange(64)[:, None]
    >>> image = (10 + 90 * np.exp(-0.5 * ((rows - 30.2) / 1.5) ** 2) * np.ones(99)).astype("uint8")
    >>> from lsvision.laser_line.extraction import extract_laser_line
    >>> format_line_csv(extract_laser_line(image)).splitlines()[0]
    'u [px],v [px],std [px],width [px],intensity [DN],saturated'
    """
    table = np.column_stack([line.pixels, line.std, line.width, line.intensity, line.saturated])
    rows = [",".join([*(f"{x:.4f}" for x in row[:5]), f"{row[5]:.0f}"]) for row in table]
    return "\n".join([HEADER, *rows]) + "\n"
