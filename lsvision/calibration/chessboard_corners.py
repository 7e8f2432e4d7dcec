"""Corners of a chessboard in an image, to a fraction of a pixel, from rough positions.

A corner is the saddle point of the smoothed image (Lucchese and Mitra, "Using saddle points for
subpixel feature detection in camera calibration targets", APCCAS 2002). Before that, brightness is
normalised: black becomes 0 and white 1 everywhere on the board, or the other way round, since a
gradient of the light moves a saddle point. Corners that are off the board's grid, because a laser
line or glare was taken for them, are searched again where the grid predicts them, and are left out
if they are still off it.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.geometry import FloatArray, Points
from lsvision.geometry.arrays import BoolArray
from lsvision.geometry.plane import apply_homography

SMOOTHING_FRACTION, MIN_SMOOTHING_PX = 0.05, 1.0
"""Standard deviation of the smoothing, as a fraction of the smallest square, and its smallest
value. Twice the fraction reduces the errors by a tenth on noisy images, and increases them by a
tenth in uneven light."""

RADIUS_FRACTION, MIN_RADIUS_PX = 0.2, 3.0
"""Radius of the window around a corner, as a fraction of the smallest square, and its smallest
value."""

MAX_REFINEMENT_STEPS = 10
"""Maximum number of iterations of the refinement."""

SEARCH_ROUNDS = 3
"""Number of searches; each starts from the grid fitted to the corners of the previous one."""

GRID_TOLERANCE = 0.02
"""Distance of a corner from the grid, in squares, that errors of initial positions and lens
distortion explain."""

OUTLIER_SIGMAS = 5.0
"""Distance from the grid, in robust standard deviations, beyond which a corner is left out."""

MIN_OUTLIER_FRACTION, MIN_OUTLIER_PX = 0.004, 0.1
"""Distances from the grid, in squares and in px, below which no corner is left out."""

MIN_KEPT_FRACTION = 0.7
"""Smallest fraction of corners that is left; below it the grid itself is wrong."""

MAX_GRID_STD = 0.06
"""Largest robust standard deviation of the distances from the grid, in squares."""

MIN_SQUARE_PX = 1.0
"""Smallest square of a grid in which corners are searched. Units: px."""

RADIAL_PRIOR = 0.5
"""Standard deviation of the prior on the two radial terms of the grid; the unit of the radius is
half the longer side of the image."""

MIN_CONTRAST_FRACTION = 0.2
"""Smallest contrast of black and white by which the image is normalised, as a fraction of the
median contrast: extrapolated to the outer corners, the polynomials may give none."""

RAYLEIGH_MEDIAN = float(np.sqrt(2 * np.log(2)))
"""Median length of a vector of two normal coordinates of standard deviation 1."""


def detect_initial_corners(
    image: npt.NDArray[np.uint8], columns: int, rows: int
) -> Iterator[Points]:
    """Yield the corners (rows, columns, 2) in px that OpenCV's detectors find, one set for each.

    Which corner is the first is not defined. The classic detector is fast. The others also find
    boards that are blurred, or crossed by a laser line.
    """
    halved = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    # Twice the median becomes white: a laser line is then no brighter than the white squares.
    clipped = np.minimum(image * (255 / (2 * max(float(np.median(image)), 1))), 255)
    classic = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    for find, picture, flags in (
        (cv2.findChessboardCorners, image, classic),
        (cv2.findChessboardCornersSB, image, 0),
        (cv2.findChessboardCorners, halved, classic),
        (cv2.findChessboardCornersSB, image, cv2.CALIB_CB_NORMALIZE_IMAGE),
        (cv2.findChessboardCorners, clipped.astype(np.uint8), classic),
    ):
        found, corners = find(picture, (columns, rows), flags=flags)
        if found:
            scale = image.shape[1] / picture.shape[1]
            positions = np.asarray(corners, dtype=np.float64).reshape(rows, columns, 2)
            yield (positions + 0.5) * scale - 0.5


def locate_corners(
    image: npt.NDArray[np.uint8], initial: Points
) -> tuple[Points, BoolArray] | None:
    """Return the corners of a chessboard, and the mask of those that fit the grid.

    The corners (rows, columns, 2) in px of a grey image start from `initial` ones, accurate to
    about a tenth of a square, of which some may be wrong. The mask (rows, columns) is False for a
    corner that is off the grid of the others. None if too few corners fit one grid.
    """
    initial_size = max(measure_square_size(initial), MIN_SQUARE_PX)  # 0 if two corners are equal
    grid = _Grid.fit(initial, image.shape, GRID_TOLERANCE * initial_size)
    corners, inliers = initial, np.ones(initial.shape[:2], dtype=bool)
    for _ in range(SEARCH_ROUNDS):
        size = measure_square_size(grid.corners)
        if not size > MIN_SQUARE_PX:
            return None
        distances = np.linalg.norm(corners - grid.corners, axis=-1)
        tolerance = 4 * max(_robust_std(distances), GRID_TOLERANCE * size)
        initial_guess = np.where(
            ((distances > tolerance) | ~inliers)[..., None], grid.corners, corners
        )
        corners, inliers = _refine(image, initial_guess, grid.corners)
        min_outlier_px = max(MIN_OUTLIER_FRACTION * size, MIN_OUTLIER_PX)
        grid = _Grid.fit(corners, image.shape, min_outlier_px, grid)
    distances = np.linalg.norm(corners - grid.corners, axis=-1)
    std = _robust_std(distances)
    inliers &= distances < max(OUTLIER_SIGMAS * std, min_outlier_px)
    if inliers.mean() < MIN_KEPT_FRACTION or std > MAX_GRID_STD * size:
        return None
    return corners, inliers


def measure_square_size(corners: Points) -> float:
    """Return the smallest height, over the longer side, of the squares between corners.

    `corners` are (rows, columns, 2). Units: px.
    """
    row_steps, column_steps = np.diff(corners, axis=1)[:-1], np.diff(corners, axis=0)[:, :-1]
    area = np.abs(
        row_steps[..., 0] * column_steps[..., 1] - row_steps[..., 1] * column_steps[..., 0]
    )
    longer_side = np.maximum(
        np.linalg.norm(row_steps, axis=-1), np.linalg.norm(column_steps, axis=-1)
    )
    return float((area / np.maximum(longer_side, 1e-9)).min())


def _robust_std(distances: FloatArray) -> float:
    """Return the standard deviation of one coordinate, from the lengths of error vectors."""
    return float(np.median(distances)) / RAYLEIGH_MEDIAN


@dataclass(frozen=True, eq=False)
class _Grid:
    """Grid of a flat board through a lens: a homography and two radial terms.

    Parameters
    ----------
    corners : (rows, columns, 2) ndarray
        Predicted corners. Units: px.
    parameters : (10,) ndarray
        Homography without its last element, and two radial terms. It maps grid nodes (numbers of
        squares from the board's middle) to image points, from the image's middle in units of half
        its longer side.
    """

    corners: Points
    parameters: FloatArray

    @staticmethod
    def fit(
        corners: Points, shape: tuple[int, ...], scale: float, start: "_Grid | None" = None
    ) -> "_Grid":
        """Return the grid fitted to corners; residuals above `scale` px have less weight.

        `shape` is that of the image. Without the grid `start`, a homography is the initial guess.
        """
        from scipy.optimize import least_squares

        rows, columns = corners.shape[:2]
        row, column = np.divmod(np.arange(rows * columns), columns)
        nodes = np.column_stack([column - (columns - 1) / 2, row - (rows - 1) / 2])
        half_side = max(shape) / 2
        middle = (np.array(shape[1::-1]) - 1) / 2
        observed = (corners.reshape(-1, 2) - middle) / half_side

        def residuals(parameters: FloatArray) -> FloatArray:
            error = (_distort_grid(parameters, nodes) - observed) * half_side / scale
            return np.append(error.ravel(), parameters[8:] / RADIAL_PRIOR)

        if start is None:
            homography, _ = cv2.findHomography(nodes, observed, cv2.LMEDS)
            if homography is None:
                homography, _ = cv2.findHomography(nodes, observed)
            if homography is None:  # corners on one line, whose grid is too small for a search
                homography = np.eye(3)
            guess = np.append((homography / homography[2, 2]).ravel()[:8], [0.0, 0.0])
        else:
            guess = start.parameters
        solution = least_squares(residuals, guess, loss="soft_l1", x_scale="jac", max_nfev=100).x
        predicted = middle + half_side * _distort_grid(solution, nodes)
        return _Grid(predicted.reshape(corners.shape), solution)


def _distort_grid(parameters: FloatArray, nodes: Points) -> Points:
    """Return the image points of grid nodes (n, 2), in the units of `_Grid.parameters`."""
    homography = np.append(parameters[:8], 1.0).reshape(3, 3)
    ideal = apply_homography(homography, nodes)
    squares = (ideal**2).sum(axis=1, keepdims=True)
    distorted: Points = ideal * (1 + parameters[8] * squares + parameters[9] * squares**2)
    return distorted


def _refine(image: npt.NDArray[np.uint8], start: Points, grid: Points) -> tuple[Points, BoolArray]:
    """Return the saddle points near initial positions, and the mask of those that exist.

    Where there is none within the radius of the window, the initial position is returned. `start`
    and the predicted corners `grid` are (rows, columns, 2) in px.
    """
    size = measure_square_size(grid)
    smooth = cv2.GaussianBlur(
        image.astype(np.float32), (0, 0), max(SMOOTHING_FRACTION * size, MIN_SMOOTHING_PX)
    )
    levels = _Levels.fit(smooth, grid)
    radius = max(RADIUS_FRACTION * size, MIN_RADIUS_PX)
    x, y = _list_disc_offsets(radius)
    fit_paraboloid = np.linalg.pinv(np.column_stack([x * x, x * y, y * y, x, y, np.ones_like(x)]))
    start_points = start.reshape(-1, 2)
    corners, is_saddle = start_points.copy(), np.ones(len(start_points), dtype=bool)
    for _ in range(MAX_REFINEMENT_STEPS):
        positions = corners[:, None] + np.column_stack([x, y])
        # a x^2 + b x y + c y^2 + d x + e y + f, whose saddle point is where its gradient is zero.
        a, b, c, d, e, _ = fit_paraboloid @ levels.normalise(smooth, positions).T
        determinant = 4 * a * c - b * b
        is_saddle = determinant < 0
        divisor = np.where(is_saddle, determinant, -1.0)
        steps = np.column_stack([b * e - 2 * c * d, b * d - 2 * a * e]) / divisor[:, None]
        steps[~is_saddle] = 0
        length = np.linalg.norm(steps, axis=1)
        # At most half the radius of the window: the paraboloid is not valid beyond.
        corners += steps * np.minimum(1, radius / 2 / np.maximum(length, 1e-9))[:, None]
        if length.max() < 1e-3:
            break
    exists = is_saddle & (np.linalg.norm(corners - start_points, axis=1) < radius)
    corners[~exists] = start_points[~exists]
    return corners.reshape(start.shape), exists.reshape(start.shape[:2])


def _list_disc_offsets(radius: float) -> tuple[FloatArray, FloatArray]:
    """Return the offsets x and y of the pixels within a radius. Units: px."""
    steps = np.arange(-np.ceil(radius), np.ceil(radius) + 1)
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    inside = x**2 + y**2 <= radius**2
    return x[inside], y[inside]


@dataclass(frozen=True, eq=False)
class _Levels:
    """Brightness of both colours of squares, as polynomials of the position in the image.

    Parameters
    ----------
    middle : (2,) ndarray
        Mean corner, origin of the position. Units: px.
    extent : float
        Unit of the position: half the extent of the corners. Units: px.
    degree : int
        Degree of the polynomials, 0 to 2.
    first, second : ndarray
        Coefficients of the colour of the first square, and of the other colour; values in DN.
    """

    middle: FloatArray
    extent: float
    degree: int
    first: FloatArray
    second: FloatArray

    @staticmethod
    def fit(image: npt.NDArray[np.float32], grid: Points) -> "_Levels":
        """Return the levels fitted to the middles of the squares; constant for few squares.

        `grid` are the corners (rows, columns, 2) in px.
        """
        middles = compute_cell_middles(grid)
        odd = np.indices(middles.shape[:2]).sum(axis=0) % 2 == 1
        # Twice as many squares of each colour as the polynomial has terms.
        degree = int(np.searchsorted([12, 24], odd.size, side="right"))
        positions = grid.reshape(-1, 2)
        middle, extent = positions.mean(axis=0), float(np.ptp(positions, axis=0).max()) / 2
        values = sample(image, middles)
        first, second = (
            _solve_robustly(
                _evaluate_terms((middles[colour] - middle) / extent, degree), values[colour]
            )
            for colour in (~odd, odd)
        )
        return _Levels(middle, extent, degree, first, second)

    def normalise(self, image: npt.NDArray[np.float32], positions: Points) -> FloatArray:
        """Return the image at positions (..., 2): 0 in squares like the first, 1 in the others."""
        terms = _evaluate_terms((positions - self.middle) / self.extent, self.degree)
        contrast = terms @ (self.second - self.first)
        median = np.median(contrast)
        sign, min_contrast = np.sign(median), MIN_CONTRAST_FRACTION * abs(median)
        contrast = sign * np.maximum(sign * contrast, min_contrast)
        normalised: FloatArray = (sample(image, positions) - terms @ self.first) / (contrast + 1e-9)
        return normalised


def compute_cell_middles(corners: Points) -> Points:
    """Return the middles (rows - 1, columns - 1, 2) of the squares between corners."""
    pairs = corners[:-1] + corners[1:]
    return (pairs[:, :-1] + pairs[:, 1:]) / 4


def sample(image: npt.NDArray[np.float32], positions: Points) -> FloatArray:
    """Return the image interpolated at positions (..., 2) in px, its border continued outside."""
    flat_positions = positions.reshape(1, -1, 2).astype(np.float32)
    # OpenCV's remap takes up to 32767 columns.
    samples = [
        cv2.remap(image, block, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for block in np.array_split(flat_positions, 1 + flat_positions.shape[1] // 30000, axis=1)
    ]
    return np.concatenate(samples, axis=1).reshape(positions.shape[:-1]).astype(np.float64)


def _evaluate_terms(positions: Points, degree: int) -> FloatArray:
    """Return the 1, 3 or 6 terms (last axis) of a polynomial of degree 0, 1 or 2 in x and y."""
    x, y = positions[..., 0], positions[..., 1]
    terms = [np.ones_like(x), x, y, x * x, x * y, y * y]
    return np.stack(terms[: (1, 3, 6)[degree]], axis=-1)


def _solve_robustly(design: FloatArray, values: FloatArray) -> FloatArray:
    """Return the solution of least squares with Huber weights (a laser line brightens a few)."""
    weights = np.ones(len(values))  # of the residuals: roots of those of their squares
    for _ in range(5):
        solution = np.linalg.lstsq(design * weights[:, None], values * weights, rcond=None)[0]
        error = np.abs(values - design @ solution)
        limit = max(2.0 * float(np.median(error)), 0.5)
        weights = np.sqrt(np.minimum(1.0, limit / np.maximum(error, 1e-9)))
    return np.asarray(solution, dtype=np.float64)
