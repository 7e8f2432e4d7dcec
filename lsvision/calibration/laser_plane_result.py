"""Result of a laser plane's calibration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.bundle_adjustment_problem import LaserView
from lsvision.calibration.result_tables import (
    build_common_record,
    cells_from_rows,
    format_laser_plane_rows,
    format_rejections,
)
from lsvision.calibration.views import RejectedView, rms_distance
from lsvision.geometry import FloatArray, Plane, Pose
from lsvision.geometry.arrays import rms
from lsvision.geometry.equality import ComparedByValue
from lsvision.results.number_format import format_value
from lsvision.results.quantities import Record, convert_numbers_to_json
from lsvision.results.result import Result
from lsvision.sensors.light_section import LightSection


@dataclass(frozen=True, eq=False)
class CalibratedLaserView(ComparedByValue):
    """Pose and residuals of one board with its laser line after the calibration.

    Parameters
    ----------
    index : int
        Index of the view in the input.
    laser_view : LaserView
        Corners and laser line in the images.
    camera_from_board : Pose
        Pose of the board.
    corner_residuals : (n, 2) ndarray
        Projected minus observed corners. Units: px.
    line_residuals : (m,) ndarray
        Signed distances, in the image, of the observed points of the laser line from the
        intersection of laser plane and board; positive if the point's ray meets the laser plane
        behind the board. Units: px.
    """

    index: int
    laser_view: LaserView
    camera_from_board: Pose
    corner_residuals: FloatArray
    line_residuals: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class LaserPlaneCalibration(Result):
    """Calibrated light section with covariance, residuals and warnings.

    Parameters
    ----------
    light_section : LightSection
        Calibrated light section; its camera is refined if there are enough views.
    covariance : (3, 3) ndarray
        Covariance of the rotation of the plane's normal about the section's X and Y (rad), and of
        the plane's distance from the camera's centre (mm).
    views : tuple of CalibratedLaserView
        Pose and residuals of each view.
    board_bow, board_bow_std : (3,) ndarray
        Bow along x and along y, positive if the board's middle is farther from the camera than its
        edges, and twist at the corners (see `board_shape`), with standard deviations; zero if not
        fitted. Units: mm.
    rejected : tuple of RejectedView
        Views that could not be used, or whose line is not in the plane of the others.
    outliers : tuple of RejectedView
        Views that were used, but have large residuals.
    warnings : tuple of str
        Warnings about the set of views, with remedies.
    """

    light_section: LightSection
    covariance: FloatArray
    views: tuple[CalibratedLaserView, ...]
    board_bow: FloatArray
    board_bow_std: FloatArray
    rejected: tuple[RejectedView, ...]
    outliers: tuple[RejectedView, ...]
    warnings: tuple[str, ...]

    @property
    def plane(self) -> Plane:
        """The laser plane, camera frame, at a positive distance. Units: mm."""
        return self.light_section.laser_plane

    @property
    def residuals(self) -> tuple[FloatArray, ...]:
        """Residuals of the laser line in each view. Units: px."""
        return tuple(view.line_residuals for view in self.views)

    @property
    def line_rms(self) -> float:
        """Root mean square residual of the laser line. Units: px."""
        return rms(np.concatenate(self.residuals))

    @property
    def corner_rms(self) -> float:
        """Root mean square residual of the corners, per point as in OpenCV. Units: px."""
        return rms_distance(np.concatenate([view.corner_residuals for view in self.views]))

    def to_dict(self) -> Record:
        """Return the plane with its uncertainty and the residuals, ready for JSON.

        Returns
        -------
        dict
            Camera frame; lengths in ``*_mm``, angles in ``*_deg``, residuals in ``*_px``.
        """
        tilt_x, tilt_y, distance = (math.sqrt(value) for value in self.covariance.diagonal())
        return {
            "normal": convert_numbers_to_json(self.plane.normal),
            "tilt_x_std_deg": math.degrees(tilt_x),
            "tilt_y_std_deg": math.degrees(tilt_y),
            "distance_mm": self.plane.distance,
            "distance_std_mm": distance,
            "line_rms_px": self.line_rms,
            "corner_rms_px": self.corner_rms,
            **build_common_record(self),
        }

    def _summarise(self) -> str:
        std = math.sqrt(float(self.covariance[2, 2]))
        return (
            f"distance {format_value(self.plane.distance, std)} mm from {len(self.views)} views, "
            f"laser line rms {self.line_rms:.3f} px"
        )

    def _list_cells(self) -> list[tuple[str, ...]]:
        return cells_from_rows(format_laser_plane_rows(self))

    def _list_notes(self) -> list[str]:
        return format_rejections(self.rejected, self.outliers, self.warnings)
