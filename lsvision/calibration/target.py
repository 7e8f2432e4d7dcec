"""Calibration targets and their detection in images.

Board frame: origin at the first corner, x along a row, y along a column (down as printed),
z = x cross y into the board; the pattern lies in z = 0.
"""

from __future__ import annotations

import operator
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.calibration.chessboard_corners import detect_initial_corners, locate_corners
from lsvision.calibration.chessboard_numbering import find_corner_order, find_reading_order
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray, Points, as_readonly_array
from lsvision.geometry.arrays import freeze_arrays
from lsvision.geometry.equality import ComparedByValue
from lsvision.laser_line.image_array import convert_to_grey

MIN_CHARUCO_CORNERS = 6
"""Smallest number of visible inner corners: four determine the homography, two check it."""
MIN_DISCS = 15
"""Smallest number of discs that OpenCV's `findCirclesGrid` finds."""


class TargetNotFound(CalibrationFailed):
    """The target was not found in an image."""


@dataclass(frozen=True, eq=False)
class TargetView(ComparedByValue):
    """Points of a target found in one image.

    Parameters
    ----------
    points : (n, 3) array_like
        Points in the board frame, z = 0. Units: mm.
    pixels : (n, 2) array_like
        Images of `points`. Units: px.
    size : tuple of int
        ``(width, height)`` of the image. Units: px.
    """

    points: FloatArray
    pixels: FloatArray
    size: tuple[int, int]

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", as_readonly_array(self.points, ("n", 3), "board points"))
        freeze_arrays(self, pixels=(len(self.points), 2))
        if not (np.isfinite(self.points).all() and np.isfinite(self.pixels).all()):
            raise ValueError(
                "expected finite points and pixels, got NaN or infinity: leave lost points out"
            )


def fit_board_homography(view: TargetView) -> FloatArray:
    """Return the homography (3, 3) from the board plane (mm) to the image (px)."""
    points = np.ascontiguousarray(view.points[:, :2])
    homography, _ = cv2.findHomography(points, np.ascontiguousarray(view.pixels))
    return np.asarray(homography, dtype=np.float64)


@runtime_checkable
class Target(Protocol):
    """Flat pattern of known points."""

    @property
    def points(self) -> Points:
        """All points, (n, 3), board frame, z = 0. Units: mm."""
        ...

    def find(self, image: npt.NDArray[np.uint8]) -> tuple[Points, Points] | None:
        """Return points (n, 3) in mm and their pixels (n, 2) in a grey image, or None."""
        ...


class PrintedTarget(ABC):
    """Base class of the targets that this package prints and finds."""

    def find(self, image: npt.NDArray[np.uint8]) -> tuple[Points, Points] | None:
        """Return the points of the target in an image.

        Parameters
        ----------
        image : (height, width) ndarray of uint8
            Grey image.

        Returns
        -------
        points, pixels : (n, 3) and (n, 2) ndarray
            Points in the board frame (mm) and in the image (px); None if the target is not found.

        Examples
        --------
        >>> target = ChArUco()
        >>> points, pixels = target.find(target.board.generateImage((1100, 800), marginSize=50))
        >>> points.shape, pixels.shape
        ((70, 3), (70, 2))
        """
        return self._find(image)

    @abstractmethod
    def _find(self, image: npt.NDArray[np.uint8]) -> tuple[Points, Points] | None:
        """Return what `find` returns, which is documented once for all targets."""


