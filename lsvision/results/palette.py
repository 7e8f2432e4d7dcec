"""The colours of all pictures: cylinders have the same colours in a photo, a section and a scan.

Based on the palette of Okabe and Ito, made darker where white letters are written on a colour:
colour-blind readers can distinguish them, on white and on a dark photo.
"""

CYLINDERS = ("#0072B2", "#00805E", "#A8457E", "#4B4BC8")
"""Colours of the first to fourth cylinder, of the fifth to eighth, and so on."""
REJECTED = ("#D55E00", "#9A6A00")
"""Colours of rejected arcs by turns; none is the colour of a cylinder."""
POINTS = "#8C8C8C"
"""Measured points that belong to no cylinder."""
LASER_LINE, SATURATED = "#0095C8", "#D55E00"
"""Points of an extracted laser line, and its saturated points."""
INLIER, OUTLIER = "#0072B2", "#D55E00"
"""Residuals of a calibration: of inliers and of outliers."""
CORNER, CORNER_RESIDUAL = "#0095C8", "#D55E00"
"""Corners found in the photos of a calibration, and the arrows of their residuals."""
BOARD, LASER_PLANE = "#999999", "#C8102E"
"""Outlines of calibration targets and of the laser plane; in the photos of a calibration also the
points found of its laser line, with their residuals."""
DECISIONS = {"OK": "#00644A", "NG": "#B3261E", "undecided": "#7A5B00"}
"""Colours of verdicts; the shape of a marker or a text states the verdict, too."""
LIMITS = "#B3261E"
"""Lines of limits."""
EDGES = "#666666"
"""Edges of the box around a drawing in space, and its numbers."""
FRAME_AXES = ("#C8102E", "#00805E", "#0072B2")
"""X, Y and Z of a frame."""


def choose_cylinder_colour(number: int) -> str:
    """Return the colour of a cylinder, numbered from 1; colours repeat."""
    return CYLINDERS[(number - 1) % len(CYLINDERS)]
