"""Check of the stated size of a board by the motion of the robot.

A wrong size multiplies all distances from the camera to the board by one factor, but not the
robot's motion, which is in mm. The hand-eye solution absorbs most of this by a shift of the camera
along its optical axis (4 mm for a board 400 mm away whose stated size is 1 % wrong): the residuals
increase by much less.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.calibration.errors_in_variables import ErrorsInVariablesFit
from lsvision.calibration.hand_eye_warnings import (
    MIN_BOARD_SCALE_ERROR,
    describe_board_scale,
    is_wrong_scale,
)
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray, Points

MAX_SCALE_ERROR = 0.02
"""Deviation of the factor from 1 above which the calibration is rejected; the scale of printers
deviates by less."""
MAX_SCALE_STD = 0.1
"""Standard deviation of the size's relative error above which it is not determined, as by a flange
that only rotates about its origin."""
MIN_INFORMATION_RATIO = 1e-12
"""Fraction of the information on the size that a solution leaves, below which it is rounding."""


@dataclass(frozen=True, eq=False)
class BoardScale:
    """Factor by which the size of a board must be multiplied.

    Parameters
    ----------
    factor, std : float
        Estimate and its standard deviation.
    step : (6,) ndarray
        Change of the sensor's translation (mm) and left-hand rotation (rad) by which the solution
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
        """Raise an error if the stated size is wrong by more than `MAX_SCALE_ERROR`.

        Raises
        ------
        CalibrationFailed
            With the factor and the remedy.
        """
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

    Parameters
    ----------
    fit : ErrorsInVariablesFit
        Solution with the stated size.
    origins : (n, 3) ndarray
        Origin of the board in the camera frame, in each of the n poses, as the solution predicts
        it: the noise of the observed ones would look like an error of the scale. Units: mm.
    camera_modes : (m, n, 6) ndarray
        Shifts of the board's n poses, origin (mm) and left-hand rotation (rad), by m independent
        errors of the camera, one standard deviation each. They look like an error of the scale.
    robot_is_stated : bool
        Whether the standard deviation of the robot was stated. An estimated one contains the
        effect of a wrong size; then the noise is estimated from the residuals without that effect.

    Returns
    -------
    BoardScale or None
        Factor with its standard deviation, not checked (see `BoardScale.require_plausible`); None
        if the robot's motion does not determine it, within `MAX_SCALE_STD`.
    """
    # An error e of the size shifts the board's poses by e times this.
    scale_shift = np.concatenate([origins, np.zeros_like(origins)], axis=1)
    shifts = np.concatenate([scale_shift[None], camera_modes])
    steps = fit.steps_by_shifts(shifts)
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
