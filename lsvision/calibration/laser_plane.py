"""Laser plane in the camera frame from the laser line on a board in several poses.

One pose gives one line, which lies in many planes: at least two poses are needed, best 15 to 20,
tilted by 25 deg and more to all sides and spread over the depth range of the measurement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from lsvision.calibration.board_shape import SHAPE_TERMS
from lsvision.calibration.bundle_adjustment import BundleAdjustmentResult, adjust_bundle
from lsvision.calibration.bundle_adjustment_problem import (
    BundleAdjustmentState,
    LaserView,
    Refinement,
    build_tilt_axes,
)
from lsvision.calibration.camera_uncertainty import (
    check_intrinsics_covariance,
    covariance_by_camera,
)
from lsvision.calibration.laser_line_on_board import LineOnBoardSettings, find_laser_views
from lsvision.calibration.laser_plane_checks import (
    MIN_ON_PATTERN_FRACTION,
    TWO_VIEWS_STD_FACTOR,
    find_outliers,
    list_outside_warnings,
    list_warnings,
    measure_pattern_fraction,
    require_one_plane,
)
from lsvision.calibration.laser_plane_initial_guess import (
    find_plane_inlier_views,
    fit_plane,
    guess_board_poses,
    intersect_laser_rays_with_boards,
)
from lsvision.calibration.laser_plane_result import CalibratedLaserView, LaserPlaneCalibration
from lsvision.calibration.lens_blur import estimate_blur_from_views
from lsvision.calibration.target import Target, TargetView, list_left_out_warnings
from lsvision.calibration.views import (
    RejectedView,
    ViewSources,
    compute_max_tilt,
    require_tilted,
    require_views,
)
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray
from lsvision.geometry.arrays import BoolArray
from lsvision.laser_line.extraction import LineSettings
from lsvision.laser_line.image_array import as_image
from lsvision.laser_line.line_image import split_colour_planes
from lsvision.sensors.camera import Camera
from lsvision.sensors.light_section import LightSection


@dataclass(frozen=True, kw_only=True)
class LaserPlaneSettings:
    """Settings of `calibrate_laser_plane`.

    Parameters
    ----------
    line : LineOnBoardSettings
        Settings of the detection of the line on the board.
    refine_camera_from, fit_bow_from : int
        Smallest number of views with which the camera's intrinsics, and the board's bow, are
        refined. A large number keeps them fixed. The bow is also fixed if much of the line lies
        outside the outline of the corners.
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
    camera_covariance: FloatArray | None = None,
) -> LaserPlaneCalibration:
    """Calibrate the laser plane from images of a board with the laser line on it.

    Parameters
    ----------
    camera : Camera
        Camera from `calibrate_camera`; refined together with the plane if there are enough views.
    target : Target
        Board in the images.
    board_images : sequence of images
        Images of the evenly lit board, one for each pose.
    line_images : sequence of images
        Images of the laser line on the unmoved board, in the same order; may be `board_images`.
    settings : LaserPlaneSettings, optional
        Settings of the detection, and numbers of views for the refinement.
    camera_covariance : (4 + k, 4 + k) ndarray, optional
        `CameraCalibration.covariance`; used where the views are too few to refine the camera.
        Without it such a camera is taken as exact.

    Returns
    -------
    LaserPlaneCalibration
        Light section with covariance, residuals and warnings, and with the blur along the line if
        it can be measured on the board's edges (`measure_lens_blur`).

    Raises
    ------
    ValueError
        If the numbers of line images and board images differ, or the covariance does not belong to
        the camera.
    CalibrationFailed
        If the images differ in size from the camera's, fewer than two show board and line, or the
        laser lines do not lie in one plane.
    DegenerateGeometry
        If the laser lines lie on one line, or all boards are parallel and the camera is refined.

    Examples
    --------
    >>> from lsvision.calibration.intrinsics import calibrate_camera
    >>> from lsvision.calibration.target import ChArUco
    >>> from lsvision.io.images import read_image
    >>> folder, names = "calibration/example", [f"{k:02d}.jpg" for k in (0, 4, 8)]
    >>> boards = [read_image(f"{folder}/boards/board_{name}") for name in names]
    >>> lines = [read_image(f"{folder}/lines/line_{name}") for name in names]
    >>> camera = calibrate_camera(boards, ChArUco()).camera
    >>> calibration = calibrate_laser_plane(camera, ChArUco(), boards, lines)
    >>> len(calibration.views), calibration.line_rms < 0.5
    (3, True)
    """
    settings = settings or LaserPlaneSettings()
    views, sources = find_laser_views(camera, target, board_images, line_images, settings.line)
    calibration = fit_laser_plane(camera, views, settings, sources, camera_covariance)
    corner_warnings = list_left_out_warnings(
        target,
        [TargetView(view.points, view.pixels, camera.size) for view in views],
        sources.list_image_indices(len(views)),
    )
    outside = list_outside_warnings(views, settings.line.margin)
    calibration = replace(calibration, warnings=(*calibration.warnings, *outside, *corner_warnings))
    used_images = [board_images[k] for k in sources.list_image_indices(len(views))]
    return _with_line_blur(
        calibration, used_images, views, settings.line.extraction or LineSettings()
    )


