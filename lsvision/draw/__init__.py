"""Pictures of results; matplotlib's own objects, never pyplot and its global state."""

from lsvision.draw.figures import render_figure
from lsvision.draw.laser_line import draw_laser_line, summarise_line
from lsvision.draw.measurement import draw_measurement, draw_on_axes
from lsvision.draw.overlay import draw_on_photo, draw_overlay

__all__ = [
    "draw_laser_line",
    "draw_measurement",
    "draw_on_axes",
    "draw_on_photo",
    "draw_overlay",
    "render_figure",
    "summarise_line",
]
