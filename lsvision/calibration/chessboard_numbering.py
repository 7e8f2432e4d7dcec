"""Order of a chessboard's corners, independent of the detector and the image's orientation.

The first corner touches a black square at a corner of the board. Seen with the rows pointing to the
right, the columns point down, as printed. If the board looks the same after a turn, because both
counts of inner corners are even or both are odd, the order is used whose rows point most to the
right in the image.
"""

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.calibration.chessboard_corners import (
    compute_cell_middles,
    measure_square_size,
    sample,
)
from lsvision.geometry import IntArray, Points

SMOOTHING_FRACTION = 0.1
"""Standard deviation of the smoothing before the squares are sampled, in squares."""


def find_corner_order(image: npt.NDArray[np.uint8], corners: Points) -> IntArray:
    """Return the indices (rows, columns) that bring corners into the order of the board.

    They are indices into ``corners.reshape(-1, 2)`` for the corners (rows, columns, 2) of a grey
    image in px, a grid that may be rotated or mirrored.

    Examples
    --------
    >>> board = np.kron(np.indices((4, 5)).sum(axis=0) % 2, np.ones((20, 20))) * 255
    >>> y, x = np.mgrid[1:4, 1:5] * 20.0
    >>> upside_down = np.stack([x, y], axis=-1)[::-1, ::-1]
    >>> int(find_corner_order(board.astype(np.uint8), upside_down)[0, 0])
    11
    """
    smoothing = max(SMOOTHING_FRACTION * measure_square_size(corners), 0.5)
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), smoothing)
    flat, right_handed = corners.reshape(-1, 2), _select_right_handed_orders(corners)
    black_first = [order for order in right_handed if _measure_contrast(smooth, flat[order]) > 0]
    # On a board with four white corner squares no corner touches a black corner square.
    return max(
        black_first or right_handed, key=lambda order: _compute_rightward_cosine(flat[order])
    )


def find_reading_order(centres: Points) -> IntArray:
    """Return the indices (rows, columns) of a symmetric grid: rows to the right, as one reads.

    `centres` (rows, columns, 2) are a grid that may be rotated or mirrored; all rotations of a
    symmetric grid look the same.
    """
    flat = centres.reshape(-1, 2)
    return max(
        _select_right_handed_orders(centres),
        key=lambda order: _compute_rightward_cosine(flat[order]),
    )


def _select_right_handed_orders(corners: Points) -> list[IntArray]:
    """Return the orders that are not mirrored: columns point down if rows point to the right."""
    flat = corners.reshape(-1, 2)
    return [
        order
        for order in _list_grid_orders(corners.shape[:2])
        if _compute_handedness(flat[order]) > 0
    ]


def _list_grid_orders(shape: tuple[int, ...]) -> list[IntArray]:
    """Return the indices of the grid, rotated and mirrored: four ways, eight for a square grid."""
    order = np.arange(shape[0] * shape[1]).reshape(shape)
    orders = [order, order.T] if shape[0] == shape[1] else [order]
    return [
        order[::row_step, ::column_step]
        for order in orders
        for row_step in (1, -1)
        for column_step in (1, -1)
    ]


def _compute_handedness(corners: Points) -> float:
    """Return the cross product of the mean row and the mean column; positive if not mirrored."""
    row = (corners[:, -1] - corners[:, 0]).mean(axis=0)
    column = (corners[-1] - corners[0]).mean(axis=0)
    return float(row[0] * column[1] - row[1] * column[0])


def _measure_contrast(image: npt.NDArray[np.float32], corners: Points) -> float:
    """Return how much brighter the other squares are than those of the first square's colour.

    The first square between corners has the colour of the square at the board's corner, which it
    touches in the first corner.
    """
    middles = compute_cell_middles(corners)
    odd = np.indices(middles.shape[:2]).sum(axis=0) % 2 == 1
    values = sample(image, middles)
    return float(np.median(values[odd]) - np.median(values[~odd]))


def _compute_rightward_cosine(corners: Points) -> float:
    """Return the cosine of the angle between a row and the image's rows."""
    row = (corners[:, -1] - corners[:, 0]).mean(axis=0)
    return float(row[0] / np.linalg.norm(row))
