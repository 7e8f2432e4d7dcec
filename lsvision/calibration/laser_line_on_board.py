"""Board and laser line of each pose: from pairs of images to the numbers that are fitted."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.calibration.bundle_adjustment_state import LaserView
from lsvision.calibration.grey_image import grey_image
from lsvision.calibration.target import Target, TargetView, find_target
from lsvision.calibration.views import ViewSources, collect_views, require_size
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray, Points
from lsvision.geometry.arrays import BoolArray
from lsvision.laser_line.extraction import LineSettings, extract_laser_line
from lsvision.sensors.camera import Camera

EDGE_INFLUENCE_SIGMAS = 2.5
"""Sigmas of the line within which what lies under it pulls its centre."""

MIN_UNIFORM_FRACTION = 0.15
"""Share of points on even ground, below which the line itself is what is uneven."""


@dataclass(frozen=True, kw_only=True)
class LineOnBoardSettings:
    """How the laser line is found on the board.

    Parameters
    ----------
    extraction : LineSettings, optional
        Of `extract_laser_line`; its defaults if None.
    margin : float
        How far beyond the outermost points of the target the board still is flat and white.
        Units: squares.
    edge_clearance : float
        Line points nearer than this to the edge of a square are left out, because the edge
        pulls the line's centre; applies within the pattern. Units: squares.
    max_background_variation : float
        Line points are left out, too, where the board's own image changes by more within the
        line's reach: the edges of markers, discs, scratches. As a share of the contrast of
        black and white. Does not apply where the line lies on the board image as well.
    max_line_deviation_px : float
        Line points farther than this from the straight line through the others lie on
        something else. Units: px.
    max_points : int
        Line points wanted on each board at most; evenly thinned.
    min_points : int
        Fewer on a board are no line.
    """

    extraction: LineSettings | None = None
    margin: float = 0.9
    edge_clearance: float = 0.15
    max_background_variation: float = 0.2
    max_line_deviation_px: float = 2.0
    max_points: int = 150
    min_points: int = 15


def find_laser_views(
    camera: Camera,
    target: Target,
    board_images: Sequence[npt.ArrayLike],
    line_images: Sequence[npt.ArrayLike],
    settings: LineOnBoardSettings,
) -> tuple[list[LaserView], ViewSources]:
    """Find board and laser line in each pair of images.

    Parameters
    ----------
    camera : Camera
        For the size of the images and the straightness of the line.
    target : Target
        The board.
    board_images, line_images : sequence of images
        In the same order.
    settings : LineOnBoardSettings
        See there.

    Returns
    -------
    views : list of LaserView
        What the pairs show.
    sources : ViewSources
        Which pairs they are, and the others with the reason.

    Raises
    ------
    ValueError
        If there are not as many line images as board images.
    CalibrationFailed
        If an image is of another size than the camera's.
    """
    if len(board_images) != len(line_images):
        raise ValueError(
            f"want a line image for each of {len(board_images)} board images, got "
            f"{len(line_images)}"
        )
    for what, images in (("board image", board_images), ("line image", line_images)):
        for index, image in enumerate(images):
            require_size(camera, image, f"{what} {index}")
    pairs = zip(board_images, line_images, strict=True)
    return collect_views(pairs, lambda pair: find_laser_view(camera, target, *pair, settings))


def find_laser_view(
    camera: Camera,
    target: Target,
    board_image: npt.ArrayLike,
    line_image: npt.ArrayLike,
    settings: LineOnBoardSettings,
) -> LaserView:
    """Find board and laser line of one pose.

    Returns
    -------
    LaserView
        See `find_laser_views` for the parameters.

    Raises
    ------
    TargetNotFound
        If the board is not seen.
    LsvisionError
        If no laser line lies on it.
    """
    seen = find_target(board_image, target)
    outline = _outline(seen, target, settings.margin)
    low = np.maximum(np.floor(outline.min(axis=0)), 0).astype(int)
    high = np.ceil(outline.max(axis=0)).astype(int) + 1
    window = np.asarray(line_image)[low[1] : high[1], low[0] : high[0]]
    line = extract_laser_line(window, settings.extraction)
    pixels = line.pixels + low
    keep = np.isfinite(pixels).all(axis=1)
    keep[keep] &= _inside(pixels[keep], outline)
    keep[keep] &= _clear_of_edges(pixels[keep], seen, target, settings.edge_clearance)
    if not np.array_equal(board_image, line_image):
        keep[keep] &= _on_uniform_background(
            board_image, pixels[keep], line.width[keep], settings.max_background_variation
        )
    keep[keep] &= _line_inliers(camera, pixels[keep], settings.max_line_deviation_px)
    chosen = np.flatnonzero(keep)
    if len(chosen) < settings.min_points:
        raise CalibrationFailed(
            f"{len(chosen)} points of the laser line lie on the board clear of its squares' edges "
            f"and {settings.min_points} are needed: let the line cross the squares instead of "
            f"running along them, or widen the margin of {settings.margin:g} squares where the "
            "board is larger than its pattern"
        )
    chosen = chosen[:: max(1, len(chosen) // settings.max_points)]
    return LaserView(seen.points, seen.pixels, pixels[chosen], line.std[chosen])


def _pitch(target: Target) -> float:
    """Distance between neighbours. Units: mm."""
    points = target.points[:, :2]
    return float(np.sort(np.hypot(*(points - points[0]).T))[1])


def _homography(seen: TargetView) -> FloatArray:
    homography, _ = cv2.findHomography(
        np.ascontiguousarray(seen.points[:, :2]), np.ascontiguousarray(seen.pixels)
    )
    return np.asarray(homography, dtype=np.float64)


def _outline(seen: TargetView, target: Target, margin: float) -> Points:
    """Corners (4, 2) of the board's flat part in the image. Units: px."""
    grown = margin * _pitch(target)
    low = target.points[:, :2].min(axis=0) - grown
    high = target.points[:, :2].max(axis=0) + grown
    corners = [low, (high[0], low[1]), high, (low[0], high[1])]
    return _mapped(_homography(seen), np.array(corners))


