"""Calibrations as HTML pages: numbers, warnings and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from lsvision.calibration.camera_warnings import CELLS_PER_SIDE, find_covered_cells
from lsvision.calibration.hand_eye_result import HandEye
from lsvision.calibration.intrinsics import CameraCalibration
from lsvision.calibration.laser_plane_result import CalibratedLaserView, LaserPlaneCalibration
from lsvision.calibration.observations import RejectedPose
from lsvision.calibration.views import RejectedView
from lsvision.draw.calibration_figures import (
    compute_rms_of_views,
    draw_bars,
    draw_coverage,
    draw_laser_plane,
    draw_poses,
)
from lsvision.draw.figures import render_svg_element
from lsvision.draw.view_photos import ViewPhoto, compute_arrow_factor, render_photo_svg
from lsvision.geometry import FloatArray, Points, Pose
from lsvision.geometry.arrays import rms
from lsvision.results.html import build_html_environment

_NO_POINTS: FloatArray = np.empty((0, 2))
"""Points of a board without corners or without a line."""


class _Detections(NamedTuple):
    """Points found in a photo with their residuals; the fields of the same names of `ViewPhoto`."""

    corners: Points = _NO_POINTS
    corner_residuals: FloatArray = _NO_POINTS
    line: Points = _NO_POINTS
    line_residuals: FloatArray = _NO_POINTS


@dataclass(frozen=True)
class ReportContent:
    """Content of the page of any calibration, other than its figures.

    Rows are name, number with standard deviation, and unit. Warnings are about rejected images,
    outliers and the result; `names` are those of all images or poses, also of the rejected ones,
    each with a photo unless it is a hand-eye calibration without; the provenance is method, date,
    version, inputs and their hash.
    """

    rows: Sequence[tuple[str, str, str]]
    warnings: Sequence[str]
    names: Sequence[str]
    provenance: Mapping[str, str]
    images: Sequence[npt.NDArray[Any]] = ()


def render_camera_page(calibration: CameraCalibration, page: ReportContent) -> str:
    """Return the page of a camera calibration, HTML without references to other files."""
    names, outliers = _find_names_and_outliers(calibration, page)
    sizes = [view.rms_px for view in calibration.views]
    covered = find_covered_cells(
        calibration.camera.size, [view.target_view for view in calibration.views]
    ).mean()
    pictures = [
        (
            render_svg_element(draw_coverage(calibration)),
            f"Corners of all views: they lie in {100 * covered:.0f} % of the "
            f"{CELLS_PER_SIDE} x {CELLS_PER_SIDE} cells of the image. In the shaded ones the "
            "lens is extrapolated. Right: residuals of all corners.",
        ),
        (
            render_svg_element(draw_bars(names, [("rms", sizes)], outliers, "rms, px")),
            "Residual of each view; orange: beyond the limit for outliers.",
        ),
    ]
    views = {
        view.index: _Detections(view.target_view.pixels, view.residuals)
        for view in calibration.views
    }
    return _render_page(
        "Camera calibration", page, pictures, _render_photos(page, views, calibration.rejected)
    )


def render_laser_plane_page(
    calibration: LaserPlaneCalibration, board_points: Points, page: ReportContent
) -> str:
    """Return the page of a laser-plane calibration.

    `board_points`, (n, 3), are the points of the board, board frame, in mm.
    """
    names, outliers = _find_names_and_outliers(calibration, page)
    line, corners = compute_rms_of_views(calibration)
    bars = draw_bars(names, [("laser line", line), ("corners", corners)], outliers, "rms, px")
    pictures = [
        (
            render_svg_element(draw_laser_plane(calibration, _find_outline(board_points))),
            "Camera (triangle), boards (grey) and laser plane (red): the plane is measured where "
            "boards are, and extrapolated elsewhere.",
        ),
        (
            render_svg_element(bars),
            "Residual of each view, laser line dark and corners light; orange: beyond the limit "
            "for outliers.",
        ),
    ]
    views = {
        view.index: _Detections(
            view.laser_view.pixels, view.corner_residuals, view.laser_view.line_pixels,
            compute_line_vectors(calibration, view),
        )
        for view in calibration.views
    }  # fmt: skip
    return _render_page(
        "Laser plane calibration", page, pictures, _render_photos(page, views, calibration.rejected)
    )


def compute_line_vectors(
    calibration: LaserPlaneCalibration, view: CalibratedLaserView
) -> FloatArray:
    """Return the residuals of a view's laser line as vectors along the line's normal, (m, 2).

    They point from the found to the predicted line, without lens distortion. Units: px.
    """
    rays = calibration.light_section.camera.rays(view.laser_view.line_pixels)
    board_normal, plane_normal = view.camera_from_board.rotation[:, 2], calibration.plane.normal
    # The ray (x, y, 1) of a pixel meets the laser plane at a height above the board that is 0 on
    # the line; the gradient of this height by x and y, but for a positive factor, is the normal.
    ratio = (rays @ board_normal) / (rays @ plane_normal)
    gradient = board_normal[:2] - ratio[:, None] * plane_normal[:2]
    normals = gradient / np.hypot(*gradient.T)[:, None]
    vectors: FloatArray = -view.line_residuals[:, None] * normals
    return vectors


def render_hand_eye_page(
    calibration: HandEye,
    flanges: Sequence[Pose],
    page: ReportContent,
    corners: Sequence[tuple[Points, FloatArray]] = (),
) -> str:
    """Return the page of a hand-eye calibration.

    `flanges` are ``base_from_flange`` of each observation. For a board, `corners` are the corners
    found in each photo and their residuals (predicted by the robot's pose and the result, minus
    found), both (n, 2) in px.
    """
    rejected = [pose.index for pose in calibration.rejected]
    series = [
        ("residual", calibration.residuals.tolist()),
        ("leave-one-out", calibration.leave_one_out_residuals.tolist()),
    ]
    pictures = [
        (
            render_svg_element(draw_poses(calibration, flanges)),
            "Positions of the target in the sensor's view, and poses of the sensor; numbers from "
            "0.",
        ),
        (
            render_svg_element(draw_bars(page.names, series, rejected, "mm")),
            "Residual of each pose (dark), and with respect to a fit without it (light); orange: "
            "rejected.",
        ),
    ]
    views = {
        index: _Detections(points, residuals) for index, (points, residuals) in enumerate(corners)
    }
    photos = _render_photos(page, views, calibration.rejected)
    prediction = "predicted by the robot's pose and the result,"
    return _render_page("Sensor to robot", page, pictures, photos, prediction)


def _render_photos(
    page: ReportContent,
    views: Mapping[int, _Detections],
    rejected: Sequence[RejectedView] | Sequence[RejectedPose],
) -> list[tuple[str, str]]:
    """Return each photo with its caption: numbers of points and residuals, or the rejection.

    `views` has what was found in the photos, by their indices; there may be no photos.
    """
    if not page.images:
        return []
    reasons = {view.index: view.reason for view in rejected}
    photos = [
        ViewPhoto(name=name, image=image, **views.get(index, _Detections())._asdict())
        for index, (name, image) in enumerate(zip(page.names, page.images, strict=True))
    ]
    width = max(photo.image.shape[1] for photo in photos)
    factors = (
        compute_arrow_factor([photo.corner_residuals for photo in photos], width),
        compute_arrow_factor([photo.line_residuals for photo in photos], width),
    )
    return [
        (render_photo_svg(photo, factors), _format_caption(photo, factors, reasons.get(index)))
        for index, photo in enumerate(photos)
    ]


def _format_caption(photo: ViewPhoto, factors: tuple[float, float], reason: str | None) -> str:
    """Return the caption of a view: why it is left out, or rms residuals and scale of arrows."""
    if reason is not None:
        return f"{photo.name}: left out: {reason}"
    corner_rms = rms(np.hypot(*photo.corner_residuals.T))
    texts = [f"{len(photo.corners)} corners, {corner_rms:.3f} px rms, arrows ×{factors[0]:g}"]
    if len(photo.line):
        line_rms = rms(np.hypot(*photo.line_residuals.T))
        texts.append(
            f"{len(photo.line)} points of the laser line, {line_rms:.3f} px rms, "
            f"arrows ×{factors[1]:g}"
        )
    return f"{photo.name}: {'; '.join(texts)}"


def _render_page(
    title: str,
    page: ReportContent,
    pictures: Sequence[tuple[str, str]],
    photos: Sequence[tuple[str, str]],
    prediction: str = "predicted",
) -> str:
    """Return a page; each picture and photo is an ``<svg>`` element with its caption.

    `prediction` states, before the words "minus found", what the arrows in the photos show.
    """
    template = build_html_environment("lsvision.draw").get_template("calibration.html.j2")
    values = {"title": title, "pictures": pictures, "photos": photos, "prediction": prediction}
    return template.render(**values, **vars(page))


def _find_names_and_outliers(
    calibration: CameraCalibration | LaserPlaneCalibration, page: ReportContent
) -> tuple[list[str], list[int]]:
    """Return the name of each view that was used, and the positions of the outliers among them."""
    indices = [view.index for view in calibration.views]
    outliers = [view.index for view in calibration.outliers]
    positions = [position for position, index in enumerate(indices) if index in outliers]
    return [page.names[index] for index in indices], positions


def _find_outline(points: Points) -> Points:
    """Return the (4, 3) corners of the rectangle around a board's points, board frame."""
    (left, top, _), (right, bottom, _) = points.min(axis=0), points.max(axis=0)
    return np.array([[left, top, 0], [right, top, 0], [right, bottom, 0], [left, bottom, 0]])
