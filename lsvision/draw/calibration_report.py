"""Calibrations as HTML pages: numbers, warnings and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.hand_eye_result import HandEye
from lsvision.calibration.intrinsics import CameraCalibration
from lsvision.calibration.laser_plane_result import LaserPlaneCalibration
from lsvision.draw.calibration_figures import (
    draw_bars,
    draw_coverage,
    draw_laser_plane,
    draw_poses,
    view_sizes,
)
from lsvision.draw.figure_files import svg_element
from lsvision.geometry import Points, Pose
from lsvision.results.html import html_environment


@dataclass(frozen=True)
class ReportContent:
    """Content of every page other than its pictures.

    Parameters
    ----------
    rows : sequence of (str, str, str)
        Name, number with one sigma, unit.
    warnings : sequence of str
        What was left out, fits badly, or leaves the result poorly determined.
    names : sequence of str
        Names of the images or poses, in the order of their indices.
    provenance : mapping of str to str
        Method, date, version, inputs and their hash.
    """

    rows: Sequence[tuple[str, str, str]]
    warnings: Sequence[str]
    names: Sequence[str]
    provenance: Mapping[str, str]


def camera_page(found: CameraCalibration, page: ReportContent) -> str:
    """Return the page of a camera calibration.

    Parameters
    ----------
    found : CameraCalibration
        The calibration.
    page : ReportContent
        Its values, warnings, names and provenance.

    Returns
    -------
    str
        HTML without references to other files.
    """
    names = [page.names[view.index] for view in found.views]
    bad = _positions([view.index for view in found.views], [view.index for view in found.outliers])
    sizes = [view.rms_px for view in found.views]
    pictures = [
        (
            svg_element(draw_coverage(found)),
            "Good: the points fill the image into its corners, and the residuals are one round "
            "cloud. In a gap the distortion is extrapolated.",
        ),
        (
            svg_element(draw_bars(names, [("rms", sizes)], bad, "rms, px")),
            "Residual of each view. Good: all alike, 0.05 to 0.3 px. Orange fits badly: blurred, "
            "moved, or wrongly found.",
        ),
    ]
    return _page("Camera calibration", page, pictures)


def laser_plane_page(
    found: LaserPlaneCalibration, board_points: Points, page: ReportContent
) -> str:
    """Return the page of a laser-plane calibration; see `camera_page`.

    Parameters
    ----------
    found : LaserPlaneCalibration
        The calibration.
    board_points : (n, 3) ndarray
        Points of the board, board frame. Units: mm.
    page : ReportContent
        Its values, warnings, names and provenance.
    """
    names = [page.names[view.index] for view in found.views]
    bad = _positions([view.index for view in found.views], [view.index for view in found.outliers])
    line, corners = view_sizes(found)
    bars = draw_bars(names, [("laser line", line), ("corners", corners)], bad, "rms, px")
    pictures = [
        (
            svg_element(draw_laser_plane(found, _outline(board_points))),
            "Good: the boards lean to all sides and fill the depth of later measurements. "
            "The triangle is the camera.",
        ),
        (
            svg_element(bars),
            "Residual of each view, laser line dark and corners light. Good: all alike, the line "
            "0.1 to 0.3 px. A line much worse than that on every view: a bowed or glossy board.",
        ),
    ]
    return _page("Laser plane calibration", page, pictures)


def hand_eye_page(found: HandEye, flanges: Sequence[Pose], page: ReportContent) -> str:
    """Return the page of a hand-eye calibration; see `camera_page`.

    Parameters
    ----------
    found : HandEye
        The calibration.
    flanges : sequence of Pose
        ``base_from_flange``, one a pose.
    page : ReportContent
        Its values, warnings, names and provenance.
    """
    bad = [pose.index for pose in found.rejected]
    series = [
        ("residual", found.residuals.tolist()),
        ("held out", found.leave_one_out_residuals.tolist()),
    ]
    pictures = [
        (
            svg_element(draw_poses(found, flanges)),
            "Good: the sensor looks from many sides and turned all around; the target lies left, "
            "right, near and far in its view, and on both sides of the laser plane.",
        ),
        (
            svg_element(draw_bars(page.names, series, bad, "mm")),
            "Residual of each pose (dark), and of a fit without that pose (light). Good: about "
            "the robot's own accuracy. Orange was left out.",
        ),
    ]
    return _page("Sensor to robot", page, pictures)


def _page(title: str, page: ReportContent, pictures: Sequence[tuple[str, str]]) -> str:
    """Render a page; each picture is an ``<svg>`` element with its caption."""
    template = html_environment("lsvision.draw").get_template("calibration.html.j2")
    return template.render(title=title, pictures=pictures, **vars(page))


def _positions(indices: Sequence[int], marked: Sequence[int]) -> list[int]:
    return [position for position, index in enumerate(indices) if index in marked]


def _outline(points: Points) -> Points:
    """Return the (4, 3) corners of the rectangle around a board's points, board frame."""
    (left, top, _), (right, bottom, _) = points.min(axis=0), points.max(axis=0)
    return np.array([[left, top, 0], [right, top, 0], [right, bottom, 0], [left, bottom, 0]])
