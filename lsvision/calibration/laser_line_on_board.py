"""Detection of board and laser line in pairs of images."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.calibration.board_outline import (
    compute_target_pitch,
    mask_inside_outline,
    project_board_outline,
    target_bounds,
)
from lsvision.calibration.bundle_adjustment_problem import MIN_POINTS, LaserView
from lsvision.calibration.target import (
    CircleGrid,
    Target,
    TargetView,
    find_target,
    fit_board_homography,
)
from lsvision.calibration.views import ViewSources, collect_views, require_size
from lsvision.errors import CalibrationFailed, LsvisionError, NoLaserLine
from lsvision.geometry import BoolArray, FloatArray, IntArray, Points
from lsvision.geometry.plane import apply_homography
from lsvision.laser_line.extraction import LineSettings, extract_laser_line
from lsvision.laser_line.image_array import as_image, convert_to_grey
from lsvision.laser_line.line import LaserLine
from lsvision.laser_line.line_image import interpolate_grey
from lsvision.sensors.camera import Camera

EDGE_INFLUENCE_SIGMAS = 2.5
"""Distance from the line, in standard deviations of its cross section, within which the background
shifts its centre."""

OUTER_EDGE_CLEARANCE = 0.2
"""Distance beyond the pattern, in squares, at which its outer edges no longer shift the line."""

MIN_OUTSIDE_BRIGHTNESS_RATIO = 3.0
"""Ratio of the brightness of a line outside the board to that of a line on it, above which the line
on the board is taken for a reflection or an edge."""

MIN_UNIFORM_FRACTION = 0.15
"""Smallest fraction of points on uniform background; below it the line is taken to be in the board
image, too."""

LINE_REMEDY = (
    "darken the room, expose until the line is bright, or set channel to the laser's colour "
    "(--laser)"
)
"""Remedy for a line that is not found, in Python and in the commands of calibrations."""


@dataclass(frozen=True, kw_only=True)
class LineOnBoardSettings:
    """Settings of the detection of the laser line on the board.

    A square, as a unit, is the distance of neighbouring points of the target.

    Parameters
    ----------
    extraction : LineSettings, optional
        Settings of `extract_laser_line`; its defaults if None.
    margin : float
        Width of the flat, white border beyond the outermost points of the target. A line farther
        out is reported and not used. Units: squares.
    edge_clearance : float
        Smallest distance of a line point from the edge of a square or disc, which shifts the line's
        centre; applies within the pattern. Units: squares.
    max_background_variation : float
        Largest change of the board image across the line, within its width, as a fraction of the
        contrast of black and white: excludes edges of markers, discs, scratches. Does not apply
        where the line is in the board image, too.
    max_line_deviation_px : float
        Largest distance from the straight line through the other points. Units: px.
    max_points : int
        Largest number of line points on each board; evenly thinned.
    min_points : int
        Smallest number of line points on a board.

    Raises
    ------
    ValueError
        If `max_line_deviation_px` is not positive, `margin` not finite, a number negative, or
        `min_points` or `max_points` too small.
    """

    extraction: LineSettings | None = None
    margin: float = 0.9
    edge_clearance: float = 0.15
    max_background_variation: float = 0.2
    max_line_deviation_px: float = 2.0
    max_points: int = 150
    min_points: int = 15

    def __post_init__(self) -> None:
        counts = (self.min_points, self.max_points)
        if not all(isinstance(n, int | np.integer) and n >= MIN_POINTS for n in counts):
            raise ValueError(f"expected whole min_points, max_points from {MIN_POINTS}, got {self}")
        for name, value in vars(self).items():
            if name != "extraction" and not 0 <= value < math.inf:
                raise ValueError(f"expected a finite {name} >= 0, got {value}")
        if not self.max_line_deviation_px > 0:
            raise ValueError("expected a positive max_line_deviation_px, got 0")


def find_laser_views(
    camera: Camera,
    target: Target,
    board_images: Sequence[npt.ArrayLike],
    line_images: Sequence[npt.ArrayLike],
    settings: LineOnBoardSettings,
) -> tuple[list[LaserView], ViewSources]:
    """Return board and laser line of each pair of images, and the sources of these views.

    Board images without and with the laser line are in the same order. With the distortion of the
    camera the line is tested for straightness.

    Raises
    ------
    ValueError
        If the numbers of line images and board images differ.
    CalibrationFailed
        If an image is of another size than the camera's.
    """
    if len(board_images) != len(line_images):
        raise ValueError(
            f"expected a line image for each of {len(board_images)} board images, got "
            f"{len(line_images)}"
        )
    for name, images in (("board image", board_images), ("line image", line_images)):
        for index, image in enumerate(images):
            require_size(camera, image, f"{name} {index}")
    pairs = zip(board_images, line_images, strict=True)
    return collect_views(
        pairs,
        lambda pair: find_laser_view(camera, target, *pair, settings),
        lambda view: view.pixels.tobytes() + view.line_pixels.tobytes(),
    )


def find_laser_view(
    camera: Camera,
    target: Target,
    board_image: npt.ArrayLike,
    line_image: npt.ArrayLike,
    settings: LineOnBoardSettings,
) -> LaserView:
    """Return board and laser line of one pair of images; see `find_laser_views`.

    Raises
    ------
    TargetNotFound
        If the board is not found.
    LsvisionError
        If no laser line lies on it, or `margin` reaches beyond the horizon of its plane.
    """
    bayer = _choose_extraction_settings(settings).bayer
    board_grey = convert_to_grey(interpolate_grey(as_image(board_image), bayer))
    view = find_target(board_grey, target)
    outline = project_board_outline(view, target, settings.margin)
    outside = _find_line_outside(camera, target, view, line_image, settings)
    try:
        low = np.maximum(np.floor(outline.min(axis=0)), 0).astype(int)
        low -= low % 2  # a part of a mosaic must begin with the same colour as the whole
        high = np.ceil(outline.max(axis=0)).astype(int) + 1
        window = np.asarray(line_image)[low[1] : high[1], low[0] : high[0]]
        line = _extract(window, settings)
        background = None if np.array_equal(board_image, line_image) else board_grey
        indices = _find_indices_on_board(camera, target, background, view, (line, low), settings)
    except LsvisionError as error:
        if outside is None:
            raise
        raise CalibrationFailed(outside.format_message(settings.margin)) from error
    intensity = float(np.median(line.intensity[indices]))
    if outside and outside.intensity > MIN_OUTSIDE_BRIGHTNESS_RATIO * intensity:
        raise CalibrationFailed(outside.format_message(settings.margin))
    indices = indices[:: math.ceil(len(indices) / settings.max_points)]
    return LaserView(view.points, view.pixels, line.pixels[indices] + low, line.std[indices])


def _extract(window: npt.ArrayLike, settings: LineOnBoardSettings) -> LaserLine:
    """Return the line in a window of the image; an error has the remedy for a calibration."""
    try:
        return extract_laser_line(window, _choose_extraction_settings(settings))
    except NoLaserLine as error:
        # An empty remedy means that the finding itself says what to do.
        raise NoLaserLine(error.finding, error.remedy and LINE_REMEDY) from error


def _choose_extraction_settings(settings: LineOnBoardSettings) -> LineSettings:
    """Return settings that use the laser's colour channel, in which the pattern disturbs less."""
    return replace(settings.extraction or LineSettings(), luminance=False)


