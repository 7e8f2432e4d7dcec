"""What a calibration of the laser plane gives."""

from dataclasses import dataclass

import numpy as np

from lsvision.calibration.views import RejectedView
from lsvision.geometry import FloatArray, Plane, Pose
from lsvision.sensors.light_section import LightSection


@dataclass(frozen=True, eq=False)
class CalibratedLaserView:
    """One board pose after the calibration.

    Parameters
    ----------
    index : int
        Which of the images.
    camera_from_board : Pose
        Where the board stood.
    corner_residuals : (n, 2) ndarray
        Units: px.
    line_residuals : (m,) ndarray
        Of the laser line, across it. Units: px.
    """

    index: int
    camera_from_board: Pose
    corner_residuals: FloatArray
    line_residuals: FloatArray


@dataclass(frozen=True, eq=False)
class LaserPlaneCalibration:
    """A light section with its evidence.

    Parameters
    ----------
    light_section : LightSection
        The result; its camera is refined where the views sufficed.
    covariance : (3, 3) ndarray
        Of the plane: tilt about the section's X, about its Y (rad), distance (mm).
    views : tuple of CalibratedLaserView
        Residuals of each view.
    board_bow, board_bow_std : (2,) ndarray
        How far the middle of the board stands out along x and along y, positive away from
        the camera; zero where it was not fitted. Units: mm.
    rejected : tuple of RejectedView
        Views that could not be used, or whose line is not in the plane of the others.
    outliers : tuple of RejectedView
        Views that were used and fit badly.
    warnings : tuple of str
        What a person should know before using the result.
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
        """Residuals of the laser line, view by view. Units: px."""
        return tuple(view.line_residuals for view in self.views)

    @property
    def line_rms(self) -> float:
        """Of the laser line's residuals. Units: px."""
        return rms(np.concatenate(self.residuals))

    @property
    def corner_rms(self) -> float:
        """Of the corners' residuals, per point as OpenCV counts. Units: px."""
        residuals = np.concatenate([view.corner_residuals for view in self.views])
        return float(np.sqrt(2)) * rms(residuals)


def rms(values: FloatArray) -> float:
    """Root mean square of any array."""
    return float(np.sqrt(np.mean(np.square(values))))