def fit_laser_plane(
    camera: Camera,
    views: Sequence[LaserView],
    settings: LaserPlaneSettings | None = None,
    sources: ViewSources | None = None,
    camera_covariance: FloatArray | None = None,
) -> LaserPlaneCalibration:
    """Return the laser plane calibrated from corners and line points of at least two views.

    `camera` is an initial guess; ``settings.line`` is not used; `sources` are the image indices of
    the views, and the rejected images for the result. See `calibrate_laser_plane` for result and
    errors.
    """
    settings, sources = settings or LaserPlaneSettings(), sources or ViewSources()
    if camera_covariance is not None:
        check_intrinsics_covariance(camera, camera_covariance)
    require_views(
        len(views),
        2,
        "the board with the laser line on it",
        "one line alone lies in many planes; add poses of the board",
        sources,
    )
    image_indices = sources.list_image_indices(len(views))
    poses = guess_board_poses(camera, views)
    laser_points = intersect_laser_rays_with_boards(camera, poses, views)
    inlier_mask, distances = find_plane_inlier_views(laser_points, camera.focal_length)
    inliers = np.flatnonzero(inlier_mask).tolist()
    rejected = _list_rejected_views(image_indices, inlier_mask, distances)
    plane = fit_plane(np.concatenate([laser_points[k] for k in inliers]))
    views, boards = [views[k] for k in inliers], tuple(poses[k] for k in inliers)
    refinement = _select_refinement(views, settings)
    if refinement.camera:
        require_tilted(boards, "camera and distance")
    initial_guess = BundleAdjustmentState(camera, plane, boards, np.zeros(SHAPE_TERMS))
    solution = adjust_bundle(views, initial_guess, refinement)
    calibrated_views = _list_calibrated_views([image_indices[k] for k in inliers], views, solution)
    require_one_plane(calibrated_views)
    return LaserPlaneCalibration(
        LightSection(
            solution.state.camera,
            solution.state.plane,
            {"method": f"laser line on a board in {len(views)} poses"},
        ),
        _plane_covariance(views, solution, None if refinement.camera else camera_covariance),
        calibrated_views,
        solution.state.bow,
        solution.bow_std,
        (*sources.rejected, *rejected),
        find_outliers(calibrated_views),
        tuple(list_warnings(solution, len(views), compute_max_tilt(boards))),
    )


def _select_refinement(views: Sequence[LaserView], settings: LaserPlaneSettings) -> Refinement:
    """Return what is refined beside plane and poses with these views."""
    enough_for_bow = len(views) >= settings.fit_bow_from
    return Refinement(
        camera=len(views) >= settings.refine_camera_from,
        bow=enough_for_bow and measure_pattern_fraction(views) > MIN_ON_PATTERN_FRACTION,
    )


def _plane_covariance(
    views: Sequence[LaserView],
    solution: BundleAdjustmentResult,
    camera_covariance: FloatArray | None,
) -> FloatArray:
    """Return the covariance (3, 3) of the plane, with the effect of that of a camera (if given).

    It is larger by `TWO_VIEWS_STD_FACTOR` squared for two views.
    """
    covariance = solution.plane_covariance
    if camera_covariance is not None:
        refit = partial(_refit_plane, views, solution)
        covariance = covariance + covariance_by_camera(
            refit, solution.state.camera, camera_covariance
        )
    return covariance * (TWO_VIEWS_STD_FACTOR**2 if len(views) == 2 else 1.0)


def _refit_plane(
    views: Sequence[LaserView], solution: BundleAdjustmentResult, camera: Camera
) -> FloatArray:
    """Return the change (3,) of the plane's tilts (rad) and distance (mm) with another camera."""
    state = solution.state
    guess = BundleAdjustmentState(camera, state.plane, guess_board_poses(camera, views), state.bow)
    plane = adjust_bundle(views, guess, Refinement(camera=False, bow=False)).state.plane
    tilts = build_tilt_axes(state) @ (plane.normal - state.plane.normal)
    return np.append(tilts, plane.distance - state.plane.distance)


def _list_rejected_views(
    image_indices: Sequence[int], inlier_mask: BoolArray, distances: FloatArray
) -> tuple[RejectedView, ...]:
    """Return the views whose line is not in the plane of the others, with the reason."""
    return tuple(
        RejectedView(
            image_indices[k],
            f"its laser line lies {distances[k]:.0f} px off the plane of the other views: board "
            "moved between the two images, images mixed up, or line not on the board",
        )
        for k in np.flatnonzero(~inlier_mask).tolist()
    )


def _with_line_blur(
    calibration: LaserPlaneCalibration,
    images: Sequence[npt.ArrayLike],
    views: Sequence[LaserView],
    line: LineSettings,
) -> LaserPlaneCalibration:
    """Return the calibration with the blur along the line, or a warning why it is unknown.

    In the raw image of a colour camera it is measured with the pixels of the laser's colour alone:
    an interpolated image is blurred further.
    """
    spacing = 1 if line.bayer is None else 2
    if line.bayer is not None:
        planes = [
            split_colour_planes(as_image(image), line.bayer, line.channel)[0] for image in images
        ]
        images = [plane for _, _, plane in planes]
        views = [
            replace(view, pixels=(view.pixels - (column, row)) / spacing)
            for view, (row, column, _) in zip(views, planes, strict=True)
        ]
    extents = np.median([np.ptp(view.line_pixels, axis=0) for view in views], axis=0)
    try:
        blur = estimate_blur_from_views(images, views, "u" if extents[0] >= extents[1] else "v")
    except CalibrationFailed as error:
        warning = f"the blur along the line is not known and not corrected for: {error}"
        return replace(calibration, warnings=(*calibration.warnings, warning))
    return replace(
        calibration,
        light_section=replace(calibration.light_section, line_blur_px=spacing * blur.sigma),
    )


def _list_calibrated_views(
    image_indices: Sequence[int], views: Sequence[LaserView], solution: BundleAdjustmentResult
) -> tuple[CalibratedLaserView, ...]:
    """Return the views with their poses and residuals."""
    fields = zip(
        image_indices,
        views,
        solution.state.camera_from_boards,
        solution.corner_residuals,
        solution.line_residuals,
        strict=True,
    )
    return tuple(CalibratedLaserView(*values) for values in fields)