@dataclass(frozen=True)
class _LineOutside:
    """Straight line outside the board: distance from the pattern (squares), brightness (DN)."""

    distance_squares: float
    intensity: float

    def format_message(self, margin: float) -> str:
        """Return the message that the line is outside of `margin` squares, with the remedy."""
        distance = self.distance_squares
        return (
            f"no laser line within {margin:g} squares of the pattern, but one {distance:.1f} "
            f"squares beside it: set margin (--margin) to {math.ceil(distance)} if the board "
            "is flat and white that far; else move the board until the line crosses its pattern"
        )


def _find_line_outside(
    camera: Camera,
    target: Target,
    view: TargetView,
    line_image: npt.ArrayLike,
    settings: LineOnBoardSettings,
) -> _LineOutside | None:
    """Return the laser line of the image if it is straight and outside the board, else None."""
    try:
        line = extract_laser_line(line_image, _choose_extraction_settings(settings))
    except LsvisionError:
        return None
    indices = np.flatnonzero(np.isfinite(line.pixels).all(axis=1))
    indices = indices[
        _find_line_inliers(camera, line.pixels[indices], settings.max_line_deviation_px)
    ]
    if len(indices) < settings.min_points:
        return None
    distances = _distances_outside(line.pixels[indices], view, target)
    if (distances <= settings.margin).sum() >= settings.min_points:
        return None
    # Twice as many points as are needed, since some of them will be left out.
    rank = min(2 * settings.min_points, len(distances)) - 1
    return _LineOutside(float(np.sort(distances)[rank]), float(np.median(line.intensity[indices])))


def _distances_outside(pixels: Points, view: TargetView, target: Target) -> FloatArray:
    """Return the distances of points outside the outermost corners, in squares; negative inside."""
    on_board = _map_to_board(pixels, view)
    low, high = target_bounds(target)
    distance: FloatArray = np.maximum(low - on_board, on_board - high).max(axis=1)
    return distance / compute_target_pitch(target)


