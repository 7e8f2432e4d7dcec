"""Checks of a hand-eye calibration: residuals, heights of the sensor, stated size of the board.

A wrong size of a board multiplies all distances from the camera to it by one factor, but not the
robot's motion, which is in mm. The hand-eye solution absorbs most of this by a shift of the camera
along its optical axis (4 mm for a board 400 mm away whose stated size is 1 % wrong): the residuals
increase by much less.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.errors_in_variables import ErrorsInVariablesFit
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray, Points

Scale = tuple[float, float]
"""Factor and its standard deviation."""

LARGE_RESIDUAL_MM = 3.0
"""Root mean square residual above which a warning is given. Units: mm. Right poses of robots with
errors of up to 1.25 mm and 0.16 deg per axis leave at most 2.7 mm, on a board 550 to 850 mm away
(18 simulated sets); a wrong convention, order or mounting leaves 60 mm and more."""
SCALE_SIGMAS = 4.0
"""Standard deviations from 1 above which a scale is significant. Of 257 simulated boards of the
stated size none is above 2.9, and with a limit of 2.8 one gives a false warning, with 2 eleven. Of
boards whose size is 1.6 % wrong, 63 % are noticed, 87 % with 2.8, and 29 % with 5.6."""
MIN_HEIGHT_SCALE_ERROR = 0.005
"""Deviation of the height scale from 1 above which a warning is given."""
MIN_BOARD_SCALE_ERROR = 0.003
"""Deviation of a board's scale from 1 above which a warning is given; the error of a camera's
focal length may be as large."""
MAX_SCALE_ERROR = 0.02
"""Deviation of the factor from 1 above which the calibration is rejected; the scale of laser
printers may deviate by 2 %. The camera would be shifted along its axis by that fraction of its
distance from the board."""
MAX_SCALE_STD = 0.1
"""Standard deviation of the size's relative error above which it is not determined, as by a flange
that only rotates about its origin. The factor 1 / (1 + error) has a bias of that fraction of its
standard deviation, and only sizes that are wrong by 40 % would be significant; 506 simulated sets
of 5 to 13 poses with tilts of 35 deg have 0.022 at most."""
MIN_INFORMATION_RATIO = 1e-12
"""Fraction of the information on the size that a solution leaves, below which it is rounding."""


def is_wrong_scale(scale: Scale, min_error: float) -> bool:
    """Return whether a scale, with its standard deviation, differs from 1 significantly."""
    factor, std = scale
    return abs(factor - 1) >= max(SCALE_SIGMAS * std, min_error)


def describe_board_scale(scale: Scale) -> str:
    """Return the message on a board whose size was stated wrong, with the remedy.

    Examples
    --------
    >>> describe_board_scale((0.99, 0.0004)).split(":")[0]
    "by the robot's motion the size of the board must be multiplied by 0.9900 +/- 0.0004"
    """
    factor, std = scale
    return (
        "by the robot's motion the size of the board must be multiplied by "
        f"{factor:.4f} +/- {std:.4f}: measure its squares, and give the same size here and to the "
        "calibration of the camera"
    )


def describe_residuals(residual_rms: float, robot_std: tuple[float, float]) -> str:
    """Return the warning about large residuals of `HandEye`, with the remedy."""
    position, rotation = robot_std
    return (
        f"the residuals are {residual_rms:.2g} mm rms, as with a robot of {position:.2g} mm and "
        f"{math.degrees(rotation):.2g} deg per axis: if the robot is more accurate, check the size "
        "of the target, the convention of the poses, and that the robot stood still"
    )


def describe_height_scale(scale: Scale, *, radius_is_given: bool) -> str:
    """Return the warning about wrong heights of a sensor, with the remedy."""
    factor, std = scale
    given = "the given radius (calibrate without it, it is estimated then), "
    radius = given if radius_is_given else ""
    return (
        f"the sensor's heights must be multiplied by {factor:.3f} +/- {std:.3f}: check {radius}"
        "their unit and the sensor's own calibration; away from the working point, positions and "
        "radii have the same relative error"
    )


@dataclass(frozen=True, eq=False)
class BoardScale:
    """Factor by which the size of a board must be multiplied.

    Parameters
    ----------
    factor, std : float
        Estimate and its standard deviation.
    step : (6,) ndarray
        Change of the sensor's translation (mm) and left perturbation (rad) by which the solution
        would differ if the factor were applied.
    """

    factor: float
    std: float
    step: FloatArray

    @property
    def significant(self) -> bool:
        """Whether the factor differs significantly from 1: the stated size is wrong."""
        return is_wrong_scale((self.factor, self.std), MIN_BOARD_SCALE_ERROR)

    def require_plausible(self) -> None:
        """Raise CalibrationFailed if the stated size is wrong by more than `MAX_SCALE_ERROR`."""
        if self.significant and abs(self.factor - 1) > MAX_SCALE_ERROR:
            raise CalibrationFailed(describe_board_scale((self.factor, self.std)))


def estimate_board_scale(
    fit: ErrorsInVariablesFit,
    origins: Points,
    camera_modes: FloatArray,
    *,
    robot_is_stated: bool,
) -> BoardScale | None:
    """Return the scale of a board, estimated from the residuals of a fit with the stated size.

    `origins` (n, 3) are those of the board in the camera frame, in each of the n poses, as the fit
    predicts it: the noise of the observed ones would look like an error of the scale. So do the
    errors of the camera: `camera_modes` (m, n, 6) are the shifts of the board's poses, origin (mm)
    and left perturbation (rad), by m independent errors, one standard deviation each. A standard
    deviation of the robot that is not stated but estimated contains the effect of a wrong size;
    then the noise is estimated from the residuals without that effect.

    The factor is not checked (see `BoardScale.require_plausible`). None if the robot's motion does
    not determine it, within `MAX_SCALE_STD`.
    """
    # An error e of the size shifts the board's poses by e times this.
    scale_shift = np.concatenate([origins, np.zeros_like(origins)], axis=1)
    shifts = np.concatenate([scale_shift[None], camera_modes])
    steps = fit.propagate_shifts(shifts)
    # Change of the whitened residuals by each shift, of which the solution absorbs a part.
    whitened_shifts = fit.mask[:, None] * np.einsum("nij,knj->kni", fit.whitening, shifts)
    whitened_changes = whitened_shifts + fit.mask[:, None] * np.einsum(
        "nij,kj->kni", fit.jacobian, steps
    )
    information = float((whitened_changes[0] ** 2).sum())
    if not information > MIN_INFORMATION_RATIO * float((whitened_shifts[0] ** 2).sum()):
        return None
    errors = np.einsum(
        "ni,kni->k",
        whitened_changes[0],
        np.concatenate([fit.residuals[None], whitened_changes[1:]]),
    )
    error, camera_errors = errors[0] / information, errors[1:] / information
    chi2 = (fit.chi2 - error**2 * information) / max(fit.dof - 1, 1)
    variance = (max(chi2, 1.0) if robot_is_stated else chi2) / information
    std = float(np.sqrt(variance + (camera_errors**2).sum()))
    if std > MAX_SCALE_STD:
        return None
    factor = 1 / (1 + float(error))
    return BoardScale(factor, std * factor**2, -steps[0, :6] * float(error))
