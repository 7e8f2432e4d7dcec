"""The laser plane in the camera's frame, from the laser line on a board in several poses.

One pose alone gives one line, through which any plane may pass: two poses at least, best 15
to 20, tilted by 25 deg and more to all sides and spread over the depth measured later.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.calibration.bundle_adjustment import BundleAdjustmentResult, adjust_bundle
from lsvision.calibration.bundle_adjustment_state import BundleAdjustmentState, LaserView
from lsvision.calibration.intrinsics_check import tilt_of
from lsvision.calibration.laser_line_on_board import LineOnBoardSettings, find_laser_views
from lsvision.calibration.laser_plane_initial_guess import (
    OUTLIER_DISTANCE_PX,
    fit_plane,
    guess_board_poses,
    laser_points_on_boards,
    plane_inlier_views,
)
from lsvision.calibration.laser_plane_result import (
    CalibratedLaserView,
    LaserPlaneCalibration,
    rms,
)
from lsvision.calibration.lens_blur import estimate_blur_from_views
from lsvision.calibration.target import Target
from lsvision.calibration.views import (
    RejectedView,
    ViewSources,
    outlier_views,
    require_tilted,
    require_views,
)
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray
from lsvision.geometry.arrays import BoolArray
from lsvision.sensors.camera import Camera
from lsvision.sensors.light_section import LightSection

RECOMMENDED_TILT = np.radians(25.0)
"""Tilt from the mean board that a good set reaches: at 5 deg the error is 7 times larger."""

MIN_ON_PATTERN_FRACTION = 0.6
"""Share of the line's points between the corners from which on a bow can be fitted."""

MIN_REPORTED_BOW_MM = 0.02
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
        The light section with its covariance, residuals, and what to know about them; with the
        blur along the line, where the board's edges show it (`measure_lens_blur`).

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
    views, sources = find_laser_views(camera, target, board_images, line_images, settings.line)
    found = fit_laser_plane(camera, views, settings, sources)
    return _with_line_blur(found, [board_images[k] for k in sources.names(len(views))], views)


def fit_laser_plane(
    camera: Camera,
    views: Sequence[LaserView],
    settings: LaserPlaneSettings | None = None,
    sources: ViewSources | None = None,
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
    sources : ViewSources, optional
        Which images they come from.

    Returns
    -------
    LaserPlaneCalibration
        See `calibrate_laser_plane`, also for the errors.
    """
    settings, sources = settings or LaserPlaneSettings(), sources or ViewSources()
    require_views(
        len(views),
        2,
        "the board with the laser line on it",
        "one line alone lies in many planes; add poses of the board",
        sources,
    )
    names = sources.names(len(views))
    poses = guess_board_poses(camera, views)
    lit = laser_points_on_boards(camera, poses, views)
    agree, misfits = plane_inlier_views(lit, camera.focal_length)
    kept = np.flatnonzero(agree).tolist()
    strays = _rejected_views(names, agree, misfits)
    plane = fit_plane(np.concatenate([lit[k] for k in kept]))
    start = BundleAdjustmentState(camera, plane, tuple(poses[k] for k in kept), np.zeros(2))
    refine = (
        len(kept) >= settings.refine_camera_from,
        len(kept) >= settings.fit_bow_from and _on_pattern([views[k] for k in kept]),
    )
    if refine[0]:
        require_tilted(start.camera_from_boards, "camera and distance")
    tilt = tilt_of(start.camera_from_boards)
    solution = adjust_bundle([views[k] for k in kept], start, refine)
    seen = _calibrated_views([names[k] for k in kept], solution)
    _require_one_plane(seen)
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
        (*sources.rejected, *strays),
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
    return float(np.mean(inside)) > MIN_ON_PATTERN_FRACTION


def _rejected_views(
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


def _with_line_blur(
    found: LaserPlaneCalibration, images: Sequence[npt.ArrayLike], views: Sequence[LaserView]
) -> LaserPlaneCalibration:
    """The rig with its blur along the line, or a word on why it is not known."""
    spans = np.median([np.ptp(view.line_pixels, axis=0) for view in views], axis=0)
    try:
        blur = estimate_blur_from_views(images, views, "u" if spans[0] >= spans[1] else "v")
    except CalibrationFailed as reason:
        word = f"the blur along the line is not known and not corrected for: {reason}"
        return replace(found, warnings=(*found.warnings, word))
    return replace(found, light_section=replace(found.light_section, line_blur_px=blur.sigma))


def _calibrated_views(
    names: Sequence[int], solution: BundleAdjustmentResult
) -> tuple[CalibratedLaserView, ...]:
    each = zip(
        names,
        solution.state.camera_from_boards,
        solution.corner_residuals,
        solution.line_residuals,
        strict=True,
    )
    return tuple(CalibratedLaserView(*values) for values in each)


def _require_one_plane(views: Sequence[CalibratedLaserView]) -> None:
    """Refuse lines that lie in no plane."""
    usual = float(np.median([rms(view.line_residuals) for view in views]))
    if usual > OUTLIER_DISTANCE_PX:
        raise CalibrationFailed(
            f"the laser lines of {len(views)} views lie in no one plane, but {usual:.0f} px off "
            "the best: are board and line images shuffled, did laser and camera move against "
            "each other, or the board between its two images?"
        )


def _outliers(views: Sequence[CalibratedLaserView]) -> tuple[RejectedView, ...]:
    names = [view.index for view in views]
    mend = "look at the image, and leave it out if it is blurred or glares"
    found = [
        outlier
        for what, sizes in (
            ("laser line", [rms(view.line_residuals) for view in views]),
            ("corners", [rms(view.corner_residuals) for view in views]),
        )
        for outlier in outlier_views(names, sizes, OUTLIER_FACTOR, (f"{what} off by ", mend))
    ]
    return tuple(sorted(found, key=lambda view: view.index))


def _warnings(solution: BundleAdjustmentResult, count: int, tilt: float) -> list[str]:
    found = []
    if count < 10:
        found.append(f"{count} views; 15 halve the error of 4")
    if tilt < RECOMMENDED_TILT:
        found.append(
            f"boards tilted by {np.degrees(tilt):.0f} deg at most; want 25 deg and more: "
            "camera and distance are weakly determined"
        )
    if solution.line_inconsistent:
        found.append(
            "the laser line contradicts the boards and was not allowed to move them: let it fall "
            "on the flat pattern itself, not saturated, and keep the board still between images"
        )
    bow, std = solution.state.bow, solution.bow_std
    if np.any((np.abs(bow) > MIN_REPORTED_BOW_MM) & (np.abs(bow) > 3 * std)):
        found.append(
            f"the board is bowed by {bow[0]:+.3f} mm along x and {bow[1]:+.3f} mm along y; the "
            "result allows for it, a flat board is better"
        )
    return found
