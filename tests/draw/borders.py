"""Whether a picture is whole: nothing is cut where nothing touches the edge."""

import numpy as np

BORDER_PX = 3


def has_white_border(figure):
    """Whether the outermost pixels of a figure are white all around."""
    figure.canvas.draw()
    dark = np.asarray(figure.canvas.buffer_rgba())[..., :3].min(axis=2) < 255
    dark[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX] = False
    return not dark.any()
