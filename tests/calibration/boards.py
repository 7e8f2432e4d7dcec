"""Pictures of chessboards, drawn pixel by pixel with a pinhole that is not the library's."""

import cv2
import numpy as np


def rotation(vector):
    return cv2.Rodrigues(np.array(vector, dtype=float))[0]


def chessboard_picture(turn, *, counts=(9, 6), square=12.0, depth=300.0, blur=0.7, focal=1200.0):
    """A board's whiteness (480, 640) and its true corners (rows * columns, 2) in px.

    The black square of the first corner is printed at the upper left.
    """
    columns, rows = counts
    R = rotation(turn)
    middle = np.array([columns - 1, rows - 1, 0]) * square / 2
    shift = np.array([0, 0, depth]) - R @ middle
    u, v = np.meshgrid((np.arange(3 * 640) - 1) / 3, (np.arange(3 * 480) - 1) / 3)
    rays = np.stack([(u - 320) / focal, (v - 240) / focal, np.ones_like(u)], axis=-1)
    points = rays * (R[:, 2] @ shift / (rays @ R[:, 2]))[..., None] - shift
    x, y = points @ R[:, 0] / square, points @ R[:, 1] / square
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
