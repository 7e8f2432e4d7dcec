"""A target as a page of black shapes in mm, on a sheet that a printer knows."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from lsvision.calibration.target import ChArUco, Chessboard, CircleGrid, Target
from lsvision.geometry.arrays import BoolArray

MARGIN = 10.0
"""mm; white border, which the detectors need and the printer cannot print on anyway."""

RULER = 100.0
"""mm; length of the bar by which a person checks the printer's scale."""

FOOT = 14.0
"""mm; height of the strip below the pattern that holds bar and text."""

PAPERS = ((210.0, 297.0), (297.0, 420.0), (420.0, 594.0), (594.0, 841.0), (841.0, 1189.0))
"""mm; A4 to A0. A page of another size than the paper invites the printer to scale it."""


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Black rectangle; (x, y) is its top left corner. Units: mm."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class Disc:
    """Black disc around (x, y). Units: mm."""

    x: float
    y: float
    radius: float


@dataclass(frozen=True)
class PageLayout:
    """A page of black shapes on white; y grows downwards.

    Parameters
    ----------
    width, height : float
        Units: mm.
    shapes : tuple of Rectangle or Disc
        What is black.
    text : str
        One line below the pattern.
    text_at : tuple of float
        Where its base line begins. Units: mm.
    """

    width: float
    height: float
    shapes: tuple[Rectangle | Disc, ...]
    text: str
    text_at: tuple[float, float]


def layout_target(target: Target) -> PageLayout:
    """The page that shows a target, with a bar of 100 mm to check the print.

    Raises
    ------
    TypeError
        If it is a target that this module cannot draw.
    """
    match target:
        case ChArUco():
            shapes = _charuco(target)
            size = (target.squares_x * target.square, target.squares_y * target.square)
            text = (
                f"ChArUco {target.squares_x} x {target.squares_y}, square {target.square:g} mm, "
                f"marker {target.marker:g} mm, {target.dictionary}"
            )
        case Chessboard():
            shapes = _squares(target.columns + 1, target.rows + 1, target.square, first=0)
            size = ((target.columns + 1) * target.square, (target.rows + 1) * target.square)
            text = (
                f"chessboard {target.columns} x {target.rows} corners, square {target.square:g} mm"
            )
        case CircleGrid():
            points, radius = target.points[:, :2] + target.spacing, target.diameter / 2
            shapes = [Disc(float(x), float(y), radius) for x, y in points]
            size = tuple((points.max(axis=0) + target.spacing).tolist())
            kind = "asymmetric" if target.asymmetric else "symmetric"
            text = (
                f"{kind} circles {target.columns} x {target.rows}, spacing "
                f"{target.spacing:g} mm, diameter {target.diameter:g} mm"
            )
        case _:
            raise TypeError(f"want a ChArUco, Chessboard or CircleGrid, got {target!r}")
    return _page(shapes, size, text)


def _page(shapes: Sequence[Rectangle | Disc], size: tuple[float, float], text: str) -> PageLayout:
    width, height = _paper(max(size[0], RULER) + 2 * MARGIN, size[1] + 2 * MARGIN + FOOT)
    left, top = (width - size[0]) / 2, (height - size[1] - FOOT) / 2
    moved = [_moved(shape, left, top) for shape in shapes]
    below = top + size[1] + MARGIN
    bar = [
        Rectangle(MARGIN, below + 2, RULER, 0.4),
        Rectangle(MARGIN, below, 0.2, 4.4),
        Rectangle(MARGIN + RULER - 0.2, below, 0.2, 4.4),
    ]
    text = f"{text}. Print at 100 %; the bar is 100 mm."
    return PageLayout(width, height, (*moved, *bar), text, (MARGIN, below + 9))


def _paper(width: float, height: float) -> tuple[float, float]:
    """The smallest sheet that holds a page, either way up; the page itself beyond A0."""
    for short, long in PAPERS:
        for sheet in ((short, long), (long, short)):
            if width <= sheet[0] and height <= sheet[1]:
                return sheet
    return width, height


def _moved(shape: Rectangle | Disc, x: float, y: float) -> Rectangle | Disc:
    if isinstance(shape, Disc):
        return Disc(shape.x + x, shape.y + y, shape.radius)
    return Rectangle(shape.x + x, shape.y + y, shape.width, shape.height)


def _squares(columns: int, rows: int, edge: float, first: int) -> list[Rectangle | Disc]:
    """Every second square; `first` is 0 if the top left one is black."""
    return [
        Rectangle(column * edge, row * edge, edge, edge)
        for row in range(rows)
        for column in range(columns)
        if (row + column) % 2 == first
    ]


def _charuco(target: ChArUco) -> list[Rectangle | Disc]:
    """Black squares, and the black cells of the markers in the white ones."""
    board = target.board
    # OpenCV's own picture, one pixel a cell, tells which squares are black and holds the bits:
    # it differs between the legacy pattern and today's.
    first = 0
    if target.legacy and target.squares_y % 2 == 0:
        first = 1
    shapes = _squares(target.squares_x, target.squares_y, target.square, first)
    dictionary = board.getDictionary()
    cells = dictionary.markerSize + 2
    edge = target.marker / cells
    for number, corners in zip(board.getIds().ravel(), board.getObjPoints(), strict=True):
        left, top = np.asarray(corners)[:, :2].min(axis=0)
        bits = cv2.aruco.generateImageMarker(dictionary, int(number), cells)
        for row, column, width in _runs(bits == 0):
            shapes.append(
                Rectangle(float(left) + column * edge, float(top) + row * edge, width * edge, edge)
            )
    return shapes


def _runs(black: BoolArray) -> list[tuple[int, int, int]]:
    """Row, column and length of each horizontal run of black cells."""
    runs = []
    for row, line in enumerate(black):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
        runs += [(row, int(a), int(b - a)) for a, b in edges.reshape(-1, 2)]
    return runs
