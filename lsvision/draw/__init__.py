"""Pictures of results; matplotlib's own objects, never pyplot and its global state."""

from lsvision.draw.laser_line import draw_laser_line, line_summary
from lsvision.draw.measurement import draw_measurement, draw_on_axes
from lsvision.draw.numbers import decimals_for, sigma_text, with_sigma
from lsvision.draw.overlay import draw_on_photo, draw_overlay
from lsvision.draw.picture import picture_bytes

__all__ = [
    "decimals_for",
    "draw_laser_line",
    "draw_measurement",
    "draw_on_axes",
    "draw_on_photo",
    "draw_overlay",
    "line_summary",
    "picture_bytes",
    "sigma_text",
    "with_sigma",
]
