"""The laser plane in the camera's frame, from the laser line on a board in several poses.

One pose alone gives one line, through which any plane may pass: two poses at least, best 15
to 20, tilted by 25 deg and more to all sides and spread over the depth measured later.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.calibrate.boards_in_view import BoardsSolution, solve_boards
from lsvision.calibrate.boards_state import BoardsState, LaserView
from lsvision.calibrate.laser_plane_result import (
    CalibratedLaserView,
    LaserPlaneCalibration,
    rms,
)
from lsvision.calibrate.laser_plane_start import (
    agreeing_views,
    lit_on_boards,
    plane_through,
    start_poses,
)
from lsvision.calibrate.line_on_board import LineOnBoardSettings, find_laser_views
from lsvision.calibrate.target import Target
from lsvision.calibrate.views import RejectedView
from lsvision.errors import CalibrationFailed, DegenerateGeometry
from lsvision.sensor.camera import Camera
from lsvision.sensor.light_section import LightSection
from lsvision.shapes import FloatArray, Pose
from lsvision.shapes.arrays import BoolArray

MIN_TILT = np.radians(5.0)
"""Largest angle between two boards, below which they count as parallel."""

GOOD_TILT = np.radians(25.0)
"""Tilt from the mean board that a good set reaches: at 5 deg the error is 7 times larger."""

ON_PATTERN = 0.6
"""Share of the line's points between the corners from which on a bow can be fitted."""

NOTABLE_BOW = 0.02
"""mm; a board that is bent by less needs no mention."""

OUTLIER_FACTOR = 3.0
"""A view counts as outlier from this multiple of the median view's residual on."""


@dataclass(frozen=True, kw_only=True)
class LaserPlaneSettings:
    """Settings of `calibrate_laser_plane`.

    Parameters
    ----------
    line : LineOnBoardSettings
        How the line is found on the board.
    refine_camera_from, fit_bow_from : int
        Views from which on the camera's intrinsics, and the board's bow, are refined too;
        with fewer they are held. A large number holds them always. The bow also is held where
        the line falls beside the patterns.
    """

    line: LineOnBoardSettings = field(default_factory=LineOnBoardSettings)
    refine_camera_from: int = 6
    fit_bow_from: int = 6


def calibrate_laser_plane(
    camera: Camera,
    target: Target,
    board_images: Sequence[npt.ArrayLike],
    line_images: Sequence[npt.ArrayLike],
    settings: LaserPlaneSettings | None = None,
) -> LaserPlaneCalibration:
    """Calibrate the laser plane from images of a board with the laser line on it.

    Parameters
    ----------
    camera : Camera
        From `calibrate_camera`; refined along with the plane.
    target : Target
        The board.
    board_images : sequence of images
        The board, evenly lit; one for each pose.
    line_images : sequence of images
        The laser line on it, the board unmoved; in the same order. May be the same images.
    settings : LaserPlaneSettings, optional
        See there.

    Returns
    -------
    LaserPlaneCalibration
        The light section with its covariance, residuals, and what to know about them.

    Raises
    ------
    ValueError
        If there are not as many line images as board images.
    CalibrationFailed
        If the images differ in size from the camera's, or fewer than two show board and line.
    DegenerateGeometry
        If the laser lines do not span a plane, or all boards are parallel.
    """
    settings = settings or LaserPlaneSettings()
    indices, views, rejected = find_laser_views(
        camera, target, board_images, line_images, settings.line
    )
    return fit_laser_plane(camera, views, settings, indices=indices, rejected=rejected)


def fit_laser_plane(
    camera: Camera,
    views: Sequence[LaserView],
    settings: LaserPlaneSettings | None = None,
    *,
    indices: Sequence[int] | None = None,
    rejected: Sequence[RejectedView] = (),
) -> LaserPlaneCalibration:
    """Calibrate the laser plane from corners and line points already found.

    Parameters
    ----------
    camera : Camera
        Start of the camera.
    views : sequence of LaserView
        Two at least.
    settings : LaserPlaneSettings, optional
        See there; ``line`` plays no part.
    indices : sequence of int, optional
        What each view is called in the result; its place if None.
    rejected : sequence of RejectedView
        Views already left out, for the result and the messages.

    Returns
    -------
    LaserPlaneCalibration
        See `calibrate_laser_plane`, also for the errors.
    """
    settings = settings or LaserPlaneSettings()
    _check_count(views, rejected)
    names = list(range(len(views))) if indices is None else list(indices)
    poses = start_poses(camera, views)
    lit = lit_on_boards(camera, poses, views)
    agree, misfits = agreeing_views(lit, camera.focal_length)
    kept = np.flatnonzero(agree).tolist()
    strays = _strays(names, agree, misfits)
    plane = plane_through(np.concatenate([lit[k] for k in kept]))
    start = BoardsState(camera, plane, tuple(poses[k] for k in kept), np.zeros(2))
    refine = (
        len(kept) >= settings.refine_camera_from,
        len(kept) >= settings.fit_bow_from and _on_pattern([views[k] for k in kept]),
    )
    tilt = _check_tilt(start.camera_from_boards, refine[0])
    solution = solve_boards([views[k] for k in kept], start, refine)
    seen = _calibrated_views([names[k] for k in kept], solution)
    return LaserPlaneCalibration(
        LightSection(
            solution.state.camera,
            solution.state.plane,
            {"method": f"laser line on a board in {len(kept)} poses"},
        ),
        solution.plane_covariance,
        seen,
        solution.state.bow,
        solution.bow_std,
        (*rejected, *strays),
        _outliers(seen),
        tuple(_warnings(solution, len(kept), tilt)),
    )


