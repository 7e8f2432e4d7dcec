"""Calibration targets, and where an image shows them.

Board frame: origin at the first corner, x along a row, y along a column (down as printed),
z = x cross y into the board; the pattern lies in z = 0.
"""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.calibration.grey_image import grey_image
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray, Points, as_readonly_array

REFINEMENT_STEPS = 30
"""Steps of the corner refinement at most."""

WINDOW_FRACTION = 1 / 6
"""Half window of the corner refinement, in squares: 0.018 px instead of 0.024 with a fixed
5 px (camera.md, section 2)."""


class TargetNotFound(CalibrationFailed):
    """An image in which the target is not seen."""


@dataclass(frozen=True, eq=False)
class TargetView:
    """What one image shows of a target.

    Parameters
    ----------
    points : (n, 3) array_like
        Board frame, z = 0. Units: mm.
    pixels : (n, 2) array_like
        Where they appear. Units: px.
    size : tuple of int
        ``(width, height)`` of the image. Units: px.
    """

    points: FloatArray
    pixels: FloatArray
    size: tuple[int, int]

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", as_readonly_array(self.points, ("n", 3), "board points"))
        object.__setattr__(self, "pixels", as_readonly_array(self.pixels, ("n", 2), "pixels"))
        if len(self.points) != len(self.pixels):
            raise ValueError(f"want {len(self.points)} pixels, got {len(self.pixels)}")


@runtime_checkable
class Target(Protocol):
    """A flat pattern of known points."""

    @property
    def points(self) -> Points:
        """All its points, (n, 3), board frame, z = 0. Units: mm."""
        ...

    def find(self, image: npt.NDArray[np.uint8]) -> tuple[Points, Points] | None:
        """Points (n, 3) in mm and their pixels (n, 2) in a grey image, or None."""
        ...


@dataclass(frozen=True)
class ChArUco:
    """Chessboard with markers in its white squares: may be seen in part. The default target.

    Parameters
    ----------
    squares_x, squares_y : int
        Squares in a row and in a column.
    square, marker : float
        Edges. Units: mm.
    dictionary : str
        Name of OpenCV's marker dictionary.
    legacy : bool
        The pattern of OpenCV before 4.6 (boards with an even count of rows differ).
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
            raise ValueError(f"want 0 < marker < square {self.square:g} mm, got {self.marker:g}")
        if not hasattr(cv2.aruco, self.dictionary):
            raise ValueError(f"want a dictionary of cv2.aruco, got {self.dictionary!r}")

    @property
    def points(self) -> Points:
        """Inner corners, (n, 3). Units: mm."""
        return _grid(self.squares_x - 1, self.squares_y - 1, self.square)

    @property
    def board(self) -> Any:
        """OpenCV's board of this pattern."""
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        size = (self.squares_x, self.squares_y)
        board = cv2.aruco.CharucoBoard(size, self.square, self.marker, dictionary)
        board.setLegacyPattern(self.legacy)
        return board

    def find(self, image: npt.NDArray[np.uint8]) -> tuple[Points, Points] | None:
        """Inner corners seen, at least six not in one row; see `Target`."""
        corners, ids, _, _ = cv2.aruco.CharucoDetector(self.board).detectBoard(image)
        if ids is None or len(ids) < 6:
            return None
        points = self.points[np.asarray(ids).reshape(-1)]
        if min(np.ptp(points[:, 0]), np.ptp(points[:, 1])) == 0:
            return None
        return points, np.asarray(corners, dtype=np.float64).reshape(-1, 2)


@dataclass(frozen=True)
class Chessboard:
    """Plain chessboard, seen whole.

    Parameters
    ----------
    columns, rows : int
        Inner corners in a row and in a column; best one even, one odd.
    square : float
        Edge. Units: mm.
    corner_window : int, optional
        Half window of the corner refinement; a sixth of the smallest square if None. Larger
        ones reach into neighbouring corners. Units: px.
    corner_stop : float
        Step below which the refinement stops. Units: px.
    """

    columns: int = 9
    rows: int = 6
    square: float = 25.0
    corner_window: int | None = None
    corner_stop: float = 1e-3

    def __post_init__(self) -> None:
        _check_grid(self.columns, self.rows, self.square, "square")
        if not (self.corner_stop > 0 and (self.corner_window is None or self.corner_window > 0)):
            raise ValueError("want a positive corner_window and corner_stop in px")

    @property
    def points(self) -> Points:
        """Inner corners, (n, 3). Units: mm."""
        return _grid(self.columns, self.rows, self.square)

    def find(self, image: npt.NDArray[np.uint8]) -> tuple[Points, Points] | None:
        """All inner corners; see `Target`."""
        size = (self.columns, self.rows)
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, corners = cv2.findChessboardCorners(image, size, flags=flags)
        if not found:
            # Slower, but sees boards that glare or a laser line spoils for the first.
            found, corners = cv2.findChessboardCornersSB(image, size)
        if not found:
            return None
        rough = np.asarray(corners, dtype=np.float32).reshape(-1, 2)
        window = self.corner_window or self._window_for(rough)
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, REFINEMENT_STEPS, self.corner_stop)
        refined = cv2.cornerSubPix(image, rough.reshape(-1, 1, 2), (window, window), (-1, -1), stop)
        return self.points, np.asarray(refined, dtype=np.float64).reshape(-1, 2)

    def _window_for(self, corners: npt.NDArray[np.float32]) -> int:
        grid = corners.reshape(self.rows, self.columns, 2)
        steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
        return int(np.clip(round(min(steps) * WINDOW_FRACTION), 2, 15))


