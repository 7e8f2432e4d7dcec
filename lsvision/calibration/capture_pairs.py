"""Pairs of board and laser line from a stream of frames, and those that are still missing.

The board is held by hand. One image shows it at rest and in focus, the other the laser line on the
unmoved board. Images are selected automatically from the frames, without a key press.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from lsvision.calibration.board_pose import DEFAULT_FOCAL_RATIO, guess_board_pose
from lsvision.calibration.camera_warnings import CELLS_PER_SIDE, find_covered_cells
from lsvision.calibration.laser_line_on_board import LineOnBoardSettings, find_laser_view
from lsvision.calibration.lens_blur import estimate_blur_from_views
from lsvision.calibration.target import (
    CircleGrid,
    Target,
    TargetNotFound,
    TargetView,
    find_target,
)
from lsvision.errors import CalibrationFailed, LsvisionError
from lsvision.laser_line.extraction import LineSettings
from lsvision.laser_line.image_array import convert_to_grey
from lsvision.laser_line.line_image import interpolate_grey
from lsvision.sensors.camera import Camera
from lsvision.statistics.robust import mad_std

Image = npt.NDArray[Any]

LASER_ON = "board taken, hold it still: laser on, lamps off"
"""Instruction for the second image of a pair."""
NOISE_SIGMAS = 5.0
"""Smallest contrast of the line, in standard deviations of its surroundings, the board's part of
the image."""
REQUESTED_TILT = np.radians(20.0)
"""Requested tilt of a hand-held board towards each of its four sides. Units: rad."""
REQUESTED_DEPTH_RATIO = 1.15
"""Requested ratio of the farthest to the nearest distance of the board."""
_SIDES = (("right", 0, 1), ("left", 0, -1), ("lower", 1, 1), ("upper", 1, -1))
"""Side of the board that is nearer, image axis along which its normal (z) is tilted, and sign."""
_ROWS, _COLUMNS = ("upper", "middle", "lower"), ("left", "middle", "right")
"""Names of parts of the image, from top to bottom and from left to right."""


@dataclass(frozen=True, kw_only=True)
class CaptureSettings:
    """Limits for a board at rest, in focus and in a new pose, and for the presence of a line.

    Parameters
    ----------
    still_px : float
        Largest median movement of the corners between two frames. Units: px.
    max_blur_px : float
        Largest blur of the board's edges, one sigma; edges that are too short or too blurred to
        be measured count as blurred. Units: px.
    min_change : float
        Smallest median distance of the corners from those of every pair so far, relative to the
        image's width.
    min_contrast : float
        Smallest difference of brightness between the line and its surroundings, after subtraction
        of the board's image if the lamps are on; it must also exceed `NOISE_SIGMAS` standard
        deviations of the surroundings. Units: DN of 255.
    line : LineOnBoardSettings
        Detection of the line, as for `calibrate_laser_plane`.
    """

    still_px: float = 0.5
    max_blur_px: float = 1.5
    min_change: float = 0.03
    min_contrast: float = 8.0
    line: LineOnBoardSettings = field(default_factory=LineOnBoardSettings)

    def __post_init__(self) -> None:
        limits = (self.still_px, self.max_blur_px, self.min_change, self.min_contrast)
        if not all(limit >= 0 for limit in limits):
            raise ValueError(f"expected limits of at least 0, got {limits}")


@dataclass(frozen=True, eq=False)
class Pair:
    """Image of a board and image of the laser line on it.

    Parameters
    ----------
    board, line : ndarray
        Image of the board, and image of the laser line on the unmoved board.
    view : TargetView
        Corners of the board in `board`.
    """

    board: Image
    line: Image
    view: TargetView


@dataclass(frozen=True, eq=False, kw_only=True)
class CaptureState:
    """Pairs taken so far, the board in the previous frame, and one that awaits its laser line.

    Parameters
    ----------
    pairs : tuple of TargetView
        View of the board in each complete pair.
    previous_view : TargetView, optional
        View of the board in the previous frame; None if it was not found.
    pending : tuple of (ndarray, TargetView), optional
        Image and view of the board whose laser line is still missing.
    """

    pairs: tuple[TargetView, ...] = ()
    previous_view: TargetView | None = None
    pending: tuple[Image, TargetView] | None = None


def advance_state(
    state: CaptureState, frame: Image, target: Target, settings: CaptureSettings
) -> tuple[CaptureState, str, Pair | None]:
    """Return the state after a frame, the instruction to the user, and a complete pair.

    The frame is a grey or colour image, (height, width) or (height, width, 3); `target` is the
    board that is held into it. The pair is None while an image is missing.
    """
    extraction = settings.line.extraction or LineSettings()
    grey = convert_to_grey(interpolate_grey(frame, extraction.bayer))
    view = _find_board(grey, target)
    pending = state.pending
    if pending is not None and (
        view is None or measure_movement(pending[1], view) <= settings.still_px
    ):
        if _shows_line(frame, view, pending, target, settings):
            completed = CaptureState(pairs=(*state.pairs, pending[1]))
            instruction = f"pair {len(completed.pairs)} taken: move the board"
            return completed, instruction, Pair(pending[0], frame, pending[1])
        return replace(state, previous_view=view), LASER_ON, None
    searching = CaptureState(pairs=state.pairs, previous_view=view)
    if view is None:
        return searching, "no board: show it whole, sharp and evenly lit", None
    problem = _find_view_problem(state, grey, view, target, settings)
    if problem:
        return searching, problem, None
    return replace(searching, pending=(frame, view)), LASER_ON, None


def _find_view_problem(
    state: CaptureState, grey: Image, view: TargetView, target: Target, settings: CaptureSettings
) -> str | None:
    """Return the instruction for a board that is not accepted yet; None if it is."""
    if any(
        measure_movement(pair, view) < settings.min_change * view.size[0] for pair in state.pairs
    ):
        return "as in an earlier pair: move the board"
    movement_px = (
        np.inf if state.previous_view is None else measure_movement(state.previous_view, view)
    )
    if movement_px > settings.still_px:
        return "board seen: hold it still"
    if isinstance(target, CircleGrid):  # no straight edges
        return None
    return _find_focus_problem(grey, view, settings.max_blur_px)


def measure_movement(first: TargetView, second: TargetView) -> float:
    """Return the median distance in px of the corners that two views of a target share.

    Infinite if they share none. Each may lack corners, for example under a laser line.
    """
    first_pixels = dict(zip(map(tuple, first.points.tolist()), first.pixels, strict=True))
    pairs = zip(map(tuple, second.points.tolist()), second.pixels, strict=True)
    displacements = [pixel - first_pixels[point] for point, pixel in pairs if point in first_pixels]
    return float(np.median(np.hypot(*np.transpose(displacements)))) if displacements else np.inf


def _find_board(frame: Image, target: Target) -> TargetView | None:
    """Return the view of the board in a frame; None if it is not found."""
    try:
        return find_target(frame, target)
    except TargetNotFound:
        return None


def _find_focus_problem(grey: Image, view: TargetView, max_blur_px: float) -> str | None:
    """Return the instruction for a board whose edges are blurred; None if they are sharp."""
    sigmas = []
    for along in ("u", "v"):
        with suppress(CalibrationFailed):
            sigmas.append(estimate_blur_from_views([grey], [view], along).sigma)
    if sigmas and max(sigmas) <= max_blur_px:
        return None
    blur = f"board blurred by {max(sigmas):.1f} px" if sigmas else "board's edges not sharp"
    return f"{blur}: focus the lens, or bring the board nearer"


def _shows_line(
    frame: Image, view: TargetView | None, pending: tuple[Image, TargetView], target: Target,
    settings: CaptureSettings,
) -> bool:  # fmt: skip
    """Return whether the laser line lies on the pending board, as the calibration will find it."""
    board, board_view = pending
    if board.shape != frame.shape:
        return False
    try:
        line = find_laser_view(
            guess_camera(board_view.size), target, board, frame, settings.line
        ).line_pixels
    except LsvisionError:
        return False
    # Converted together: 16-bit images are scaled by their largest value.
    grey, board_grey = np.split(
        convert_to_grey(np.concatenate([frame, board])).astype(np.float64), 2
    )
    # If no board is found, the lamps are off and the board is dark: nothing to subtract.
    laser_grey = grey - (0.0 if view is None else board_grey)
    u, v = np.round(line).astype(int).T
    outline = np.concatenate([line, board_view.pixels]).astype(int)
    (left, top), (right, bottom) = outline.min(axis=0), outline.max(axis=0) + 1
    surroundings = laser_grey[max(top, 0) : bottom, max(left, 0) : right]
    background = float(np.median(surroundings))
    noise = mad_std(surroundings - background)
    contrast = float(np.median(laser_grey[v, u])) - background
    return contrast > max(settings.min_contrast, NOISE_SIGMAS * noise)


def list_missing_views(views: Sequence[TargetView], pairs: int) -> tuple[str, ...]:
    """Return instructions for the next views; empty if none are missing.

    They name missing pairs (of `pairs`, each an image of the board and one of the laser line on
    it), parts of the image without corners, missing tilts and distances. The views are those of one
    camera, which need not be calibrated.
    """
    missing = []
    if len(views) < pairs:
        missing.append(f"{pairs - len(views)} more")
    if not views:
        return tuple(missing)
    if areas := _find_empty_areas(views):
        missing.append(f"board into the image's {', '.join(areas)}")
    camera = guess_camera(views[0].size)
    poses = [guess_board_pose(view, camera.rays(view.pixels)) for view in views]
    sides = [
        name
        for name, axis, sign in _SIDES
        if max(sign * pose.rotation[axis, 2] for pose in poses) < np.sin(REQUESTED_TILT)
    ]
    if sides:
        missing.append(f"tilt with the {', '.join(sides)} side nearer")
    distances = [float(np.linalg.norm(pose.translation)) for pose in poses]
    if max(distances) < REQUESTED_DEPTH_RATIO * min(distances):
        missing.append("nearer and farther")
    return tuple(missing)


def guess_camera(size: tuple[int, int]) -> Camera:
    """Return an approximate camera without distortion, of `DEFAULT_FOCAL_RATIO`."""
    width, height = size
    focal = DEFAULT_FOCAL_RATIO * width
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    return Camera(matrix, np.zeros(0), size)


def _find_empty_areas(views: Sequence[TargetView]) -> list[str]:
    """Return the corners, sides and the middle of the image without any corner of a board."""
    covered = find_covered_cells(views[0].size, views)
    # Blocks of cells along a side: the first cell, all between, and the last cell.
    blocks = np.array([0, *[1] * (CELLS_PER_SIDE - 2), 2])
    return [
        " ".join(dict.fromkeys((row_name, column_name)))
        for row, row_name in enumerate(_ROWS)
        for column, column_name in enumerate(_COLUMNS)
        if not covered[np.ix_(blocks == row, blocks == column)].any()
    ]