def _on_pattern(views: Sequence[LaserView]) -> bool:
    """Whether the line falls on the patterns: beside them their bow is not known."""
    inside = []
    for view in views:
        hull = cv2.convexHull(view.pixels.astype(np.float32))
        for u, v in view.line_pixels:
            inside.append(cv2.pointPolygonTest(hull, (float(u), float(v)), False) >= 0)
    return float(np.mean(inside)) > ON_PATTERN


def _strays(
    names: Sequence[int], agree: BoolArray, misfits: FloatArray
) -> tuple[RejectedView, ...]:
    return tuple(
        RejectedView(
            names[k],
            f"its laser line lies {misfits[k]:.0f} px off the plane of the other views: board "
            "moved between the two images, images mixed up, or line not on the board",
        )
        for k in np.flatnonzero(~agree).tolist()
    )


def _calibrated_views(
    names: Sequence[int], solution: BoardsSolution
) -> tuple[CalibratedLaserView, ...]:
    each = zip(
        names,
        solution.state.camera_from_boards,
        solution.corner_residuals,
        solution.line_residuals,
        strict=True,
    )
    return tuple(CalibratedLaserView(*values) for values in each)


def _check_count(views: Sequence[LaserView], rejected: Sequence[RejectedView]) -> None:
    if len(views) < 2:
        reasons = "".join(f"\n  image {view.index}: {view.reason}" for view in rejected)
        raise CalibrationFailed(
            f"{len(views)} views show the board with the laser line on it and 2 are needed, "
            f"best 15: one line alone lies in many planes; add poses of the board{reasons}"
        )


def _check_tilt(poses: Sequence[Pose], refine_camera: bool) -> float:
    """Largest angle of a board to the mean board (rad); refuses parallel ones."""
    normals = np.array([pose.rotation[:, 2] for pose in poses])
    between = np.arccos(np.clip(normals @ normals.T, -1, 1)).max()
    if refine_camera and between < MIN_TILT:
        raise DegenerateGeometry(
            f"all boards are parallel within {np.degrees(between):.1f} deg, which leaves camera "
            "and distance undetermined: tilt the board by 25 deg and more to all sides"
        )
    mean = normals.mean(axis=0)
    return float(np.arccos(np.clip(normals @ (mean / np.linalg.norm(mean)), -1, 1)).max())


def _outliers(views: Sequence[CalibratedLaserView]) -> tuple[RejectedView, ...]:
    found = []
    for what, sizes in (
        ("laser line", [rms(view.line_residuals) for view in views]),
        ("corners", [rms(view.corner_residuals) for view in views]),
    ):
        usual = float(np.median(sizes))
        found += [
            RejectedView(
                view.index,
                f"{what} off by {size:.2f} px rms where the median view has {usual:.2f} px: "
                "look at the image, and leave it out if it is blurred or glares",
            )
            for view, size in zip(views, sizes, strict=True)
            if size > OUTLIER_FACTOR * usual
        ]
    return tuple(sorted(found, key=lambda view: view.index))


def _warnings(solution: BoardsSolution, count: int, tilt: float) -> list[str]:
    found = []
    if count < 10:
        found.append(f"{count} views; 15 halve the error of 4")
    if tilt < GOOD_TILT:
        found.append(
            f"boards tilted by {np.degrees(tilt):.0f} deg at most; want 25 deg and more: "
            "camera and distance are weakly determined"
        )
    if solution.discord:
        found.append(
            "the laser line contradicts the boards and was not allowed to move them: let it fall "
            "on the flat pattern itself, not saturated, and keep the board still between images"
        )
    bow, std = solution.state.bow, solution.bow_std
    if np.any((np.abs(bow) > NOTABLE_BOW) & (np.abs(bow) > 3 * std)):
        found.append(
            f"the board is bowed by {bow[0]:+.3f} mm along x and {bow[1]:+.3f} mm along y; the "
            "result allows for it, a flat board is better"
        )
    return found