@dataclass(frozen=True)
class CircleGrid:
    """Grid of dark discs, seen whole.

    Parameters
    ----------
    columns, rows : int
        Discs in a row and in a column.
    spacing : float
        Between neighbours of a row; in an asymmetric grid half the distance within a row,
        and the distance between rows. Units: mm.
    diameter : float
        Of a disc. Units: mm.
    asymmetric : bool
        Every second row is moved by `spacing`; tells top from bottom.
    """

    columns: int = 4
    rows: int = 11
    spacing: float = 15.0
    diameter: float = 12.0
    asymmetric: bool = True

    def __post_init__(self) -> None:
        _check_grid(self.columns, self.rows, self.spacing, "spacing")
        room = self.spacing * (np.sqrt(2) if self.asymmetric else 1)
        if not 0 < self.diameter < room:
            raise ValueError(f"want 0 < diameter < {room:g} mm, got {self.diameter:g}")

    @property
    def points(self) -> Points:
        """Centres, (n, 3). Units: mm."""
        if not self.asymmetric:
            return _grid(self.columns, self.rows, self.spacing)
        row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
        x = (2 * column + row % 2) * self.spacing
        return np.column_stack([x, row * self.spacing, np.zeros(len(row))])

    def find(self, image: npt.NDArray[np.uint8]) -> tuple[Points, Points] | None:
        """All centres; see `Target`."""
        layout = cv2.CALIB_CB_ASYMMETRIC_GRID if self.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
        # The grid finder's own blob detector misses discs of more than 5000 px.
        limits = cv2.SimpleBlobDetector_Params()
        limits.minArea, limits.maxArea = 20.0, image.size / (self.columns * self.rows)
        limits.minDistBetweenBlobs = 2.0
        blobs = cv2.SimpleBlobDetector_create(limits)
        size = (self.columns, self.rows)
        found, centres = cv2.findCirclesGrid(image, size, flags=layout, blobDetector=blobs)
        if not found:
            return None
        return self.points, np.asarray(centres, dtype=np.float64).reshape(-1, 2)


def find_target(image: npt.ArrayLike, target: Target) -> TargetView:
    """Find a target in an image.

    Parameters
    ----------
    image : (height, width) or (height, width, 3) array_like
        8 or 16 bit; three channels in OpenCV's order, blue first.
    target : Target
        What to look for.

    Returns
    -------
    TargetView
        The points seen and their pixels.

    Raises
    ------
    TypeError, ValueError
        If it is no image.
    TargetNotFound
        If the target is not seen.

    Examples
    --------
    >>> board = np.kron(np.indices((7, 8)).sum(axis=0) % 2, np.ones((40, 40))) * 255
    >>> image = np.pad(board, 40, constant_values=255).astype(np.uint8)
    >>> view = find_target(image, Chessboard(columns=7, rows=6, square=10.0))
    >>> view.pixels[0].round(1)
    array([79.5, 79.5])
    """
    grey = grey_image(image)
    found = target.find(grey)
    if found is None:
        height, width = grey.shape
        raise TargetNotFound(
            f"no {target} in the image of {width} x {height} px: show it whole, sharp and "
            "evenly lit, with a white margin, and check its counts"
        )
    points, pixels = found
    return TargetView(points, pixels, (grey.shape[1], grey.shape[0]))


def _grid(columns: int, rows: int, step: float) -> Points:
    row, column = np.divmod(np.arange(columns * rows), columns)
    return np.column_stack([column * step, row * step, np.zeros(len(row))])


def _check_grid(columns: int, rows: int, length: float, name: str) -> None:
    if not (columns >= 3 and rows >= 3):
        raise ValueError(f"want 3 columns and rows at least, got {columns} x {rows}")
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"want a positive {name} in mm, got {length}")