@dataclass(frozen=True)
class ChArUco(PrintedTarget):
    """Chessboard with markers in its white squares: may be partly visible. The default target.

    Parameters
    ----------
    squares_x, squares_y : int
        Number of squares in a row and in a column.
    square, marker : float
        Edge lengths. Units: mm.
    dictionary : str
        Name of OpenCV's marker dictionary, with a marker for each white square.
    legacy : bool
        Pattern of OpenCV before 4.6: boards with an even number of rows begin with a white square.
        Where the stated pattern is not found, the other one is tried: their corners are the same.

    Examples
    --------
    >>> ChArUco(11, 8, square=15.0, marker=11.0).points.shape
    (70, 3)
    """

    squares_x: int = 11
    squares_y: int = 8
    square: float = 15.0
    marker: float = 11.0
    dictionary: str = "DICT_4X4_100"
    legacy: bool = False

    def __post_init__(self) -> None:
        _check_grid(self.squares_x, self.squares_y, self.square, "square")
        if not 0 < self.marker < self.square:
            raise ValueError(
                f"expected 0 < marker < square {self.square:g} mm, got {self.marker:g}"
            )
        if (self.squares_x - 1) * (self.squares_y - 1) < MIN_CHARUCO_CORNERS:
            raise ValueError(
                f"expected at least {MIN_CHARUCO_CORNERS} inner corners, got a ChArUco board of "
                f"{self.squares_x} x {self.squares_y} squares"
            )
        if not (str(self.dictionary).startswith("DICT_") and hasattr(cv2.aruco, self.dictionary)):
            raise ValueError(f"expected a dictionary of cv2.aruco, got {self.dictionary!r}")
        markers, available = self.squares_x * self.squares_y // 2, len(self._dictionary.bytesList)
        if markers > available:
            raise ValueError(
                f"expected at most {available} white squares with {self.dictionary}, got "
                f"{markers}: a dictionary with a larger last number has more markers"
            )

    def __str__(self) -> str:
        return (
            f"ChArUco board of {self.squares_x} x {self.squares_y} squares of {self.square:g} mm "
            f"(markers of {self.marker:g} mm, {self.dictionary})"
        )

    @property
    def points(self) -> Points:
        """Inner corners (n, 3), board frame, z = 0. Units: mm."""
        return _build_grid(self.squares_x - 1, self.squares_y - 1, self.square)

    @property
    def board(self) -> Any:
        """OpenCV's board of this pattern."""
        return self._build_board(self.legacy)

    @property
    def _dictionary(self) -> Any:
        """OpenCV's dictionary of the markers."""
        return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))

    def _build_board(self, legacy: bool) -> Any:
        """Return OpenCV's board with or without the legacy pattern."""
        size = (self.squares_x, self.squares_y)
        board = cv2.aruco.CharucoBoard(size, self.square, self.marker, self._dictionary)
        board.setLegacyPattern(legacy)
        return board

    def _find(self, image: npt.NDArray[np.uint8]) -> tuple[Points, Points] | None:
        """Return the visible inner corners, at least six and not all in one row or column."""
        patterns = (self.legacy, not self.legacy) if self.squares_y % 2 == 0 else (self.legacy,)
        for legacy in patterns:
            corners, ids, _, _ = cv2.aruco.CharucoDetector(self._build_board(legacy)).detectBoard(
                image
            )
            if ids is not None:
                break
        if ids is None or len(ids) < MIN_CHARUCO_CORNERS:
            return None
        points = self.points[np.asarray(ids).reshape(-1)]
        if not np.ptp(points[:, :2], axis=0).all():
            return None
        return points, np.asarray(corners, dtype=np.float64).reshape(-1, 2)


@dataclass(frozen=True)
class Chessboard(PrintedTarget):
    """Plain chessboard; must be completely visible.

    The first corner touches a black square at a corner of the board. Corners that a laser line or
    glare covers are left out. One count should be even and the other odd: otherwise the board looks
    the same after half a turn, and a hand-eye calibration must resolve its orientation by the
    robot's poses (`turn_boards`).

    Parameters
    ----------
    columns, rows : int
        Number of inner corners in a row and in a column.
    square : float
        Edge length. Units: mm.

    Examples
    --------
    >>> Chessboard(columns=9, rows=6, square=25.0).points[-1]
    array([200., 125.,   0.])
    """

    columns: int = 9
    rows: int = 6
    square: float = 25.0

    def __post_init__(self) -> None:
        _check_grid(self.columns, self.rows, self.square, "square")

    def __str__(self) -> str:
        return f"chessboard of {self.columns} x {self.rows} inner corners {self.square:g} mm apart"

    @property
    def points(self) -> Points:
        """Inner corners (n, 3), board frame, z = 0. Units: mm."""
        return _build_grid(self.columns, self.rows, self.square)

    def _find(self, image: npt.NDArray[np.uint8]) -> tuple[Points, Points] | None:
        """Return the inner corners that are on the grid of the others."""
        for initial in detect_initial_corners(image, self.columns, self.rows):
            detection = locate_corners(image, initial)
            if detection is not None:
                corners, inliers = detection
                order = find_corner_order(image, corners).ravel()
                visible = inliers.ravel()[order]
                return self.points[visible], corners.reshape(-1, 2)[order[visible]]
        return None