def _find_indices_on_board(
    camera: Camera,
    target: Target,
    background: npt.NDArray[np.uint8] | None,
    board_view: TargetView,
    line_and_corner: tuple[LaserLine, IntArray],
    settings: LineOnBoardSettings,
) -> IntArray:
    """Return the indices of the line's points on the board, or raise `CalibrationFailed`.

    `background` is the board without the line, None if there is no such image; `line_and_corner`
    are the line in a window of the image, and the window's first pixel (u, v).
    """
    line, low = line_and_corner
    pixels, outline = line.pixels + low, project_board_outline(board_view, target, settings.margin)
    usable: BoolArray = np.asarray(np.isfinite(pixels).all(axis=1))
    usable[usable] &= mask_inside_outline(pixels[usable], outline)
    usable[usable] &= _is_clear_of_edges(
        pixels[usable], board_view, target, settings.edge_clearance
    )
    if background is not None:
        change = _measure_change_across_line(background, line, usable)
        usable[usable] &= _is_on_uniform_background(
            background, change, pixels[usable], settings.max_background_variation
        )
    usable[usable] &= _find_line_inliers(camera, pixels[usable], settings.max_line_deviation_px)
    indices = np.flatnonzero(usable)
    if len(indices) < settings.min_points:
        raise CalibrationFailed(
            f"{len(indices)} points of the laser line lie on the board clear of its squares' edges "
            f"and {settings.min_points} are needed: let the line cross the squares instead of "
            f"running along them, or widen the margin of {settings.margin:g} squares where the "
            "board is larger than its pattern"
        )
    return indices


def _map_to_board(pixels: Points, view: TargetView) -> Points:
    """Return the points (n, 2) of the board plane that pixels show. Units: mm."""
    inverse: FloatArray = np.linalg.inv(fit_board_homography(view)).astype(np.float64)
    return apply_homography(inverse, pixels)


def _is_clear_of_edges(
    pixels: Points, view: TargetView, target: Target, clearance: float
) -> BoolArray:
    """Return the mask of points far from the edges of squares or discs, or outside the pattern."""
    pitch = compute_target_pitch(target)
    on_board = _map_to_board(pixels, view)
    if isinstance(target, CircleGrid):
        offset = on_board[:, None] - target.points[:, :2]
        distance = np.linalg.norm(offset, axis=2).min(axis=1, initial=np.inf)
        far: BoolArray = np.abs(distance - target.diameter / 2) >= clearance * pitch
        return far
    low, high = target_bounds(target)
    # The outermost squares end one pitch beyond the corners.
    reach = (1 + OUTER_EDGE_CLEARANCE) * pitch
    outside = ((on_board < low - reach) | (on_board > high + reach)).any(axis=1)
    squares = (on_board - low) / pitch
    edge_distance = np.abs(squares - np.round(squares)).min(axis=1)
    clear: BoolArray = outside | (edge_distance >= clearance)
    return clear


def _measure_change_across_line(
    grey: npt.NDArray[np.uint8], line: LaserLine, usable: BoolArray
) -> npt.NDArray[np.int16]:
    """Return the change of the image around each pixel, across the line and within its width.

    The width is the median one of the `usable` points. Units: DN.
    """
    if not usable.any():
        return np.zeros(grey.shape, dtype=np.int16)
    reach = int(np.ceil(EDGE_INFLUENCE_SIGMAS * float(np.median(line.width[usable]))))
    across, along = 2 * reach + 1, 3
    # A line with a point in each row runs down the image.
    shape = (across, along) if line.direction == "columns" else (along, across)
    window = np.ones(shape, dtype=np.uint8)
    change: npt.NDArray[np.int16] = cv2.dilate(grey, window).astype(np.int16)
    change -= cv2.erode(grey, window)
    return change


def _is_on_uniform_background(
    grey: npt.NDArray[np.uint8],
    change: npt.NDArray[np.int16],
    pixels: Points,
    max_variation: float,
) -> BoolArray:
    """Return the mask of points on uniform background; all if the line is in the board image."""
    if not len(pixels):
        return np.zeros(0, dtype=bool)
    u, v = np.clip(np.round(pixels).astype(int), 0, np.array(grey.shape)[::-1] - 1).T
    black, white = np.percentile(grey[v, u], [5, 95])
    uniform: BoolArray = change[v, u] <= max_variation * max(float(white - black), 1.0)
    return uniform if uniform.mean() > MIN_UNIFORM_FRACTION else np.ones(len(pixels), dtype=bool)


def _find_line_inliers(camera: Camera, pixels: Points, tolerance: float) -> BoolArray:
    """Return the mask of the largest set of points on one straight line, distortion removed.

    `tolerance` is the largest distance of a point from the line. Units: px.
    """
    undistorted = camera.rays(pixels)[:, :2] * camera.focal_length
    # Deterministic: all pairs of up to 60 evenly spaced points.
    evenly_spaced = np.linspace(0, len(pixels) - 1, min(len(pixels), 60)).astype(int)
    sample = undistorted[evenly_spaced]
    first, second = (sample[indices] for indices in np.triu_indices(len(sample), 1))
    normals = (second - first) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    length = np.hypot(*normals.T)
    if not (length > 0).any():  # fewer than two pixels, or pixels without a ray
        return np.zeros(len(pixels), dtype=bool)
    normals = normals[length > 0] / length[length > 0, None]
    offset = np.einsum("ij,ij->i", normals, first[length > 0])
    inliers = np.abs(normals @ undistorted.T - offset[:, None]) < tolerance
    largest: BoolArray = inliers[inliers.sum(axis=1).argmax()]
    return largest
