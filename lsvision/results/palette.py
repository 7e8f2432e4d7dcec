"""The colours of all pictures: an object has the same colour in a photo, a section and a scan.

Based on the palette of Okabe and Ito, darkened under white letters: colour-blind readers can
distinguish them, on white and on a dark photo.
"""

CYLINDERS = ("#0072B2", "#00805E", "#A8457E", "#4B4BC8")
"""Colours of the cylinders, repeated; see `cylinder_colour`."""
REJECTED = ("#D55E00", "#9A6A00")
"""Colours of rejected arcs, repeated; neighbours differ, and none has the colour of a cylinder."""
POINTS = "#8C8C8C"
"""Measured points that belong to no cylinder."""
LASER_LINE, SATURATED = "#0095C8", "#D55E00"
"""Points of a laser line, and saturated points of it."""
INLIER, OUTLIER = "#0072B2", "#D55E00"
"""Residuals of a calibration: of inliers and of outliers."""
BOARD, LASER_PLANE = "#999999", "#C8102E"
"""Outlines of calibration targets and of the laser plane."""
DECISIONS = {"OK": "#00644A", "NG": "#B3261E", "undecided": "#7A5B00"}
"""Colours of verdicts, which shapes and text show too."""
LIMITS = "#B3261E"
"""Lines of limits."""
EDGES = "#666666"
"""Edges of the box around a drawing in space, and its numbers."""
FRAME_AXES = ("#C8102E", "#00805E", "#0072B2")
"""X, Y and Z of a frame."""


def cylinder_colour(number: int) -> str:
    """Return the colour of a cylinder, numbered from 1; colours repeat."""
    return CYLINDERS[(number - 1) % len(CYLINDERS)]