@dataclass(frozen=True)
class CircleGrid(PrintedTarget):
    """Grid of discs, dark on bright or bright on dark; must be completely visible.

    A symmetric grid is numbered in reading order of the image: its rotations look the same.

    Parameters
    ----------
    columns, rows : int
        Number of discs in a row, and number of rows. An asymmetric grid needs 5, 7, ... rows: with
        an even number it looks the same after half a turn.
    spacing : float
        Distance of neighbouring rows, and in a symmetric grid of neighbouring discs in a row; in an
        asymmetric grid these are two spacings apart, and the nearest discs sqrt(2). Units: mm.
    diameter : float
        Diameter of a disc. Units: mm.
    asymmetric : bool
        Whether every second row is shifted by `spacing`, which makes the orientation unique.

    Examples
    --------
    >>> CircleGrid().points.shape
    (44, 3)
    """

    columns: int = 4
    rows: int = 11
    spacing: float = 15.0
    diameter: float = 12.0
    asymmetric: bool = True

    def __post_init__(self) -> None:
        _check_grid(self.columns, self.rows, self.spacing, "spacing")
        counts = f"{self.columns} x {self.rows}"
        if self.asymmetric and (self.rows % 2 == 0 or self.rows < 5):
            raise ValueError(
                f"expected an odd number of rows of an asymmetric grid, at least 5, got {counts}: "
                "count the discs of one straight row as columns, as in 4 x 11"
            )
        if self.columns * self.rows < MIN_DISCS:
            raise ValueError(f"expected a grid of at least {MIN_DISCS} discs, got {counts}")
        limit = self.spacing * (np.sqrt(2) if self.asymmetric else 1)
        if not 0 < self.diameter < limit:
            raise ValueError(f"expected 0 < diameter < {limit:g} mm, got {self.diameter:g}")

    def __str__(self) -> str:
        kind, which = ("asymmetric", ", rows") if self.asymmetric else ("symmetric", "")
        return f"{kind} grid of {self.columns} x {self.rows} discs{which} {self.spacing:g} mm apart"

    @property
    def points(self) -> Points:
        """Centres of the discs (n, 3), board frame, z = 0. Units: mm."""
        if not self.asymmetric:
            return _build_grid(self.columns, self.rows, self.spacing)
        row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
        x = (2 * column + row % 2) * self.spacing
        return np.column_stack([x, row * self.spacing, np.zeros(len(row))])

    def _find(self, image: npt.NDArray[np.uint8]) -> tuple[Points, Points] | None:
        """Return all centres."""
        layout = cv2.CALIB_CB_ASYMMETRIC_GRID if self.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
        # The grid finder's own blob detector misses discs with an area of more than 5000 px.
        limits = cv2.SimpleBlobDetector_Params()
        limits.minArea, limits.maxArea = 20.0, image.size / (self.columns * self.rows)
        limits.minDistBetweenBlobs = 2.0
        blobs = cv2.SimpleBlobDetector_create(limits)
        for picture in (image, 255 - image):  # the blob detector finds dark discs only
            found, centres = cv2.findCirclesGrid(
                picture, (self.columns, self.rows), flags=layout, blobDetector=blobs
            )
            if found:
                grid = np.asarray(centres, dtype=np.float64).reshape(self.rows, self.columns, 2)
                grid = grid if self.asymmetric else grid.reshape(-1, 2)[find_reading_order(grid)]
                return self.points, grid.reshape(-1, 2)
        return None


def find_target(image: npt.ArrayLike, target: Target) -> TargetView:
    """Find a target in an image.

    Parameters
    ----------
    image : (height, width) or (height, width, 3) array_like
        Image of 8 or 16 bit; three channels in OpenCV's order (blue, green, red).
    target : Target
        Target to find.

    Returns
    -------
    TargetView
        Points found, in the board frame and in the image.

    Raises
    ------
    TypeError, ValueError, TargetNotFound
        If `image` is not an image, or the target is not found in it.

    Examples
    --------
    >>> board = np.kron(np.indices((7, 8)).sum(axis=0) % 2, np.ones((40, 40))) * 255
    >>> image = np.pad(board, 40, constant_values=255).astype(np.uint8)
    >>> find_target(image, Chessboard(columns=7, rows=6, square=10.0)).pixels[0].round(1)
    array([79.5, 79.5])
    """
    grey = convert_to_grey(image)
    height, width = grey.shape
    if (detection := target.find(grey)) is None:
        raise TargetNotFound(
            f"no {target} in the image of {width} x {height} px: show it whole, sharp and "
            "evenly lit, with a white margin, and check its counts"
        )
    return TargetView(*detection, (width, height))


def list_left_out_warnings(
    target: Target, views: Sequence[TargetView], indices: Sequence[int]
) -> list[str]:
    """Return a warning for each view in which corners of a fully visible target are left out.

    `indices` are the image indices of the views. A `ChArUco` board may be partly visible.
    """
    count = len(target.points)
    return [
        f"image {index}: {count - len(view.points)} of {count} corners left out, off the grid of "
        "the others: a laser line, glare or dirt lies on them"
        for index, view in zip(indices, views, strict=True)
        if not isinstance(target, ChArUco) and len(view.points) < count
    ]


def _build_grid(columns: int, rows: int, step: float) -> Points:
    """Return the points (n, 3) of a rectangular grid, row by row."""
    row, column = np.divmod(np.arange(columns * rows), columns)
    return np.column_stack([column * step, row * step, np.zeros(len(row))])


def _check_grid(columns: int, rows: int, length: float, name: str) -> None:
    """Require at least 3 columns and rows (of points or squares), and a positive length."""
    if not min(map(operator.index, (columns, rows))) >= 3:
        raise ValueError(f"expected at least 3 columns and rows, got {columns} x {rows}")
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"expected a positive {name} in mm, got {length}")
