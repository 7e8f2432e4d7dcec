"""Pictures of results; matplotlib's own objects, never pyplot and its global state."""

from lsvision.draw.figures import figure_bytes
from lsvision.draw.laser_line import draw_laser_line, line_summary
from lsvision.draw.measurement import draw_measurement, draw_on_axes
from lsvision.draw.overlay import draw_on_photo, draw_overlay

__all__ = [
    "draw_laser_line",
    "draw_measurement",
    "draw_on_axes",
    "draw_on_photo",
    "draw_overlay",
    "figure_bytes",
    "line_summary",
]
