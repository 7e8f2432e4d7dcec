"""Pictures of results; matplotlib's own objects, never pyplot and its global state."""

from lsvision.draw.measurement import draw_measurement, draw_on_axes
from lsvision.draw.numbers import decimals_for, with_sigma
from lsvision.draw.picture import picture_bytes

__all__ = ["decimals_for", "draw_measurement", "draw_on_axes", "picture_bytes", "with_sigma"]
