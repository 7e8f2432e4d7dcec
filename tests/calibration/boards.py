"""Pictures of boards, drawn pixel by pixel with a pinhole that is not the library's."""

import cv2
import numpy as np


def rotation(vector):
    return cv2.Rodrigues(np.array(vector, dtype=float))[0]


def board_along(rotation, shift, focal, centre, directions):
    """Coordinates of what a pinhole sees of a board's plane, along directions of its frame.

    One array (1440, 1920) for each direction, at each third of a px. The plane contains `shift`,
    and its normal is the third column of `rotation`.
    """
    across = ((np.arange(3 * 640) - 1) / 3 - centre[0]) / focal
    down = ((np.arange(3 * 480) - 1) / 3 - centre[1])[:, None] / focal

    def of_ray(direction):
        return direction[0] * across + direction[1] * down + direction[2]

    depth = rotation[:, 2] @ shift / of_ray(rotation[:, 2])
    return [depth * of_ray(direction) for direction in directions]


def chessboard_picture(turn, *, counts=(9, 6), square=12.0, depth=300.0, blur=0.7, focal=1200.0):
    """A board's whiteness (480, 640) and its true corners (rows * columns, 2) in px.

    The black square of the first corner is printed at the upper left.
    """
    columns, rows = counts
    R = rotation(turn)
    middle = np.array([columns - 1, rows - 1, 0]) * square / 2
    shift = np.array([0, 0, depth]) - R @ middle
    x, y = board_along(R, shift, focal, (320, 240), (R[:, 0], R[:, 1]))
    x, y = (x - shift @ R[:, 0]) / square, (y - shift @ R[:, 1]) / square
    inside = (x > -1) & (x < columns) & (y > -1) & (y < rows)
    white = np.where(inside & ((np.floor(x) + np.floor(y)) % 2 == 0), 0.1, 1.0)
    image = cv2.resize(white.astype(np.float32), (640, 480), interpolation=cv2.INTER_AREA)
    row, column = np.divmod(np.arange(columns * rows), columns)
    corners = np.column_stack([column, row, 0 * row]) * square @ R.T + shift
    return cv2.GaussianBlur(image, (0, 0), blur), corners[:, :2] / corners[:, 2:] * focal + (
        320,
        240,
    )


def photographed(white, rng, *, bright=200.0, noise=2.0, laser=None):
    """The picture in 8 bit, lit from the right, with noise, and a laser's light added."""
    lit = white * np.linspace(0.7, 1.3, 640) * bright + 10
    lit = lit + (0 if laser is None else laser) + rng.normal(0, noise, white.shape)
    return np.clip(np.round(lit), 0, 255).astype(np.uint8)
