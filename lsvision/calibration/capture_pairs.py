"""Pairs of board and laser line from a stream of frames, with the board held by hand.

One image shows the board at rest and in focus, the other the laser line on the unmoved board.
Images are selected automatically from the frames, without a key press.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from lsvision.calibration.capture_needs import rough_camera
from lsvision.calibration.laser_line_on_board import LineOnBoardSettings, find_laser_view
from lsvision.calibration.lens_blur import estimate_blur_from_views
from lsvision.calibration.target import (
    CircleGrid,
    Target,
    TargetNotFound,
    TargetView,
    find_target,
    grey_image,
)
from lsvision.errors import CalibrationFailed, LsvisionError
from lsvision.geometry import FloatArray
from lsvision.laser_line.extraction import LineSettings
from lsvision.laser_line.mosaic import interpolated_grey
from lsvision.statistics.robust import mad_std

Image = npt.NDArray[Any]

LASER_ON = "board taken, hold it still: laser on, lamps off"
NOISE_SIGMAS = 5.0
SURROUNDINGS_PX = 40
"""Width of the surroundings on each side of the line. Units: px."""


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
        Smallest brightness of the line over its surroundings, and beyond five sigmas of these,
        after what the board's image explains is subtracted. Units: DN of 255.
    line : LineOnBoardSettings
        Detection of the line, as for `calibrate_laser_plane`.
    """

    still_px: float = 0.5
    max_blur_px: float = 1.5
    min_change: float = 0.03
    min_contrast: float = 8.0
    line: LineOnBoardSettings = field(default_factory=LineOnBoardSettings)


@dataclass(frozen=True, eq=False)
class Pair:
    """A board and the laser line on it.

    Parameters
    ----------
    board, line : ndarray
        The two images.
    view : TargetView
        Corners of the board.
    """

    board: Image
    line: Image
    view: TargetView


@dataclass(frozen=True, eq=False, kw_only=True)
class CaptureState:
    """Pairs taken so far, and the last frame.

    Parameters
    ----------
    pairs : tuple of TargetView
        Views of the pairs.
    last : TargetView, optional
        The board in the last frame.
    pending : tuple of (ndarray, TargetView), optional
        Board whose laser line is still missing.
    """

    pairs: tuple[TargetView, ...] = ()
    last: TargetView | None = None
    pending: tuple[Image, TargetView] | None = None


def next_state(
    state: CaptureState, frame: Image, target: Target, settings: CaptureSettings
) -> tuple[CaptureState, str, Pair | None]:
    """Return the state after a frame, the instruction to the user, and a complete pair.

    Parameters
    ----------
    state : CaptureState
        Before the frame.
    frame : ndarray
        Grey or colour.
    target : Target
        The board.
    settings : CaptureSettings
        Limits.
    """
    extraction = settings.line.extraction or LineSettings()
    grey = grey_image(interpolated_grey(frame, extraction.bayer))
    view = _board(grey, target)
    pending = state.pending
    if pending is not None and (view is None or movement(pending[1], view) <= settings.still_px):
        if _shows_line(frame, view, pending, target, settings):
            taken = CaptureState(pairs=(*state.pairs, pending[1]))
            text = f"pair {len(taken.pairs)} taken: move the board"
            return taken, text, Pair(pending[0], frame, pending[1])
        return replace(state, last=view), LASER_ON, None
    fresh = CaptureState(pairs=state.pairs, last=view)
    if view is None:
        return fresh, "no board: show it whole, sharp and evenly lit", None
    problem = _view_problem(state, grey, view, target, settings)
    if problem:
        return fresh, problem, None
    return replace(fresh, pending=(frame, view)), LASER_ON, None


def _view_problem(
    state: CaptureState, frame: Image, view: TargetView, target: Target, settings: CaptureSettings
) -> str | None:
    """Return why a board is not accepted yet; None if it is."""
    if any(movement(pair, view) < settings.min_change * view.size[0] for pair in state.pairs):
        return "as in an earlier pair: move the board"
    moved = np.inf if state.last is None else movement(state.last, view)
    if moved > settings.still_px:
        return "board seen: hold it still"
    if isinstance(target, CircleGrid):  # no straight edges
        return None
    return _focus_problem(frame, view, settings.max_blur_px)


def movement(first: TargetView, second: TargetView) -> float:
    """Return the median distance of the corners that two views share; infinite without any.

    A laser line may lie on some of them.

    Parameters
    ----------
    first, second : TargetView
        Two views of the same target.

    Returns
    -------
    float
        Median distance of the common corners. Units: px.
    """
    known = dict(zip(map(tuple, first.points.tolist()), first.pixels, strict=True))
    pairs = zip(map(tuple, second.points.tolist()), second.pixels, strict=True)
    steps = [pixel - known[point] for point, pixel in pairs if point in known]
    return float(np.median(np.hypot(*np.transpose(steps)))) if steps else np.inf


def _board(frame: Image, target: Target) -> TargetView | None:
    try:
        return find_target(frame, target)
    except TargetNotFound:
        return None


def _focus_problem(frame: Image, view: TargetView, limit: float) -> str | None:
    """Return the message for a board whose edges are blurred; None where they are sharp."""
    sigmas = []
    for along in ("u", "v"):
        with suppress(CalibrationFailed):
            sigmas.append(estimate_blur_from_views([frame], [view], along).sigma)
    if sigmas and max(sigmas) <= limit:
        return None
    blur = f"board blurred by {max(sigmas):.1f} px" if sigmas else "board's edges not sharp"
    return f"{blur}: focus the lens, bring it nearer"


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
            rough_camera(board_view.size), target, board, frame, settings.line
        ).line_pixels
    except LsvisionError:
        return False
    # Where the lamps are off, the board's image explains nothing.
    laser_grey = _grey(frame) - (0.0 if view is None else _grey(board))
    u, v = np.round(line).astype(int).T
    (left, top), (right, bottom) = line.min(axis=0), line.max(axis=0)
    rows = slice(max(int(top) - SURROUNDINGS_PX, 0), int(bottom) + SURROUNDINGS_PX)
    around = laser_grey[rows, max(int(left) - SURROUNDINGS_PX, 0) : int(right) + SURROUNDINGS_PX]
    dark = float(np.median(around))
    noise = mad_std(around - dark)
    contrast = float(np.median(laser_grey[v, u])) - dark
    return contrast > max(settings.min_contrast, NOISE_SIGMAS * noise)


def _grey(image: Image) -> FloatArray:
    return grey_image(image).astype(np.float64)