def _mapped(homography: FloatArray, points: Points) -> Points:
    mapped = points @ homography[:, :2].T + homography[:, 2]
    result: Points = mapped[:, :2] / mapped[:, 2:]
    return result


def _inside(pixels: Points, outline: Points) -> BoolArray:
    edges = np.roll(outline, -1, axis=0) - outline
    side = [
        edge[0] * (pixels - at)[:, 1] - edge[1] * (pixels - at)[:, 0]
        for edge, at in zip(edges, outline, strict=True)
    ]
    sides = np.array(side)
    inside: BoolArray = np.all(sides > 0, axis=0) | np.all(sides < 0, axis=0)
    return inside


def _clear_of_edges(
    pixels: Points, seen: TargetView, target: Target, clearance: float
) -> BoolArray:
    """Points that are no grid line's neighbours; all of those beside the pattern."""
    pitch = _pitch(target)
    on_board = _mapped(np.asarray(np.linalg.inv(_homography(seen)), dtype=np.float64), pixels)
    low, high = target.points[:, :2].min(axis=0), target.points[:, :2].max(axis=0)
    beside = ((on_board < low - 1.2 * pitch) | (on_board > high + 1.2 * pitch)).any(axis=1)
    squares = (on_board - low) / pitch
    gap = np.abs(squares - np.round(squares)).min(axis=1)
    clear: BoolArray = beside | (gap >= clearance)
    return clear


def _on_uniform_background(
    board_image: npt.ArrayLike, pixels: Points, widths: FloatArray, evenness: float
) -> BoolArray:
    """Points round which the board's image is of one brightness; all if the line is on it, too."""
    grey = grey_image(board_image)
    if not len(pixels):
        return np.zeros(0, dtype=bool)
    reach = 2 * int(np.ceil(EDGE_INFLUENCE_SIGMAS * float(np.median(widths)))) + 1
    window = np.ones((reach, 3), dtype=np.uint8)
    change = cv2.dilate(grey, window).astype(np.int16) - cv2.erode(grey, window)
    at = np.clip(np.round(pixels).astype(int), 0, np.array(grey.shape)[::-1] - 1)
    black, white = np.percentile(grey[at[:, 1], at[:, 0]], [5, 95])
    even: BoolArray = change[at[:, 1], at[:, 0]] <= evenness * max(float(white - black), 1.0)
    return even if even.mean() > MIN_UNIFORM_FRACTION else np.ones(len(pixels), dtype=bool)


def _line_inliers(camera: Camera, pixels: Points, tolerance: float) -> BoolArray:
    """Points on the straight line, in the undistorted image, that most lie on."""
    if len(pixels) < 2:
        return np.zeros(len(pixels), dtype=bool)
    plane = camera.rays(pixels)[:, :2] * camera.focal_length
    # All pairs of up to 60 evenly spread points: few enough to try each, no chance involved.
    sample = plane[np.linspace(0, len(plane) - 1, min(len(plane), 60)).astype(int)]
    first, second = (sample[part] for part in np.triu_indices(len(sample), 1))
    across = (second - first) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    length = np.hypot(*across.T)
    across = across[length > 0] / length[length > 0, None]
    offset = np.einsum("ij,ij->i", across, first[length > 0])
    near = np.abs(across @ plane.T - offset[:, None]) < tolerance
    best: BoolArray = near[near.sum(axis=1).argmax()]
    return best
